"""Low-pass filters that the noise of repeats shows."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from klute_sim.diagnosis.experiments.low_pass import LowPassFilter
from klute_sim.diagnosis.noise.filtered_noise import _add_filters, detect_low_pass_filters
from tests.diagnosis.filtered_signals import RATE_HZ, REVERSALS, TIME, amplify, filter_twice, make_noise
from tests.diagnosis.synthetic_dataset import make_repeats


def detect(*forces: np.ndarray) -> LowPassFilter | None:
    """Return the filter that pairs of repeats show."""
    differences = [(TIME, one - other) for one, other in zip(forces[::2], forces[1::2], strict=True)]
    return next((f["force"] for f in detect_low_pass_filters({"force": differences}, {"force": RATE_HZ})), None)


def measure_cutoff(*forces: np.ndarray) -> float:
    found = detect(*forces)
    assert found is not None
    return found.cutoff


@pytest.mark.slow
@settings(max_examples=4, deadline=None)
@given(st.floats(8.0, 60.0), st.integers(2, 4), st.integers(0, 1000))
def test_noise_shows_the_filter(cutoff: float, order: int, seed: int) -> None:
    forces = [filter_twice(REVERSALS + make_noise(6 * seed + k), cutoff, order) for k in range(6)]
    assert measure_cutoff(*forces) == pytest.approx(cutoff, rel=0.12)


def test_noise_of_a_sensor_with_a_lag_shows_the_filter() -> None:
    forces = [filter_twice(lfilter([0.12], [1.0, -0.88], make_noise(k)), 10.0, 2) for k in range(2)]  # 10 Hz
    assert measure_cutoff(*forces) == pytest.approx(10.0, rel=0.2)


def test_channels_with_the_same_filter_show_it_together() -> None:
    pairs = {
        name: [filter_twice(make_noise(10 * number + k), 10.0, 2) for k in range(2)]
        for number, name in enumerate(("force", "pressure", "muscle_length"))
    }
    differences = {name: [(TIME, one - other)] for name, (one, other) in pairs.items()}
    filters, *_ = detect_low_pass_filters(differences, dict.fromkeys(pairs, RATE_HZ))
    assert filters.keys() == pairs.keys()
    assert len(set(filters.values())) == 1
    assert filters["force"].cutoff == pytest.approx(10.0, rel=0.05)


def test_channel_without_filter_gets_none_beside_others() -> None:
    forces = [filter_twice(make_noise(k), 10.0, 2) for k in range(2)]
    pressures = [filter_twice(lfilter([0.06], [1.0, -0.94], make_noise(k)), 10.0, 2) for k in range(2, 4)]  # 5 Hz
    lengths = [make_noise(k) for k in range(4, 6)]
    pairs = {"force": forces, "pressure": pressures, "muscle_length": lengths}
    differences = {name: [(TIME, one - other)] for name, (one, other) in pairs.items()}
    filters, *_ = detect_low_pass_filters(differences, dict.fromkeys(pairs, RATE_HZ))
    assert filters.keys() == {"force", "pressure"}


@pytest.mark.slow
def test_channels_with_other_filters_have_their_own() -> None:
    forces, pressures = ([filter_twice(make_noise(k), cutoff, 2) for k in range(2)] for cutoff in (6.0, 20.0))
    differences = {"force": [(TIME, forces[0] - forces[1])], "pressure": [(TIME, pressures[0] - pressures[1])]}
    filters, *_ = detect_low_pass_filters(differences, dict.fromkeys(differences, RATE_HZ))
    assert filters["force"].cutoff == pytest.approx(6.0, rel=0.15)
    assert filters["pressure"].cutoff == pytest.approx(20.0, rel=0.15)


def test_last_digits_behind_the_filter_change_nothing() -> None:
    forces = [np.round(filter_twice(REVERSALS + make_noise(k), 10.0, 4), 2) for k in range(2)]
    assert measure_cutoff(*forces) == pytest.approx(10.0, rel=0.05)


@pytest.mark.parametrize(
    ("kind", "order"), [("butterworth", 4), pytest.param("butterworth", 8, marks=pytest.mark.slow), ("bessel", 6)]
)
@pytest.mark.parametrize("cutoff", [pytest.param(8.0, marks=pytest.mark.slow), 30.0])
def test_noise_shows_the_filter_of_an_amplifier(kind: str, order: int, cutoff: float) -> None:
    found = detect(*(amplify(REVERSALS + make_noise(k), cutoff, order, kind) for k in range(6)))
    assert found is not None
    true = LowPassFilter(cutoff, order, RATE_HZ, "bessel" if kind == "bessel" else "butterworth")
    assert found.has_delay
    assert found.delay == pytest.approx(true.delay, rel=0.1)
    assert found.cutoff == pytest.approx(cutoff, rel=0.1)


def test_filter_without_clear_evidence_has_no_delay() -> None:
    pair = [filter_twice(make_noise(k), 5.0, 4)[::2] for k in range(2)]
    filters, *others = detect_low_pass_filters({"force": [(TIME[::2], pair[0] - pair[1])]}, {"force": RATE_HZ / 2.0})
    assert not filters["force"].has_delay
    assert others
    assert all(other["force"].has_delay for other in others)


@pytest.mark.parametrize(
    "change",
    [
        lambda force: force,
        lambda force: filter_twice(force, 0.8 * RATE_HZ / 2.0, 4),
        lambda force: lfilter([0.06], [1.0, -0.94], force),
        lambda force: REVERSALS + np.cumsum(force - REVERSALS) / 20.0,
        lambda force: filter_twice(force, 10.0, 4) + make_noise(int(abs(force[1]))),
        lambda force: np.full(len(TIME), 3.0),
    ],
    ids=["white", "near half the sampling rate", "lag of first order", "random walk", "noise behind", "constant"],
)
def test_other_noise_shows_no_filter(change: Callable[[np.ndarray], np.ndarray]) -> None:
    assert detect(*(change(REVERSALS + make_noise(k)) for k in range(2))) is None


def test_record_shorter_than_the_ends_of_its_filter_is_left_out() -> None:
    trials = [make_repeats([np.linspace(0.0, 500.0, n)])[0] for n in (2000, 100)]
    long, short = (_add_filters(e, {"force": LowPassFilter(2.0, 2, RATE_HZ)}) for e in trials)
    assert trials[1].measured["force"].time[-1] < 2.0 * short.filters["force"].end_time
    assert not short.measured
    assert 2 <= len(long.measured["force"].time) < 2000


def test_short_records_show_no_filter() -> None:
    forces = [filter_twice(make_noise(k), 60.0, 4)[:100] for k in range(2)]
    assert detect_low_pass_filters({"force": [(TIME[:100], forces[0] - forces[1])]}, {"force": RATE_HZ}) == []
    assert detect_low_pass_filters({"force": []}, {"force": RATE_HZ}) == []
