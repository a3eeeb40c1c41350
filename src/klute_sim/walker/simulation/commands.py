"""Pressure commands to the prosthesis of a walker, from the sensors of the prosthesis alone."""

import copy

import numpy as np

from klute_sim.controllers.feedback import SensorReadings
from klute_sim.controllers.parse import Controller
from klute_sim.controllers.pressure import PressureController
from klute_sim.device.delay import DelayLine
from klute_sim.device.dynamics import get_dead_time
from klute_sim.errors import InputError
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.types import Array
from klute_sim.units import BAR
from klute_sim.walker.simulation import state as layout
from klute_sim.walker.simulation.simulator import WalkSimulator

COMMAND_INTERVAL = 0.01
"""Time between two commands of a controller that follows the gait phase, and between two looks at a walk [s]."""
_HIP_RIGHT, _KNEE_RIGHT = 6, 7
"""Coordinates of the right leg in MuJoCo's state."""


class DeviceCommands:
    """Commands of a controller to the device of one simulation.

    A controller that follows the gait phase gets the phase that the load cell tells: the time since the last foot
    strike over the duration of the stride before.
    """

    def __init__(self, simulator: WalkSimulator, controller: Controller | None, n_steps: int) -> None:
        """Command the device of ``simulator`` for at most ``n_steps`` steps; None: the prosthesis has no device.

        Raises InputError when the interval of the controller is not a multiple of the time step.
        """
        self._simulator = simulator
        self.controller = copy.deepcopy(controller)
        """Controller of this simulation alone; None: there is no device."""
        dt = simulator.settings.dt
        interval = COMMAND_INTERVAL
        self._feedback = None if isinstance(self.controller, PressureController) else self.controller
        if self._feedback is not None:
            interval = self._feedback.interval
        self.steps_per_command = round(interval / dt)
        if self.steps_per_command < 1 or abs(self.steps_per_command * dt - interval) > 1e-9:
            raise InputError(
                f"time step is {1e3 * dt:g} ms; allowed: a whole fraction of the controller's interval, "
                f"{1e3 * interval:g} ms"
            )
        self._delay: DelayLine | None = None
        actuator = simulator.actuator
        if actuator is not None:
            self._ankle = int(simulator.model.joint(PROSTHESIS_PREFIX + "ankle").qposadr[0])
        if controller is None or actuator is None:
            self.controller = self._feedback = None
            return
        self.pressures: Array = np.zeros(n_steps + self.steps_per_command)
        dead_time = get_dead_time(actuator.parameters)
        if dead_time > 0.0:
            self._delay = DelayLine(self.pressures, dead_time, dt)
        if self._feedback is not None:
            self._feedback.reset()

    @property
    def steps_per_update(self) -> int:
        """Number of steps between two calls of :meth:`update`; a dead time needs every step."""
        return 1 if self._delay is not None else self.steps_per_command

    def update(self, index: int) -> None:
        """Command the device at time step ``index``."""
        if self.controller is None or self._simulator.actuator is None:
            return
        if index % self.steps_per_command == 0:
            self.pressures[index : index + self.steps_per_command] = self._compute_pressure()
        pressure = self.pressures[index] if self._delay is None else self._delay.sample(index)
        self._simulator.actuator.set_command(self._simulator.data, float(pressure))

    def _compute_pressure(self) -> float:
        if self._feedback is not None:
            return self._feedback.command(self.read_sensors())
        assert isinstance(self.controller, PressureController)
        return self.controller.pressure_at(self._estimate_phase())

    def _estimate_phase(self) -> float:
        state = self._simulator.state
        return min(float(state[layout.PHASE_TIME] / state[layout.STRIDE_TIME]), 1.0)

    def read_sensors(self) -> SensorReadings:
        """Return the readings of the prosthesis; inclinations are relative to gravity, as for an inertial sensor."""
        simulator = self._simulator
        qpos, qvel = simulator.data.qpos.tolist(), simulator.data.qvel.tolist()
        assert simulator.actuator is not None
        return SensorReadings(
            ankle_angle=-qpos[self._ankle],
            ankle_rate=-qvel[self._ankle],
            shank_angle=qpos[2] - qpos[_HIP_RIGHT] + qpos[_KNEE_RIGHT] - simulator.settings.slope,
            shank_rate=qvel[2] - qvel[_HIP_RIGHT] + qvel[_KNEE_RIGHT],
            load=float(simulator.state[layout.PYLON_LOAD]),
            pressure=BAR * float(simulator.data.act[simulator.actuator.act_address]),
            phase=self._estimate_phase(),
        )
