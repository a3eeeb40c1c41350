"""The device alone with its ledger: the rollout's steps, and the same bits compiled and not."""

import numpy as np
import pytest

from klute_sim.device.account import account
from klute_sim.device.files import load, read
from klute_sim.device.ledger import LINES
from klute_sim.device.rollout import rollout
from klute_sim.device.step import State, settled
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
def test_compiled_and_python_agree_to_the_bit_and_take_the_rollouts_steps(name: str) -> None:
    device = read(load("klute-3-4-pair").content + EFFECTS, "mine") if name == "with effects" else load(name)
    p = device.parameters
    length = p.tendon.slack_length + p.muscle.resting_length * (0.93 + 0.05 * np.sin(15 * TIME))
    command = np.where(TIME % 0.3 < 0.15, 4e5, 1e5)
    fast, slow = (account(p, length, command, STEP, law=law) for law in ("compiled", "python"))
    for a, b in zip([*fast[:4], *fast.ledger[:-1]], [*slow[:4], *slow.ledger[:-1]], strict=True):
        assert np.array_equal(a, b)
    plain = rollout(p, length, command, STEP)
    assert np.array_equal(fast.tension, plain.tension)
    assert np.array_equal(fast.length, plain.length)
    assert np.ptp(fast.ledger.gas_power) > 1.0
    assert (np.ptp(fast.ledger.effects_power) > 0.1) == (name == "with effects")
    assert set(fast.ledger.shares) == ({"tendon_hysteresis", "pressure_delay"} if name == "with effects" else set())


def test_every_effect_has_its_share_and_the_shares_are_all_there_is() -> None:
    more = (
        EFFECTS
        + b"[effects.braid_hysteresis]\nslope_n_per_bar = 10.0\n[effects.threshold_pressure]\npressure_bar = 0.2\n"
    )
    p = read(load("klute-3-4-pair").content + more, "mine").parameters
    length = p.tendon.slack_length + p.muscle.resting_length * (0.93 + 0.05 * np.sin(15 * TIME))
    told = account(p, length, np.full(len(TIME), 3e5), STEP).ledger
    work = {name: STEP * power.sum() for name, power in told.shares.items()}
    assert set(work) == {"tendon_hysteresis", "pressure_delay", "braid_hysteresis", "threshold_pressure"}
    assert work["pressure_delay"] == 0.0  # it moves no force of its own
    assert work["braid_hysteresis"] < -0.1
    assert work["tendon_hysteresis"] < 0.0
    assert sum(told.shares.values()) == pytest.approx(told.effects_power, abs=1e-12)
    given = sum(getattr(told, line) for line in LINES)
    assert given == pytest.approx(told.delivered_power, abs=1e-9)
    assert STEP * np.abs(told.solver_power).sum() < 1e-3 * STEP * np.abs(told.delivered_power).sum()


def test_where_it_starts_can_be_said() -> None:
    p = load("klute-3-4-pair").parameters
    still = account(p, np.full(50, 0.34), np.full(50, 3e5), STEP, start=settled(p, 0.34, 3e5))
    assert np.ptp(still.length) < 1e-9
    assert np.ptp(account(p, np.full(50, 0.34), np.full(50, 3e5), STEP).length) > 1e-4


def test_what_is_not_finite_is_said() -> None:
    p = load("klute-3-4-pair").parameters
    with pytest.raises(SimulationError, match=r"no finite state at t = 0\.0000 s"):
        account(p, np.full(5, 0.34), np.full(5, 3e5), STEP, start=State(3e5, float("nan")))
