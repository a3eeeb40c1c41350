"""A registration that differs between conditions is told, and nothing else is taken for one."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest

from klute_sim.diagnosis.condition_registration import describe_condition_registration
from klute_sim.diagnosis.experiments.registration import REGISTRATION_DEVIATIONS
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from tests.diagnosis.synthetic_walk import DEVICE, make_walks


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    simulator = Simulator(1)
    yield simulator
    simulator.close()


def describe(simulator: Simulator, cop_errors: Sequence[float], effects: str = "") -> list[str]:
    """Return the remarks on walks in three conditions, whose centre of pressure is wrong by ``cop_errors`` [m]."""
    walks = []
    for walk in make_walks(amplitudes=(1.0, 0.8, 0.6), effects=effects):
        shift = cop_errors[int(walk.group)] * walk.load.vertical
        walks.append(replace(walk, inputs=walk.inputs._replace(ground_moment=walk.inputs.ground_moment + shift)))
    names = tuple(REGISTRATION_DEVIATIONS.items())
    hypothesis = Hypothesis(DEVICE, (), (), registration=names)
    (residuals,) = WeightedData(simulator, walks, {}).compute_residuals(hypothesis, [np.zeros(len(names))])
    data = WeightedData(simulator, walks, estimate_noise_from_repeats(walks, residuals))
    return describe_condition_registration(data, fit_hypothesis(data, hypothesis))


@pytest.mark.slow
def test_conditions_on_different_plates_are_told(simulator: Simulator) -> None:
    (sentence,) = describe(simulator, (0.012, -0.012, 0.0))
    found = re.findall(r"in '(\d)' the centre of pressure lies ([\d.]+) mm further (forward|back)", sentence)
    values = [float(size) * (1.0 if direction == "forward" else -1.0) for _, size, direction in found]
    assert [group for group, *_ in found] == ["0", "1", "2"]
    assert np.diff(values) == pytest.approx([-24.0, 12.0], rel=0.15)
    assert int(re.findall(r"(\d+) % of the misfit", sentence)[0]) > 90


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cop_errors", "effects"),
    [
        pytest.param((0.0, 0.0, 0.0), "", id="no error"),
        pytest.param((0.012, 0.012, 0.012), "", id="one registration for all"),
        pytest.param(
            (0.0, 0.0, 0.0), '[effects.braid_hysteresis]\nform = "coulomb"\nslope_n_per_bar = 40.0', id="braid"
        ),
        pytest.param((0.0, 0.0, 0.0), '[effects.seal_friction]\nform = "coulomb"\nforce_n = 60.0', id="seal"),
        pytest.param((0.0, 0.0, 0.0), '[effects.tendon_slack]\nform = "dead_length"\nslack_mm = 3.0', id="slack"),
    ],
)
def test_other_causes_are_no_registration(cop_errors: Sequence[float], effects: str, simulator: Simulator) -> None:
    assert describe(simulator, cop_errors, effects) == []
