"""Wrong bench datasets are named, unusual but right ones are accepted (benchmarks/robustness/plausibility)."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.robustness.plausibility import right_trials, wrong_trials
from benchmarks.robustness.plausibility.recordings import Variant, find_names, write_variant

from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import load_device, parse_device
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.errors import InputError
from klute_sim.plausibility.finding import ImplausibleInputError
from klute_sim.types import Array
from tests.datasets.test_muscle_diameter import TEN_MM

WRONG = list(wrong_trials.list_variants())
RIGHT = list(right_trials.list_variants())
FAST_TEST_INTERVAL = 9
"""Every ninth variant is in the default tests; the others are slow."""


def mark_slow(variants: list[Variant]) -> list[object]:
    return [
        pytest.param(variant, id=variant.name, marks=[] if index % FAST_TEST_INTERVAL == 0 else pytest.mark.slow)
        for index, variant in enumerate(variants)
    ]


def test_suite_is_large_enough() -> None:
    assert len(WRONG) >= 90
    assert len(RIGHT) >= 40
    assert len({variant.name for variant in (*WRONG, *RIGHT)}) == len(WRONG) + len(RIGHT)


@pytest.mark.parametrize("variant", mark_slow(WRONG))
def test_wrong_trials_are_named(variant: Variant, tmp_path: Path) -> None:
    names, message = find_names(variant, tmp_path / "data")
    assert variant.expected in names, message
    assert f"--accept {variant.expected}" in message


@pytest.mark.parametrize("unit", ["kN", "kgf", "lbf"])
def test_unit_of_a_force_is_guessed_by_its_magnitude(unit: str, tmp_path: Path) -> None:
    variant = next(variant for variant in WRONG if variant.name.startswith(f"force: {unit} under [N]"))
    _, message = find_names(variant, tmp_path / "data")
    assert f"is its unit {unit}?" in message


@pytest.mark.parametrize("variant", mark_slow(RIGHT))
def test_unusual_but_right_trials_are_accepted(variant: Variant, tmp_path: Path) -> None:
    assert find_names(variant, tmp_path / "data") == ((), "")


def test_accepted_findings_are_remarks(tmp_path: Path) -> None:
    variant = next(variant for variant in WRONG if variant.expected == "force-sign")
    write_variant(variant, tmp_path / "data")
    dataset = load_dataset(tmp_path / "data", accept=["force-sign"])
    assert {finding.name for finding in dataset.accepted} == {"force-sign"}
    *accepted, left_out = dataset.remarks
    assert all(remark.startswith("accepted: trial '") for remark in accepted)
    assert left_out.startswith("further checks left out trial")
    with pytest.raises(InputError, match="there is no finding 'sign'; found in these data: force-sign"):
        load_dataset(tmp_path / "data", accept=["force-sign", "sign"])
    file = tmp_path / "data" / "dataset.toml"
    file.write_text('accept = ["force-sign", "length-unit"]\n' + file.read_text("utf-8"), "utf-8")
    *remarks, unused = load_dataset(tmp_path / "data").remarks
    assert tuple(remarks) == dataset.remarks
    assert unused == f"{file}: 'accept' names 'length-unit', which was not found in trials without accepted findings"


def test_a_fast_regulator_without_a_force_does_not_tell_another_unit(tmp_path: Path) -> None:
    rows = [f"{t / 100:.2f},340,{3 * (t > 100)},{3 * (t > 100)}" for t in range(400)]
    heading = "time [s],length [mm],pressure_command [bar],pressure [bar]"
    (tmp_path / "step.csv").write_text("\n".join([heading, *rows]))
    head = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
    (tmp_path / "dataset.toml").write_text(head + '[[trial]]\nfiles = ["step.csv"]\n')
    assert load_dataset(tmp_path).accepted == ()


def test_uncalibrated_force_of_a_long_trial_is_found(tmp_path: Path) -> None:
    """Of a long trial, only the window that moves most is simulated: here the cycles after a rest of 12 s."""
    time = np.arange(0.0, 40.0, 0.002)
    command = 2.5 - 1.5 * np.cos(2.0 * np.pi * 0.5 * np.maximum(0.0, time - 12.0))
    parameters = load_device("klute-3-4-pair").parameters
    response = simulate_rollouts(parameters, np.full(len(time), 0.34), 1e5 * command, 0.002)
    columns = {"time [s]": time, "length [mm]": np.full(len(time), 340.0), "pressure_command [bar]": command}
    write_trial(tmp_path / "cycles.csv", columns | {"force [N]": response.tension / 187.0})
    head = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
    (tmp_path / "dataset.toml").write_text(head + '[[trial]]\nfiles = ["cycles.csv"]\n')
    with pytest.raises(ImplausibleInputError, match="force-unit"):
        load_dataset(tmp_path)


@pytest.mark.parametrize("has_force", [False, True])
def test_slow_supply_alone_is_no_wrong_sampling_rate(tmp_path: Path, has_force: bool) -> None:
    """A supply of 6 bar/s, where the device file says 60: with a force, all velocities tell the sampling rate."""
    device = load_device("klute-3-4-pair")
    time = np.arange(0.0, 8.0, 0.005)
    command = np.array([0.5, 3.5, 1.0, 4.5])[np.minimum(3, (time / 2.0).astype(int))]
    fast = 0.1 * time
    length = 340.0 + 4.0 * np.sin(2.0 * np.pi * 2.0 * fast)
    parameters = device.parameters
    response = simulate_rollouts(parameters, 1e-3 * length, 1e5 * command, 0.0005)
    columns = {"time [s]": time, "length [mm]": length, "pressure_command [bar]": command}
    columns |= {"pressure [bar]": 1e-5 * response.pressure, **({"force [N]": response.tension} if has_force else {})}
    write_trial(tmp_path / "steps.csv", columns)
    head = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
    (tmp_path / "dataset.toml").write_text(head + '[[trial]]\nfiles = ["steps.csv"]\n')
    if not has_force:
        assert load_dataset(tmp_path).accepted == ()
        return
    with pytest.raises(ImplausibleInputError, match="sampling rate that the times were computed with seems wrong"):
        load_dataset(tmp_path)


@pytest.mark.parametrize("speed", [0.1, 10.0])
def test_other_supply_of_a_muscle_without_damper_is_no_wrong_sampling_rate(tmp_path: Path, speed: float) -> None:
    """Nothing in a bare muscle but its supply depends on time, so that its force tells no sampling rate either."""
    device = load_device("klute-3-4")
    real = device.with_changes({"supply.rate_bar_per_s": 20.0 * speed})
    time = np.arange(0.0, 8.0, 0.005)
    command = np.array([0.5, 3.5, 1.0, 4.5])[np.minimum(3, (time / 2.0).astype(int))]
    length = np.full_like(time, 170.0)
    response = simulate_rollouts(real.parameters, 1e-3 * length, 1e5 * command, 0.005)
    columns = {"time [s]": time, "length [mm]": length, "pressure_command [bar]": command}
    columns |= {"pressure [bar]": 1e-5 * response.pressure, "force [N]": response.tension}
    write_trial(tmp_path / "steps.csv", columns)
    device.with_changes({"supply.rate_bar_per_s": 20.0}).save(tmp_path / "muscle.toml")
    head = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "muscle.toml"\n'
    (tmp_path / "dataset.toml").write_text(head + '[[trial]]\nfiles = ["steps.csv"]\n')
    assert load_dataset(tmp_path).accepted == ()


def write_muscle_trial(folder: Path, resting_length: float, columns: dict[str, Array]) -> Path:
    write_trial(folder / "trial.csv", columns)
    (folder / "muscle.toml").write_text(TEN_MM.replace("= 200.0", f"= {resting_length}"), "utf-8")
    head = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "muscle.toml"\n'
    (folder / "dataset.toml").write_text(head + '[[trial]]\nfiles = ["trial.csv"]\n', "utf-8")
    return folder


def test_constant_load_needs_no_waveform_of_the_force(tmp_path: Path) -> None:
    """A muscle of 233 mm with conical ends lifts 150 N: its law is imperfect, the columns and pressures are right."""
    pressure_kpa = [207.0, 218.0, 267.0, 316.0, 365.0, 413.0, 462.0, 511.0, 560.0, 609.0, 620.0]
    length_mm = [232.5, 232.1, 230.2, 227.9, 225.0, 221.4, 216.9, 212.2, 207.5, 203.4, 202.5]
    time = np.arange(0.0, 24.0, 0.1)
    instants = np.interp(time, [0.0, 1.0, 11.0, 13.0, 24.0], [0.0, 0.0, 10.0, 10.0, 0.0])
    columns = {
        "time [s]": time,
        "length [mm]": np.interp(instants, range(11), length_mm),
        "pressure_command [kPa]": np.interp(instants, range(11), pressure_kpa),
        "force [N]": 150.0 + np.random.default_rng(0).normal(0.0, 0.6, len(time)),
    }
    assert load_dataset(write_muscle_trial(tmp_path, 233.0, columns)).accepted == ()


def simulate_filling() -> dict[str, Array]:
    """Return a slow filling of a clamped muscle: columns in s, mm, bar and N."""
    time = np.arange(0.0, 6.0, 0.01)
    pressure = np.interp(time, [0.0, 0.6, 3.0, 5.4, 6.0], [0.2e5, 0.2e5, 6e5, 0.2e5, 0.2e5])
    length = np.full(len(time), 0.2)
    tension = simulate_rollouts(parse_device(TEN_MM.encode(), "muscle").parameters, length, pressure, 0.01).tension
    pressures = {"pressure_command [bar]": 1e-5 * pressure, "pressure [bar]": 1e-5 * pressure}
    return {"time [s]": time, "length [mm]": 1e3 * length, "force [N]": tension, **pressures}


def test_exchanged_columns_of_a_clamped_muscle_are_no_constant_load(tmp_path: Path) -> None:
    """Force and length are exchanged: under force stands the constant length, 200 mm."""
    columns = simulate_filling()
    exchanged = {**columns, "length [mm]": columns["force [N]"], "force [N]": columns["length [mm]"]}
    with pytest.raises(ImplausibleInputError, match="columns of length and force seem exchanged"):
        load_dataset(write_muscle_trial(tmp_path, 200.0, exchanged))


@pytest.mark.parametrize(("volts_per_newton", "match"), [(0.01, "100 times the size: is it a voltage"), (0.5, "")])
def test_uncalibrated_force_is_told(volts_per_newton: float, match: str, tmp_path: Path) -> None:
    """No unit is a hundredth of a newton; a muscle of half the strength is possible."""
    columns = simulate_filling()
    columns["force [N]"] = volts_per_newton * columns["force [N]"]
    folder = write_muscle_trial(tmp_path, 200.0, columns)
    if not match:
        assert load_dataset(folder).accepted == ()
        return
    with pytest.raises(ImplausibleInputError, match=match):
        load_dataset(folder)
