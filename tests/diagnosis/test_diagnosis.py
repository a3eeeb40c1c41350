"""The whole workflow on data from an independent generator, as a user runs it."""

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

from klute_sim.api.diagnosis import DiagnosisResult
from klute_sim.datasets import dataset as datasets
from klute_sim.device.device import load_device
from klute_sim.diagnosis.device_file import augment_device
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.result import Diagnosis, DiagnosisOptions
from klute_sim.diagnosis.verdict import verdict_to_dict
from klute_sim.diagnosis.workflow import diagnose
from klute_sim.report.diagnosis import text as words
from tests.command_line import run
from tests.diagnosis.synthetic_dataset import write_dataset

pytestmark = pytest.mark.slow

WITHOUT_LENGTH: dict[str, Any] = {"muscle_length": False}


def load_hidden(folder: Path, seed: int, **options: Any) -> tuple[datasets.Dataset, dict[str, Any]]:
    """Return a dataset of the generator, and its true effects."""
    truth = make_dataset(folder, seed, **{**WITHOUT_LENGTH, **options})
    return datasets.load_dataset(folder), truth


def describe_effect(name: str, form: str, **parameters: float) -> dict[str, Any]:
    return {"name": name, "form": form, "parameters": parameters}


@pytest.fixture(scope="module")
def friction(tmp_path_factory: pytest.TempPathFactory) -> tuple[Diagnosis, dict[str, Any]]:
    """Return the diagnosis of hidden dry friction, and the truth."""
    data, truth = load_hidden(
        tmp_path_factory.mktemp("hidden") / "friction",
        11,
        effects=[describe_effect("braid_hysteresis", "coulomb", slope_n_per_bar=6.0)],
    )
    return diagnose(data), truth


def test_hidden_friction_is_identified_with_its_size(friction: tuple[Diagnosis, dict[str, Any]]) -> None:
    diagnosis, truth = friction
    verdict = verdict_to_dict(diagnosis)
    assert score_verdict(truth, verdict) == "right"
    assert verdict["verdict"] == "identified"
    (entry,) = verdict["effects"]
    assert entry["form"] == "coulomb"
    slope = entry["parameters"]["slope_n_per_bar"]
    assert slope["low"] < 6.0 < slope["high"]
    assert slope["value"] == pytest.approx(6.0, rel=0.05)
    gap = verdict["gap"]["force"]
    assert gap["nominal"] >= gap["refitted"] > 3.0 * gap["noise_floor"]
    assert gap["with_effects"] < 1.10 * gap["noise_floor"]
    rejected = {entry["name"]: entry["reason"] for entry in verdict["rejected"]}
    assert "braid_hysteresis" not in rejected
    assert rejected.keys() >= {"seal_friction", "muscle_damping"}
    assert all(rejected.values())
    assert words.describe_verdict(diagnosis) == "The simulated device lacks braid hysteresis (Coulomb)."
    sentence = words.describe_equation_residuals(diagnosis)
    assert "the equation of muscle, damper or tendon leaves a force of " in sentence
    assert sentence.endswith(" N rms; that of the supply holds within the noise.")
    assert verdict["split"]["test"] == ["test_1_a", "test_1_b"]
    assert 0.5 < sum(region["share"] for region in verdict["where"]) <= 1.01
    assert verdict["where"][0]["channel"] == "force"
    assert "bar" in verdict["where"][0]["region"]  # the friction increases with pressure


def test_device_file_equals_the_fit_and_nothing_is_missing_with_it(
    friction: tuple[Diagnosis, dict[str, Any]], tmp_path: Path
) -> None:
    diagnosis, _ = friction
    assert diagnosis.final_fit is not None
    file = tmp_path / "device.toml"
    file.write_bytes(augment_device(diagnosis.final_fit, "test").content)
    device = load_device(str(file))
    assert device.spec.effects["braid_hysteresis"]["form"] == "coulomb"
    assert device.spec.sources["effects.braid_hysteresis.slope_n_per_bar"] == "fitted by klute-sim diagnose to test"
    data = datasets.load_dataset(diagnosis.dataset.folder, device)
    simulator, fit_experiments = Simulator(2), diagnosis.experiments
    file_experiments = prepare_experiments(data, datasets.split_dataset(data))
    setups = diagnosis.final_fit.hypothesis.build_setups(diagnosis.final_fit.x, fit_experiments)
    (fitted,) = simulator.simulate([setups], fit_experiments)
    setups = Hypothesis(device, (), ()).build_setups(np.zeros(0), file_experiments)
    (written,) = simulator.simulate([setups], file_experiments)
    simulator.close()
    for a, b in zip(fitted, written, strict=True):
        for channel in a:
            assert np.abs(a[channel] - b[channel]).max() < 1e-9 * np.abs(a[channel]).max()
    again = diagnose(data)
    assert again.verdict == "nothing-missing", again.reasons
    assert verdict_to_dict(again)["effects"] == []


@pytest.fixture(scope="module")
def without_friction(friction: tuple[Diagnosis, dict[str, Any]]) -> Diagnosis:
    """Return the diagnosis of the same data without friction in the catalogue."""
    # A few other effects suffice here; the benchmark tests all of them.
    return diagnose(friction[0].dataset, DiagnosisOptions(only=("muscle_damping", "end_taper", "sensor_gain")))


@pytest.mark.long
def test_unknown_effect_is_unexplained(without_friction: Diagnosis) -> None:
    assert without_friction.verdict == "unexplained"
    assert all(e.get("proxy", e.get("data_driven")) for e in verdict_to_dict(without_friction)["effects"])
    assert any("standard errors" in reason for reason in without_friction.reasons)
    assert any("data-driven term" in reason for reason in without_friction.reasons)


@pytest.mark.long
def test_data_driven_term_replaces_an_unknown_effect(without_friction: Diagnosis) -> None:
    """The independent generator has friction of two muscles, 6 N/bar each, at 5 bar."""
    (entry,) = verdict_to_dict(without_friction)["effects"]
    assert entry["data_driven"]
    assert entry["parameters"].keys() == {"pressure_friction_n"}
    assert entry["parameters"]["pressure_friction_n"]["value"] == pytest.approx(60.0, rel=0.03)
    gap = without_friction.channel_rms["force"]
    assert gap.noise_floor is not None
    assert gap.with_effects**2 - gap.noise_floor**2 < 0.02 * (gap.refitted**2 - gap.noise_floor**2)


def test_clean_data_miss_nothing(tmp_path: Path) -> None:
    data, _ = load_hidden(tmp_path / "clean", 21, block="clean")
    diagnosis = diagnose(data)
    assert diagnosis.verdict == "nothing-missing", diagnosis.reasons
    assert diagnosis.channel_rms["force"].with_effects < 1.1 * diagnosis.channel_rms["force"].noise_floor
    assert verdict_to_dict(diagnosis)["device_file"] == "device.toml"


@pytest.mark.long
def test_load_cell_error_is_not_a_device_effect(tmp_path: Path) -> None:
    data, truth = load_hidden(
        tmp_path / "instrument",
        31,
        instruments=[{**describe_effect("sensor_gain", "gain", gain=1.06), "channel": "pressure"}],
    )
    diagnosis = diagnose(data)
    assert score_verdict(truth, verdict_to_dict(diagnosis)) == "right"
    entries = {(entry["kind"], entry["channel"]) for entry in verdict_to_dict(diagnosis)["effects"]}
    assert ("instrument", "pressure") in entries or diagnosis.verdict == "indistinguishable"


@pytest.mark.parametrize(
    ("defect", "words"),
    [
        pytest.param("no_excitation", "effects that depend on speed are hardly visible", marks=pytest.mark.long),
        ("dead_channel", "the channel is dead"),
    ],
)
def test_insufficient_data_are_explained(defect: str, words: str, tmp_path: Path) -> None:
    data, _ = load_hidden(tmp_path / defect, 41, defect=defect, block="defective")
    diagnosis = diagnose(data, DiagnosisOptions(only=("muscle_damping",)))
    assert any(words in reason for reason in diagnosis.reasons), diagnosis.reasons


@pytest.mark.long
def test_without_repeats_only_large_effects_are_added(tmp_path: Path) -> None:
    """Without repeats the noise is an assumption, so no model is complete and the noise floor is unknown."""
    options = DiagnosisOptions(only=("braid_hysteresis", "muscle_damping", "sensor_gain"))
    plain = diagnose(datasets.load_dataset(write_dataset(tmp_path / "plain", repeats=1)), options)
    assert plain.verdict == "insufficient-data"
    assert verdict_to_dict(plain)["effects"] == []
    effects = {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}}
    diagnosis = diagnose(datasets.load_dataset(write_dataset(tmp_path / "friction", effects, repeats=1)), options)
    # Predictions of left-out conditions need no noise.
    assert diagnosis.verdict == "identified-in-part"
    assert "braid hysteresis (Coulomb)" in words.describe_verdict(diagnosis)
    (entry,) = verdict_to_dict(diagnosis)["effects"]
    assert entry["name"] == "braid_hysteresis"
    slope = entry["parameters"]["slope_n_per_bar"]
    assert slope["value"] == pytest.approx(6.0, rel=0.1)
    assert slope["low"] < 6.0 < slope["high"]
    assert verdict_to_dict(diagnosis)["gap"]["force"]["noise_floor"] is None
    for result in (plain, diagnosis):
        assert any("Record every input at least twice" in reason for reason in result.reasons)
    DiagnosisResult(diagnosis).write_files(tmp_path, report=True)
    assert "repeat noise" not in (tmp_path / "index.html").read_text("utf-8").split("<h2")[1]


@pytest.mark.parametrize(("factor", "is_found"), [(1.3, True), (1.0, False)])
def test_noise_of_another_channel_hides_no_number_without_repeats(
    factor: float, is_found: bool, tmp_path: Path
) -> None:
    """Half of the error of prediction is that of a pressure with nothing but noise."""
    declared = load_device("klute-3-4-pair").parameters
    device = declared._replace(muscle=declared.muscle._replace(c10=factor * declared.muscle.c10))
    groups = ("fit_1", "fit_2", "fit_3", "fit_4", "validation_1", "test_1")
    folder = write_dataset(tmp_path / "data", base=device, groups=groups, repeats=1, seconds=2.0)
    verdict = verdict_to_dict(diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("muscle.c10_kpa",))))
    assert verdict["verdict"] == ("identified-in-part" if is_found else "insufficient-data")
    assert [entry["number"] for entry in verdict["effects"]] == (["muscle.c10_kpa"] if is_found else [])


def test_inconsistent_repeat_is_excluded(tmp_path: Path) -> None:
    """A loose cable in one trial would inflate the noise estimate, and all effects would count as noise."""
    effects = {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}}
    folder = write_dataset(
        tmp_path / "cable", effects, groups=("fit_1", "fit_2", "fit_3", "validation_1", "test_1"), seconds=2.0
    )
    file = folder / "fit_2_1.csv"
    head, *rows = file.read_text("utf-8").splitlines()
    column = [name.split(" ")[0] for name in head.split(",")].index("force")
    still = [",".join([*cells[:column], "346.0", *cells[column + 1 :]]) for cells in (row.split(",") for row in rows)]
    file.write_text("\n".join([head, *still]) + "\n", "utf-8")
    diagnosis = diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("braid_hysteresis", "muscle_damping")))
    assert diagnosis.verdict == "identified", diagnosis.reasons
    assert any("it is constant at 346 N in fit_2_1" in reason for reason in diagnosis.reasons), diagnosis.reasons
    assert diagnosis.noise["force"].std < 5.0


def test_unusable_data_are_reported(tmp_path: Path) -> None:
    """The repeats of the only fitted group contradict each other in every channel."""
    folder = write_dataset(tmp_path / "none", groups=("fit_1", "validation_1", "validation_2", "test_1"), seconds=2.5)
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
    diagnosis = diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("muscle_damping",)))
    assert diagnosis.verdict == "insufficient-data"
    assert any(reason.startswith("No channel is usable") for reason in diagnosis.reasons), diagnosis.reasons
    assert any("a file of another trial?" in reason for reason in diagnosis.reasons), diagnosis.reasons


def test_channel_without_repeats_is_reported(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "once", {("seal_friction", "coulomb"): {"force_n": 60.0}}, seconds=2.0)
    for file in folder.glob("*_1.csv"):
        head, *rows = file.read_text("utf-8").splitlines()
        column = [name.split(" ")[0] for name in head.split(",")].index("force")
        less = [",".join(c for k, c in enumerate(row.split(",")) if k != column) for row in (head, *rows)]
        file.write_text("\n".join(less) + "\n", "utf-8")
    diagnosis = diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("seal_friction",)))
    assert diagnosis.verdict == "insufficient-data"
    assert any("'force' was never recorded twice" in reason for reason in diagnosis.reasons), diagnosis.reasons


def test_existing_effect_can_be_uncertain(tmp_path: Path) -> None:
    """The effect in a device file that a diagnosis wrote may be one of the uncertain numbers."""
    folder = write_dataset(tmp_path / "seal", {("seal_friction", "coulomb"): {"force_n": 30.0}}, seconds=2.0)
    text = load_device("klute-3-4-pair").content.decode() + "\n[effects.seal_friction]\nforce_n = 20.0\n"
    (folder / "with_seal.toml").write_text(text, "utf-8")
    toml = (folder / "dataset.toml").read_text("utf-8").replace('"klute-3-4-pair"', '"with_seal.toml"')
    toml = toml.replace("[uncertain]\n", '[uncertain]\n"effects.seal_friction.force_n" = "50 %"\n')
    (folder / "dataset.toml").write_text(toml, "utf-8")
    diagnosis = diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("muscle_damping",)))
    assert diagnosis.verdict == "nothing-missing", diagnosis.reasons
    assert diagnosis.final_fit is not None
    values = dict(
        zip([u.name for u in diagnosis.final_fit.hypothesis.parameters], diagnosis.final_fit.values, strict=True)
    )
    assert values["effects.seal_friction.force_n"] == pytest.approx(30.0, rel=0.05)


@pytest.mark.long
def test_dissertation_terms_are_identified(tmp_path: Path) -> None:
    """With a geometric model, the diagnosis identifies bladder and friction."""
    text = load_device("klute-3-4-pair").content.decode()
    geometric = text.replace("[muscle]\n", "[muscle]\nbladder = false\nfriction = false\n", 1)
    assert "bladder = false" in geometric
    folder = write_dataset(tmp_path / "ladder")
    (folder / "geometric.toml").write_text(geometric, "utf-8")
    toml = (folder / "dataset.toml").read_text("utf-8").replace('"klute-3-4-pair"', '"geometric.toml"')
    (folder / "dataset.toml").write_text(toml.replace('"muscle.friction_slope_n_per_bar" = "10 %"\n', ""), "utf-8")
    diagnosis = diagnose(datasets.load_dataset(folder))
    entries = {entry["name"]: entry["parameters"] for entry in verdict_to_dict(diagnosis)["effects"]}
    # A passive tension falls with the contraction almost as the tension of the bladder does.
    assert diagnosis.verdict in ("identified", "indistinguishable"), diagnosis.reasons
    assert set(entries) == {"bladder", "friction_offset"}  # in any order
    assert entries["bladder"]["c10_kpa"]["value"] == pytest.approx(118.4, rel=0.03)
    assert entries["friction_offset"]["slope_n_per_bar"]["value"] == pytest.approx(28.0, rel=0.05)
    assert entries["friction_offset"]["offset_n"]["value"] == pytest.approx(-38.2, rel=0.1)


def test_command_writes_and_prints_the_verdict(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "data", {("muscle_damping", "viscous"): {"coefficient_n_s_per_m": 400.0}})
    only = ("--only", "muscle_damping", "--only", "seal_friction")
    process = run("diagnose", str(folder), "--out", str(tmp_path / "results"), "--json", *only)
    assert process.returncode == 0, process.stderr
    verdict = json.loads(process.stdout)
    assert verdict == json.loads((tmp_path / "results" / "verdict.json").read_text("utf-8"))
    assert set(verdict) == {
        *("schema", "verdict", "reasons", "effects", "numbers", "alternatives", "indistinguishable", "split"),
        *("where", "gap", "held_out", "cross_validation", "recommended", "direct_measurements"),
        *("p_value", "probability_nothing_missing", "misfit_map", "predictions"),
        *("rejected", "next_experiment", "device_file", "accepted", "initial_friction"),
    }
    assert verdict["schema"] == "klute-sim-verdict/3"
    assert verdict["effects"][0]["parameters"]["coefficient_n_s_per_m"]["value"] == pytest.approx(400.0, rel=0.05)
    device = load_device(str(tmp_path / "results" / "device.toml"))
    assert device.spec.effects["muscle_damping"]["form"] == "viscous"
    process = run("diagnose", str(folder), "--out", str(tmp_path / "again"), "--no-report", *only)
    assert "The simulated device lacks muscle damping (viscous)." in process.stdout
    assert "on test trials" in process.stdout
    assert sorted(f.name for f in (tmp_path / "again").iterdir()) == ["device.toml", "verdict.json"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nowhere",), "folder nowhere does not exist"),
        (("{data}", "--only", "gremlins"), "there is no effect or number 'gremlins'; the effects are: "),
        (
            ("{data}", "--exclude", "muscle.bladder_radius"),
            "did you mean 'muscle.bladder_radius_mm'? The numbers are: ",
        ),
        (("{data}", "--device", "gremlin"), "no device 'gremlin'"),
        (("{data}", "--catalogue", "gremlins.py"), "does not exist"),
        (("{data}", "--out", "{data}"), "is not empty"),
        (("",), "the path is empty"),
    ],
)
def test_invalid_input_gives_one_sentence(arguments: tuple[str, ...], words: str, tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "data", seconds=0.5)
    process = run("diagnose", *(a.format(data=folder) for a in arguments))
    assert process.returncode == 2
    assert words in process.stderr
    assert len(process.stderr.strip().splitlines()) == 1
    assert process.stdout == ""


@pytest.mark.long
def test_user_effect_is_identified(tmp_path: Path) -> None:
    users = Path(__file__).parents[1] / "effects" / "user_effects.py"
    script = (
        "import sys; from pathlib import Path; from tests.diagnosis.synthetic_dataset import write_dataset\n"
        "write_dataset(Path(sys.argv[1]), {('warming', 'first_order'): {'gain': 0.04, 'time_constant_s': 0.8}})"
    )
    data = tmp_path / "data"
    environment = {**os.environ, "KLUTE_SIM_CATALOGUE": str(users)}
    root = Path(__file__).parents[2]
    subprocess.run([sys.executable, "-c", script, str(data)], check=True, env=environment, cwd=root)
    only = ("--only", "warming", "--only", "sensor_gain", "--only", "muscle_damping")
    process = run("diagnose", str(data), "--catalogue", str(users), "--out", str(tmp_path / "results"), "--json", *only)
    assert process.returncode == 0, process.stderr
    assert f"Running the code in {users}" in process.stderr
    (entry,) = json.loads(process.stdout)["effects"]
    assert entry["name"] == "warming"
    assert entry["parameters"]["gain"]["value"] == pytest.approx(0.04, rel=0.1)
