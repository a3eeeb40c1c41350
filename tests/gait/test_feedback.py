"""Feedback controllers: their sensor readings, and the state machine."""

import math
from typing import Any

import numpy as np
import pytest

from klute_sim.constants import GRAVITY
from klute_sim.controllers.feedback import SensorReadings
from klute_sim.controllers.pressure import ConstantPressure
from klute_sim.controllers.state_machine import StateMachine, load_default_state_machine, parse_state_machine
from klute_sim.device.device import load_device, parse_device
from klute_sim.errors import InputError
from klute_sim.gait.metrics import compute_gait_metrics
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions

DEVICE = load_device("klute-1-1-4-pair")
PRESSURES = {"loading_bar": 1.1, "rollover_bar": 1.8, "rollover_end_bar": 3.2, "push_off_bar": 4.4, "swing_bar": 0.9}
SHORT = GaitOptions(strides=2, dt=1e-3, alignment=0.0, learning_strides=5)


class RecordingController:
    """Command the pressure of the constant controller, and record the readings."""

    interval = 0.01

    def __init__(self) -> None:
        self.readings: list[SensorReadings] = []

    def reset(self) -> None:
        self.readings.clear()

    def command(self, readings: SensorReadings) -> float:
        self.readings.append(readings)
        return 1e5

    def describe(self) -> dict[str, Any]:
        return {"kind": "listener"}


def create_machine(**changed: float) -> StateMachine:
    return StateMachine(**{**PRESSURES, **changed})


def test_constant_feedback_controller_equals_the_constant_controller() -> None:
    recorder = RecordingController()
    feedback_run, constant = simulate_gait(DEVICE, recorder, SHORT), simulate_gait(DEVICE, ConstantPressure(1e5), SHORT)
    for name in feedback_run.channels:
        assert np.array_equal(feedback_run[name], constant[name], equal_nan=True), name
    steps_per_command = 10
    assert len(recorder.readings) == math.ceil(len(feedback_run["time"]) / steps_per_command)
    # Readings equal the recorded values; forces are one time step older.
    angle = np.array([reading.ankle_angle for reading in recorder.readings])
    shank = np.array([reading.shank_angle for reading in recorder.readings])
    assert np.degrees(angle) == pytest.approx(feedback_run["ankle_angle"][::steps_per_command], abs=1e-9)
    assert np.degrees(shank) == pytest.approx(feedback_run["shank_angle"][::steps_per_command], abs=1e-9)
    loads = np.array([reading.load for reading in recorder.readings][1:])
    assert loads == pytest.approx(feedback_run["grf_vertical"][::steps_per_command][1:] / (75.0 * GRAVITY), abs=0.25)
    assert np.corrcoef(loads, feedback_run["grf_vertical"][::steps_per_command][1:])[0, 1] > 0.95
    phase = np.array([reading.phase for reading in recorder.readings])
    true_phase = feedback_run["gait_phase"][::steps_per_command] / 100.0
    apart = np.abs(phase - true_phase)
    assert np.median(np.minimum(apart, 1.0 - apart)) < 0.05


def test_shank_angle_is_relative_to_gravity() -> None:
    level, uphill = RecordingController(), RecordingController()
    simulate_gait(DEVICE, level, GaitOptions(strides=1, dt=1e-3, alignment=0.0, learning_strides=0))
    simulate_gait(
        DEVICE,
        uphill,
        GaitOptions(strides=1, dt=1e-3, slope=math.radians(3.0), alignment=0.0, learning_strides=0),
    )
    count = min(len(level.readings), len(uphill.readings))
    apart = [
        math.degrees(a.shank_angle - b.shank_angle)
        for a, b in zip(level.readings[:count], uphill.readings[:count], strict=True)
    ]
    assert np.abs(apart).max() < 1.5  # the segments keep their inclination in space


def test_dead_time_delays_the_commands() -> None:
    late = parse_device(DEVICE.content + b"\n[effects.pressure_delay]\ndelay_s = 0.0305\n", "late")
    now, later = (simulate_gait(device, create_machine(), SHORT) for device in (DEVICE, late))
    first = int(np.flatnonzero(now["pressure"] > now["pressure"][0] + 0.2)[0])
    second = int(np.flatnonzero(later["pressure"] > later["pressure"][0] + 0.2)[0])
    assert (second - first) * 1e-3 == pytest.approx(0.0305, abs=0.012)


def test_interval_must_be_a_multiple_of_the_time_step() -> None:
    with pytest.raises(
        InputError, match=r"time step is 0\.3 ms; allowed: a whole fraction of the controller's interval, 10 ms"
    ):
        simulate_gait(DEVICE, create_machine(), GaitOptions(strides=1, dt=3e-4))


def create_readings(load: float, lean: float) -> SensorReadings:
    return SensorReadings(0.0, 0.0, math.radians(lean), 0.0, load, 0.0, 0.0)


def test_stride_passes_through_all_states() -> None:
    controller = create_machine(lean_deg=12.0)
    controller.reset()
    path = [(0.0, -20.0), (0.6, -18.0), (0.8, 1.0), (0.7, 6.0), (0.9, 11.9), (1.1, 13.0), (0.4, 40.0), (0.02, 50.0)]
    pressures_bar, states = [], []
    for load_, lean in [*path, (0.0, -10.0), (0.3, -20.0)]:
        pressures_bar.append(controller.command(create_readings(load_, lean)) / 1e5)
        states.append(controller.state)
    assert states == ["loading"] * 2 + ["rollover"] * 3 + ["push_off"] * 2 + ["swing"] * 2 + ["loading"]
    assert pressures_bar == pytest.approx(
        [1.1, 1.1, 1.8 + 1.4 / 12.0, 1.8 + 1.4 * 0.5, 1.8 + 1.4 * 11.9 / 12.0, 4.4, 4.4, 0.9, 0.9, 1.1]
    )


def test_stumble_leads_to_swing_but_a_bounce_does_not() -> None:
    stumbles = create_machine()
    stumbles.reset()
    for load_, lean in ((0.8, 5.0), (0.01, 6.0)):
        stumbles.command(create_readings(load_, lean))
    assert stumbles.state == "swing"
    bounces = create_machine()
    bounces.reset()
    for load_, lean in ((0.8, -15.0), (0.01, -14.0)):
        bounces.command(create_readings(load_, lean))
    assert bounces.state == "loading"


@pytest.mark.slow
def test_state_machine_walks_with_push_off() -> None:
    metrics = compute_gait_metrics(
        simulate_gait(DEVICE, create_machine(lean_deg=14.0), GaitOptions(strides=3, dt=1e-3))
    )
    off = compute_gait_metrics(simulate_gait(DEVICE, ConstantPressure(0.0), SHORT))
    assert not metrics.has_swing_contact
    assert metrics.strides[-1].ankle_work_net_j_per_kg > off.strides[-1].ankle_work_net_j_per_kg + 0.1
    assert metrics.strides[-1].ankle_power_peak_w_per_kg > 2.0


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"swing_bar": -1.0}, "swing_bar of the state machine is -1; allowed: 0 to 20 bar"),
        ({"push_off_bar": math.nan}, "push_off_bar of the state machine is nan"),
        ({"lift_bw": 0.2}, "0 < lift_bw < strike_bw < 1"),
        ({"lean_deg": -5.0}, "upright_deg < lean_deg"),
    ],
)
def test_invalid_thresholds_are_refused(changed: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        create_machine(**changed)


def test_default_state_machine_round_trips_through_its_file() -> None:
    description = load_default_state_machine().describe()
    assert description["kind"] == "machine"
    text = "\n".join(f"{name} = {value}" for name, value in description.items() if name != "kind")
    assert parse_state_machine(text.encode(), "again").describe() == description


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("swing_bar = ", "is not valid TOML"),
        ("swing = 1", "unknown key 'swing'; allowed: loading_bar"),
        ("swing_bar = 1", "'loading_bar' is missing"),
        ("swing_bar = true", "'swing_bar' is True; allowed: a number"),
        ("state = 1", "unknown key 'state'"),
    ],
)
def test_invalid_state_machine_file_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_state_machine(text.encode(), "mine.toml")
