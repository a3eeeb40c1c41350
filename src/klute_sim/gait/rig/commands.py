"""What a controller asks for along a walk, whether it knows the phase or only what a prosthesis senses."""

import mujoco
import numpy as np

from klute_sim.controllers.parse import Controller
from klute_sim.controllers.pressure import PressureController
from klute_sim.errors import InputError
from klute_sim.gait.rig.sensors import ProsthesisSensors, to_sensor_readings
from klute_sim.gait.rig.setup import GaitRig
from klute_sim.recording.recording import Array

_ALL_SIMULATIONS = np.ones(1, dtype=np.bool_)


class PressureCommands:
    """Of ``controller`` over ``count`` steps of ``rig``."""

    def __init__(self, controller: Controller, gait_rig: GaitRig, n_steps: int) -> None:
        """Raises InputError for a controller whose interval is no whole number of steps."""
        self.pressures: Array = np.empty(n_steps)
        """Gauge pressure [Pa] at each step that has been."""
        self._n_known, self._controller = 0, None
        if isinstance(controller, PressureController):
            stride = np.array([controller.pressure_at(float(p)) for p in gait_rig.phase])
            self.pressures[:] = np.resize(stride, n_steps)
            self._n_known = n_steps
            return
        step = gait_rig.options.dt
        self._steps_per_command = round(controller.interval / step)
        if self._steps_per_command < 1 or abs(self._steps_per_command * step - controller.interval) > 1e-9:
            interval = 1e3 * controller.interval
            raise InputError(
                f"step is {1e3 * step:g} ms; allowed: what divides the controller's {interval:g} ms evenly"
            )
        self._controller, self._sensors = controller, ProsthesisSensors(gait_rig, 1, controller.interval)
        self._sensors.reset(_ALL_SIMULATIONS)
        controller.reset()

    def update(self, index: int, data: mujoco.MjData) -> float:
        """Gauge pressure [Pa] asked for at step ``k``, which ``data`` is at the start of."""
        if index >= self._n_known and self._controller is not None:
            if index > 0:
                self._sensors.update_phase(self._sensors.measure_load(data.sensordata[None]), _ALL_SIMULATIONS)
            now = self._sensors.read(data.qpos[None], data.qvel[None], data.act[None], data.sensordata[None])
            self.pressures[index : index + self._steps_per_command] = self._controller.command(to_sensor_readings(now))
            self._n_known = index + self._steps_per_command
        return float(self.pressures[index])

    def sample(self, index: float) -> float:
        """Gauge pressure [Pa] asked for at ``place``, in steps, no later than now; the first one before the walk."""
        if index <= 0.0:
            return float(self.pressures[0])
        low = int(index)
        here = float(self.pressures[low])
        return here if index == low else here + (index - low) * (float(self.pressures[low + 1]) - here)
