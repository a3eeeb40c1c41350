"""A number that is wrong by more than is plausible does not stand before an equivalent model without one."""

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
from klute_sim.diagnosis.selection import robustness
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.naming import MAX_NUMBER_SIGMAS, find_implausible_number
from klute_sim.diagnosis.selection.robustness import EquivalentModel, select_final_fit
from tests.diagnosis.synthetic_dataset import make_repeats

TEMPERATURE = EffectTerm("number_error", "value", number="supply.gas_temperature_c")
RATE = EffectTerm("number_error", "value", number="supply.rate_bar_per_s")
VOLUME = EffectTerm("number_error", "value", number="supply.dead_volume_cm3")
FRICTION = EffectTerm("seal_friction", "coulomb")


def make_fit(*terms: EffectTerm, sigmas: float) -> Fit:
    """Return a fit of ``terms`` whose parameters are ``sigmas`` plausible errors or typical sizes."""
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (("force", 3.0),), terms)
    x = np.full(len(hypothesis.parameters), sigmas)
    return Fit(hypothesis, x, np.zeros(1), np.ones((1, len(x))), True, [])


@pytest.fixture
def search() -> Iterator[ForwardSelection]:
    noise = {"force": Noise(3.0, (Autocorrelation(0.005, 1.0, 200),))}
    simulator = Simulator(1)
    yield ForwardSelection(WeightedData(simulator, make_repeats([np.zeros(100)] * 2), noise), [], [])
    simulator.close()


def test_number_is_implausible_beyond_three_plausible_errors() -> None:
    assert find_implausible_number(make_fit(TEMPERATURE, sigmas=0.99 * MAX_NUMBER_SIGMAS)) is None
    for sigmas in (4.0, -4.0):
        assert find_implausible_number(make_fit(TEMPERATURE, FRICTION, sigmas=sigmas)) == (TEMPERATURE, 4.0)
    assert find_implausible_number(make_fit(FRICTION, sigmas=5.0)) is None
    # Data do not show how much faster a supply is.
    assert find_implausible_number(make_fit(RATE, sigmas=5.0)) is None
    assert find_implausible_number(make_fit(RATE, sigmas=-5.0)) == (RATE, 5.0)


@pytest.mark.parametrize(
    ("sigmas", "rival_sigmas", "difference", "has_misfit", "first"),
    [
        (4.0, 0.3, 4.0, False, VOLUME),
        (4.0, 3.5, 4.0, False, TEMPERATURE),
        (2.0, 0.3, 4.0, False, TEMPERATURE),
        (4.0, 0.3, 12.0, False, TEMPERATURE),
        (4.0, 0.3, 4.0, True, TEMPERATURE),
    ],
    ids=["implausible", "both are implausible", "plausible", "rival explains less", "rival leaves a misfit"],
)
def test_plausible_model_stands_before_an_implausible_number(
    sigmas: float,
    rival_sigmas: float,
    difference: float,
    has_misfit: bool,
    first: EffectTerm,
    search: ForwardSelection,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    temperature, volume = make_fit(TEMPERATURE, sigmas=sigmas), make_fit(VOLUME, sigmas=rival_sigmas)
    others = {TEMPERATURE: EquivalentModel(volume, difference), VOLUME: EquivalentModel(temperature, -difference)}
    monkeypatch.setattr(robustness, "refine_and_simplify", lambda search, fit, rng: (fit, True))
    monkeypatch.setattr(robustness, "find_equivalent_models", lambda search, fit: [others[fit.hypothesis.terms[-1]]])
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: has_misfit and fit is volume)
    fit, _, (rival,) = select_final_fit(search, temperature, 0, lambda *_: None)
    assert fit.hypothesis.terms == (first,)
    assert {fit.hypothesis.terms[0], rival.fit.hypothesis.terms[0]} == {TEMPERATURE, VOLUME}
