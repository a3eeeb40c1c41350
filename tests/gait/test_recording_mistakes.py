"""Mistakes in the recording of walks that a replay shows: a plate with another clock, and absolute pressures."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.device.device import parse_device
from klute_sim.gait.replay import clock_delay
from klute_sim.gait.replay.clock_delay import MIN_DELAY, ClockDelay, UnexplainedShares, estimate_clock_delay
from klute_sim.gait.replay.foot import build_replayed_foot
from klute_sim.gait.replay.measured_trial import PLATE_CHANNELS, TIME_STEP, MeasuredTrial
from klute_sim.gait.replay.prescribed import prepare_prescribed_motion
from klute_sim.gait.replay.recording_mistakes import find_recording_mistakes
from klute_sim.gait.replay.rollout import simulate_replay
from klute_sim.plausibility.finding import ImplausibleInputError
from tests.diagnosis.synthetic_gait_dataset import write_dataset

ATMOSPHERE = 1.013e5
LOG_CHANNELS = ("pressure_command", "ankle_angle", "force", "pressure", "muscle_length")
PRESSURES = ("pressure_command", "pressure")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("walks") / "d", groups=("fit_1",), repeats=1, strides=3)


@pytest.fixture(scope="module")
def walk(folder: Path) -> Trial:
    return datasets.load_dataset(folder).trials[0]


def change(trial: Trial, edits: Mapping[str, tuple[float, float]]) -> Trial:
    """Return ``trial`` with channel -> (time [s], value [SI]) added."""

    def apply(channels: Mapping[str, TimeSeries]) -> dict[str, TimeSeries]:
        return {
            name: TimeSeries(series.time + edits[name][0], series.value + edits[name][1]) if name in edits else series
            for name, series in channels.items()
        }

    return replace(trial, prescribed=apply(trial.prescribed), measured=apply(trial.measured))


def delay(trial: Trial, seconds: float, channels: tuple[str, ...] = PLATE_CHANNELS) -> Trial:
    return change(trial, dict.fromkeys(channels, (seconds, 0.0)))


def keep(trial: Trial, *channels: str) -> Trial:
    return replace(trial, measured={name: trial.measured[name] for name in channels})


def imitate(trial: Trial, effects: str) -> Trial:
    """Return ``trial`` with the measurements of a replay of its device with ``effects``."""
    device = parse_device((trial.device.content.decode() + effects).encode(), trial.device.name)
    motion = prepare_prescribed_motion(trial.prescribed, trial.name)
    time = np.arange(motion.start_time, motion.end_time, TIME_STEP)
    result = simulate_replay(device.parameters, build_replayed_foot(device), motion.interpolate(time), TIME_STEP)
    values = {"force": result.tension, "ankle_angle": result.ankle_angle, "muscle_length": result.length}
    return replace(trial, measured={name: TimeSeries(time, series) for name, series in values.items()})


@pytest.mark.parametrize(
    "seconds", [-0.02, *(pytest.param(seconds, marks=pytest.mark.slow) for seconds in (0.015, 0.05, 0.3))]
)
@pytest.mark.parametrize(
    "channels", [("force", "ankle_angle"), pytest.param(("force", "muscle_length"), marks=pytest.mark.slow)]
)
def test_delay_of_the_plate_is_measured(walk: Trial, seconds: float, channels: tuple[str, ...]) -> None:
    (finding,) = find_recording_mistakes([keep(delay(walk, seconds), *channels)])
    found = estimate_clock_delay(MeasuredTrial(keep(delay(walk, seconds), *channels)))
    assert found is not None
    assert found.plate_delay == pytest.approx(seconds, abs=0.002)
    assert tuple(found.unexplained) == channels
    assert finding.name == "plate-delay"
    direction = "late" if seconds > 0.0 else "early"
    assert (
        f"{abs(1e3 * found.plate_delay):.0f} ms {direction} against {channels[0]} and {channels[1]}" in finding.sentence
    )


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.04, -0.03])
def test_late_log_is_no_early_plate(walk: Trial, seconds: float) -> None:
    (finding,) = find_recording_mistakes([delay(walk, seconds, LOG_CHANNELS)])
    found = estimate_clock_delay(MeasuredTrial(delay(walk, seconds, LOG_CHANNELS)))
    assert found is not None
    assert found.log_delay == pytest.approx(seconds, abs=0.002)
    assert finding.name == "log-delay"
    size, direction = f"{1e3 * found.log_delay:.0f} ms", "late" if seconds > 0.0 else "early"
    assert f"is {size.removeprefix('-')} {direction} against the motion and the force plate" in finding.statement
    assert f"state '{size}' for each of pressure_command, " in finding.statement
    assert f"or {-found.log_delay:.3f} for the file of the log under [clock]" in finding.statement


def test_both_remedies_are_named_where_replays_do_not_tell_the_clocks_apart(walk: Trial) -> None:
    """Here both clocks differ from that of the motion."""
    (finding,) = find_recording_mistakes([delay(delay(walk, 0.015), -0.01, LOG_CHANNELS)])
    assert finding.name == "plate-delay"
    for part in (
        "ms late against force and ankle_angle, or the log of the device is",
        "do not tell apart",
        "if motion and plate have one clock, state '-",
        "ms' for each of pressure_command, ",
        "ms' for each of grf_vertical, grf_forward and cop_x under [delay]",
    ):
        assert part in finding.statement, finding.statement


def test_trials_of_one_clock_decide_together() -> None:
    def make(plate: float, log: float) -> ClockDelay:
        return ClockDelay(-0.03, 0.03, {"force": UnexplainedShares(0.1, plate, log)})

    for shares, clock in (
        ([(0.01, 0.002)], "log"),
        ([(0.01, 0.005), (0.01, 0.001)], "log"),
        ([(0.01, 0.005)], "unknown"),
        ([(0.01, 0.002), (0.002, 0.01)], "unknown"),
        ([(0.002, 0.01)], "plate"),
    ):
        assert clock_delay.identify_clock([make(*each) for each in shares]) == clock


@pytest.mark.parametrize(
    ("delays", "advice"),
    [
        ({}, "state '20 ms' for each of grf_vertical, grf_forward and cop_x under [delay]"),
        (
            dict.fromkeys(PLATE_CHANNELS, 0.04),
            "state '60 ms' for each of grf_vertical, grf_forward and cop_x in place of the delay stated now",
        ),
        (
            {"grf_vertical": 0.04, "grf_forward": 0.04},
            "state grf_vertical = '60 ms', grf_forward = '60 ms', cop_x = '20 ms' in place",
        ),
    ],
)
def test_stated_delay_is_part_of_the_advice(walk: Trial, delays: Mapping[str, float], advice: str) -> None:
    (finding,) = find_recording_mistakes([replace(delay(walk, 0.02), delays=delays)])
    assert advice in finding.statement


@pytest.mark.parametrize("seconds", [0.0, -0.006, 0.006])
def test_delay_that_the_registration_fits_is_accepted(walk: Trial, seconds: float) -> None:
    assert abs(seconds) < MIN_DELAY
    assert find_recording_mistakes([delay(walk, seconds)]) == []


@pytest.mark.slow
def test_late_instrument_is_no_plate(walk: Trial) -> None:
    assert estimate_clock_delay(MeasuredTrial(delay(walk, 0.03, ("force",)))) is None
    assert estimate_clock_delay(MeasuredTrial(delay(walk, 0.03, ("ankle_angle",)))) is None


@pytest.mark.slow
def test_single_channel_shows_a_late_plate_only(walk: Trial) -> None:
    """A filter of the encoder makes the plate look early."""
    alone = keep(walk, "ankle_angle")
    found = estimate_clock_delay(MeasuredTrial(delay(alone, 0.03)))
    assert found is not None
    assert found.plate_delay == pytest.approx(0.03, abs=0.003)
    assert estimate_clock_delay(MeasuredTrial(delay(alone, -0.03))) is None
    assert estimate_clock_delay(MeasuredTrial(keep(delay(walk, 0.03), "pressure"))) is None


@pytest.mark.parametrize(
    "effects",
    [
        '[effects.ankle_friction]\nform = "coulomb"\nmoment_n_m = 10.0\n',
        '[effects.ankle_friction]\nform = "viscous"\ndamping_n_m_s = 5.0\n',
        '[effects.pressure_lag]\nform = "first_order"\ntime_constant_s = 0.05\n',
        '[effects.seal_friction]\nform = "coulomb"\nforce_n = 60.0\n',
    ],
)
def test_dissipation_of_the_device_is_no_delay(walk: Trial, effects: str) -> None:
    assert find_recording_mistakes([imitate(walk, "\n" + effects)]) == []


def test_absolute_pressures_are_named(walk: Trial) -> None:
    absolute = change(walk, dict.fromkeys(PRESSURES, (0.0, ATMOSPHERE)))
    findings = find_recording_mistakes([absolute, absolute])
    assert [finding.name for finding in findings] == 2 * ["pressure-absolute", "pressure_command-absolute"]
    assert "subtract 1.013 bar from it" in findings[0].sentence
    without_force = keep(absolute, "ankle_angle", "pressure")
    assert {finding.name for finding in find_recording_mistakes([without_force])} == {
        "pressure-absolute",
        "pressure_command-absolute",
    }


def test_gauge_pressures_are_accepted(walk: Trial) -> None:
    """Neither high gauge pressures nor trials that differ are absolute pressures."""
    assert find_recording_mistakes([walk]) == []
    absolute = change(walk, dict.fromkeys(PRESSURES, (0.0, ATMOSPHERE)))
    assert find_recording_mistakes([absolute, walk]) == []
    lifted = change(walk, {"pressure_command": (0.0, ATMOSPHERE)})
    assert find_recording_mistakes([replace(imitate(lifted, ""), prescribed=lifted.prescribed)]) == []


def test_stated_delay_and_accepted_finding_load(folder: Path, tmp_path: Path) -> None:
    text = (folder / "dataset.toml").read_text("utf-8")
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
        if file.name.endswith("_load.csv"):
            heading, *rows = file.read_text("utf-8").splitlines()
            cells = [row.split(",") for row in rows]
            shifted = [",".join([f"{float(row[0]) + 0.04:.6f}", *row[1:]]) for row in cells]
            (tmp_path / file.name).write_text("\n".join([heading, *shifted]) + "\n", "utf-8")
    # The file of the plate holds the sensors, too: the encoder of the other file is early, not the plate late.
    ks.load_dataset(tmp_path)
    sensors = "".join(f'{name} = "40 ms"\n' for name in ("force", "pressure", "muscle_length"))
    (tmp_path / "dataset.toml").write_text(text + f"\n[delay]\n{sensors}", "utf-8")
    with pytest.raises(ImplausibleInputError, match="plate is 40 ms late against force and ankle_angle") as error:
        ks.load_dataset(tmp_path)
    assert "\n" not in str(error.value)
    assert ks.load_dataset(tmp_path, accept=["plate-delay"]).accepted
    plate = "".join(f'{name} = "0.04 s"\n' for name in PLATE_CHANNELS)
    (tmp_path / "dataset.toml").write_text(text + f"\n[delay]\n{sensors}{plate}", "utf-8")
    (first, *_), (expected, *_) = (ks.load_dataset(path).trials for path in (tmp_path, folder))
    for name in PLATE_CHANNELS:
        assert first.prescribed[name].time == pytest.approx(expected.prescribed[name].time, abs=1e-6)
