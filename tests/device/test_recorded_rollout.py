"""Recorded rollouts: the same time steps as rollouts, bit-identical backends, and the energy balance."""

import numpy as np
import pytest

from klute_sim.device.device import load_device, parse_device
from klute_sim.device.dynamics import DeviceState
from klute_sim.device.energy.ledger import POWER_TERMS
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.device.recorded_rollout import record_rollout
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.errors import SimulationError

STEP = 5e-4
TIME = np.arange(1500) * STEP
EFFECTS = b"""
[effects.tendon_hysteresis]
loss_fraction = 0.1
[effects.pressure_delay]
delay_s = 0.0101
"""


@pytest.mark.parametrize("name", ["klute-3-4-pair", "klute-1-2", "with effects"])
def test_backends_are_bit_identical_and_agree_with_rollouts(name: str) -> None:
    device = (
        parse_device(load_device("klute-3-4-pair").content + EFFECTS, "mine")
        if name == "with effects"
        else load_device(name)
    )
    p = device.parameters
    length = p.tendon.slack_length + p.muscle.resting_length * (0.93 + 0.05 * np.sin(15 * TIME))
    command = np.where(TIME % 0.3 < 0.15, 4e5, 1e5)
    compiled, python = (record_rollout(p, length, command, STEP, backend=backend) for backend in ("compiled", "python"))
    for a, b in zip(
        [*compiled[:4], *compiled.energy_balance[:-1]], [*python[:4], *python.energy_balance[:-1]], strict=True
    ):
        assert np.array_equal(a, b)
    plain = simulate_rollouts(p, length, command, STEP)
    assert np.array_equal(compiled.tension, plain.tension)
    assert np.array_equal(compiled.length, plain.length)
    assert np.ptp(compiled.energy_balance.gas_power) > 1.0
    assert (np.ptp(compiled.energy_balance.effects_power) > 0.1) == (name == "with effects")
    assert set(compiled.energy_balance.effect_powers) == (
        {"tendon_hysteresis", "pressure_delay"} if name == "with effects" else set()
    )


def test_effect_powers_sum_to_the_power_of_all_effects() -> None:
    more = (
        EFFECTS
        + b"[effects.braid_hysteresis]\nslope_n_per_bar = 10.0\nstiffness_n_per_mm = 40.0\n"
        + b"[effects.threshold_pressure]\npressure_bar = 0.2\n"
    )
    p = parse_device(load_device("klute-3-4-pair").content + more, "mine").parameters
    length = p.tendon.slack_length + p.muscle.resting_length * (0.93 + 0.05 * np.sin(15 * TIME))
    balance = record_rollout(p, length, np.full(len(TIME), 3e5), STEP).energy_balance
    work = {name: STEP * power.sum() for name, power in balance.effect_powers.items()}
    assert set(work) == {"tendon_hysteresis", "pressure_delay", "braid_hysteresis", "threshold_pressure"}
    assert work["pressure_delay"] == 0.0  # a delay of the command does no work
    assert work["braid_hysteresis"] < -0.1
    assert work["tendon_hysteresis"] < 0.0
    assert sum(balance.effect_powers.values()) == pytest.approx(balance.effects_power, abs=1e-12)
    power_sum = sum(getattr(balance, line) for line in POWER_TERMS)
    assert power_sum + balance.residual_power == pytest.approx(balance.delivered_power, abs=1e-9)
    assert abs(balance.residual_power.sum()) < 1e-3 * np.abs(balance.delivered_power).sum()
    assert np.abs(balance.force_residual).max() < 1e-6


def test_rollout_starts_in_the_initial_state() -> None:
    p = load_device("klute-3-4-pair").parameters
    still = record_rollout(
        p, np.full(50, 0.34), np.full(50, 3e5), STEP, initial_state=compute_equilibrium_state(p, 0.34, 3e5)
    )
    assert np.ptp(still.length) < 1e-9
    assert np.ptp(record_rollout(p, np.full(50, 0.34), np.full(50, 3e5), STEP).length) > 1e-4


def test_non_finite_state_is_an_error() -> None:
    p = load_device("klute-3-4-pair").parameters
    with pytest.raises(SimulationError, match=r"no finite state at t = 0\.0000 s"):
        record_rollout(p, np.full(5, 0.34), np.full(5, 3e5), STEP, initial_state=DeviceState(3e5, float("nan")))
