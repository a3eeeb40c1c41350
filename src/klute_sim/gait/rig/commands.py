"""Pressure commands of a controller during a gait run, whether it knows the gait phase or only sensor readings."""

import mujoco
import numpy as np

from klute_sim.controllers.parse import Controller
from klute_sim.controllers.pressure import PressureController
from klute_sim.errors import InputError
from klute_sim.gait.rig.sensors import ProsthesisSensors, to_sensor_readings
from klute_sim.gait.rig.setup import GaitRig
from klute_sim.types import Array

_ALL_SIMULATIONS = np.ones(1, dtype=np.bool_)


class PressureCommands:
    """Commands of a controller over all time steps of a gait run."""

    def __init__(self, controller: Controller, gait_rig: GaitRig, n_steps: int) -> None:
        """Prepare the commands of ``controller`` for ``n_steps`` time steps of ``gait_rig``.

        Raises InputError when the interval of a feedback controller is not a multiple of the time step.
        """
        self.pressures: Array = np.empty(n_steps)
        """Commanded gauge pressure [Pa] at each time step; with a feedback controller, known up to the current one."""
        self._n_known, self._controller = 0, None
        if isinstance(controller, PressureController):
            stride = np.array([controller.pressure_at(float(phase)) for phase in gait_rig.phase])
            self.pressures[:] = np.resize(stride, n_steps)
            self._n_known = n_steps
            return
        dt = gait_rig.options.dt
        self._steps_per_command = round(controller.interval / dt)
        if self._steps_per_command < 1 or abs(self._steps_per_command * dt - controller.interval) > 1e-9:
            raise InputError(
                f"time step is {1e3 * dt:g} ms; allowed: a whole fraction of the controller's interval, "
                f"{1e3 * controller.interval:g} ms"
            )
        self._controller, self._sensors = controller, ProsthesisSensors(gait_rig, 1, controller.interval)
        self._sensors.reset(_ALL_SIMULATIONS)
        controller.reset()

    def update(self, index: int, data: mujoco.MjData) -> float:
        """Return the commanded gauge pressure [Pa] at time step ``index``; ``data`` is the simulation at its start."""
        if index >= self._n_known and self._controller is not None:
            if index > 0:
                self._sensors.update_phase(self._sensors.measure_load(data.sensordata[None]), _ALL_SIMULATIONS)
            columns = self._sensors.read(data.qpos[None], data.qvel[None], data.act[None], data.sensordata[None])
            pressure = self._controller.command(to_sensor_readings(columns))
            self.pressures[index : index + self._steps_per_command] = pressure
            self._n_known = index + self._steps_per_command
        return float(self.pressures[index])
