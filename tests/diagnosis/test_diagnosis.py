"""The whole workflow, on data from a generator that shares no code with it, as a user would run it."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.hidden_effects.generate import make_dataset
from benchmarks.hidden_effects.score import score_verdict

from klute_sim.cli.diagnose import write_results as write_results
from klute_sim.datasets import dataset as datasets
from klute_sim.device.device import load_device
from klute_sim.diagnosis.device_file import augment_device
from klute_sim.diagnosis.experiments.base import Simulator
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.verdict import verdict_to_dict
from klute_sim.diagnosis.workflow import Diagnosis, DiagnosisOptions, diagnose
from klute_sim.report.diagnosis import text as words
from tests.command_line import run
from tests.diagnosis.synthetic_dataset import dataset as made

QUIET: dict[str, Any] = {"muscle_length": False}


def hidden(folder: Path, seed: int, **what: Any) -> tuple[datasets.Dataset, dict[str, Any]]:
    """A dataset of the generator and its truth."""
    truth = make_dataset(folder, seed, **{**QUIET, **what})
    return datasets.load_dataset(folder), truth


def effect(name: str, form: str, **parameters: float) -> dict[str, Any]:
    return {"name": name, "form": form, "parameters": parameters}


@pytest.fixture(scope="module")
def friction(tmp_path_factory: pytest.TempPathFactory) -> tuple[Diagnosis, dict[str, Any]]:
    """The diagnosis of hidden dry friction."""
    data, truth = hidden(
        tmp_path_factory.mktemp("hidden") / "friction",
        11,
        effects=[effect("braid_hysteresis", "coulomb", slope_n_per_bar=6.0)],
    )
    return diagnose(data), truth


def test_hidden_friction_is_named_with_its_size(friction: tuple[Diagnosis, dict[str, Any]]) -> None:
    found, truth = friction
    verdict = verdict_to_dict(found)
    assert score_verdict(truth, verdict) == "right"
    assert verdict["verdict"] == "named"
    (only,) = verdict["effects"]
    assert only["form"] == "coulomb"
    slope = only["parameters"]["slope_n_per_bar"]
    assert slope["low"] < 6.0 < slope["high"]
    assert slope["value"] == pytest.approx(6.0, rel=0.05)
    gap = verdict["gap"]["force"]
    assert gap["before"] > 3.0 * gap["floor"]
    assert gap["after"] < 1.10 * gap["floor"]
    assert words.describe_verdict(found) == "The simulated device lacks braid hysteresis (Coulomb)."
    assert words.describe_equation_residuals(found).startswith("If the instruments are right, ")
    told = " N rms of force are missing in muscle, damper or tendon; nothing is missing in the supply."
    assert words.describe_equation_residuals(found).endswith(told)
    assert verdict["split"]["show"] == ["show_1_a", "show_1_b"]
    assert 0.5 < sum(place["share"] for place in verdict["where"]) <= 1.01
    assert verdict["where"][0]["channel"] == "force"
    assert "bar" in verdict["where"][0]["region"]  # it grows with pressure


def test_the_device_file_is_the_fit_and_with_it_nothing_is_missing(
    friction: tuple[Diagnosis, dict[str, Any]], tmp_path: Path
) -> None:
    found, _ = friction
    assert found.final_fit is not None
    file = tmp_path / "device.toml"
    file.write_bytes(augment_device(found.final_fit, "test").content)
    device = load_device(str(file))
    assert device.spec.effects["braid_hysteresis"]["form"] == "coulomb"
    assert device.spec.sources["effects.braid_hysteresis.slope_n_per_bar"] == "fitted by klute-sim diagnose to test"
    data = datasets.load_dataset(found.dataset.folder, device)
    bench, own, theirs = Simulator(2), found.experiments, prepare_experiments(data, datasets.split_dataset(data))
    (fitted,) = bench.simulate([found.final_fit.hypothesis.build_setups(found.final_fit.x, own)], own)
    (written,) = bench.simulate([Hypothesis(device, (), ()).build_setups(np.zeros(0), theirs)], theirs)
    bench.close()
    for a, b in zip(fitted, written, strict=True):
        for channel in a:
            assert np.abs(a[channel] - b[channel]).max() < 1e-9 * np.abs(a[channel]).max()
    again = diagnose(data)
    assert again.verdict == "nothing-missing", again.reasons
    assert verdict_to_dict(again)["effects"] == []


@pytest.fixture(scope="module")
def struck(friction: tuple[Diagnosis, dict[str, Any]]) -> Diagnosis:
    """The same data, asked by someone who knows of no friction."""
    # A few of the others are enough here; all of them are the benchmark's business.
    return diagnose(friction[0].dataset, DiagnosisOptions(only=("muscle_damping", "end_taper", "sensor_gain")))


@pytest.mark.long
def test_without_the_true_effect_in_the_catalogue_it_says_so(struck: Diagnosis) -> None:
    assert struck.verdict == "unexplained"
    assert all(each.get("proxy", each.get("data_driven")) for each in verdict_to_dict(struck)["effects"])
    assert any("standard errors" in reason for reason in struck.reasons)
    assert any("data-driven term" in reason for reason in struck.reasons)


@pytest.mark.long
def test_a_data_driven_term_stands_in_for_it(struck: Diagnosis) -> None:
    """Found in data of laws that are not ours: friction of two muscles, 6 N/bar each, at 5 bar."""
    pytest.importorskip("pysindy")
    (only,) = verdict_to_dict(struck)["effects"]
    assert only["data_driven"]
    assert only["parameters"].keys() == {"pressure_friction_n"}
    assert only["parameters"]["pressure_friction_n"]["value"] == pytest.approx(60.0, rel=0.03)
    gap = struck.channel_rms["force"]
    assert gap.noise_floor is not None
    assert gap.with_effects**2 - gap.noise_floor**2 < 0.02 * (gap.refitted**2 - gap.noise_floor**2)


def test_clean_data_miss_nothing(tmp_path: Path) -> None:
    data, _ = hidden(tmp_path / "clean", 21, block="clean")
    found = diagnose(data)
    assert found.verdict == "nothing-missing", found.reasons
    assert found.channel_rms["force"].with_effects < 1.1 * found.channel_rms["force"].noise_floor
    assert verdict_to_dict(found)["device_file"] is None


@pytest.mark.long
def test_a_wrong_load_cell_is_no_physics(tmp_path: Path) -> None:
    data, truth = hidden(
        tmp_path / "instrument", 31, instruments=[{**effect("sensor_gain", "gain", gain=1.06), "channel": "pressure"}]
    )
    found = diagnose(data)
    assert score_verdict(truth, verdict_to_dict(found)) == "right"
    entries = {(each["kind"], each["channel"]) for each in verdict_to_dict(found)["effects"]}
    assert ("instrument", "pressure") in entries or found.verdict == "ambiguous"


@pytest.mark.parametrize(
    ("defect", "words"),
    [
        pytest.param("no_excitation", "what depends on speed hardly shows", marks=pytest.mark.long),
        ("dead_channel", "the channel is dead; it is not used"),
    ],
)
def test_data_that_cannot_answer_are_told_why(defect: str, words: str, tmp_path: Path) -> None:
    data, _ = hidden(tmp_path / defect, 41, defect=defect, block="defective")
    found = diagnose(data, DiagnosisOptions(only=("muscle_damping",)))
    assert any(words in reason for reason in found.reasons), found.reasons


@pytest.mark.long
def test_without_repeats_only_what_stands_out_is_named(tmp_path: Path) -> None:
    """Noise is only supposed then: nothing can be declared complete, and no floor is known."""
    options = DiagnosisOptions(only=("braid_hysteresis", "muscle_damping", "sensor_gain"))
    plain = diagnose(datasets.load_dataset(made(tmp_path / "plain", repeats=1)), options)
    assert plain.verdict == "insufficient-data"
    assert verdict_to_dict(plain)["effects"] == []
    effects = {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}}
    found = diagnose(datasets.load_dataset(made(tmp_path / "friction", effects, repeats=1)), options)
    assert found.verdict == "insufficient-data"
    assert "braid hysteresis (Coulomb) would explain what stands out" in words.describe_verdict(found)
    (only,) = verdict_to_dict(found)["effects"]
    assert only["name"] == "braid_hysteresis"
    assert only["proxy"]
    slope = only["parameters"]["slope_n_per_bar"]
    assert slope["value"] == pytest.approx(6.0, rel=0.1)
    assert slope["low"] < 6.0 < slope["high"]
    assert verdict_to_dict(found)["gap"]["force"]["floor"] is None
    for one in (plain, found):
        assert any("Record every input at least twice" in reason for reason in one.reasons)
    write_results(found, tmp_path, report=True)
    assert "noise of repeats" not in (tmp_path / "report.html").read_text("utf-8").split("<h2")[1]


def test_a_wrong_repeat_is_told_and_left_out(tmp_path: Path) -> None:
    """A cable that came off in one trial: noise would else be judged by it, and everything would pass for noise."""
    effects = {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}}
    folder = made(tmp_path / "cable", effects, groups=("fit_1", "fit_2", "fit_3", "select_1", "show_1"), seconds=2.0)
    file = folder / "fit_2_1.csv"
    head, *rows = file.read_text("utf-8").splitlines()
    column = [name.split(" ")[0] for name in head.split(",")].index("force")
    still = [",".join([*cells[:column], "346.0", *cells[column + 1 :]]) for cells in (row.split(",") for row in rows)]
    file.write_text("\n".join([head, *still]) + "\n", "utf-8")
    found = diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("braid_hysteresis", "muscle_damping")))
    assert found.verdict == "named", found.reasons
    assert any("it always shows 346 N in fit_2_1" in reason for reason in found.reasons), found.reasons
    assert found.noise["force"].std < 5.0


def test_when_nothing_is_left_it_says_so(tmp_path: Path) -> None:
    """The only fitted group has repeats that contradict each other in every channel."""
    folder = made(tmp_path / "none", groups=("fit_1", "select_1", "select_2", "show_1"), seconds=2.5)
    file = folder / "fit_1_1.csv"
    head, *rows = file.read_text("utf-8").splitlines()
    columns = [name.split(" ")[0] for name in head.split(",")]
    spoiled = []
    for k, row in enumerate(rows):
        cells = row.split(",")
        for channel, size in (("force", 500.0), ("pressure", 3.0)):
            cells[columns.index(channel)] = str(size * (1.0 + 0.5 * np.sin(0.3 * k)))
        spoiled.append(",".join(cells))
    file.write_text("\n".join([head, *spoiled]) + "\n", "utf-8")
    found = diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("muscle_damping",)))
    assert found.verdict == "insufficient-data"
    assert any(reason.startswith("No usable channel is left") for reason in found.reasons), found.reasons
    assert any("another trial's file?" in reason for reason in found.reasons), found.reasons


def test_a_channel_that_was_never_repeated_is_told(tmp_path: Path) -> None:
    folder = made(tmp_path / "once", {("seal_friction", "coulomb"): {"force_n": 60.0}}, seconds=2.0)
    for file in folder.glob("*_1.csv"):
        head, *rows = file.read_text("utf-8").splitlines()
        column = [name.split(" ")[0] for name in head.split(",")].index("force")
        less = [",".join(c for k, c in enumerate(row.split(",")) if k != column) for row in (head, *rows)]
        file.write_text("\n".join(less) + "\n", "utf-8")
    found = diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("seal_friction",)))
    assert found.verdict == "insufficient-data"
    assert any("'force' was never recorded twice" in reason for reason in found.reasons), found.reasons


def test_an_effect_that_the_device_has_can_be_uncertain(tmp_path: Path) -> None:
    """The file that a diagnosis wrote comes back, its effect now one of the uncertain numbers."""
    folder = made(tmp_path / "seal", {("seal_friction", "coulomb"): {"force_n": 30.0}}, seconds=2.0)
    text = load_device("klute-3-4-pair").content.decode() + "\n[effects.seal_friction]\nforce_n = 20.0\n"
    (folder / "with_seal.toml").write_text(text, "utf-8")
    toml = (folder / "dataset.toml").read_text("utf-8").replace('"klute-3-4-pair"', '"with_seal.toml"')
    toml = toml.replace("[uncertain]\n", '[uncertain]\n"effects.seal_friction.force_n" = "50 %"\n')
    (folder / "dataset.toml").write_text(toml, "utf-8")
    found = diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("muscle_damping",)))
    assert found.verdict == "nothing-missing", found.reasons
    assert found.final_fit is not None
    values = dict(zip([u.key for u in found.final_fit.hypothesis.parameters], found.final_fit.values, strict=True))
    assert values["effects.seal_friction.force_n"] == pytest.approx(30.0, rel=0.05)


@pytest.mark.long
def test_the_dissertations_own_ladder(tmp_path: Path) -> None:
    """A geometric model, and data of the device with its bladder and its friction: both are found."""
    text = load_device("klute-3-4-pair").content.decode()
    geometric = text.replace("[muscle]\n", "[muscle]\nbladder = false\nfriction = false\n", 1)
    assert "bladder = false" in geometric
    folder = made(tmp_path / "ladder")
    (folder / "geometric.toml").write_text(geometric, "utf-8")
    toml = (folder / "dataset.toml").read_text("utf-8").replace('"klute-3-4-pair"', '"geometric.toml"')
    (folder / "dataset.toml").write_text(toml.replace('"muscle.friction_slope_n_per_bar" = "10 %"\n', ""), "utf-8")
    found = diagnose(datasets.load_dataset(folder))
    entries = {each["name"]: each["parameters"] for each in verdict_to_dict(found)["effects"]}
    assert found.verdict == "named", found.reasons
    assert set(entries) == {"bladder", "friction_offset"}  # the larger one first, whichever it is in these data
    assert entries["bladder"]["c10_kpa"]["value"] == pytest.approx(118.4, rel=0.03)
    assert entries["friction_offset"]["slope_n_per_bar"]["value"] == pytest.approx(28.0, rel=0.05)
    assert entries["friction_offset"]["offset_n"]["value"] == pytest.approx(-38.2, rel=0.1)


def test_the_command_writes_and_prints_the_verdict(tmp_path: Path) -> None:
    folder = made(tmp_path / "data", {("muscle_damping", "viscous"): {"coefficient_n_s_per_m": 400.0}})
    only = ("--only", "muscle_damping", "--only", "seal_friction")
    done = run("diagnose", str(folder), "--out", str(tmp_path / "found"), "--json", *only)
    assert done.returncode == 0, done.stderr
    verdict = json.loads(done.stdout)
    assert verdict == json.loads((tmp_path / "found" / "verdict.json").read_text("utf-8"))
    assert set(verdict) == {
        *("schema", "verdict", "reasons", "effects", "alternatives", "alike", "split", "where", "gap"),
        *("next_experiment", "device_file"),
    }
    assert verdict["schema"] == "klute-sim-verdict/1"
    assert verdict["effects"][0]["parameters"]["coefficient_n_s_per_m"]["value"] == pytest.approx(400.0, rel=0.05)
    device = load_device(str(tmp_path / "found" / "device.toml"))
    assert device.spec.effects["muscle_damping"]["form"] == "viscous"
    told = run("diagnose", str(folder), "--out", str(tmp_path / "again"), "--no-report", *only)
    assert "The simulated device lacks muscle damping (viscous)." in told.stdout
    assert "Gap on trials that no fit saw" in told.stdout
    assert sorted(f.name for f in (tmp_path / "again").iterdir()) == ["device.toml", "verdict.json"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nowhere",), "there is no folder nowhere"),
        (("{data}", "--only", "gremlins"), "there is no effect 'gremlins'; there are: "),
        (("{data}", "--device", "gremlin"), "no device 'gremlin'"),
        (("{data}", "--catalogue", "gremlins.py"), "does not exist"),
        (("{data}", "--out", "{data}"), "is not empty"),
        (("",), "the path is empty"),
    ],
)
def test_bad_input_is_one_sentence(arguments: tuple[str, ...], words: str, tmp_path: Path) -> None:
    folder = made(tmp_path / "data", seconds=0.5)
    done = run("diagnose", *(a.format(data=folder) for a in arguments))
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""


@pytest.mark.long
def test_a_users_effect_is_found(tmp_path: Path) -> None:
    users = Path(__file__).parents[1] / "effects" / "users.py"
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); from pathlib import Path; from made import dataset\n"
        "dataset(Path(sys.argv[2]), {('warming', 'first_order'): {'gain': 0.04, 'time_constant_s': 0.8}})"
    )
    data, here = tmp_path / "data", str(Path(__file__).parent)
    environment = {**os.environ, "KLUTE_SIM_CATALOGUE": str(users)}
    subprocess.run([sys.executable, "-c", script, here, str(data)], check=True, env=environment)
    only = ("--only", "warming", "--only", "sensor_gain", "--only", "muscle_damping")
    done = run("diagnose", str(data), "--catalogue", str(users), "--out", str(tmp_path / "found"), "--json", *only)
    assert done.returncode == 0, done.stderr
    assert "was run for its effects" in done.stderr
    (only_effect,) = json.loads(done.stdout)["effects"]
    assert only_effect["name"] == "warming"
    assert only_effect["parameters"]["gain"]["value"] == pytest.approx(0.04, rel=0.1)
