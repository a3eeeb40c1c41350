"""``klute-sim plan`` as a user types it."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from klute_sim.bench.protocols.library import load_identification_protocols
from klute_sim.datasets import dataset
from klute_sim.datasets.trial_files import table
from klute_sim.device.device import list_presets, load_device, parse_device
from klute_sim.diagnosis.experiments.base import SimulationSetup
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import observe, simulate_extrapolated
from klute_sim.diagnosis.planning import measurement_plan
from klute_sim.units import BAR
from tests import command_line as command

PROTOCOLS = load_identification_protocols()
COMMAND = {"time": "s", "length": "m", "pressure_command": "Pa"}


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return command.run("plan", *arguments, cwd=cwd)


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    folder = tmp_path_factory.mktemp("plan")
    done = run("klute-3-4-pair", "--out", "my-bench", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "my-bench", json.loads(done.stdout)


@pytest.fixture(scope="module")
def simulated_plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated_plan")
    done = run("klute-3-4-pair", "--out", "trial-run", "--simulate", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "simulated, not measured" in done.stdout
    return folder / "trial-run"


def test_help_names_all_protocols(tmp_path: Path) -> None:
    words = " ".join(run("--help", cwd=tmp_path).stdout.split())
    assert f"({', '.join(PROTOCOLS)})" in words


def test_plan_has_all_files(plan: tuple[Path, dict[str, object]]) -> None:
    folder, told = plan
    files = {file.name for file in folder.iterdir()}
    assert files == {f"{name}.csv" for name in PROTOCOLS} | {"README.txt", "dataset.toml", "device.toml"}
    assert told["files"] == sorted(files)
    assert (told["folder"], told["device"], told["simulated"]) == ("my-bench", "klute-3-4-pair", False)
    assert [p["name"] for p in told["protocols"]] == list(PROTOCOLS)  # type: ignore[attr-defined]
    assert (folder / "device.toml").read_bytes() == load_device("klute-3-4-pair").content
    for text in ("README.txt", "dataset.toml"):
        assert "simulated, not" not in (folder / text).read_text("utf-8")


def test_command_files_equal_the_protocols(plan: tuple[Path, dict[str, object]]) -> None:
    folder, told = plan
    for row in told["protocols"]:  # type: ignore[attr-defined]
        path = folder / row["command"]
        assert path.read_text("utf-8").splitlines()[0] == "time [s],length [mm],pressure_command [bar]"
        columns = table.read_trial_file(path, COMMAND).columns
        wanted = PROTOCOLS[row["name"]].build_program(load_device("klute-3-4-pair"))
        np.testing.assert_allclose(columns["time"], wanted.time, atol=1e-9)
        np.testing.assert_allclose(columns["length"], wanted.unit_length, atol=1.1e-7)
        np.testing.assert_allclose(columns["pressure_command"], wanted.command, atol=11.0)
        assert columns["length"].max() <= wanted.unit_length.max() + 1e-9
        assert row["duration_s"] == pytest.approx(wanted.time[-1])
        assert row["use"] == PROTOCOLS[row["name"]].use
        assert row["recordings"] == [f"{row['name']}_a.csv", f"{row['name']}_b.csv"]
        assert row["reveals"] == list(PROTOCOLS[row["name"]].revealed_effects)


def test_readme_has_instructions(plan: tuple[Path, dict[str, object]]) -> None:
    text = (plan[0] / "README.txt").read_text("utf-8")
    assert 'trusted = ["pressure"] into the [[trial]]' in text
    for name, protocol in PROTOCOLS.items():
        assert f"{name}.csv (" in text
        assert f"-> {name}_a.csv, {name}_b.csv\n" in text
        assert protocol.description in text
    for phrase in ("length [mm]", "pressure_command [bar]", "force [N]", "pressure [bar]", "muscle_length [mm]",
                  "Start at rest", "between 321.5 and 350.0 mm", "between 0.30 and 4.50 bar", "second gauge",
                  "dead weight", "klute-sim diagnose"):  # fmt: skip
        assert phrase in text, phrase
    assert "no tendon" not in text
    assert max(map(len, text.splitlines())) <= 120


def test_plan_has_no_recordings(plan: tuple[Path, dict[str, object]]) -> None:
    with pytest.raises(Exception, match=r"steps_a\.csv does not exist"):
        dataset.load_dataset(plan[0])


def test_simulated_plan_is_a_dataset_with_the_planned_split(simulated_plan: Path) -> None:
    data = dataset.load_dataset(simulated_plan)
    assert data.remarks == ()
    parts = dataset.split_dataset(data)
    for use in ("fit", "validation", "test"):
        wanted = {f"{name}_{letter}" for name, p in PROTOCOLS.items() for letter in "ab" if p.use == use}
        assert set(getattr(parts, use)) == wanted
        assert wanted
    assert all(trial.group == trial.name[:-2] for trial in data.trials)
    assert {*data.trials[0].measured} == {"force", "pressure"}
    assert set(data.uncertainties) == set(measurement_plan.DEFAULT_UNCERTAINTIES)
    assert data.uncertainties["tendon.stiffness_1_n_per_mm"] == pytest.approx(6.0)


def test_simulated_plan_is_marked(simulated_plan: Path) -> None:
    for file in ("dataset.toml", "README.txt"):
        assert "simulated, not measured" in (simulated_plan / file).read_text("utf-8").splitlines()[0]


def test_simulated_recordings_are_device_plus_noise(simulated_plan: Path) -> None:
    data = dataset.load_dataset(simulated_plan)
    left: dict[str, list[np.ndarray]] = {"force": [], "pressure": []}
    for experiment in prepare_experiments(data, dataset.split_dataset(data)):
        setting = SimulationSetup(experiment.device.parameters)
        told = observe(setting, experiment, simulate_extrapolated(setting, experiment))
        for channel, values in told.items():
            left[channel].append(experiment.measured[channel].value - values)
    for channel, deviation in (("force", 3.0), ("pressure", 0.01 * BAR)):
        every = np.concatenate(left[channel])
        assert every.std() == pytest.approx(deviation, rel=0.03)
        assert abs(every.mean()) < 5 * deviation / np.sqrt(len(every))
        between = np.corrcoef(left[channel][0], left[channel][1])[0, 1]
        assert abs(between) < 0.15  # repeats have noise of their own


def test_simulated_recording_starts_at_rest() -> None:
    device = load_device("klute-3-4-pair")
    found = measurement_plan.simulate_recording(device, PROTOCOLS["hold"].build_program(device), (0, 0))
    early = found["time [s]"] < 0.45
    assert found["force [N]"][0] == pytest.approx(found["force [N]"][early].mean(), abs=12.0)
    assert found["force [N]"][early].std() == pytest.approx(3.0, rel=0.3)


def test_simulated_plan_is_reproducible(simulated_plan: Path) -> None:
    done = run("klute-3-4-pair", "--out", "again", "--simulate", "--only", "steps", cwd=simulated_plan.parent)
    assert done.returncode == 0, done.stderr
    again = simulated_plan.parent / "again"
    for file in ("steps_a.csv", "steps_b.csv", "steps.csv"):
        assert (again / file).read_bytes() == (simulated_plan / file).read_bytes()


def test_selected_protocols_and_more_repeats(tmp_path: Path) -> None:
    options = ("--only", "sines", "--only", "steps", "--only", "steps", "--repeats", "4", "--simulate")
    done = run("klute-3-4", *options, "--out", "bare", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [p["name"] for p in json.loads(done.stdout)["protocols"]] == ["steps", "sines"]
    assert json.loads(done.stdout)["simulated"] is True
    data = dataset.load_dataset(tmp_path / "bare")
    assert [trial.name for trial in data.trials] == [f"{name}_{k}" for name in ("steps", "sines") for k in "abcd"]
    assert dataset.split_dataset(data).validation == tuple(f"sines_{k}" for k in "abcd")
    assert set(data.uncertainties) == {"muscle.c10_kpa", "muscle.friction_slope_n_per_bar"}
    text = (tmp_path / "bare" / "README.txt").read_text("utf-8")
    assert "This device has no tendon" in text
    assert "clamp to clamp" in text
    assert "steps_a.csv to steps_d.csv" in text


def test_without_a_protocol_to_fit_the_split_decides(tmp_path: Path) -> None:
    done = run("klute-3-4-pair", "--only", "mixed", "--simulate", "--out", "one", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "assigned later" in done.stdout
    data = dataset.load_dataset(tmp_path / "one")
    assert dataset.split_dataset(data).fit == ("mixed_a", "mixed_b")


@pytest.mark.parametrize(
    ("names", "uses"),
    [
        (("steps", "ramps", "hold"), [None, None, None]),
        (("steps", "ramps", "sines"), [None, None, None]),
        (("steps", "sines"), ["fit", "validation"]),  # too few groups for the split to reserve one
        (("steps", "hold", "mixed"), ["fit", "fit", "test"]),
    ],
)
def test_without_a_protocol_to_test_the_split_decides(names: tuple[str, ...], uses: list[str | None]) -> None:
    assert measurement_plan.assign_uses([PROTOCOLS[name] for name in names]) == uses


@pytest.mark.parametrize("name", list_presets())
def test_dataset_file_is_valid_for_all_presets(name: str) -> None:
    from klute_sim.datasets import format as file_format

    device = load_device(name)
    text = measurement_plan.format_dataset_toml(device, list(PROTOCOLS.values()), 3, simulated=False)
    file = file_format.parse_dataset_file(text.encode(), "here")
    assert len(file.trial) == 3 * len(PROTOCOLS)
    assert file_format.compute_standard_deviations(file.uncertain, device.spec.collect_values(), "here")


def test_disabled_or_zero_term_is_not_uncertain() -> None:
    text = load_device("klute-3-4-pair").content.decode()
    off = text.replace("friction_offset_n = -38.2", "friction_offset_n = -38.2\nbladder = false\nfriction = false")
    zero = off.replace("stiffness_2_n_per_mm = 140.0", "stiffness_2_n_per_mm = 0.0")
    device = parse_device(zero.encode(), "x")
    content = measurement_plan.format_dataset_toml(device, list(PROTOCOLS.values()), 2, simulated=False)
    for key in ("muscle.c10_kpa", "muscle.friction_slope_n_per_bar", "tendon.stiffness_2_n_per_mm"):
        assert key not in content
    assert "tendon.stiffness_1_n_per_mm" in content


CYLINDER = "[cylinder]\nextended_length_mm = 200\nstroke_mm = 60\n"
PARTS = {
    "tendon": "[tendon]\nslack_length_mm = 100\nstiffness_1_n_per_mm = 60\nstiffness_2_n_per_mm = 0\n"
    "engagement_mm = 40\n",
    "cylinder": CYLINDER,
    "supplied": f"{CYLINDER}[supply]\npressure_bar = 8\nrate_bar_per_s = 100\ngas_temperature_c = 20\n",
}


@pytest.mark.parametrize(
    ("part", "without"),
    [("tendon", {"steps"}), ("cylinder", {"steps", "slack"}), ("supplied", {"slack"})],
)
def test_plan_of_a_part_speaks_of_what_the_part_has(part: str, without: set[str], tmp_path: Path) -> None:
    (tmp_path / "part.toml").write_text(f'name = "part"\n{PARTS[part]}')
    done = run("part.toml", "--out", "plan", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert [p["name"] for p in told["protocols"]] == [name for name in PROTOCOLS if name not in without]
    files = [(tmp_path / "plan" / name).read_text("utf-8") for name in ("README.txt", "dataset.toml")]
    texts = "\n".join([done.stdout, *files])
    absent = ["muscle", "braid", "bladder", "inflated", "choked_valve", "resting_length_mm"]
    absent += [] if part == "supplied" else ["pressure", "egulator", " bar"]
    absent += ["orifice", "oil"] + (["seal"] if part == "tendon" else ["tendon"])
    for word in absent:
        assert word not in texts, word
    assert "Reveals: " in texts
    if part == "tendon":
        assert "All lengths are between 100.0 and 115.8 mm." in texts
        assert "Forces reach about 950 N." in texts
        assert "tendon_stiffening" in texts


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["klute-3-4-pair"], "Missing option '--out'"),
        (["--out", "x"], "Missing argument 'DEVICE'"),
        (["klute-3-4-pair", "--out", ""], "the path is empty"),
        (["klute-9", "--out", "x"], "no device 'klute-9'"),
        (["klute-3-4-pair", "--out", "x", "--repeats", "1"], "the number of repeats is 1; allowed: 2 to 26"),
        (["klute-3-4-pair", "--out", "x", "--repeats", "27"], "the number of repeats is 27; allowed: 2 to 26"),
        (["klute-3-4-pair", "--out", "x", "--only", "jumps"], "there is no protocol 'jumps'; allowed: steps, ramps"),
        (["klute-3-4-pair", "--out", "full"], "output folder full is not empty"),
        (["klute-3-4-pair", "--out", "full/notes.txt"], "is a file; name a new or an empty folder"),
        (["locked.toml", "--out", "x"], "cannot be tested: its muscle locks"),
        (["foot.toml", "--out", "x"], "describe a foot alone as a [tendon]"),
        (["both.toml", "--out", "x"], "device 'part' has no plan: its [tendon] cannot push the piston"),
        (["spring.toml", "--out", "x", "--only", "steps"], "'steps' steps the pressure, but 'part' has no [supply]"),
    ],
)
def test_invalid_input_gives_one_sentence(arguments: list[str], says: str, tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    text = load_device("klute-3-4").content.decode()
    text = text.replace("turns_per_m = 8.287293", "turns_per_m = 35.0")
    (tmp_path / "locked.toml").write_text(text.replace("braid_length_ratio = 1.053039", "braid_length_ratio = 1.73"))
    (tmp_path / "foot.toml").write_text('name = "foot"\n[foot]\npreset = "sach"\n')
    (tmp_path / "spring.toml").write_text(f'name = "part"\n{PARTS["tendon"]}')
    (tmp_path / "both.toml").write_text(f'name = "part"\n{CYLINDER}{PARTS["tendon"]}')
    done = run(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""
    devices = {"locked.toml", "foot.toml", "spring.toml", "both.toml"}
    assert {file.name for file in tmp_path.iterdir()} == {"full", *devices}
    assert (tmp_path / "full" / "notes.txt").read_text() == "mine"
