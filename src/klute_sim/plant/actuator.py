"""The device on an actuator of a MuJoCo model: its command, its states, its tension."""

import mujoco

from klute_sim.device.step import NO_MEMORY, State, gas, with_gas
from klute_sim.device.vector import unpack
from klute_sim.errors import InputError
from klute_sim.plant import coupling
from klute_sim.plant.router import row_of
from klute_sim.units import BAR


class DeviceActuator:
    """Reads and commands the device on one actuator, of any simulation of the same model."""

    def __init__(self, model: mujoco.MjModel, name: str) -> None:
        """Find it; raises InputError if the actuator carries no device (:func:`klute_sim.plant.models.equip`)."""
        actuator = model.actuator(name).id
        row = row_of(model, actuator)
        if row is None:
            raise InputError(f"actuator '{name}' carries no device; put one there with klute_sim.plant.models.equip")
        self.parameters = unpack(row)
        self.id = int(actuator)
        self.act = int(model.actuator_actadr[actuator])
        """Where its states begin in ``data.act``."""
        self.ctrl = int(model.actuator_ctrladr[actuator])
        """Where its command is in ``data.ctrl``."""
        self._out = int(model.actuator_outadr[actuator])
        self._row = row
        self._remembers = bool(model.actuator_actnum[actuator] != coupling.STATES)

    def command(self, data: mujoco.MjData, pressure: float) -> None:
        """Ask for gauge ``pressure`` [Pa] from now on."""
        data.ctrl[self.ctrl] = pressure / BAR

    def set_state(self, data: mujoco.MjData, state: State) -> None:
        """Put the device into ``state``."""
        data.act[self.act] = state.pressure / BAR
        data.act[self.act + 1] = state.length - self.parameters.muscle.resting_length
        if self._remembers:
            data.act[self.act + coupling.STATES : self.act + coupling.ALL_STATES] = state.memory

    def state(self, data: mujoco.MjData) -> State:
        """State at ``data.time``, before the next step."""
        pressure, offset = data.act[self.act : self.act + coupling.STATES].tolist()
        memory = NO_MEMORY
        if self._remembers:
            memory = tuple(data.act[self.act + coupling.STATES : self.act + coupling.ALL_STATES].tolist())
        return coupling.state(self.parameters, pressure, offset, memory)

    def reached(self, model: mujoco.MjModel, data: mujoco.MjData, before: State) -> State:
        """The state that the step just taken from ``before`` led to; ``data`` is as the step left it."""
        by_pressure, by_length = data.act_dot[self.act : self.act + coupling.STATES].tolist()
        unit_length, step = self.unit_length(data), model.opt.timestep
        after = coupling.reached(self.parameters, before, by_pressure, by_length, unit_length, step)
        # What the supply remembers no force depends on: it stands where MuJoCo has carried it by now.
        return after._replace(memory=with_gas(after.memory, gas(self.state(data))))

    def unit_length(self, data: mujoco.MjData) -> float:
        """Length [m] of the whole muscle-tendon unit at the last evaluation."""
        return float(data.actuator_length[self._out])

    def unit_rate(self, data: mujoco.MjData) -> float:
        """How fast that length changes [m/s], at the last evaluation."""
        return float(data.actuator_velocity[self._out])

    def tension(self, data: mujoco.MjData) -> float:
        """Tension [N] at the last evaluation."""
        given_back = coupling.given_back(self._row, self.unit_rate(data))
        return given_back - float(data.actuator_force[self._out])
