"""One person who walks with a prosthesis, one interval after the other, under the commands of a policy."""

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.controllers.feedback import SensorReadings
from klute_sim.controllers.parse import Controller
from klute_sim.controllers.pressure import PressureController
from klute_sim.envs.base.task import CONTROL_INTERVAL
from klute_sim.errors import SimulationError
from klute_sim.types import Array
from klute_sim.units import BAR
from klute_sim.walker.outcomes import MIN_SWING, SEGMENT_LENGTH
from klute_sim.walker.reflexes.gain_table import Reflexes
from klute_sim.walker.simulation import state as layout
from klute_sim.walker.simulation.commands import DeviceCommands
from klute_sim.walker.simulation.simulator import WalkSimulator
from klute_sim.walker.simulation.walk import Walk

_LEAN = 2
_HIPS, _KNEES = (3, 6), (4, 7)
"""Coordinates of trunk and legs in MuJoCo's state."""
MIN_STEP_LENGTHS = 0.2
"""Least sum of two step lengths [m] for which their asymmetry means something (assumed)."""
MIN_SPEED, STANDING_TIME = 0.5, 2.0
"""Mean speed [m/s] over a time [s] below which a person stands, which counts as a fall (assumed)."""


class WholeBodyState(NamedTuple):
    """Motion of the whole person at the end of an interval: what a prosthesis does not sense."""

    speed_m_per_s: float
    """Forward speed of the hip [m/s]."""
    rise_m_per_s: float
    """Upward speed of the hip [m/s]."""
    hip_height_m: float
    """Height of the hip [m]."""
    trunk_lean_rad: float
    """Inclination of the trunk, forward positive [rad]."""
    trunk_rate_rad_per_s: float
    """Its rate [rad/s]."""
    hip_left_rad: float
    """Flexion of the left hip [rad]."""
    knee_left_rad: float
    """Flexion of the left knee [rad]."""
    ankle_left_rad: float
    """Dorsiflexion of the left ankle [rad]."""
    hip_right_rad: float
    """Flexion of the right hip [rad]."""
    knee_right_rad: float
    """Flexion of the right knee [rad]."""
    hip_rate_left_rad_per_s: float
    """Rate of the left hip [rad/s]."""
    knee_rate_left_rad_per_s: float
    """Rate of the left knee [rad/s]."""
    ankle_rate_left_rad_per_s: float
    """Rate of the left ankle [rad/s]."""
    hip_rate_right_rad_per_s: float
    """Rate of the right hip [rad/s]."""
    knee_rate_right_rad_per_s: float
    """Rate of the right knee [rad/s]."""
    load_left_bw: float
    """Vertical ground reaction of the left foot [body weights]."""
    load_right_bw: float
    """That of the right foot [body weights]."""
    step_asymmetry: float
    """(left - right)/(left + right) of the last two step lengths; 0 before both legs have made a step."""
    metabolic_cost_j_per_kg_m: float
    """Metabolic energy of the interval over body mass and the distance at target speed, the mean of both laws."""


class ActionController:
    """Pressure of an action: a pressure, or a change of that of a base controller, which sees the same sensors."""

    interval = CONTROL_INTERVAL

    def __init__(self, base: Controller | None, max_residual: float, max_pressure: float) -> None:
        """Change the pressure of ``base`` by at most ``max_residual``; None: command up to ``max_pressure`` [Pa]."""
        self._profile = base if isinstance(base, PressureController) else None
        self._feedback = None if isinstance(base, PressureController) else base
        self._max_residual, self._max_pressure = max_residual, max_pressure
        self.action = 0.0
        """Action until the next one, -1 to 1."""
        self.readings: SensorReadings | None = None
        """What the prosthesis senses at the beginning of the interval, with noise and delay."""

    def reset(self) -> None:
        """Prepare for a walk from its start."""
        if self._feedback is not None:
            self._feedback.reset()

    def command(self, readings: SensorReadings) -> float:
        """Return the commanded gauge pressure [Pa]; the ideal ``readings`` are not used."""
        sensed = self.readings or readings
        if self._feedback is not None:
            pressure = self._feedback.command(sensed)
        elif self._profile is not None:
            pressure = self._profile.pressure_at(sensed.phase)
        else:
            return 0.5 * (self.action + 1.0) * self._max_pressure
        return min(max(pressure + self._max_residual * self.action, 0.0), self._max_pressure)

    def describe(self) -> dict[str, Any]:
        """Return the base controller (JSON types)."""
        base = self._feedback or self._profile
        return {"kind": "action", "base": None if base is None else base.describe()}


class WalkingPerson:
    """A person in simulation; step it inside :func:`klute_sim.plant.callbacks.device_callbacks`."""

    def __init__(
        self, simulator: WalkSimulator, controller: ActionController | None, n_intervals: int, speed: float
    ) -> None:
        """Let a person walk for at most ``n_intervals``; ``speed`` is the target [m/s].

        ``controller`` commands the device; None: the prosthesis has none.
        """
        self.simulator, self._controller = simulator, controller
        self._steps_per_interval = round(CONTROL_INTERVAL / simulator.settings.dt)
        self._n_steps = n_intervals * self._steps_per_interval
        mass = simulator.settings.body_weight / GRAVITY
        self._cost_scale = 1.0 / (mass * speed * CONTROL_INTERVAL)

    def start(self, reflexes: Reflexes) -> None:
        """Start a walk with ``reflexes``."""
        self.simulator.reset(reflexes)
        self._commands = DeviceCommands(self.simulator, self._controller, self._n_steps)
        self._walk = Walk(self.simulator, self._commands)
        self.is_walking = True
        """Whether the person neither has fallen nor stands."""
        self._positions = deque([self.simulator.data.qpos[0]], maxlen=round(STANDING_TIME / CONTROL_INTERVAL))
        self._has_contact, self._swing_begin, self._step_lengths = [True, True], [0.0, 0.0], [0.0, 0.0]
        self._energy = 0.0
        self.body_state = self._observe()
        """What the person does at the end of the interval."""

    @property
    def command(self) -> float:
        """Last commanded gauge pressure [bar]; 0 without a device."""
        n = self._walk.n_steps
        return float(self._commands.pressures[n - 1]) / BAR if n and self._controller is not None else 0.0

    def read_sensors(self) -> tuple[float, ...]:
        """Return the readings of the prosthesis in the order of the observations, pressure in bar, and the phase."""
        readings = self._commands.read_sensors()
        return (*readings[:5], self.pressure, readings.phase)

    @property
    def pressure(self) -> float:
        """Gauge pressure of the device [bar]."""
        assert self.simulator.actuator is not None
        return float(self.simulator.data.act[self.simulator.actuator.act_address])

    def set_action(self, action: float, measured: Array) -> None:
        """Set the ``action`` of the next interval, and what the prosthesis has ``measured`` (7,) before it."""
        controller = self._commands.controller
        if isinstance(controller, ActionController):
            values = measured.tolist()
            controller.action = action
            controller.readings = SensorReadings._make((*values[:5], values[5] * BAR, values[6]))

    def advance(self) -> None:
        """Walk for one interval; threads may advance different persons at the same time."""
        try:
            self.is_walking = self._walk.advance(CONTROL_INTERVAL)
        except SimulationError:  # the Python backend raises at once when a device has no finite state
            self.is_walking = False
        self.body_state = self._observe()
        data, positions = self.simulator.data, self._positions
        if len(positions) == positions.maxlen and data.qpos[0] - positions[0] < MIN_SPEED * STANDING_TIME:
            self.is_walking = False
        positions.append(data.qpos[0])
        if not (math.isfinite(sum(self.body_state)) and math.isfinite(data.act.sum())):
            self.is_walking = False

    def _observe(self) -> WholeBodyState:
        state, data = self.simulator.state, self.simulator.data
        q, v = data.qpos.tolist(), data.qvel.tolist()
        self._update_steps(q)
        left, right = self._step_lengths
        has_stepped = left != 0.0 and right != 0.0
        asymmetry = (left - right) / max(left + right, MIN_STEP_LENGTHS) if has_stepped else 0.0
        energy = 0.5 * float(state[layout.METABOLIC_MINETTI] + state[layout.METABOLIC_BHARGAVA])
        cost, self._energy = self._cost_scale * (energy - self._energy), energy
        loads = state[layout.LOAD : layout.LOAD + layout.N_SIDES].tolist()
        trunk = (v[0], v[1], q[1], q[_LEAN], v[_LEAN])
        return WholeBodyState._make((*trunk, *q[3:8], *v[3:8], *loads, min(max(asymmetry, -1.0), 1.0), cost))

    def _update_steps(self, q: list[float]) -> None:
        """Measure a step where a foot strikes after a swing; a bounce or a scuff is no step."""
        time = self.simulator.time
        stance = self.simulator.state[layout.STANCE : layout.STANCE + layout.N_SIDES].tolist()
        for side, had_contact in enumerate(self._has_contact):
            has_contact = self._has_contact[side] = stance[side] > 0.5
            if had_contact and not has_contact:
                self._swing_begin[side] = time
            elif has_contact and not had_contact and time - self._swing_begin[side] > MIN_SWING:
                self._step_lengths[side] = _measure_step(q, side)


def _measure_step(q: list[float], side: int) -> float:
    """Return the distance by which the ankle of ``side`` is ahead of the other one [m]."""
    ahead = []
    for hip, knee in zip(_HIPS, _KNEES, strict=True):
        thigh = q[hip] - q[_LEAN]
        ahead.append(SEGMENT_LENGTH * (math.sin(thigh) + math.sin(thigh - q[knee])))
    return ahead[side] - ahead[1 - side]


def stack_body_states(people: list[WalkingPerson]) -> dict[str, Array]:
    """Return the :class:`WholeBodyState` of ``people`` (n,) by name."""
    rows = np.array([person.body_state for person in people])
    return dict(zip(WholeBodyState._fields, rows.T, strict=True))
