"""The bench in MuJoCo: the device without a leg."""

import numpy as np
import pytest

from klute_sim import bench
from klute_sim.device.device import load_device
from klute_sim.device.energy.ledger import POWER_TERMS
from klute_sim.errors import InputError
from klute_sim.laws import mckibben

PAIR = load_device("klute-3-4-pair")
BARE = load_device("klute-3-4")
STEP = 5e-4


def test_bare_muscle_force_equals_the_mckibben_law() -> None:
    length = np.full(400, 0.96 * 0.181)
    recording = bench.simulate_tester(BARE, length, np.full(400, 5e5), STEP)
    assert recording["force"][-1] == pytest.approx(736, abs=1)  # the crosshead gives way a little
    reached = 1e-3 * recording["length"][-1]
    assert recording["force"][-1] == pytest.approx(mckibben.force(BARE.parameters.muscle, 5e5, reached), rel=1e-9)


def test_pressure_is_limited_by_supply_and_rate() -> None:
    command = np.full(400, 9e5)
    command[:100] = 1e5
    recording = bench.simulate_tester(PAIR, np.full(400, 0.34), command, STEP)
    pressure = recording["pressure"]
    assert pressure[99] == pytest.approx(1.0)
    assert np.diff(pressure).max() == pytest.approx(100 * STEP)
    assert pressure[-1] == pytest.approx(5.0)
    assert recording["pressure_command"][-1] == 9.0


def test_muscle_and_damper_force_equals_tendon_force() -> None:
    time = np.arange(2000) * STEP
    recording = bench.simulate_tester(PAIR, 0.335 + 0.01 * np.sin(2 * np.pi * 2 * time), np.full(2000, 4e5), STEP)
    assert recording["muscle_length"].max() < 1e3 * PAIR.parameters.muscle.resting_length
    balance = recording["muscle_force"] + recording["damper_force"] - recording["force"]
    assert np.abs(balance).max() < 1e-6


def test_energy_balance_closes_over_a_cycle() -> None:
    step = 2e-4
    time = np.arange(round(1.0 / step)) * step
    recording = bench.simulate_tester(
        PAIR, 0.335 + 0.01 * np.sin(2 * np.pi * 2 * time), (3 + np.sin(2 * np.pi * 2 * time)) * 1e5, step
    )
    last = recording.select(recording["time"] >= 0.5)
    given = sum(last[line][1:].sum() * step for line in POWER_TERMS)
    delivered = last["delivered_power"][1:].sum() * step
    assert abs(given - delivered) < 1e-4 * np.abs(last["delivered_power"]).sum() * step
    assert delivered == pytest.approx(-np.trapezoid(last["force"], 1e-3 * last["length"]), rel=1e-9)


@pytest.mark.parametrize(
    ("length", "command", "says"),
    [
        (np.full(10, 0.2), np.full(9, 1e5), "equally many"),
        (np.full(10, np.nan), np.full(10, 1e5), "finite"),
        (np.full(10, 0.182), np.full(10, 1e5), "allowed for 'klute-3-4'"),
        (np.full(10, 0.05), np.full(10, 1e5), "allowed for 'klute-3-4'"),
    ],
)
def test_invalid_series_are_refused(length: np.ndarray, command: np.ndarray, says: str) -> None:
    with pytest.raises(InputError, match=says):
        bench.simulate_tester(BARE, length, command, STEP)


def test_invalid_time_step_is_refused() -> None:
    for step in (0.0, -1e-3, float("nan")):
        with pytest.raises(InputError, match="step is"):
            bench.simulate_tester(BARE, np.full(10, 0.18), np.full(10, 1e5), step)


def test_all_possible_muscle_lengths_are_accepted() -> None:
    lock = mckibben.lock_length(BARE.parameters.muscle)
    recording = bench.simulate_tester(BARE, np.linspace(lock, 0.181, 500), np.full(500, 5e5), STEP)
    assert recording["force"][-1] > recording["force"][0]
