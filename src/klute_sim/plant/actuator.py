"""The device as a MuJoCo actuator on a tendon.

States (``data.act``): gauge pressure [bar] and muscle length minus resting length [m]. Pressure is kept in
bar so that both states are of a size that finite differences and solvers like; the length is an offset so
that MuJoCo's reset, which zeroes states, is the device at rest. The command (``data.ctrl``) is gauge pressure
[bar]. The callbacks are pure: everything the device remembers is in ``data.act``.

The length is solved implicitly inside ``act_dyn`` and handed over as the *effective rate*
``(l+ - l)/h``, so that MuJoCo's single-step integrators land on l+. MuJoCo evaluates every rate before any
force, so the force is that of l+: exactly the one that balances muscle and damper.
"""

import math

import mujoco

from klute_sim.device.ledger import Ledger, entries
from klute_sim.device.step import Parameters, State, advance, tension
from klute_sim.errors import InputError, SimulationError
from klute_sim.plant import router
from klute_sim.units import BAR


class DeviceActuator:
    """Binds a device to one actuator of one model and reads its states there."""

    def __init__(self, model: mujoco.MjModel, name: str, parameters: Parameters) -> None:
        """Bind; raises InputError if the actuator was not made for a device."""
        actuator = model.actuator(name).id
        made_for_device = (
            model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_USER
            and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_USER
            and model.actuator_actnum[actuator] == 2
            and model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_TENDON
        )
        if not made_for_device:
            raise InputError(
                f"actuator '{name}' cannot carry a device: it must act on a tendon, with dyntype and "
                "biastype 'user' and actdim 2"
            )
        self.parameters = parameters
        self.id = actuator
        self._act = int(model.actuator_actadr[actuator])
        self._ctrl = int(model.actuator_ctrladr[actuator])
        self._out = int(model.actuator_outadr[actuator])
        self._rest = parameters.muscle.resting_length
        router.bind(model, actuator, self)

    def command(self, data: mujoco.MjData, pressure: float) -> None:
        """Ask for gauge ``pressure`` [Pa] from now on."""
        data.ctrl[self._ctrl] = pressure / BAR

    def set_state(self, data: mujoco.MjData, state: State) -> None:
        """Put the device into ``state``."""
        data.act[self._act] = state.pressure / BAR
        data.act[self._act + 1] = state.length - self._rest

    def state(self, data: mujoco.MjData) -> State:
        """State at ``data.time``, before the next step."""
        act = data.act
        return State(float(act[self._act]) * BAR, self._rest + float(act[self._act + 1]))

    def _next(self, model: mujoco.MjModel, data: mujoco.MjData, state: State) -> State:
        rates, step = data.act_dot, model.opt.timestep
        pressure = state.pressure + step * float(rates[self._act]) * BAR
        return State(pressure, state.length + step * float(rates[self._act + 1]))

    def act_dyn(self, model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
        """Rates that carry the states to the implicit step's end; raises SimulationError on NaN."""
        state, step = self.state(data), model.opt.timestep
        command = float(data.ctrl[self._ctrl]) * BAR
        length = self.unit_length(data)
        after = advance(self.parameters, state, length, command, step)
        if not (math.isfinite(after.length) and math.isfinite(after.pressure) and math.isfinite(command)):
            raise SimulationError(
                f"actuator '{model.actuator(actuator).name}' has no finite state at t = {data.time:.4f} s: "
                f"pressure command {command:.6g} Pa, pressure {state.pressure:.6g} Pa, muscle length "
                f"{state.length:.6g} m, muscle-tendon length {length:.6g} m"
            )
        data.act_dot[self._act] = (after.pressure - state.pressure) / (BAR * step)
        data.act_dot[self._act + 1] = (after.length - state.length) / step
        return 0.0

    def act_bias(self, model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
        """Force on the tendon [N]: minus the tension at the step's end."""
        rate = float(data.act_dot[self._act + 1])
        after = self._next(model, data, self.state(data))
        return -tension(self.parameters, after, self.unit_length(data), rate)

    def ledger(self, model: mujoco.MjModel, data: mujoco.MjData, before: State) -> tuple[State, Ledger]:
        """State and entries of the step just taken from ``before``; ``data`` is as the step left it."""
        after = self._next(model, data, before)
        length = self.unit_length(data)
        return after, entries(self.parameters, before, after, length, model.opt.timestep)

    def unit_length(self, data: mujoco.MjData) -> float:
        """Length [m] of the whole muscle-tendon unit at the last evaluation."""
        return float(data.actuator_length[self._out])

    def tension(self, data: mujoco.MjData) -> float:
        """Tension [N] at the last evaluation."""
        return -float(data.actuator_force[self._out])
