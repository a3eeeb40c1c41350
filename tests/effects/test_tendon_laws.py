"""The effects of the tendon in closed form: what one unit of each parameter does."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from klute_sim.device.device import load_device, parse_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.effects.families import tendon
from klute_sim.laws.tendon import TendonParameters, force
from klute_sim.types import Array

ALONE = parse_device(
    b'name = "t"\n[tendon]\nslack_length_mm = 200\nstiffness_1_n_per_mm = 100\nstiffness_2_n_per_mm = 0\n'
    b"engagement_mm = 5\n",
    "t",
).parameters
"""A tendon without a muscle: one spring of 100 N/mm."""
STIFFNESS = 1e5
MUSCLE = load_device("klute-3-4-pair").parameters.muscle
SPRINGS = TendonParameters(0.1, 6e4, 1.4e5, 4e-3, is_rigid=False)


def make_viscous(damping_n_s_per_mm: float, device: DeviceParameters = ALONE) -> DeviceParameters:
    effects = {("tendon_hysteresis", "viscous"): {"damping_n_s_per_mm": damping_n_s_per_mm}}
    return device._replace(effects=catalogue.pack_effects(effects))


def stretch_tendon(device: DeviceParameters, stretch: Array, dt: float) -> Array:
    """Return the tension [N] of a tendon without a muscle."""
    taut = device.tendon.slack_length + device.muscle.resting_length
    start = compute_taut_state(device, taut + float(stretch[0]), 0.0)
    return simulate_rollouts(device, taut + stretch, np.zeros(len(stretch)), dt, initial_state=start).tension


def check_convergence(device: DeviceParameters, dt: float) -> None:
    """Assert that the tension beside a muscle converges with the time step ``dt`` [s], and does not oscillate."""

    def run(step: float) -> Array:
        time = step * np.arange(1, round(1.0 / step) + 1)
        length = 0.338 + 6e-3 * np.sin(4.0 * np.pi * time)
        command = np.where(time % 0.5 < 0.25, 4e5, 2e5)
        return simulate_rollouts(device, length, command, step).tension[round(5e-3 / step) - 1 :: round(5e-3 / step)]

    coarse, fine, finest = run(dt), run(dt / 2.0), run(1e-4)
    assert np.isfinite(coarse).all()
    assert coarse.min() >= 0.0
    error, half_error = (np.sqrt(np.mean((x - finest) ** 2)) for x in (coarse, fine))
    assert error < 0.05 * np.ptp(finest)
    assert half_error < 0.75 * error + 1e-3
    jumps = np.abs(np.diff(coarse, 2)).max()
    assert jumps < 1.5 * np.abs(np.diff(finest, 2)).max() + 1.0  # it does not oscillate from step to step


def test_stiffening_adds_its_coefficient_times_the_squared_stretch() -> None:
    p = catalogue.find_form("tendon_stiffening", "quadratic")[1].parameter_type(2e6)
    assert tendon.stiffening_force(p, (), 100.0, 0.01, SPRINGS) == pytest.approx(100.0 + 200.0)
    assert tendon.stiffening_force(p, (), 0.0, -0.01, SPRINGS) == 0.0


@pytest.mark.parametrize("width", [1e-4, 5e-4, 3e-3])
def test_second_spring_joins_gradually_without_a_force_at_slack_length(width: float) -> None:
    """Its tension is the integral of a logistic share of its stiffness, and that of the sharp spring far away."""
    p = catalogue.find_form("tendon_stiffening", "gradual_engagement")[1].parameter_type(width)
    stretch = np.linspace(0.0, 0.04, 40_001)
    tension = np.array([tendon.gradual_engagement_force(p, (), force(SPRINGS, x), x, SPRINGS) for x in stretch])
    share = 1.0 / (1.0 + np.exp(-(stretch - SPRINGS.engagement_stretch) / width))
    slope = SPRINGS.stiffness_1 + SPRINGS.stiffness_2 * share
    expected = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(stretch))])
    np.testing.assert_allclose(tension, expected, atol=0.02)
    assert tension[0] == 0.0
    assert (np.diff(tension) > 0.0).all()
    missing = SPRINGS.stiffness_2 * width * np.log1p(np.exp(-SPRINGS.engagement_stretch / width))
    assert force(SPRINGS, 0.04) - tension[-1] == pytest.approx(missing, abs=0.5)
    assert tendon.gradual_engagement_force(p, (), 0.0, -1e-3, SPRINGS) == 0.0
    sharp = p._replace(transition=0.0)
    assert tendon.gradual_engagement_force(sharp, (), 321.0, 5e-3, SPRINGS) == 321.0


def test_slack_is_subtracted_from_the_stretch() -> None:
    p = catalogue.find_form("tendon_slack", "dead_length")[1].parameter_type(1.5e-3)
    assert tendon.subtract_slack(p, (), 0.01) == pytest.approx(8.5e-3)


def step_viscous(stretch: list[float], dt: float, damping: float = 3e3) -> list[float]:
    """Return the force [N] that the damper adds to 100 N after each step."""
    p, state, forces = SimpleNamespace(damping=damping), SimpleNamespace(stretch_rate=0.0, taut_stretch=0.0), []
    for x in stretch:
        values: Any = tendon.step_stretch_rate(p, state, MUSCLE, 0.0, 0.0, 0.25, x, dt)
        state = SimpleNamespace(stretch_rate=values[0], taut_stretch=values[1])
        forces.append(tendon.viscous_force(p, state, 100.0, x, SPRINGS) - 100.0)
    return forces


def test_damper_of_a_tendon_pulls_with_its_coefficient_times_the_rate_while_taut() -> None:
    assert step_viscous([1e-4, 3e-4, 3e-4, 2e-4, -1e-4, -2e-4, 1e-4], 1e-2) == pytest.approx(
        [30.0, 60.0, 0.0, -30.0, 0.0, 0.0, 30.0]
    )


@pytest.mark.parametrize("dt", [5e-4, 5e-3])
def test_viscous_tendon_is_spring_and_damper_side_by_side_and_never_pushes(dt: float) -> None:
    damping = 3e3
    time = dt * np.arange(round(4.0 / dt))
    stretch = 4e-3 * np.sin(2.0 * np.pi * time)  # half of the cycle slack
    tension = stretch_tendon(make_viscous(1e-3 * damping), stretch, dt)
    rate = np.diff(np.maximum(stretch, 0.0), prepend=0.0) / dt
    expected = np.where(stretch > 0.0, np.maximum(0.0, STIFFNESS * stretch + damping * rate), 0.0)
    assert tension == pytest.approx(expected, abs=1e-6)
    assert tension.min() == 0.0
    assert (expected[stretch > 0.0] == 0.0).any()  # released faster than its springs recoil


@pytest.mark.parametrize("frequency", [0.5, 2.0])
def test_viscous_tendon_loses_the_work_of_kelvin_and_voigt_and_converges(frequency: float) -> None:
    """A sine of amplitude A loses pi c omega A^2 in a cycle; the peak leads by atan(c omega / k)."""
    damping, amplitude, omega = 2e3, 2e-3, 2.0 * np.pi * frequency
    lags = []
    for n in (200, 400):
        phase = np.arange(2 * n + 1) / n
        stretch = 6e-3 - amplitude * np.cos(2.0 * np.pi * phase)
        tension = stretch_tendon(make_viscous(1e-3 * damping), stretch, 1.0 / (n * frequency))[n:]
        loss = np.sum(0.5 * (tension[1:] + tension[:-1]) * np.diff(stretch[n:]))
        assert loss == pytest.approx(np.pi * damping * omega * amplitude**2, rel=2e-3)
        wave = np.exp(-2j * np.pi * phase[n:-1])
        lags.append(np.angle(np.sum(tension[:-1] * wave) / np.sum(stretch[n:-1] * wave)))
    exact = np.arctan(damping * omega / STIFFNESS)
    errors = np.abs(np.array(lags) - exact)
    assert errors[1] < 0.01 * exact + 1e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


def test_maxwell_branch_that_relaxes_fast_is_viscous() -> None:
    """Its limit for a short time constant tau has the damping k tau."""
    dt, tau = 1e-3, 0.01
    stretch = 6e-3 - 4e-3 * np.cos(np.pi * dt * np.arange(4000))
    effects = {("tendon_hysteresis", "maxwell"): {"stiffness_n_per_mm": 100.0, "time_constant_s": tau}}
    maxwell = stretch_tendon(ALONE._replace(effects=catalogue.pack_effects(effects)), stretch, dt)
    viscous = stretch_tendon(make_viscous(100.0 * tau), stretch, dt)
    plain = stretch_tendon(ALONE, stretch, dt)
    late = slice(500, None)
    assert np.abs(viscous - maxwell)[late].max() < 0.05 * np.abs(viscous - plain)[late].max()


@pytest.mark.parametrize("dt", [5e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("damping", [1.0, 20.0, 200.0])
def test_viscous_tendon_beside_a_muscle_is_stable_and_converges(damping: float, dt: float) -> None:
    """The rate in the balance of forces is that of the same step."""
    device = make_viscous(damping, load_device("klute-3-4-pair").parameters)

    check_convergence(device, dt)
