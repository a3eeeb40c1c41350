"""Delays of instruments that are named: long ones, and shorter ones that leave nothing to explain."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.naming import find_naming_obstacle
from tests.diagnosis.synthetic_dataset import make_repeats

NOISE_STD = 3.0
LAG, SKEW = EffectTerm("sensor_lag", "first_order", "force"), EffectTerm("clock_skew", "linear", "force")


@pytest.fixture
def data() -> Iterator[WeightedData]:
    noise = {"force": Noise(NOISE_STD, (Autocorrelation(0.005, 1.0, 200),))}
    simulator = Simulator(1)
    yield WeightedData(simulator, make_repeats([np.linspace(0.0, 500.0, 100)] * 2), noise)
    simulator.close()


def make_fit(data: WeightedData, *terms: EffectTerm, misfit: float = NOISE_STD, **values: float) -> Fit:
    """Return a fit of ``terms`` with ``values``, whose force is off by ``misfit`` [N] in all repeats."""
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (), terms)
    x = np.array([p.normalize(values[p.name]) for p in hypothesis.parameters])
    rng = np.random.default_rng(1)
    residuals = [
        {name: misfit + NOISE_STD * rng.standard_normal(len(series.time)) for name, series in e.measured.items()}
        for e in data.experiments
    ]
    return Fit(hypothesis, x, np.zeros(1), np.ones((1, len(x))), True, residuals)


def get_interval(data: WeightedData) -> float:
    return float(np.median(np.diff(data.experiments[0].measured["force"].time)))


@pytest.mark.parametrize(
    ("lag_intervals", "shift_intervals", "expected"),
    [
        pytest.param(1.0, -0.75, "together with the other delay", id="nearly cancel"),
        pytest.param(1.0, 0.75, "", id="add up"),
        pytest.param(2.0, -0.75, "", id="leave more than half a sample"),
        pytest.param(0.3, 1.0, "is shorter than half a sampling interval", id="one is too short"),
    ],
)
def test_delays_of_a_channel_are_named_only_if_their_sum_shows(
    lag_intervals: float, shift_intervals: float, expected: str, data: WeightedData
) -> None:
    """A lag of 5 ms and a clock that is 3.7 ms early were named for a lag of 1.2 ms in a log of 200 Hz."""
    interval = get_interval(data)
    fit = make_fit(data, LAG, SKEW, time_constant_s=lag_intervals * interval, shift_s=shift_intervals * interval)
    obstacle = find_naming_obstacle(data, fit)
    assert (expected in obstacle) if expected else not obstacle


def test_delay_of_a_slow_channel_is_judged_by_its_own_samples(data: WeightedData) -> None:
    """Markers at 200 Hz beside a load cell at 1 kHz do not resolve a lag of 1 ms."""
    slow = get_interval(data)
    fine = np.arange(400) * 0.2 * slow
    experiments = [
        replace(e, measured={**e.measured, **{name: TimeSeries(fine, 0.0 * fine) for name in ("pressure", "length")}})
        for e in data.experiments
    ]
    mixed = WeightedData(data.simulator, experiments, data.noise)
    for lag, is_named in ((0.2 * slow, False), (0.6 * slow, True)):
        fit = make_fit(mixed, LAG, time_constant_s=lag)
        assert (find_naming_obstacle(mixed, fit) == "") is is_named


@pytest.mark.parametrize(
    ("lag_intervals", "misfit", "has_law_error", "n_trials", "expected"),
    [
        pytest.param(0.3, 0.0, False, 2, "", id="explains the data to the noise"),
        pytest.param(0.3, NOISE_STD, False, 2, "shorter than half a sampling interval", id="leaves a misfit"),
        pytest.param(0.3, 0.0, True, 2, "shorter than half a sampling interval", id="imperfect law"),
        pytest.param(0.3, 0.0, False, 1, "shorter than half a sampling interval", id="no repeats"),
        pytest.param(0.05, 0.0, False, 2, "shorter than a tenth of a sampling interval", id="much too short"),
    ],
)
def test_short_delay_is_named_only_if_it_explains_the_data_to_the_noise(
    lag_intervals: float, misfit: float, has_law_error: bool, n_trials: int, expected: str, data: WeightedData
) -> None:
    """A load cell that was 2 ms late in a log of 200 Hz was not named, and a device without it was `unexplained`."""
    judged = replace(data, experiments=data.experiments[:n_trials], has_law_error=has_law_error)
    delay = lag_intervals * get_interval(data)
    for term in (LAG, SKEW):
        fit = make_fit(judged, term, misfit=misfit, time_constant_s=delay, shift_s=delay)
        obstacle = find_naming_obstacle(judged, fit)
        assert (expected in obstacle) if expected else not obstacle


@pytest.mark.parametrize(
    ("lag_intervals", "bic_fall", "is_named"),
    [
        pytest.param(0.3, 17.0, False, id="short, weak evidence"),
        pytest.param(0.3, 19.0, True, id="short, strong evidence"),
        pytest.param(0.6, 7.0, True, id="as long as half an interval"),
    ],
)
def test_short_delay_needs_stronger_evidence(
    lag_intervals: float, bic_fall: float, is_named: bool, data: WeightedData
) -> None:
    """A lag of 0.7 ms in a log of 200 Hz, with a fall of 10, completed a tendon whose law was not exact."""
    after = make_fit(data, LAG, misfit=0.0, time_constant_s=lag_intervals * get_interval(data))
    before = make_fit(data, misfit=0.0)
    chi2 = after.chi2 + after.bic(data.n_effective) - before.bic(data.n_effective) + bic_fall
    before = replace(before, weighted_residuals=np.array([np.sqrt(chi2)]))
    reason = ForwardSelection(data, [], []).rejection_reason(before, after, {"g": 0.5})
    assert (reason == "") is is_named
    assert is_named or ("errors between samples" in reason and "a fall of more than 18 is required" in reason)
