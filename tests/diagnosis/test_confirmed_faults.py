"""Faults of instruments that validation trials confirm, where repeats do not show that something is missing."""

from collections.abc import Iterator

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from tests.diagnosis.synthetic_dataset import make_repeats

GAIN, FRICTION = EffectTerm("sensor_gain", "linear", "force"), EffectTerm("seal_friction", "coulomb")


@pytest.fixture
def search() -> Iterator[ForwardSelection]:
    simulator = Simulator(1)
    noise = {"force": Noise(3.0, (Autocorrelation(0.005, 1.0, 200),))}
    yield ForwardSelection(WeightedData(simulator, make_repeats([np.linspace(0.0, 500.0, 100)] * 2), noise), [], [])
    simulator.close()


def make_fit(search: ForwardSelection, terms: tuple[EffectTerm, ...], chi2: float, misfit: float = 0.0) -> Fit:
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (), terms)
    x = np.full(len(hypothesis.parameters), 0.1)
    rng = np.random.default_rng(2)
    residuals = [
        {name: misfit + 3.0 * rng.standard_normal(len(series.time)) for name, series in e.measured.items()}
        for e in search.data.experiments
    ]
    return Fit(hypothesis, x, np.array([np.sqrt(chi2)]), np.ones((1, len(x))), True, residuals)


def explain_rejection(
    search: ForwardSelection, monkeypatch: pytest.MonkeyPatch, term: EffectTerm, before: float, fall: float, **options
) -> str:
    """Return why ``term`` is rejected if chi squared of validation trials falls from ``before`` by ``fall``."""
    chi2 = {"v": [before, before - fall]}
    monkeypatch.setattr(ForwardSelection, "compute_validation_chi2", lambda self, *fits: chi2)
    base, after = make_fit(search, (), 300.0, **options), make_fit(search, (term,), 250.0)
    return search.rejection_reason(base, after, search.compute_validation_gains(base, after))


@pytest.mark.parametrize(
    ("term", "before", "fall", "is_named"),
    [
        pytest.param(GAIN, 180.0, 13.0, True, id="a fault that is confirmed"),
        pytest.param(GAIN, 180.0, 11.0, False, id="too little"),
        pytest.param(GAIN, 400.0, 13.0, False, id="less than 5 %"),
        pytest.param(FRICTION, 180.0, 13.0, False, id="an effect of the device"),
        pytest.param(FRICTION, 100.0, 11.0, True, id="more than 10 %"),
    ],
)
def test_fault_of_an_instrument_is_named_where_validation_trials_confirm_it(
    term: EffectTerm,
    before: float,
    fall: float,
    is_named: bool,
    search: ForwardSelection,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A gauge that was 1 ms late, twice the noise where pressures change, was not named."""
    reason = explain_rejection(search, monkeypatch, term, before, fall)
    assert (reason == "") is is_named
    assert is_named or "improve by no more than 10 %" in reason


def test_fault_needs_less_where_repeats_show_a_misfit(
    search: ForwardSelection, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert explain_rejection(search, monkeypatch, GAIN, 180.0, 11.0, misfit=6.0) == ""


def test_walk_does_not_confirm_a_fault(search: ForwardSelection, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(search.data.experiments[0]), "has_body", property(lambda self: True))
    assert "improve by no more than 10 %" in explain_rejection(search, monkeypatch, GAIN, 180.0, 13.0)


def test_without_repeats_the_noise_is_not_known_well_enough(
    search: ForwardSelection, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = ForwardSelection(search.data, [], [], has_repeats=False)
    monkeypatch.setattr(alone, "has_misfit", lambda fit: False)
    assert "improve by no more than 10 %" in explain_rejection(alone, monkeypatch, GAIN, 180.0, 13.0)
