"""Tests of the outcomes with a synthetic walk whose steps are known."""

import numpy as np
import pytest

from klute_sim.gait.reference import load_default_reference
from klute_sim.recording.recording import Recording
from klute_sim.types import Array
from klute_sim.walker.outcomes import CURVES, compute_outcomes, find_strikes

MASS, STRIDE, SPEED, DT = 75.0, 1.1, 1.2, 1e-3


def make_recording(seconds: float = 12.0, *, has_fallen: bool = False, scale: float = 1.0) -> Recording:
    """Return a walk with the curves of the reference in both legs, half a stride apart."""
    reference, time = load_default_reference(), np.arange(0.0, seconds, DT)
    columns: list[tuple[str, Array]] = [
        ("time [s]", time),
        ("hip_x [m]", SPEED * time),
        ("trunk_lean [deg]", np.zeros_like(time)),
        ("metabolic_energy_minetti [J]", 300.0 * time),
        ("metabolic_energy_bhargava [J]", 250.0 * time),
        ("device_power [W]", np.where((time / STRIDE) % 1.0 < 0.5, 40.0, -20.0)),
    ]
    for side, shift in (("left", 0.5), ("right", 0.0)):
        phase = (time / STRIDE + shift) % 1.0
        for channel, column in CURVES.values():
            factor = MASS if channel.startswith("grf") else scale
            unit = "N" if channel.startswith("grf") else "deg"
            columns.append((f"{channel}_{side} [{unit}]", factor * reference(column, phase)))
    return Recording.from_columns(columns, {"options": {"mass_kg": MASS, "slope_deg": 0.0}, "has_fallen": has_fallen})


def test_a_walk_like_the_reference_has_a_likeness_of_one() -> None:
    outcomes = compute_outcomes(make_recording())
    for leg in outcomes.legs.values():
        for name, likeness in leg.likeness.items():
            assert likeness.correlation > 0.995, name
            assert likeness.rms < 1.0, name
        assert leg.stride_time == pytest.approx(STRIDE, abs=DT)
        assert leg.stride_time_sd < 2 * DT
        assert 0.55 < leg.stance_share < 0.7
    assert outcomes.step_asymmetry == pytest.approx(0.0, abs=0.01)


def test_an_exaggerated_walk_keeps_its_correlation_and_not_its_rms() -> None:
    outcomes = compute_outcomes(make_recording(scale=1.5))
    assert outcomes.legs["left"].likeness["knee"].correlation > 0.995
    assert outcomes.legs["left"].likeness["knee"].rms > 8.0


def test_speed_cost_and_work_follow_from_their_channels() -> None:
    outcomes = compute_outcomes(make_recording())
    assert outcomes.speed_m_per_s == pytest.approx(SPEED)
    assert outcomes.cost_minetti_j_per_kg_m == pytest.approx(300.0 / MASS / SPEED)
    assert outcomes.cost_bhargava_j_per_kg_m == pytest.approx(250.0 / MASS / SPEED)
    assert outcomes.device_work_positive_j == pytest.approx(40.0 * 0.5 * STRIDE, rel=0.01)
    assert outcomes.device_work_net_j == pytest.approx(20.0 * 0.5 * STRIDE, rel=0.01)


def test_strikes_are_a_stride_apart_and_bounces_are_none() -> None:
    recording = make_recording()
    strikes = find_strikes(recording, "right", MASS)
    np.testing.assert_allclose(np.diff(recording["time"][strikes]), STRIDE, atol=2 * DT)
    load = recording["grf_vertical_right"].copy()
    load[strikes[2] + 30 : strikes[2] + 60] = 0.0
    bounced = Recording({**recording.channels, "grf_vertical_right": load}, recording.units, recording.provenance)
    np.testing.assert_array_equal(find_strikes(bounced, "right", MASS), strikes)


def test_a_fall_before_the_transient_has_no_speed() -> None:
    outcomes = compute_outcomes(make_recording(2.0, has_fallen=True))
    assert outcomes.has_fallen
    assert outcomes.legs == {}
    assert outcomes.speed_m_per_s is outcomes.cost_minetti_j_per_kg_m is outcomes.step_asymmetry is None
    assert outcomes.duration_s == pytest.approx(2.0, abs=2 * DT)
