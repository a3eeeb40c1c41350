"""Interpolation of the prescribed length: a curve that does not overshoot where a motion ends."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.diagnosis.experiments.interpolation import insert_corners, interpolate_smoothly

INTERVAL = 0.005
SAMPLE_TIME = np.arange(201) * INTERVAL
TIME = np.arange(2001) * 0.1 * INTERVAL


def compute_move(time: np.ndarray, acceleration: float, speed: float) -> np.ndarray:
    """Return a move from 0.4 s on that accelerates [m/s^2] to a constant speed [m/s]."""
    moved = np.clip(time - 0.4, 0.0, None)
    rise = speed / acceleration
    return np.where(moved < rise, 0.5 * acceleration * moved**2, speed * (moved - 0.5 * rise))


@pytest.mark.parametrize("acceleration", [2.0, 5.0, 12.0])
def test_curve_is_closer_to_a_machine_than_straight_lines(acceleration: float) -> None:
    truth, samples = (compute_move(time, acceleration, 0.3) for time in (TIME, SAMPLE_TIME))
    curve = interpolate_smoothly(TIME, SAMPLE_TIME, samples)
    straight = np.interp(TIME, SAMPLE_TIME, samples)
    assert np.abs(straight - truth).max() == pytest.approx(acceleration * INTERVAL**2 / 8.0, rel=0.02)
    assert np.mean((curve - truth) ** 2) < 0.1 * np.mean((straight - truth) ** 2)


def test_curve_converges_better_than_the_second_order() -> None:
    errors = []
    for interval in (0.01, 0.005):
        samples = np.arange(0.0, 1.0 + 0.5 * interval, interval)
        curve = interpolate_smoothly(TIME, samples, np.sin(2.0 * np.pi * 4.0 * samples))
        errors.append(np.sqrt(np.mean((curve - np.sin(2.0 * np.pi * 4.0 * TIME)) ** 2)))
    assert errors[0] / errors[1] > 4.8


@settings(max_examples=40)
@given(speed=st.floats(-0.3, 0.3), corner=st.integers(20, 180))
def test_curve_keeps_samples_holds_and_ramps(speed: float, corner: int) -> None:
    samples = 0.34 + speed * np.clip(SAMPLE_TIME - SAMPLE_TIME[corner], 0.0, None)
    curve = interpolate_smoothly(TIME, SAMPLE_TIME, samples)
    assert curve[::10] == pytest.approx(samples, abs=1e-12)
    since_corner = TIME - SAMPLE_TIME[corner]
    assert np.ptp(curve[since_corner <= 0.0]) < 1e-12  # friction would notice a reversal in a hold
    ramp = since_corner >= 2.0 * INTERVAL
    assert curve[ramp] == pytest.approx(np.interp(TIME[ramp], SAMPLE_TIME, samples), abs=1e-9)


def test_length_before_and_after_the_samples_is_constant() -> None:
    curve = interpolate_smoothly(np.array([-1.0, 2.0]), SAMPLE_TIME, compute_move(SAMPLE_TIME, 5.0, 0.3))
    assert curve.tolist() == [0.0, compute_move(SAMPLE_TIME, 5.0, 0.3)[-1]]


@settings(max_examples=40)
@given(corners=st.lists(st.floats(0.05, 0.2), min_size=2, max_size=6), speed=st.floats(0.01, 0.3))
def test_corners_between_samples_are_those_of_a_triangle(corners: list[float], speed: float) -> None:
    """A machine that reverses between two samples goes beyond both of them."""
    corner_time = np.concatenate([[0.0], np.cumsum(corners)])
    corner_value = 0.34 + np.concatenate(
        [[0.0], np.cumsum(speed * np.array(corners) * (-1.0) ** np.arange(len(corners)))]
    )
    sample_time = np.arange(0.0, corner_time[-1], 0.01)
    time, value = insert_corners(sample_time, np.interp(sample_time, corner_time, corner_value))
    inner = time[time <= sample_time[-3]]  # after the last corner, two samples are needed
    assert np.isin(sample_time, time).all()
    fine = np.linspace(0.0, inner[-1], 3000)
    assert np.interp(fine, time, value) == pytest.approx(np.interp(fine, corner_time, corner_value), abs=1e-9)


def test_straight_lines_have_no_corners() -> None:
    samples = np.concatenate([np.full(50, 0.34), 0.34 + 1e-3 * np.arange(50)])
    time, value = insert_corners(np.arange(100) * 0.01, samples)
    assert len(time) <= 101
    assert np.interp(np.arange(100) * 0.01, time, value) == pytest.approx(samples)
