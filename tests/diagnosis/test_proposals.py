"""Separation of two models by a proposed experiment."""

from dataclasses import replace

import numpy as np
import pytest

from klute_sim.bench.protocols.library import load_identification_protocols
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.law_error_weights import weight_by_law_error
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from klute_sim.diagnosis.planning.proposals import (
    NOT_SEPARABLE,
    RIG_CHANGES,
    ExperimentProposal,
    build_separation_setups,
    choose_proposal,
    compute_separation,
    propose_experiment,
    simulate_channels,
    weight_predictions,
)
from tests.diagnosis.synthetic_dataset import make_repeats


@pytest.mark.parametrize("bound", ["lower", "upper"])
def test_parameter_at_its_bound_is_refitted(bound: str) -> None:
    """Models that differ only in a gain are not separated, also where the gain of one is at its bound."""
    (experiment,), samples = make_repeats([np.zeros(200)]), np.ones(200)
    assert isinstance(experiment, BenchExperiment)
    experiment = replace(experiment, unit_length=0.34 * samples, command=2e5 * samples)
    gain = EffectTerm("sensor_gain", "linear", "force")
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (("force", 3.0),), (gain,))
    lower, upper = hypothesis.bounds()
    at_bound, inside = {"lower": lower, "upper": upper}[bound], 0.5 * (lower + upper)
    best, other = (Fit(hypothesis, x, np.zeros(1), np.zeros((1, 1)), True, []) for x in (at_bound, inside))
    simulator, setups = Simulator(1), build_separation_setups(best, other, experiment)
    readings = [row["force"] for row in simulate_channels(simulator, setups, experiment, with_sensor_errors=True)]
    simulator.close()
    assert np.ptp([reading[0] for reading in readings]) > 10.0
    assert compute_separation(best, readings) == pytest.approx(0.0, abs=1e-6)


def test_repeats_that_share_the_error_of_the_law_count_once() -> None:
    trials = make_repeats([np.linspace(0.0, 500.0, 100)] * 2)
    data = WeightedData(
        Simulator(1),
        trials,
        estimate_noise_from_repeats(trials, [{"force": 3.0 * np.sin(np.arange(100) + k)} for k in (0, 2)]),
    )
    law = weight_by_law_error(data, trials, [{"force": np.tile([30.0, -30.0], 50)}] * 2)
    fit = Fit(Hypothesis(load_device("klute-3-4-pair"), (), ()), np.zeros(0), np.zeros(1), np.zeros((1, 0)), True, [])
    readings = [{"force": np.zeros(100)}, {"force": np.full(100, 30.0)}]
    for weighted, n_repeats in ((data, 2), (law, 1)):
        predictions = weight_predictions(weighted, 0.01, RIG_CHANGES[0], readings, readings, {})
        weight = weighted.noise["force"].weight(0.01)
        assert compute_separation(fit, predictions) == pytest.approx(n_repeats * 100 * (weight * 30.0) ** 2)
    assert law.with_experiments(trials[:1]).has_law_error


@pytest.mark.parametrize(
    ("unchanged", "changed", "chosen"),
    [
        (4.0, 7.5, 7.5),  # only the change is decisive
        (6.0, 6.1, 6.1),
        (4.0, 5.0, 5.0),  # nothing is decisive: the best separation is reported
        (7.0, 13.0, 7.0),
        (7.0, 15.0, 15.0),
        (61.0, 200.0, 61.0),
    ],
)
def test_change_of_the_rig_is_proposed_where_it_is_needed(unchanged: float, changed: float, chosen: float) -> None:
    protocol = load_identification_protocols()["sines"]
    proposals = [
        ExperimentProposal(protocol, change, separation, ("force",))
        for change, separation in ((RIG_CHANGES[0], unchanged), (RIG_CHANGES[3], changed))
    ]
    entry = choose_proposal(proposals).to_dict()
    assert entry["separation_chi2"] == chosen
    assert (entry["sentence"] == NOT_SEPARABLE) == (max(unchanged, changed) <= 6.0)


@pytest.mark.parametrize("moves", [True, False])
def test_motion_of_a_device_that_no_trial_moves_needs_a_tester(*, moves: bool) -> None:
    (experiment,), samples = make_repeats([np.zeros(200)]), np.ones(200)
    assert isinstance(experiment, BenchExperiment)
    length = 0.34 * samples
    length[100:] -= 0.01 * moves
    experiment = replace(experiment, unit_length=length, command=2e5 * samples)
    noise = estimate_noise_from_repeats([experiment] * 2, [{"force": 3.0 * np.sin(np.arange(200) + k)} for k in (0, 2)])
    simulator, device = Simulator(1), load_device("klute-3-4-pair")
    fit = Fit(Hypothesis(device, (), (("force", 3.0),)), np.zeros(0), np.zeros(1), np.zeros((1, 0)), True, [])
    stiffer = replace(
        fit, hypothesis=fit.hypothesis.with_term(EffectTerm("sensor_gain", "linear", "force")), x=np.ones(1)
    )
    proposal = propose_experiment(WeightedData(simulator, [experiment], noise), device, fit, stiffer)
    simulator.close()
    assert proposal is not None
    assert ("It changes the length, which no fitted trial does" in proposal.to_dict()["sentence"]) != moves
