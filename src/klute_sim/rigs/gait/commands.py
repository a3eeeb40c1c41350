"""What a controller asks for along a walk, whether it knows the phase or only what a prosthesis senses."""

import mujoco
import numpy as np

from klute_sim.control.pressure import PressureController
from klute_sim.control.word import Controller
from klute_sim.errors import InputError
from klute_sim.recording.recording import Samples
from klute_sim.rigs.gait.assembly import Assembly
from klute_sim.rigs.gait.senses import Senses, sensed

_ALL = np.ones(1, dtype=np.bool_)


class Commands:
    """Of ``controller`` over ``count`` steps of ``rig``."""

    def __init__(self, controller: Controller, rig: Assembly, count: int) -> None:
        """Raises InputError for a controller whose interval is no whole number of steps."""
        self.asked: Samples = np.empty(count)
        """Gauge pressure [Pa] at each step that has been."""
        self._known, self._controller = 0, None
        if isinstance(controller, PressureController):
            stride = np.array([controller.pressure(float(p)) for p in rig.phase])
            self.asked[:] = np.resize(stride, count)
            self._known = count
            return
        step = rig.options.step
        self._every = round(controller.interval / step)
        if self._every < 1 or abs(self._every * step - controller.interval) > 1e-9:
            interval = 1e3 * controller.interval
            raise InputError(
                f"step is {1e3 * step:g} ms; allowed: what divides the controller's {interval:g} ms evenly"
            )
        self._controller, self._senses = controller, Senses(rig, 1, controller.interval)
        self._senses.begin(_ALL)
        controller.begin()

    def at(self, k: int, data: mujoco.MjData) -> float:
        """Gauge pressure [Pa] asked for at step ``k``, which ``data`` is at the start of."""
        if k >= self._known and self._controller is not None:
            if k > 0:
                self._senses.move_on(self._senses.load(data.sensordata[None]), _ALL)
            now = self._senses.read(data.qpos[None], data.qvel[None], data.act[None], data.sensordata[None])
            self.asked[k : k + self._every] = self._controller.command(sensed(now))
            self._known = k + self._every
        return float(self.asked[k])

    def earlier(self, place: float) -> float:
        """Gauge pressure [Pa] asked for at ``place``, in steps, no later than now; the first one before the walk."""
        if place <= 0.0:
            return float(self.asked[0])
        low = int(place)
        here = float(self.asked[low])
        return here if place == low else here + (place - low) * (float(self.asked[low + 1]) - here)
