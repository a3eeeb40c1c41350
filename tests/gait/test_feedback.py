"""Controllers that see only what a prosthesis senses: what they are told, and the state machine."""

import math
from typing import Any

import numpy as np
import pytest

from klute_sim.controllers.feedback import SensorReadings
from klute_sim.controllers.pressure import ConstantPressure
from klute_sim.controllers.state_machine import StateMachine, load_default_state_machine, parse_state_machine
from klute_sim.device.device import load_device, parse_device
from klute_sim.errors import InputError
from klute_sim.gait.metrics import compute_gait_metrics
from klute_sim.gait.reference import GRAVITY
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions

DEVICE = load_device("klute-1-1-4-pair")
PRESSURES = {"loading_bar": 1.1, "rollover_bar": 1.8, "rollover_end_bar": 3.2, "push_off_bar": 4.4, "swing_bar": 0.9}
SHORT = GaitOptions(strides=2, dt=1e-3)


class Listener:
    """Asks for what the constant controller does, and keeps what it was told."""

    interval = 0.01

    def __init__(self) -> None:
        self.told: list[SensorReadings] = []

    def reset(self) -> None:
        self.told.clear()

    def command(self, readings: SensorReadings) -> float:
        self.told.append(readings)
        return 1e5

    def describe(self) -> dict[str, Any]:
        return {"kind": "listener"}


def machine(**changed: float) -> StateMachine:
    return StateMachine(**{**PRESSURES, **changed})


def test_a_controller_that_hears_and_asks_for_a_constant_walks_like_the_constant() -> None:
    listener = Listener()
    heard, constant = simulate_gait(DEVICE, listener, SHORT), simulate_gait(DEVICE, ConstantPressure(1e5), SHORT)
    for name in heard.channels:
        assert np.array_equal(heard[name], constant[name], equal_nan=True), name
    every = 10
    assert len(listener.told) == math.ceil(len(heard["time"]) / every)
    # What was told is what was recorded at that moment; forces and gauges are one step older.
    angle = np.array([each.ankle_angle for each in listener.told])
    shank = np.array([each.shank_angle for each in listener.told])
    assert np.degrees(angle) == pytest.approx(heard["ankle_angle"][::every], abs=1e-9)
    assert np.degrees(shank) == pytest.approx(heard["shank_angle"][::every], abs=1e-9)
    load_told = np.array([each.load for each in listener.told][1:])
    assert load_told == pytest.approx(heard["grf_vertical"][::every][1:] / (75.0 * GRAVITY), abs=0.25)
    assert np.corrcoef(load_told, heard["grf_vertical"][::every][1:])[0, 1] > 0.95
    phase = np.array([each.phase for each in listener.told])
    true = heard["gait_phase"][::every] / 100.0
    apart = np.abs(phase - true)
    assert np.median(np.minimum(apart, 1.0 - apart)) < 0.05


def test_an_inertial_sensor_tells_inclination_to_gravity() -> None:
    level, uphill = Listener(), Listener()
    simulate_gait(DEVICE, level, GaitOptions(strides=1, dt=1e-3))
    simulate_gait(DEVICE, uphill, GaitOptions(strides=1, dt=1e-3, slope=math.radians(3.0)))
    count = min(len(level.told), len(uphill.told))
    apart = [
        math.degrees(a.shank_angle - b.shank_angle)
        for a, b in zip(level.told[:count], uphill.told[:count], strict=True)
    ]
    assert np.abs(apart).max() < 1.5  # the segments keep their inclination in space


def test_dead_time_holds_back_what_a_controller_asks_for() -> None:
    late = parse_device(DEVICE.content + b"\n[effects.pressure_delay]\ndelay_s = 0.0305\n", "late")
    now, later = (simulate_gait(device, machine(), SHORT) for device in (DEVICE, late))
    first = int(np.flatnonzero(now["pressure"] > now["pressure"][0] + 0.2)[0])
    second = int(np.flatnonzero(later["pressure"] > later["pressure"][0] + 0.2)[0])
    assert (second - first) * 1e-3 == pytest.approx(0.0305, abs=0.012)


def test_the_interval_has_to_be_a_whole_number_of_steps() -> None:
    with pytest.raises(InputError, match=r"step is 0\.3 ms; allowed: what divides the controller's 10 ms evenly"):
        simulate_gait(DEVICE, machine(), GaitOptions(strides=1, dt=3e-4))


def sensed(load: float, lean: float) -> SensorReadings:
    return SensorReadings(0.0, 0.0, math.radians(lean), 0.0, load, 0.0, 0.0)


def test_a_stride_goes_round_the_states() -> None:
    one = machine(lean_deg=12.0)
    one.reset()
    path = [(0.0, -20.0), (0.6, -18.0), (0.8, 1.0), (0.7, 6.0), (0.9, 11.9), (1.1, 13.0), (0.4, 40.0), (0.02, 50.0)]
    asked, states = [], []
    for load_, lean in [*path, (0.0, -10.0), (0.3, -20.0)]:
        asked.append(one.command(sensed(load_, lean)) / 1e5)
        states.append(one.state)
    assert states == ["loading"] * 2 + ["rollover"] * 3 + ["push_off"] * 2 + ["swing"] * 2 + ["loading"]
    assert asked == pytest.approx(
        [1.1, 1.1, 1.8 + 1.4 / 12.0, 1.8 + 1.4 * 0.5, 1.8 + 1.4 * 11.9 / 12.0, 4.4, 4.4, 0.9, 0.9, 1.1]
    )


def test_a_stumble_ends_in_swing_and_a_bounce_does_not() -> None:
    stumbles = machine()
    stumbles.reset()
    for load_, lean in ((0.8, 5.0), (0.01, 6.0)):
        stumbles.command(sensed(load_, lean))
    assert stumbles.state == "swing"
    bounces = machine()
    bounces.reset()
    for load_, lean in ((0.8, -15.0), (0.01, -14.0)):
        bounces.command(sensed(load_, lean))
    assert bounces.state == "loading"


def test_the_machine_walks_and_pushes_off_by_its_own_sensors() -> None:
    found = compute_gait_metrics(simulate_gait(DEVICE, machine(lean_deg=14.0), GaitOptions(strides=3, dt=1e-3)))
    off = compute_gait_metrics(simulate_gait(DEVICE, ConstantPressure(0.0), SHORT))
    assert not found.has_swing_contact
    assert found.strides[-1].ankle_work_net_j_per_kg > off.strides[-1].ankle_work_net_j_per_kg + 0.1
    assert found.strides[-1].ankle_power_peak_w_per_kg > 2.0


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"swing_bar": -1.0}, "swing_bar of the state machine is -1; allowed: 0 to 20 bar"),
        ({"push_off_bar": math.nan}, "push_off_bar of the state machine is nan"),
        ({"lift_bw": 0.2}, "0 < lift_bw < strike_bw < 1"),
        ({"lean_deg": -5.0}, "upright_deg < lean_deg"),
    ],
)
def test_a_machine_that_cannot_go_round_is_refused(changed: dict[str, float], says: str) -> None:
    with pytest.raises(InputError, match=says):
        machine(**changed)


def test_the_shipped_machine_is_read_from_its_file_and_says_what_it_is() -> None:
    told = load_default_state_machine().describe()
    assert told["kind"] == "machine"
    text = "\n".join(f"{name} = {value}" for name, value in told.items() if name != "kind")
    assert parse_state_machine(text, "again").describe() == told


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("swing_bar = ", "is no TOML file"),
        ("swing = 1", "there is no 'swing'; there are: loading_bar"),
        ("swing_bar = 1", "'loading_bar' is missing"),
        ("swing_bar = true", "'swing_bar' is True; allowed: a number"),
        ("state = 1", "there is no 'state'"),
    ],
)
def test_a_file_that_is_no_machine_is_refused(text: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        parse_state_machine(text, "mine.toml")
