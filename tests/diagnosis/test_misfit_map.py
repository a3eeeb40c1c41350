"""The misfit map tells in which channel and condition the simulation is off, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.localization.misfit_map import label_samples, map_misfit
from klute_sim.diagnosis.localization.misfit_regions import compute_held_speed
from klute_sim.diagnosis.noise.misfit import is_significant
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from tests.diagnosis.synthetic_dataset import make_correlated_noise, make_repeats

SAMPLES, INTERVAL = 4000, 0.005
TIME = np.arange(SAMPLES) * INTERVAL
LENGTH = 0.3 + 0.01 * np.sin(0.5 * np.pi * TIME)
STEPS = np.where(np.floor(TIME) % 5 == 4, 3e5, 2e5)


def map_force_misfit(size: float, region: str) -> dict[str, tuple[float, bool]]:
    """Return misfit over noise and significance per condition, for a misfit of ``size`` noises in ``region`` only."""
    rng, simulator = np.random.default_rng(2), Simulator(1)
    blank = [np.zeros(SAMPLES)] * 2
    experiments = [
        replace(e, unit_length=LENGTH, command=STEPS, dt=INTERVAL)
        for e in make_repeats(blank)
        if isinstance(e, BenchExperiment)
    ]
    shared, covariates = np.zeros(SAMPLES), experiments[0].compute_covariates()
    shared[label_samples(covariates, compute_held_speed(experiments)) == region] = size * 3.0
    residuals = [{"force": shared + make_correlated_noise(rng, SAMPLES, 3.0, 0.02)} for _ in range(2)]
    data = WeightedData(simulator, experiments, estimate_noise_from_repeats(experiments, residuals))
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), ())
    weighted = data.weight_residuals(residuals)
    cells = map_misfit(data, Fit(hypothesis, np.zeros(0), weighted, np.empty((len(weighted), 0)), True, residuals))
    simulator.close()
    return {cell.region: (cell.misfit.rms / cell.misfit.noise_rms, is_significant(cell.misfit)) for cell in cells}


@pytest.mark.parametrize("region", ["lengthening, steady pressure", "shortening, steady pressure"])
def test_only_the_condition_with_the_misfit_is_significant(region: str) -> None:
    cells = map_force_misfit(2.0, region)
    assert {name for name, (_, is_significant) in cells.items() if is_significant} == {region}
    assert cells[region][0] == pytest.approx(2.0, abs=0.3)


def test_noise_alone_is_significant_nowhere() -> None:
    assert not any(is_significant for _, is_significant in map_force_misfit(0.0, "").values())


def test_samples_of_a_stride_are_labelled_by_tenths() -> None:
    labels = label_samples({"phase": np.array([0.0, 0.099, 0.1, 0.95, 1.0])}, 0.0)
    first, second, last = "0 to 10 % of the stride", "10 to 20 % of the stride", "90 to 100 % of the stride"
    assert list(labels) == [first, first, second, last, last]


def test_a_trial_without_motion_is_labelled_by_pressure_alone() -> None:
    labels = label_samples({"pressure change": np.array([0.0, 1e6])}, 0.0)
    assert list(labels) == ["steady pressure", "pressure changes"]
