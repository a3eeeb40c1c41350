"""The device on one actuator of a MuJoCo model: its command, states and tension."""

import mujoco

from klute_sim.device.backend.packing import unpack_parameters
from klute_sim.device.dynamics import ZERO_INTERNAL_STATE, DeviceState, get_gas_state, replace_gas_state
from klute_sim.errors import InputError
from klute_sim.plant import coupling
from klute_sim.plant.callbacks import get_parameter_row
from klute_sim.units import BAR


class DeviceActuator:
    """Read and command the device on one actuator, in any simulation of the same model."""

    def __init__(self, model: mujoco.MjModel, name: str) -> None:
        """Find the actuator ``name``.

        Raises InputError when the actuator carries no device (see :func:`klute_sim.plant.models.attach_devices`).
        """
        actuator = model.actuator(name).id
        row = get_parameter_row(model, actuator)
        if row is None:
            raise InputError(
                f"actuator '{name}' carries no device; attach one with klute_sim.plant.models.attach_devices"
            )
        self.parameters = unpack_parameters(row)
        self.id = int(actuator)
        self.act_address = int(model.actuator_actadr[actuator])
        """Index of the device's first state in ``data.act``."""
        self.ctrl_address = int(model.actuator_ctrladr[actuator])
        """Index of the command in ``data.ctrl``."""
        self.out_address = int(model.actuator_outadr[actuator])
        """Index of the muscle-tendon length in ``data.actuator_length``."""
        self.n_states = int(model.actuator_actnum[actuator])
        """Number of states in ``data.act``."""
        self.damping = row[coupling.DAMPING_INDEX]
        """Damping that the model's tendon has for MuJoCo's integrators and the device's force compensates [N s2/m2]."""
        self._row = row
        self._has_internal_state = self.n_states != coupling.N_BASE_STATES

    def set_command(self, data: mujoco.MjData, command: float) -> None:
        """Set the command: a gauge pressure [Pa], or a valve opening [1] if the supply takes openings."""
        data.ctrl[self.ctrl_address] = command if self.parameters.supply.command_is_opening != 0.0 else command / BAR

    def set_state(self, data: mujoco.MjData, state: DeviceState) -> None:
        """Set the state of the device."""
        data.act[self.act_address] = state.pressure / BAR
        data.act[self.act_address + 1] = state.length - self.parameters.muscle.resting_length
        if self._has_internal_state:
            data.act[self.act_address + coupling.N_BASE_STATES : self.act_address + coupling.N_ALL_STATES] = (
                state.internal_state
            )

    def get_state(self, data: mujoco.MjData) -> DeviceState:
        """Return the state at ``data.time``, before the next step."""
        pressure, offset = data.act[self.act_address : self.act_address + coupling.N_BASE_STATES].tolist()
        internal_state = ZERO_INTERNAL_STATE
        if self._has_internal_state:
            first = self.act_address + coupling.N_BASE_STATES
            internal_state = tuple(data.act[first : self.act_address + coupling.N_ALL_STATES].tolist())
        return coupling.to_device_state(self.parameters, pressure, offset, internal_state)

    def compute_state_after_step(
        self, model: mujoco.MjModel, data: mujoco.MjData, previous: DeviceState
    ) -> DeviceState:
        """Return the state after the step from ``previous``; ``data`` is the simulation after that step."""
        pressure_rate, length_rate = data.act_dot[self.act_address : self.act_address + coupling.N_BASE_STATES].tolist()
        unit_length, dt = self.get_unit_length(data), model.opt.timestep
        state = coupling.compute_state_after_step(
            self.parameters, previous, pressure_rate, length_rate, unit_length, dt
        )
        # No force depends on the gas state, so MuJoCo has already integrated it.
        return state._replace(
            internal_state=replace_gas_state(state.internal_state, get_gas_state(self.get_state(data)))
        )

    def get_unit_length(self, data: mujoco.MjData) -> float:
        """Return the length [m] of the muscle-tendon unit at the last evaluation."""
        return float(data.actuator_length[self.out_address])

    def get_unit_rate(self, data: mujoco.MjData) -> float:
        """Return the rate of change [m/s] of the muscle-tendon length at the last evaluation."""
        return float(data.actuator_velocity[self.out_address])

    def get_tension(self, data: mujoco.MjData) -> float:
        """Return the tension [N] at the last evaluation."""
        compensation = coupling.compute_damping_compensation(self._row, self.get_unit_rate(data))
        return compensation - float(data.actuator_force[self.out_address])
