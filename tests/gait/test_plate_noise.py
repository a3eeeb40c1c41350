"""A force plate that is noisy, or runs longer than the cameras: contacts, load and strides are those of the foot."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.foot_load import estimate_force_offset, estimate_plate_offset, find_loaded_samples
from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.gait import prepare_gait_trial
from klute_sim.diagnosis.recording_faults import describe_uncompared_channels
from klute_sim.gait.contacts import find_contacts
from klute_sim.gait.replay.prescribed import prepare_prescribed_motion
from klute_sim.plausibility.gait.positions import ScaledSeries, check_cop
from klute_sim.plausibility.gait.steps import Series, find_steps
from klute_sim.types import Array

DEVICE = load_device("klute-1-1-4-pair")
STRIDE_TIME, STANCE, DURATION, SPEED = 1.1, 0.62, 6.0, 1.2
STRIKES = STRIDE_TIME * np.arange(1.0, 6.0)
TIME = np.arange(0.0, DURATION, 1e-3)
PHASE = (TIME / STRIDE_TIME) % 1.0
LOAD = np.where(PHASE < STANCE, 800.0 * np.sqrt(np.maximum(np.sin(np.pi * PHASE / STANCE), 0.0)), 0.0)


def make_noise(deviation: float) -> Array:
    return np.random.default_rng(1).normal(0.0, deviation, len(TIME))


def make_channels(plate_noise: float = 0.0, *, camera_start: float = 0.0) -> dict[str, TimeSeries]:
    """Return the channels of a walk whose plate reads 0 as the centre of pressure while the foot is in the air."""
    stride = np.floor(TIME / STRIDE_TIME)
    ankle_x = 3.0 + SPEED * STRIDE_TIME * (stride + np.clip((PHASE - STANCE) / (1.0 - STANCE), 0.0, 1.0))
    values = {
        "shank_angle": 0.35 * np.sin(2.0 * np.pi * (PHASE - 0.3)),
        "ankle_x": ankle_x,
        "ankle_z": 0.09 + np.where(PHASE > STANCE, 0.1 * np.sin(np.pi * (PHASE - STANCE) / (1.0 - STANCE)), 0.0),
        "grf_vertical": LOAD + make_noise(plate_noise),
        "grf_forward": np.where(LOAD > 0.0, -0.2 * LOAD * np.cos(np.pi * PHASE / STANCE), 0.0)
        + make_noise(plate_noise),
        "cop_x": np.where(LOAD > 0.0, ankle_x - 0.04 + 0.2 * PHASE / STANCE, 0.0),
        "pressure_command": np.full_like(TIME, 1e5),
    }
    channels = {name: TimeSeries(TIME, series) for name, series in values.items()}
    is_filmed = camera_start <= TIME
    for name in ("shank_angle", "ankle_x", "ankle_z"):
        channels[name] = TimeSeries(TIME[is_filmed], values[name][is_filmed])
    return channels


def make_trial(channels: dict[str, TimeSeries]) -> Trial:
    force = TimeSeries(TIME, 100.0 + LOAD)
    return Trial(
        name="walk",
        group="walk",
        use="fit",
        device=DEVICE,
        files=(Path("walk.csv"),),
        prescribed=channels,
        measured={"force": force},
    )


@pytest.mark.parametrize("deviation", [2.0, 5.0, 10.0, 20.0])
def test_noise_of_the_plate_is_no_contact(deviation: float) -> None:
    """White noise exceeds 20 N in a hundredth of the samples of swing, or in a sixth of them."""
    found = find_contacts(TIME, LOAD + make_noise(deviation))
    assert [contact.foot_strike for contact in found][1:] == pytest.approx(STRIKES, abs=0.01)
    assert [contact.toe_off for contact in found][:-1] == pytest.approx(
        STRIKES - (1.0 - STANCE) * STRIDE_TIME, abs=0.01
    )


def test_vibration_of_a_treadmill_is_no_contact() -> None:
    shaken = LOAD + 30.0 * np.sin(2.0 * np.pi * 12.0 * TIME)
    assert [c.foot_strike for c in find_contacts(TIME, shaken)][1:] == pytest.approx(STRIKES, abs=0.01)


def test_spike_of_the_plate_hides_no_contact() -> None:
    load = LOAD.copy()
    load[1500] = 1e5
    assert len(find_contacts(TIME, load)) == len(find_contacts(TIME, LOAD))
    assert not find_loaded_samples(np.zeros(10)).any()


@pytest.mark.parametrize("offset", [-60.0, -25.0, 15.0, 25.0, 150.0])
@pytest.mark.parametrize("deviation", [0.0, 5.0, 20.0])
def test_offset_is_what_the_plate_reads_in_swing(offset: float, deviation: float) -> None:
    noise = make_noise(deviation)
    assert estimate_force_offset(LOAD + noise + offset) == pytest.approx(offset, abs=0.05 * deviation)
    forward = 0.1 * LOAD + 0.2 * offset
    assert estimate_plate_offset(LOAD + noise, forward).forward == pytest.approx(0.2 * offset, abs=1e-9)
    assert [c.foot_strike for c in find_contacts(TIME, LOAD + noise + offset)][1:] == pytest.approx(STRIKES, abs=0.01)


def test_load_of_a_standing_person_is_no_offset() -> None:
    sway = 400.0 + 30.0 * np.sin(2.0 * np.pi * 0.3 * TIME) + make_noise(5.0)
    assert estimate_force_offset(sway) == 0.0
    assert estimate_force_offset(LOAD[LOAD > 0.0] + 30.0) == 0.0
    assert estimate_force_offset(np.full(5, np.nan)) == 0.0


def test_missing_samples_end_no_contact() -> None:
    """A gap of 150 ms in stance begins no step."""
    load = LOAD.copy()
    load[1300:1450] = np.nan
    assert [c.foot_strike for c in find_contacts(TIME, load)][1:] == pytest.approx(STRIKES, abs=0.01)
    assert find_contacts(TIME, np.full_like(TIME, np.nan)) == []


@pytest.mark.parametrize("deviation", [2.0, 20.0])
def test_nothing_loads_the_foot_in_the_air(deviation: float) -> None:
    """Noise of the forces times the height of the ankle, or times a centre of pressure of 0, is no moment."""
    motion = prepare_prescribed_motion(make_channels(deviation), "walk")
    expected = prepare_prescribed_motion(make_channels(), "walk")
    in_air = (PHASE > STANCE + 0.02) & (PHASE < 0.98)
    for series in (motion.ground_moment, motion.axial_force, motion.shear_force, motion.vertical_load):
        assert not series.value[in_air].any()
    difference = motion.ground_moment.value - expected.ground_moment.value
    assert np.abs(difference).max() < 0.6 * 5.0 * deviation


@pytest.mark.parametrize("deviation", [0.0, 5.0, 10.0, 20.0])
def test_strides_and_compared_samples_do_not_depend_on_noise_of_the_plate(deviation: float) -> None:
    walk = prepare_gait_trial(make_trial(make_channels(deviation)), "fit")
    clean = prepare_gait_trial(make_trial(make_channels()), "fit")
    assert walk.foot_strikes == pytest.approx(STRIKES, abs=0.01)
    assert walk.mean_stride_time == pytest.approx(STRIDE_TIME, abs=0.01)
    assert len(walk.measured["force"].time) == pytest.approx(len(clean.measured["force"].time), rel=0.02)


def test_short_touch_in_swing_is_no_stride() -> None:
    """A scuff of 200 N for 30 ms is replayed, but the stride lasts from one step to the next."""
    channels = make_channels()
    touch = np.where((TIME > 1.95) & (TIME < 1.98), 200.0, 0.0)
    channels["grf_vertical"] = TimeSeries(TIME, LOAD + touch)
    walk = prepare_gait_trial(make_trial(channels), "fit")
    assert walk.foot_strikes == pytest.approx(STRIKES, abs=0.01)
    assert walk.load.vertical[round(1.96 / walk.dt)] == pytest.approx(200.0)


def test_strides_begin_with_the_cameras() -> None:
    """Repeats are aligned stride by stride, so a plate that records longer must not count earlier steps."""
    walk = prepare_gait_trial(make_trial(make_channels(camera_start=2.5)), "fit")
    assert walk.start_time == pytest.approx(2.5)
    expected = prepare_gait_trial(make_trial(make_channels()), "fit")
    inside = slice(round(2.6 / walk.dt), None)
    assert walk.inputs.ground_moment[200:] == pytest.approx(expected.inputs.ground_moment[inside], abs=0.2)
    assert walk.foot_strikes + walk.start_time == pytest.approx(STRIKES[STRIKES > 2.5], abs=0.01)


def test_plate_that_records_longer_than_the_cameras_is_plausible() -> None:
    """Where the position of the ankle is unknown, the centre of pressure is compared with nothing."""
    channels = make_channels(camera_start=2.5)
    vertical, x = (Series(*channels[name]) for name in ("grf_vertical", "ankle_x"))
    cop = ScaledSeries("cop_x", Series(*channels["cop_x"]), "m", 1.0)
    assert check_cop(cop, x, vertical, find_steps(vertical), "walk")[0] == []


def test_log_that_ends_before_the_compared_times_is_not_used() -> None:
    """Its channels are left out and reported; the first half a second of a trial is not compared."""
    trial = make_trial(make_channels())
    short = {"force": TimeSeries(TIME[:400], LOAD[:400]), "ankle_angle": TimeSeries(TIME, 0.1 * np.sin(TIME))}
    trial = replace(trial, measured=short)
    walk = prepare_gait_trial(trial, "fit")
    assert list(walk.measured) == ["ankle_angle"]
    (sentence,) = describe_uncompared_channels([trial], [walk])
    assert sentence.startswith("'force' is not used in 1 of 1 trials, such as 'walk': it has no samples")
