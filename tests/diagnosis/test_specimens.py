"""Factors of specimens: nominally equal muscles that pull by some per cent more or less."""

from dataclasses import replace

import numpy as np
import pytest

from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import WeightedData, fit_hypothesis
from klute_sim.diagnosis.imperfect_law import fit_specimens, remove_specimens
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise

DEVICE = load_device("klute-3-4-pair")
FACTORS = {"A": 0.96, "B": 1.0, "C": 1.05}
NOISE = {"force": Noise(3.0, (Autocorrelation(0.005, 1.0, 400),))}
DT = 0.001


def make_experiment(specimen: str, device: object = DEVICE) -> BenchExperiment:
    """Return one second of a muscle under 3 bar that is stretched and released, with an empty measurement."""
    time = DT * np.arange(1, 1001)
    samples = time[4::5]
    return BenchExperiment(
        name=specimen,
        group=specimen,
        use="fit",
        device=device,
        start_time=0.0,
        dt=DT,
        command=np.full(1000, 3e5),
        measured={"force": TimeSeries(samples, np.zeros(len(samples)))},
        specimen=specimen,
        unit_length=0.335 + 0.004 * np.sin(2.0 * np.pi * time),
    )


def measure(hypothesis: Hypothesis, factors: dict[str, float], simulator: Simulator) -> list[BenchExperiment]:
    """Return an experiment of each specimen with the forces of a muscle that pulls by its factor."""
    trials = [make_experiment(name) for name in factors]
    true = replace(hypothesis, specimens=tuple(factors))
    x = np.array([p.normalize(value) for p, value in zip(true.parameters, factors.values(), strict=True)])
    readings = simulator.simulate([true.build_setups(x, trials)], trials)[0]
    return [
        replace(trial, measured={"force": TimeSeries(trial.measured["force"].time, row["force"])})
        for trial, row in zip(trials, readings, strict=True)
    ]


def test_factor_scales_the_muscle_of_its_specimen_alone() -> None:
    hypothesis = Hypothesis(DEVICE, (), (("force", 3.0),), specimens=("A", "B"))
    trials = [make_experiment(name) for name in ("A", "B", "unknown")]
    x = np.array([p.normalize(value) for p, value in zip(hypothesis.parameters, (1.04, 0.96), strict=True)])
    counts = [setup.parameters.muscle.n_actuators for setup in hypothesis.build_setups(x, trials)]
    assert counts == pytest.approx([2.08, 1.92, 2.0])
    common = hypothesis.build_setups(np.array([1.0, 1.0]), trials)  # the numbers of the device state what all share
    assert [setup.parameters.muscle.n_actuators for setup in common] == pytest.approx([2.0] * 3)
    plain = replace(hypothesis, specimens=()).build_setups(np.zeros(0), trials)
    assert all(setup.parameters == DEVICE.parameters for setup in plain)
    assert hypothesis.collect_numbers(hypothesis.values(x)) == {}


def test_factors_of_equal_specimens_are_recovered() -> None:
    simulator = Simulator(1)
    plain = Hypothesis(DEVICE, (), (("force", 3.0),))
    data = WeightedData(simulator, measure(plain, FACTORS, simulator), NOISE)
    base = fit_hypothesis(data, plain)
    fit = fit_specimens(data, base)
    mean = sum(FACTORS.values()) / len(FACTORS)
    found = dict(zip(FACTORS, fit.values, strict=True))
    assert found == pytest.approx({name: value / mean for name, value in FACTORS.items()}, abs=2e-3)
    assert fit.chi2 < 0.02 * base.chi2
    again = remove_specimens(data, fit)
    assert again.hypothesis == plain
    assert again.chi2 == pytest.approx(base.chi2)
    simulator.close()


def test_two_specimens_and_declared_differences_get_no_factors() -> None:
    simulator = Simulator(1)
    plain = Hypothesis(DEVICE, (), (("force", 3.0),))
    trials = measure(plain, FACTORS, simulator)
    two = WeightedData(simulator, trials[:2], NOISE)
    base = fit_hypothesis(two, plain)
    assert fit_specimens(two, base) is base
    longer = load_device("klute-1-1-4-pair")
    different = WeightedData(simulator, [*trials[:2], replace(trials[2], device=longer)], NOISE)
    assert fit_specimens(different, base) is base
    simulator.close()
