"""Recordings in a gait laboratory that separate two models of a walk."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.planning import gait_proposals
from klute_sim.diagnosis.planning.gait_proposals import GaitProposal, propose_gait_experiment
from klute_sim.diagnosis.planning.gait_protocols import GaitProtocol, list_gait_protocols
from tests.diagnosis import synthetic_walk as walk

pytestmark = pytest.mark.slow

PROTOCOLS = {protocol.name: protocol for protocol in list_gait_protocols()}


@pytest.fixture(scope="module")
def weighted() -> Iterator[tuple[WeightedData, Hypothesis]]:
    simulator = Simulator(2)
    yield walk.weight_walks(walk.make_walks(), simulator)
    simulator.close()


def place_fit(data: WeightedData, nominal: Hypothesis, term: EffectTerm, *values: float) -> Fit:
    """Return the model with ``term`` at ``values``, without a fit."""
    hypothesis = nominal.with_term(term)
    x = np.array([p.normalize(value) for p, value in zip(hypothesis.parameters, values, strict=True)])
    return fit_hypothesis(data, hypothesis, x, max_nfev=1)


def evaluate_all(data: WeightedData, best_fit: Fit, rival: Fit) -> dict[tuple[str, str], GaitProposal]:
    experiment = gait_proposals._use_one_clock(data.experiments[0], data)  # type: ignore[arg-type]
    return {
        (proposal.protocol.name, proposal.rig_change.description): proposal
        for protocol in PROTOCOLS.values()
        for proposal in gait_proposals._evaluate_protocol(data, experiment, protocol, best_fit, rival)
    }


def test_equal_models_are_not_separated(weighted: tuple[WeightedData, Hypothesis]) -> None:
    data, nominal = weighted
    fit = place_fit(data, nominal, EffectTerm("ankle_friction", "coulomb"), 2.0)
    proposal = propose_gait_experiment(data, fit, fit)
    assert proposal is not None
    told = proposal.to_dict()
    assert told["separation_chi2"] == pytest.approx(0.0, abs=1e-6)
    assert "No known protocol" in told["sentence"]
    assert told["protocol"] is None
    assert told["rig_change"] is None


def test_recording_that_diverges_is_not_proposed(
    weighted: tuple[WeightedData, Hypothesis], monkeypatch: pytest.MonkeyPatch
) -> None:
    data, nominal = weighted
    fit = place_fit(data, nominal, EffectTerm("ankle_friction", "coulomb"), 2.0)
    diverging = GaitProtocol(
        "unstable", "", "", lambda walk: replace(walk, foot_change=lambda foot: foot._replace(inertia=np.nan))
    )
    monkeypatch.setattr(gait_proposals, "list_gait_protocols", lambda: (diverging,))
    assert propose_gait_experiment(data, fit, fit) is None
    stable = PROTOCOLS["constant_pressure"]
    monkeypatch.setattr(gait_proposals, "list_gait_protocols", lambda: (diverging, stable))
    proposal = propose_gait_experiment(data, fit, fit_hypothesis(data, nominal))
    assert proposal is not None
    assert proposal.protocol is stable


def test_socket_is_separated_by_markers_below_it(weighted: tuple[WeightedData, Hypothesis]) -> None:
    """Markers on the prosthesis do not see the socket, so only the return spring remains."""
    data, nominal = weighted
    tilt = place_fit(data, nominal, EffectTerm("socket_tilt", "elastic"), 0.03, 330.0)
    spring = place_fit(data, nominal, EffectTerm("return_spring_error", "rest"), 1.0)
    held, usual = (
        evaluate_all(data, spring, tilt)[name, "with the instruments as they are"]
        for name in ("markers_below_socket", "constant_pressure")
    )
    assert held.separation_chi2 > 0.0
    tilted = evaluate_all(data, tilt, tilt)["markers_below_socket", "with the instruments as they are"]
    assert tilted.separation_chi2 == pytest.approx(0.0, abs=1e-6)
    proposal = propose_gait_experiment(data, spring, tilt)
    assert proposal is not None
    told = proposal.to_dict()
    assert told["separation_chi2"] >= max(held.separation_chi2, usual.separation_chi2) - 0.1
    assert told["sentence"].startswith("Record twice, with the instruments as they are: ")
    assert f"('{told['protocol']}'). The models then differ by a chi squared" in told["sentence"]
    assert told["sentence"].endswith(f"Assumed: {told['assumption']}.")


def test_faulty_gauge_is_separated_from_its_regulator_by_a_second_gauge(
    weighted: tuple[WeightedData, Hypothesis],
) -> None:
    """The reading is the same in both, and the force hardly differs in a recording that leaves the device alone."""
    data, nominal = weighted
    gauge = place_fit(data, nominal, EffectTerm("sensor_gain", "linear", "pressure"), 0.97)
    regulator = place_fit(data, nominal, EffectTerm("regulator_error", "gain"), 0.97)
    found = evaluate_all(data, gauge, regulator)
    for name in ("controller_off", "constant_pressure"):
        second = found[name, "with a second gauge at the muscle"].separation_chi2
        assert second >= found[name, "with the instruments as they are"].separation_chi2
    assert found["controller_off", "with the instruments as they are"].separation_chi2 < 6.0  # nothing is regulated
    assert found["constant_pressure", "with a second gauge at the muscle"].separation_chi2 > 100.0


def test_separation_is_that_of_the_recording(weighted: tuple[WeightedData, Hypothesis]) -> None:
    """Without fitted parameters it is the sum of squares over two repeats: here of a constant 0.05 bar."""
    data, nominal = weighted
    clean = fit_hypothesis(data, nominal)
    shifted = place_fit(data, nominal, EffectTerm("sensor_offset", "linear", "pressure"), 0.05)
    proposal = evaluate_all(data, clean, shifted)["pressure_steps_hanging", "with the instruments as they are"]
    experiment = PROTOCOLS["pressure_steps_hanging"].change(
        gait_proposals._use_one_clock(data.experiments[0], data)  # type: ignore[arg-type]
    )
    series = experiment.measured["pressure"]
    assert series.time[-1] == pytest.approx(10.0, abs=0.01)
    weight = data.noise["pressure"].weight(series.sampling_interval)
    assert proposal.separation_chi2 == pytest.approx(2.0 * len(series.time) * (weight * 5e3) ** 2, rel=1e-3)


@pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=lambda p: p.name)
def test_recordings_change_what_they_say(weighted: tuple[WeightedData, Hypothesis], protocol: GaitProtocol) -> None:
    data, nominal = weighted
    before = gait_proposals._use_one_clock(data.experiments[0], data)  # type: ignore[arg-type]
    after = protocol.change(before)
    (setup,) = nominal.build_setups(np.zeros(0), [after])
    old, new = before.simulate(setup), after.simulate(setup)
    assert old.ankle_angle is not None
    assert new.ankle_angle is not None
    range_before, range_after = np.ptp(old.ankle_angle), np.ptp(new.ankle_angle)
    match protocol.name:
        case "faster" | "slower":
            factor = 1.25 if protocol.name == "faster" else 0.75
            assert after.duration == pytest.approx(before.duration / factor, abs=2e-3)
            assert after.foot_strikes == pytest.approx(before.foot_strikes / factor)
            peak = np.abs(after.inputs.shank_angular_acceleration).max()
            assert peak == pytest.approx(factor**2 * np.abs(before.inputs.shank_angular_acceleration).max(), rel=1e-3)
        case "carried_load":
            assert after.inputs.axial_force.max() == pytest.approx(1.15 * before.inputs.axial_force.max())
            assert range_after > range_before
        case "controller_off":
            assert new.pressure[-1] < 1.0
        case "constant_pressure":
            assert np.ptp(new.pressure[len(new.pressure) // 2 :]) < 1e-6 * new.pressure[-1]
        case "clamped_ankle":
            assert range_after == 0.0
            assert np.ptp(new.tension) > 10.0  # the pressure still changes
        case "markers_below_socket":
            assert np.array_equal(old.ankle_angle, new.ankle_angle)  # without effects there is nothing to hold
        case "mass_on_foot":
            foot = after.build_foot(setup)
            assert foot.mass == walk.FOOT.mass + 0.5
            moments = [f.distal_mass * f.distal_com_z for f in (walk.FOOT, foot)]
            assert moments[1] - moments[0] == pytest.approx(0.5 * walk.FOOT.com_z)
        case "softer_foot":
            bent = np.degrees(np.abs(new.ankle_angle - old.ankle_angle).max())
            assert bent == pytest.approx(0.05 * np.abs(before.inputs.ground_moment).max(), rel=0.1)
        case _:
            assert after.duration == pytest.approx(10.0)
            assert (after.load.vertical.max() > 0.0) == ("hanging" not in protocol.name)
            assert (np.ptp(new.pressure) > 1e5) == ("steps" in protocol.name)
