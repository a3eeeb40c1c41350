"""Resampling over phase and time: exact for linear channels, with missing values where nothing was measured."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.comparison.alignment import resample
from klute_sim.comparison.alignment.resample import (
    PHASE_GRID,
    find_strides,
    make_common_time,
    resample_phase,
    resample_time,
)
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording


def make_gait(
    begin: float = 0.0, end: float = 300.0, interval: float = 0.7, *, numbered: bool = False, duration: float = 1.1
) -> Recording:
    """Return strides of ``duration`` [s] from ``begin`` to ``end`` [%] (100 per stride), at steps of ``interval``."""
    along = np.arange(begin, end, interval)
    phase = along % 100.0
    columns = [("time [s]", duration * along / 100.0), ("gait_phase [%]", phase)]
    if numbered:
        columns.append(("stride [1]", along // 100.0 + 1.0))
    return Recording.from_columns([*columns, ("line [m]", 2.0 * along - 3.0), ("saw [m]", 0.5 * phase + 1.0)])


@given(st.floats(0.05, 1.9), st.floats(0.0, 0.9), st.booleans())
def test_linear_channel_is_exact_over_phase(interval: float, begin: float, numbered: bool) -> None:
    recording = make_gait(begin * interval, 300.0, interval, numbered=numbered)
    strides = find_strides(recording, "r")
    assert [stride.number for stride in strides] == [1, 2, 3]
    for number, stride in enumerate(strides):
        assert stride.is_complete
        values = resample_phase(recording, stride, "line")
        assert values == pytest.approx(2.0 * (100.0 * number + PHASE_GRID) - 3.0, abs=1e-9)


def test_samples_on_grid_are_unchanged() -> None:
    recording = make_gait(0.0, 200.0, 0.5)
    values = np.sin(np.arange(len(recording)) ** 2.0)
    recording = Recording({**recording.channels, "x": values}, {**recording.units, "x": "m"})
    first, _ = find_strides(recording, "r")
    assert resample_phase(recording, first, "x")[:100].tolist() == values[0:200:2].tolist()


def test_strides_are_separated_by_number_or_phase() -> None:
    for numbered in (False, True):
        strides = find_strides(make_gait(40.0, 250.0, 1.0, numbered=numbered), "r")
        assert [(s.first_phase, s.last_phase, s.is_complete) for s in strides] == [
            (40.0, 99.0, False),
            (0.0, 99.0, True),
            (0.0, 49.0, False),
        ]


def test_stride_ending_at_100_percent_excludes_next_heel_strike() -> None:
    phase = np.tile(np.linspace(0.0, 100.0, 51), 2)
    value = np.concatenate([phase[:51], 500.0 + phase[51:]])
    time = np.concatenate([np.linspace(0.0, 1.0, 51), np.linspace(1.02, 2.02, 51)])
    recording = Recording.from_columns([("time [s]", time), ("gait_phase [%]", phase), ("x [m]", value)])
    first, second = find_strides(recording, "r")
    assert resample_phase(recording, first, "x") == pytest.approx(PHASE_GRID)
    assert resample_phase(recording, second, "x") == pytest.approx(500.0 + PHASE_GRID)


def test_samples_after_a_gap_are_not_neighbours() -> None:
    whole = make_gait(0.5, 200.5, 1.0)
    later = np.arange(200) >= 100
    time = whole["time"] + 5.0 * later
    line = np.where(later, 1e3, whole["gait_phase"])
    recording = Recording({**whole.channels, "time": time, "x": line}, {**whole.units, "x": "m"})
    first, second = find_strides(recording, "r")
    assert resample_phase(recording, first, "x") == pytest.approx(PHASE_GRID)  # the line goes on for one interval
    assert resample_phase(recording, second, "x") == pytest.approx(1e3)


def test_missing_samples_remain_missing() -> None:
    recording = make_gait(0.0, 100.0, 1.0)
    values = np.where((recording["gait_phase"] >= 30.0) & (recording["gait_phase"] < 40.0), np.nan, recording["saw"])
    recording = Recording({**recording.channels, "x": values}, {**recording.units, "x": "m"})
    (stride,) = find_strides(recording, "r")
    strides = resample_phase(recording, stride, "x")
    assert np.flatnonzero(np.isnan(strides)).tolist() == list(range(30, 40))
    hole = recording.select((recording["gait_phase"] < 50.0) | (recording["gait_phase"] > 70.0))
    (stride,) = find_strides(hole, "r")
    assert np.flatnonzero(np.isnan(resample_phase(hole, stride, "saw"))).tolist() == list(range(50, 71))


def test_short_gap_is_interpolated() -> None:
    recording = make_gait(0.0, 100.0, 1.0)
    recording = recording.select((recording["gait_phase"] < 50.0) | (recording["gait_phase"] > 55.0))
    (stride,) = find_strides(recording, "r")
    assert resample_phase(recording, stride, "saw") == pytest.approx(0.5 * PHASE_GRID + 1.0)


@pytest.mark.parametrize(
    ("phase", "unit", "message"),
    [
        ([0.0, 50.0, 40.0, 99.0], "1", "allowed: %"),
        ([0.0, np.nan, 40.0, 99.0], "%", "a missing sample or one outside 0 to 100 %"),
        ([0.0, 50.0, 101.0, 99.0], "%", "a missing sample or one outside 0 to 100 %"),
        ([0.0, 50.0, 50.0, 99.0], "%", "does not increase at 0.2 s, in stride 1"),
    ],
)
def test_invalid_phase_is_refused(phase: list[float], unit: str, message: str) -> None:
    columns = [("time [s]", np.arange(4) * 0.1), (f"gait_phase [{unit}]", np.array(phase))]
    with pytest.raises(InputError, match=f"^file r.*{message}"):
        find_strides(Recording.from_columns(columns), "file r")


def test_missing_phase_is_refused() -> None:
    with pytest.raises(InputError, match="has neither a column 'gait_phase"):
        find_strides(Recording.from_columns([("time [s]", np.arange(3.0))]), "r")


def clock(begin: float, end: float, step: float) -> Recording:
    time = np.arange(begin, end, step)
    return Recording.from_columns([("time [s]", time), ("line [N]", 5.0 - 4.0 * time)])


@given(st.floats(0.01, 0.1), st.floats(0.01, 0.1), st.floats(-0.5, 0.5))
def test_linear_channel_is_exact_over_time(interval: float, other_interval: float, delay: float) -> None:
    first, other = clock(0.0, 2.0, interval), clock(delay, 2.0 + delay, other_interval)
    axis = make_common_time([("a", first), ("b", other)])
    assert np.diff(axis[:-1]) == pytest.approx(max(interval, other_interval))
    assert axis[0] == max(0.0, delay)
    assert axis[-1] <= min(first["time"][-1], other["time"][-1])
    assert axis[-1] > min(first["time"][-1], other["time"][-1]) - 1.0001 * max(interval, other_interval)
    for recording in (first, other):
        assert resample_time(recording, "line", axis) == pytest.approx(5.0 - 4.0 * axis, abs=1e-9)


def test_values_outside_recording_are_missing() -> None:
    strides = resample_time(clock(0.0, 1.0, 0.1), "line", np.array([-0.01, 0.0, 0.9, 0.91]))
    assert np.isnan(strides).tolist() == [True, False, False, True]


def test_recordings_without_overlap_are_refused() -> None:
    with pytest.raises(InputError, match=r"a ends at 0.9 s and b begins at 5 s"):
        make_common_time([("a", clock(0.0, 1.0, 0.1)), ("b", clock(5.0, 6.0, 0.1))])
    with pytest.raises(InputError, match=r"overlap from 0.85 to 0.9 s, less than one sampling interval of 0.1 s"):
        make_common_time([("a", clock(0.0, 1.0, 0.1)), ("b", clock(0.85, 2.0, 0.1))])


def test_long_common_time_is_decimated() -> None:
    axis = make_common_time([("a", clock(0.0, 30.0, 0.0005)), ("b", clock(0.0, 30.0, 0.0005))])
    assert len(axis) == resample.MAX_TIME_POINTS
    assert axis[-1] == pytest.approx(29.9995)
