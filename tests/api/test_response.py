"""The response of a device to prescribed series: statics, times of the samples, hold of commands, and refusals."""

from typing import Any

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.device.device import parse_device
from klute_sim.laws import mckibben
from klute_sim.units import BAR

DEVICE = "klute-3-4-pair"
TIME = np.arange(0.0, 1.0, 0.01)
LENGTH = 330.0 - 4.0 * np.sin(6.0 * TIME)
VALVE_TEXT = ks.load_device("klute-1-1-4-pair-valve").content.decode()
VALVE_TEXT = VALVE_TEXT.replace('command = "pressure"\ngain_per_bar = 5.0\n', 'command = "opening"\n')
VALVE = parse_device(VALVE_TEXT.replace('"valve.gain_per_bar" =', "#").encode(), "valve")
COMMAND = 2.0 + np.sin(4.0 * TIME)


def test_constant_inputs_give_the_static_force() -> None:
    recording = ks.simulate_response(DEVICE, TIME, np.full(len(TIME), 330.0), 3.0)
    muscle = ks.load_device(DEVICE).parameters.muscle
    assert recording["pressure"][-1] == pytest.approx(3.0)
    expected = mckibben.force(muscle, 3.0 * BAR, 1e-3 * recording["muscle_length"][-1])
    assert recording["force"][-1] == pytest.approx(expected, rel=1e-3)


def test_response_is_at_the_given_times() -> None:
    late = ks.simulate_response(DEVICE, TIME + 5.0, LENGTH, COMMAND)
    assert late["time"] == pytest.approx(TIME + 5.0)
    assert late["length"] == pytest.approx(LENGTH)
    assert late["pressure_command"] == pytest.approx(COMMAND)
    reference = ks.simulate_response(DEVICE, TIME, LENGTH, COMMAND)
    for name in ("force", "pressure", "muscle_length"):
        assert late[name] == pytest.approx(reference[name], rel=1e-6), name
    assert {name: reference.units[name] for name in ("force", "pressure", "muscle_length")} == {
        "force": "N",
        "pressure": "bar",
        "muscle_length": "mm",
    }
    assert reference.provenance["options"]["zero_order_hold"] is False


def test_uneven_times_are_simulated_alike() -> None:
    even = ks.simulate_response(DEVICE, TIME, LENGTH, COMMAND)
    chosen = np.delete(np.arange(len(TIME)), [11, 40, 41])
    uneven = ks.simulate_response(DEVICE, TIME[chosen], LENGTH[chosen], COMMAND[chosen])
    assert uneven["force"] == pytest.approx(even["force"][chosen], rel=0.01)


def test_error_falls_in_proportion_to_the_time_step() -> None:
    forces = [
        ks.simulate_response(DEVICE, TIME, LENGTH, COMMAND, time_step=step)["force"] for step in (1e-3, 5e-4, 2.5e-4)
    ]
    coarse, fine = (np.abs(np.diff(pair, axis=0)).mean() for pair in (forces[:2], forces[1:]))
    assert coarse / fine == pytest.approx(2.0, rel=0.15)


def test_held_command_acts_after_its_sample() -> None:
    length, step = np.full(len(TIME), 330.0), np.where(TIME < 0.5, 1.0, 2.0)
    held, linear = (
        ks.simulate_response(DEVICE, TIME, length, step, zero_order_hold=is_held) for is_held in (True, False)
    )
    at_step = int(np.flatnonzero(step == 2.0)[0])
    assert held["pressure"][at_step] == pytest.approx(1.0, abs=1e-6)
    assert linear["pressure"][at_step] > 1.3
    assert held["pressure"][at_step + 5] == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time_s": TIME[:1]}, "at least two samples"),
        ({"time_s": TIME[::-1]}, "increase from each sample"),
        ({"length_mm": LENGTH[:-1]}, "length_mm has the shape"),
        ({"length_mm": np.full(len(TIME), np.nan)}, "length_mm must be finite"),
        ({"length_mm": np.full(len(TIME), 20.0)}, "unit length runs from"),
        ({"pressure_command_bar": 9.0}, "the supply of 'klute-3-4-pair' allows 0 to"),
        ({"pressure_command_bar": -0.1}, "allows 0 to"),
        ({"time_step": 0.0}, "time_step is 0 s"),
        ({"device": VALVE}, "simulate_response commands pressures"),
    ],
)
def test_unusable_input_is_refused(change: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {"device": DEVICE, "time_s": TIME, "length_mm": LENGTH, "pressure_command_bar": COMMAND}
    with pytest.raises(ks.InputError, match=message):
        ks.simulate_response(**(arguments | change))
