"""A frozen release of the benchmark: what it contains, and that its scorer needs nothing but Python."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
from benchmarks.hidden_effects.catalogue import EXACT_TWINS, RELATIVE_UNCERTAINTIES
from benchmarks.hidden_effects.device import load_device as load_bench_device
from benchmarks.hidden_effects.generate import draw_bench
from benchmarks.hidden_effects.plan import sample_datasets
from benchmarks.hidden_effects.release import freeze as release
from benchmarks.hidden_effects.release.answers import Allowed, list_faults
from benchmarks.hidden_effects.release.scorer import read_allowed, seal, unseal
from benchmarks.hidden_effects.score import format_effect
from benchmarks.hidden_effects.set_up import NUMBER_ERRORS

from klute_sim.datasets import dataset as datasets
from klute_sim.device.device import load_device
from klute_sim.device.rollout import simulate_rollouts

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def frozen(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return a release of a clean dataset and two with an effect, and its truths."""
    folder = tmp_path_factory.mktemp("release") / "r"
    return folder, release.freeze(folder, ("clean", "single", "outside"), 1, 15)  # sizes of 2 and 8


def run_scorer(folder: Path, answers: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run score.pyz without the packages of this environment."""
    command = [sys.executable, "-I", "-S", str(folder / "score.pyz"), str(answers), "--release", str(folder)]
    return subprocess.run([*command, *arguments], capture_output=True, text=True, check=False)


def write_answers(folder: Path, answers: dict[str, Any]) -> Path:
    folder.mkdir()
    for name, answer in answers.items():
        (folder / f"{name}.json").write_text(json.dumps(answer))
    return folder


def answer_truth(truth: dict[str, Any]) -> dict[str, Any]:
    """Return the ideal answer."""
    if truth["deleted"] or truth["strangers"]:
        return {"verdict": "unexplained"}
    effects = [{k: e[k] for k in ("name", "channel") if k in e} for e in [*truth["effects"], *truth["instruments"]]]
    return {"verdict": "identified", "effects": effects} if effects else {"verdict": "nothing-missing"}


def test_datasets_are_parquet_and_load(frozen: tuple[Path, dict[str, Any]]) -> None:
    folder, truths = frozen
    assert sorted(truths) == ["d0000", "d0001", "d0002"]
    assert not list(folder.rglob("*.csv"))
    for name in truths:
        data = datasets.load_dataset(folder / "datasets" / name)
        assert {trial.use for trial in data.trials} == {"fit", "validation", "test"}
        assert load_device(str(folder / "devices" / f"{data.device.name}.toml")).digest == data.device.digest


def test_truths_are_sealed_and_nothing_tells_them(frozen: tuple[Path, dict[str, Any]]) -> None:
    folder, truths = frozen
    assert unseal((folder / "truths.sealed").read_text()) == json.loads(json.dumps(truths))
    hidden = {effect["name"] for truth in truths.values() for effect in truth["effects"] if not truth["deleted"]}
    assert hidden
    for file in (folder / "datasets").rglob("*.*"):
        assert not any(name.encode() in file.read_bytes() for name in hidden), file
    assert unseal(seal({"a": {"block": "clean"}})) == {"a": {"block": "clean"}}


def test_only_a_release_to_develop_on_has_open_truths(frozen: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    folder, _ = frozen
    assert not (folder / "truths.json").exists()
    assert "This release is for scores: do not tune on it" in (folder / "DATA_CARD.md").read_text()
    truths = release.freeze(tmp_path / "own", ("clean",), 1, 4711, has_open_truths=True)
    assert json.loads((tmp_path / "own" / "truths.json").read_text()) == json.loads(json.dumps(truths))
    card = (tmp_path / "own" / "DATA_CARD.md").read_text()
    assert "`truths.json`, in the open" in card
    assert "do not tune" not in card


def test_details_show_truth_and_answer_only_where_truths_are_open(
    frozen: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    folder, truths = frozen
    answer = {"verdict": "indistinguishable", "effects": [{"name": "leak"}], "alternatives": [["hose", "end_taper"]]}
    answers = write_answers(tmp_path / "a", dict.fromkeys(truths, answer))
    done = run_scorer(folder, answers, "--details")
    assert done.returncode == 2
    assert "--details is for a release to develop on" in done.stderr
    own = tmp_path / "own"
    shutil.copytree(folder, own)
    (own / "truths.json").write_text(json.dumps(truths))
    lines = run_scorer(own, answers, "--details").stdout.splitlines()[2:]
    assert [line.split(" | ")[1] for line in lines] == ["clean", "outside", "single"]
    assert " | clean | - | - | indistinguishable: leak or end_taper + hose | false-alarm |" in lines[0]
    (hidden,) = (truth["effects"][0] for truth in truths.values() if truth["block"] == "single")
    assert f" | single | {hidden['name']} | {hidden['size']:.1f} | " in lines[2]


def test_part_of_the_answers_is_scored_only_where_truths_are_open(
    frozen: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    folder, truths = frozen
    answers = write_answers(tmp_path / "a", {"d0001": {"verdict": "nothing-missing"}})
    done = run_scorer(folder, answers, "--only-answered")
    assert done.returncode == 2
    assert "--only-answered is for a release to develop on" in done.stderr
    own = tmp_path / "own"
    shutil.copytree(folder, own)
    (own / "truths.json").write_text(json.dumps(truths))
    done = run_scorer(own, answers, "--only-answered", "--json")
    assert done.stderr == "2 of 3 datasets have no answer and do not count\n"
    assert list(json.loads(done.stdout)["outcomes"]) == ["d0001"]
    assert run_scorer(own, answers).returncode == 2


def test_reader_that_has_seen_enough_is_no_error(frozen: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    folder, truths = frozen
    answers = write_answers(tmp_path / "a", {name: {"verdict": "nothing-missing"} for name in truths})
    command = [sys.executable, str(folder / "score.pyz"), str(answers), "--release", str(folder)]
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")


def test_count_is_a_random_sample_of_a_block() -> None:
    whole = sample_datasets("single", None, 7)
    sample = sample_datasets("single", 12, 7)
    assert sample == sample_datasets("single", 12, 7)
    assert all(spec in whole for spec in sample)
    assert len({spec["name"] for spec in sample}) == 12
    assert len({spec["effects"][0]["name"] for spec in sample}) > 6
    assert sample != sample_datasets("single", 12, 8)
    assert len(sample_datasets("defective", 11, 7)) == 11


HIDDEN_KEYS = ("effects", "instruments", "strangers", "numbers", "defect")
"""Keys of a specification that hide something."""


def test_withheld_names_do_not_tell_what_is_hidden() -> None:
    planned = [spec for block in release.BENCH_BLOCKS for spec in sample_datasets(block, None, 7)]
    specs = {f"d{i:04d}": spec for i, spec in enumerate(planned)}
    withheld = release.withhold_names(specs, 7)
    assert withheld == release.withhold_names(specs, 7) != release.withhold_names(specs, 8)
    real = {name for name, spec in specs.items() if spec.get("deleted")}
    decoys = withheld.keys() - real
    assert real < withheld.keys()
    assert 2.5 * len(real) <= len(decoys) <= release.N_DECOYS * len(real)
    hides_nothing = [name for name in decoys if not list(filter(None, map(specs[name].get, HIDDEN_KEYS)))]
    assert len(hides_nothing) > 0.7 * len(real)  # to say that nothing is missing there is nearly as good
    assert len({specs[name]["block"] for name in decoys} - {"outside", "faint_outside"}) > 8
    for name in decoys:
        hidden = [e for kind in ("effects", "instruments", "numbers") for e in specs[name].get(kind, ())]
        assert not {effect["name"] for effect in hidden} & set(withheld[name])
        assert not {twin for effect in hidden for twin in EXACT_TWINS.get(effect["name"], ())} & set(withheld[name])
        assert not specs[name].get("known")
    assert {tuple(withheld[name]) for name in decoys} <= {tuple(withheld[name]) for name in real}
    assert not release.withhold_names({"d0000": {"block": "clean", "effects": []}}, 7)


def test_truth_scores_full_marks_and_a_silent_method_does_not(
    frozen: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    folder, truths = frozen
    ideal = write_answers(tmp_path / "ideal", {name: answer_truth(truth) for name, truth in truths.items()})
    done = run_scorer(folder, ideal, "--json")
    assert done.returncode == 0, done.stderr
    scored = json.loads(done.stdout)
    assert set(scored["outcomes"].values()) <= {"right", "flagged"}
    for row in scored["rows"]:
        assert row["count"] == (row["of"] if row["higher_is_better"] else 0), row
    silent = write_answers(tmp_path / "silent", {name: {"verdict": "nothing-missing"} for name in truths})
    done = run_scorer(folder, silent)
    assert done.returncode == 0, done.stderr
    assert "| wrong names, all datasets | 0.0 % |" in done.stdout
    assert "| exact set, one effect | 0.0 % |" in done.stdout


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        ({"verdict": "perhaps"}, "'verdict' is 'perhaps'; allowed: nothing-missing"),
        ({"verdict": "identified"}, "needs at least one entry in 'effects'"),
        ({"verdict": "identified", "effects": ["friction"]}, "allowed: a list of objects with 'name'"),
        (
            {"verdict": "unexplained", "alternatives": "none"},
            "'alternatives' is 'none'; allowed: a list of lists of names",
        ),
        ([], "is []; allowed: an object with 'verdict'"),
        ({"verdict": "identified", "effects": [{"name": "bogus"}]}, "'bogus' is no name of an effect; DATA_CARD.md"),
        ({"verdict": "identified", "effects": [{"name": "ankle_friction"}]}, "'ankle_friction' is no name"),
        ({"verdict": "identified", "effects": [{"name": "sensor_gain"}]}, "needs a channel that the dataset has"),
        (
            {"verdict": "identified", "effects": [{"name": "number_error", "number": "radius"}]},
            "needs a number of the device file as section.key",
        ),
        (
            {"verdict": "identified", "effects": [{"name": "leak", "channel": "force"}]},
            "belongs to the device and has no channel",
        ),
        (
            {"verdict": "indistinguishable", "effects": [{"name": "leak"}], "alternatives": [["sensor_gain@length"]]},
            "in 'alternatives', 'sensor_gain' needs a channel",
        ),
    ],
)
def test_wrong_answer_is_refused_with_one_sentence(
    frozen: tuple[Path, dict[str, Any]], tmp_path: Path, answer: Any, sentence: str
) -> None:
    folder, truths = frozen
    done = run_scorer(folder, write_answers(tmp_path / "a", dict.fromkeys(truths, answer)))
    assert done.returncode == 2
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr


def test_all_faults_of_an_answer_are_listed() -> None:
    kinds = {"leak": "device", "hose": "device", "sensor_gain": "instrument"}
    allowed = Allowed(kinds, ("leak",), ("pressure", "force"), set())
    effects = [{"name": "bogus"}, {"name": "leak"}, {"name": "sensor_gain"}, {"name": "hose"}]
    verdict, *names, alternative = list_faults(
        {"verdict": [], "effects": effects, "alternatives": [["sensor_lag@force"], ["unknown_force"]]}, allowed
    )
    assert verdict.startswith("'verdict' is []; allowed: nothing-missing")
    assert names == [
        "in 'effects', 'bogus' is no name of an effect; DATA_CARD.md lists them",
        "in 'effects', 'leak' is withheld on this dataset, as withheld.json says",
        "in 'effects', 'sensor_gain' needs a channel that the dataset has; allowed: force, pressure",
    ]
    assert alternative == "in 'alternatives', 'sensor_lag' is no name of an effect; DATA_CARD.md lists them"


@pytest.mark.parametrize(
    ("verdict", "effects", "alternatives", "fault"),
    [
        ("nothing-missing", ["leak"], [], "the verdict nothing-missing goes with no 'effects'"),
        ("nothing-missing", [], [["leak"]], "the verdict nothing-missing goes with no 'alternatives'"),
        ("identified", ["leak"], [["hose"]], "the verdict identified goes with no 'alternatives'"),
        ("identified-in-part", ["leak"], [["hose"]], "the verdict identified-in-part goes with no 'alternatives'"),
        ("indistinguishable", ["leak"], [], "needs at least one set in 'alternatives'"),
        ("indistinguishable", ["leak"], [[]], "needs at least one set in 'alternatives'"),
        ("identified", ["leak", "leak"], [], "'leak' is named twice in one set"),
        ("indistinguishable", ["leak"], [["hose", "hose"]], "'hose' is named twice in one set"),
        ("indistinguishable", ["leak"], [["leak"]], "the set leak is listed twice"),
        (
            "indistinguishable",
            ["leak"],
            [["hose", "end_taper"], ["end_taper", "hose"]],
            "the set end_taper + hose is listed",
        ),
        ("identified", ["sensor_gain@muscle_length"], [], "a channel that the dataset has; allowed: force, pressure"),
        ("identified", ["number_error@muscle.foo"], [], "such as muscle.bladder_radius_mm; 'muscle.foo' is none"),
        ("identified", ["unknown_force"], [], "'unknown_force' is no name of an effect"),
        ("identified", ["sensor_gain@force", "sensor_gain@pressure", "leak"], [], None),
        ("identified", ["number_error@muscle.c10_kpa", "number_error@muscle.c01_kpa"], [], None),
        ("indistinguishable", ["leak"], [["leak", "hose"], ["unknown_force"]], None),
        ("unexplained", ["unknown_force", "leak", "leak"], [["hose"]], None),
        ("insufficient-data", ["leak"], [], None),
    ],
)
def test_answer_that_contradicts_itself_or_its_dataset_is_refused(
    verdict: str, effects: list[str], alternatives: list[list[str]], fault: str | None
) -> None:
    kinds = dict.fromkeys(("leak", "hose", "end_taper"), "device")
    kinds |= {"sensor_gain": "instrument", "number_error": "number"}
    allowed = Allowed(kinds, (), ("force", "pressure"), {"muscle.c10_kpa", "muscle.c01_kpa"})
    named = [effect.partition("@") for effect in effects]
    entries = [{"name": name, "number" if "." in owner else "channel": owner or None} for name, _, owner in named]
    faults = list_faults({"verdict": verdict, "effects": entries, "alternatives": alternatives}, allowed)
    assert len(faults) == (fault is not None)
    assert fault is None or fault in faults[0]


def test_verdicts_of_the_program_are_answers() -> None:
    kinds = {effect.name: effect.kind for effect in release.select_effects()} | {"number_error": "number"}
    document = tomllib.loads(load_device("klute-3-4-pair").content.decode())
    numbers = {f"{name}.{key}" for name, section in document.items() if isinstance(section, dict) for key in section}
    count = 0
    with tarfile.open(release.ROOT / "benchmarks/hidden_effects/results/test_1313.tar.xz") as archive:
        for member in archive:
            name = Path(member.name).name
            if member.isfile() and not name.endswith(".truth.json") and name.startswith(release.BENCH_BLOCKS):
                file = archive.extractfile(member)
                assert file is not None
                allowed = Allowed(kinds, (), ("force", "pressure", "muscle_length"), numbers)
                assert list_faults(json.loads(file.read()), allowed) == [], name
                count += 1
    assert count > 50


def test_release_tells_the_numbers_and_channels_of_a_dataset(frozen: tuple[Path, dict[str, Any]]) -> None:
    folder, truths = frozen
    for name, allowed in read_allowed(folder, truths).items():
        table = pyarrow.parquet.read_table(folder / "datasets" / name / "fit_1_a.parquet")
        columns = {column.split(" [")[0] for column in table.column_names}
        assert set(allowed.channels) == columns - {"time", "length", "pressure_command"}
        assert NUMBER_ERRORS.keys() < allowed.numbers
        assert not {"muscle.foo", "sources.muscle"} & allowed.numbers


def test_missing_answer_and_missing_release_are_refused(frozen: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    folder, _ = frozen
    (tmp_path / "d9999.json").write_text("{}")
    messages = run_scorer(folder, tmp_path).stderr.splitlines()
    assert len(messages) == 4  # each of them at once
    assert "d0000.json is missing; every dataset needs an answer" in messages[0]
    assert "d9999.json belongs to no dataset of this release" in messages[3]
    done = run_scorer(folder, tmp_path / "nowhere")
    assert done.returncode == 2
    assert "nowhere is no folder; it should contain a file NAME.json for each dataset" in done.stderr
    command = [sys.executable, str(folder / "score.pyz"), str(tmp_path), "--release", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "truths.sealed is missing; run this in the folder of the release" in done.stderr


def test_card_has_all_names_and_its_method_runs(frozen: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    folder, truths = frozen
    card = (folder / "DATA_CARD.md").read_text()
    assert not re.search(r"\{[a-z]+\}", card)
    assert all(f"`{format_effect(effect)}`" in card for truth in truths.values() for effect in truth["effects"])
    (tmp_path / "datasets").symlink_to(folder / "datasets")
    code = card.split("```python\n")[1].split("```")[0]
    subprocess.run([sys.executable, "-I", "-c", code], cwd=tmp_path, check=True)
    assert run_scorer(folder, tmp_path / "answers").returncode == 0


def test_noise_of_the_card_needs_neither_repeats_nor_fine_steps(
    frozen: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder, truths = frozen
    (tmp_path / "datasets").mkdir()
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec((folder / "DATA_CARD.md").read_text().split("```python\n")[1].split("```")[0], names)
    (clean,) = (name for name, truth in truths.items() if truth["block"] == "clean")
    groups, _ = names["read_groups"](folder / "datasets" / clean)
    alone = {group: trials[:1] for group, trials in groups.items()}
    coarse = {
        group: [{**trial, "force": 40.0 * np.round(trial["force"] / 40.0)} for trial in trials]
        for group, trials in groups.items()
    }
    dead = {
        group: [{**trial, "force": np.full_like(trial["force"], 0.037)} for trial in trials]
        for group, trials in groups.items()
    }
    assert names["measure_noise"](groups, "force") == pytest.approx(truths[clean]["noise"]["force"], rel=0.15)
    assert names["measure_noise"](alone, "force") == pytest.approx(truths[clean]["noise"]["force"], rel=0.3)
    assert names["measure_noise"](coarse, "force") == pytest.approx(40.0 / 12.0**0.5)
    assert names["measure_noise"](dead, "force") == 0.0


def test_simulation_of_the_card_agrees_with_clean_data(
    frozen: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, truths = frozen
    monkeypatch.chdir(folder)
    names: dict[str, Any] = {}
    exec((folder / "DATA_CARD.md").read_text().split("```python\n")[2].split("```")[0], names)
    (clean,) = (name for name, truth in truths.items() if truth["block"] == "clean")
    table = pyarrow.parquet.read_table(folder / "datasets" / clean / "fit_1_a.parquet")
    trial = {name.split(" [")[0]: table[name].to_numpy() for name in table.column_names}
    force, pressure, length = names["simulate"](names["device"], trial)
    tendon_length = trial["length"] - length
    tension = np.polyfit(tendon_length[force > 50.0], force[force > 50.0], 1)
    assert tension[0] > 0.0  # both lengths in mm: what is not muscle is tendon, which stretches under force
    assert np.std(pressure - trial["pressure"]) < 0.05
    misfit, without_hold = (
        np.std(values - trial["force"])[()]
        for values in (force, names["simulate"](names["device"], trial, hold=0.0)[0])
    )
    assert misfit < 0.05 * np.ptp(trial["force"])  # the uncertain numbers are not refitted
    assert misfit < without_hold
    slow = {name: values[::4] for name, values in trial.items()}
    slow_force, other_force = (names["simulate"](names["device"], slow, is_other)[0] for is_other in (False, True))
    error = np.abs(slow_force - force[::4])
    assert error.max() > 20.0
    assert np.all(error < 3.0 + 8.0 * np.abs(other_force - slow_force))  # the noise is 3 N
    assert names["with_effect"].digest != names["changed"].digest != names["device"].digest
    allowed = json.loads(Path("names.json").read_text())
    assert {name for name, _, _ in names["candidates"]} == {name for name, kind in allowed.items() if kind == "device"}


def test_uncertain_numbers_are_never_the_hidden_ones() -> None:
    """As the card says of `number_error`."""
    assert not NUMBER_ERRORS.keys() & RELATIVE_UNCERTAINTIES.keys()
    device = load_bench_device()
    for seed in range(20):
        base = draw_bench(seed, device).base
        assert all(abs(base[key] / device[key] - 1.0) <= 2.0 * share for key, share in RELATIVE_UNCERTAINTIES.items())


def test_laws_of_the_card_are_those_of_the_program() -> None:
    names: dict[str, Any] = {}
    exec((release.HERE / "data_card.md").read_text("utf-8").split("```python\n")[3].split("```")[0], names)
    preset = load_device("klute-3-4-pair")
    device, parameters = tomllib.loads(preset.content.decode()), preset.parameters
    dt = 5e-4
    time = dt * np.arange(4000)
    length = 0.335 + 0.022 * np.sin(7.0 * time)  # slack at both ends, one of them at the stop of the muscle
    command = 2.5 - 2.5 * np.sign(np.sin(11.0 * time))
    trace = simulate_rollouts(parameters, length, command * 1e5, dt)
    assert trace.tension.min() == 0.0
    assert trace.length.max() == 0.25
    pressure, muscle_length, rows = trace.pressure[0] / 1e5, trace.length[0], []
    for k in range(1, len(time)):
        pressure = names["regulate_pressure"](device["supply"], pressure, command[k], dt)
        force, muscle_length = names["move_muscle"](device, pressure * 1e5, length[k], muscle_length, dt)
        rows.append((force, pressure, muscle_length))
    tension, pressures, lengths = np.array(rows).T
    np.testing.assert_allclose(pressures, trace.pressure[1:] / 1e5, atol=1e-9)
    np.testing.assert_allclose(lengths, trace.length[1:], atol=1e-7)
    np.testing.assert_allclose(tension, trace.tension[1:], atol=0.02)


def test_card_defines_every_fault_of_an_instrument() -> None:
    card = (release.HERE / "data_card.md").read_text("utf-8")
    faults = [effect.name for effect in release.select_effects() if effect.kind == "instrument"]
    assert re.findall(r"(?m)^\| `(\w+)` \| [zτ]", card) == faults
