"""The region of a misfit is that of the condition in which the misfit was put."""

from dataclasses import replace

import numpy as np
import pytest

from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.mechanism import MechanismExperiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.localization.misfit_regions import MisfitRegion, _find_region, locate_misfit
from klute_sim.diagnosis.noise.repeats import Residuals, estimate_noise_from_repeats
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.plant.mjcf.model_file import load_model_file
from tests.diagnosis.synthetic_dataset import make_repeats
from tests.diagnosis.synthetic_joint_dataset import INPUTS, TENDONS

SAMPLES, INTERVAL = 2000, 0.005
TIME = np.arange(SAMPLES) * INTERVAL


def locate(experiments: list[Experiment], residuals: Residuals) -> list[MisfitRegion]:
    """Return the regions of ``residuals`` [SI], whose noise is that of their repeats."""
    simulator = Simulator(1)
    data = WeightedData(simulator, experiments, estimate_noise_from_repeats(experiments, residuals))
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), ())
    weighted = data.weight_residuals(residuals)
    regions = locate_misfit(data, Fit(hypothesis, np.zeros(0), weighted, np.empty((len(weighted), 0)), True, residuals))
    simulator.close()
    return regions


def make_bench_trials(length: np.ndarray) -> list[Experiment]:
    """Return two repeats of a trial with a prescribed ``length`` [m], (samples,), and a constant pressure."""
    return [
        replace(e, unit_length=length, command=np.full(SAMPLES, 2e5))
        for e in make_repeats([np.zeros(SAMPLES)] * 2)
        if isinstance(e, BenchExperiment)
    ]


def make_joint_trial(name: str, group: str, length: np.ndarray | None) -> MechanismExperiment:
    """Return a trial of the antagonist joint whose first device has a ``length`` [m], (samples,)."""
    mechanism = Mechanism(load_model_file("antagonist_joint"), TENDONS, INPUTS)
    command = np.full(SAMPLES, 2e5)
    return MechanismExperiment(
        name=name,
        group=group,
        use="fit",
        device=load_device("klute-3-4-pair"),
        start_time=0.0,
        dt=INTERVAL,
        command=command,
        measured={"angle_joint": TimeSeries(TIME, np.zeros(SAMPLES))},
        mechanism=mechanism,
        outputs={},
        inputs=dict.fromkeys(INPUTS, command),
        numbers={},
        initial_positions={},
        unit_length=length,
    )


def test_region_does_not_depend_on_the_order_of_groups_with_and_without_a_length() -> None:
    """Only one group has a known length that changes; the misfit is in its lengthening."""
    rng, lengths = np.random.default_rng(1), {"unknown": None, "moving": 0.3 + 0.01 * np.sin(2.0 * TIME)}
    experiments = [make_joint_trial(f"{group}{k}", group, lengths[group]) for group in lengths for k in range(2)]
    shared = np.where(np.cos(2.0 * TIME) > 0.0, 0.01, 0.0)
    rows = [{"angle_joint": shared * (e.group == "moving") + rng.normal(0.0, 1e-3, SAMPLES)} for e in experiments]
    (region,), (reversed_region,) = locate(experiments, rows), locate(experiments[::-1], rows[::-1])
    assert region.region == reversed_region.region == "lengthening"
    assert region.concentration == pytest.approx(reversed_region.concentration)


@pytest.mark.parametrize("motion", ["shortening", "held", "lengthening"])
def test_region_tells_a_held_length_from_one_that_changes(motion: str) -> None:
    """The length rises, is held, falls and is held again, four times, for 0.625 s each; some noise is on it."""
    rng = np.random.default_rng(2)
    direction = np.tile(np.repeat([1.0, 0.0, -1.0, 0.0], SAMPLES // 16), 4)
    experiments = make_bench_trials(0.3 + 0.02 * INTERVAL * np.cumsum(direction) + rng.normal(0.0, 1e-7, SAMPLES))
    shared = 10.0 * (direction == {"shortening": -1.0, "held": 0.0, "lengthening": 1.0}[motion])
    (region,) = locate(experiments, [{"force": shared + rng.normal(0.0, 1.0, SAMPLES)} for _ in range(2)])
    assert region.region.split(", ")[0] == motion


def test_samples_that_count_less_hide_no_misfit() -> None:
    """The misfit is half of the noise everywhere; in the second half the inputs are unknown, and samples count less."""
    rng, scale = np.random.default_rng(3), np.repeat([1.0, 10.0], SAMPLES // 2)
    trials = make_bench_trials(np.full(SAMPLES, 0.3))
    rows = [{"force": 0.5 + rng.normal(0.0, 1.0, SAMPLES)} for _ in trials]
    (region,) = locate([replace(e, input_error_scale={"force": scale}) for e in trials], rows)
    assert region.fraction == pytest.approx(1.0, abs=0.05)
    assert region.region == "before 5.0 s"
    assert region.concentration == pytest.approx(2.0, rel=0.05)


def test_second_split_of_a_condition_replaces_the_first() -> None:
    """Above 7 bar of 0 to 8, the splits at 6 bar and at 7 bar are one condition; those of a band are two."""
    pressure = np.linspace(0.0, 8e5, SAMPLES)
    above, *_ = _find_region(np.where(pressure > 7e5, 100.0, 1.0), {"pressure": pressure})
    assert above == "above 7.0 bar"
    band, *_ = _find_region(np.where((pressure > 4.2e5) & (pressure < 5.8e5), 100.0, 1.0), {"pressure": pressure})
    assert band == "above 4.0 bar, below 6.0 bar"
