"""The device on an actuator of a MuJoCo model: its command, its states, its tension."""

import mujoco

from klute_sim.device.backend.packing import unpack_parameters
from klute_sim.device.dynamics import ZERO_INTERNAL_STATE, DeviceState, get_gas_state, replace_gas_state
from klute_sim.errors import InputError
from klute_sim.plant import coupling
from klute_sim.plant.callbacks import get_parameter_row
from klute_sim.units import BAR


class DeviceActuator:
    """Reads and commands the device on one actuator, of any simulation of the same model."""

    def __init__(self, model: mujoco.MjModel, name: str) -> None:
        """Find it; raises InputError if the actuator carries no device (:func:`klute_sim.plant.models.equip`)."""
        actuator = model.actuator(name).id
        row = get_parameter_row(model, actuator)
        if row is None:
            raise InputError(f"actuator '{name}' carries no device; put one there with klute_sim.plant.models.equip")
        self.parameters = unpack_parameters(row)
        self.id = int(actuator)
        self.act_address = int(model.actuator_actadr[actuator])
        """Where its states begin in ``data.act``."""
        self.ctrl_address = int(model.actuator_ctrladr[actuator])
        """Where its command is in ``data.ctrl``."""
        self.out_address = int(model.actuator_outadr[actuator])
        """Where its length is in ``data.actuator_length``."""
        self.n_states = int(model.actuator_actnum[actuator])
        """How many states it has."""
        self._row = row
        self._has_internal_state = self.n_states != coupling.N_BASE_STATES

    def set_command(self, data: mujoco.MjData, command: float) -> None:
        """Ask for a gauge pressure [Pa] from now on, or for an opening of the valve [1] if the supply takes those."""
        data.ctrl[self.ctrl_address] = command if self.parameters.supply.command_is_opening != 0.0 else command / BAR

    def set_state(self, data: mujoco.MjData, state: DeviceState) -> None:
        """Put the device into ``state``."""
        data.act[self.act_address] = state.pressure / BAR
        data.act[self.act_address + 1] = state.length - self.parameters.muscle.resting_length
        if self._has_internal_state:
            data.act[self.act_address + coupling.N_BASE_STATES : self.act_address + coupling.N_ALL_STATES] = (
                state.internal_state
            )

    def get_state(self, data: mujoco.MjData) -> DeviceState:
        """State at ``data.time``, before the next step."""
        pressure, offset = data.act[self.act_address : self.act_address + coupling.N_BASE_STATES].tolist()
        memory = ZERO_INTERNAL_STATE
        if self._has_internal_state:
            memory = tuple(
                data.act[self.act_address + coupling.N_BASE_STATES : self.act_address + coupling.N_ALL_STATES].tolist()
            )
        return coupling.to_device_state(self.parameters, pressure, offset, memory)

    def state_after_step(self, model: mujoco.MjModel, data: mujoco.MjData, previous: DeviceState) -> DeviceState:
        """The state that the step just taken from ``before`` led to; ``data`` is as the step left it."""
        by_pressure, by_length = data.act_dot[self.act_address : self.act_address + coupling.N_BASE_STATES].tolist()
        unit_length, step = self.unit_length(data), model.opt.timestep
        after = coupling.state_after_step(self.parameters, previous, by_pressure, by_length, unit_length, step)
        # What the supply remembers no force depends on: it stands where MuJoCo has carried it by now.
        return after._replace(
            internal_state=replace_gas_state(after.internal_state, get_gas_state(self.get_state(data)))
        )

    def unit_length(self, data: mujoco.MjData) -> float:
        """Length [m] of the whole muscle-tendon unit at the last evaluation."""
        return float(data.actuator_length[self.out_address])

    def unit_rate(self, data: mujoco.MjData) -> float:
        """How fast that length changes [m/s], at the last evaluation."""
        return float(data.actuator_velocity[self.out_address])

    def tension(self, data: mujoco.MjData) -> float:
        """Tension [N] at the last evaluation."""
        given_back = coupling.damping_compensation(self._row, self.unit_rate(data))
        return given_back - float(data.actuator_force[self.out_address])
