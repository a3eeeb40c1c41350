"""A walker in simulation: reset it, take steps, and save or restore its whole state."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.errors import InputError
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.plant import callbacks
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.coupling import N_BASE_STATES
from klute_sim.types import Array
from klute_sim.walker.person.body import MUSCLES, Body
from klute_sim.walker.person.build import LOAD_CELL
from klute_sim.walker.reflexes.gain_table import Reflexes
from klute_sim.walker.reflexes.laws import MIN_STIMULATION
from klute_sim.walker.simulation import backend as backends
from klute_sim.walker.simulation import state as layout
from klute_sim.walker.simulation import stepping

_MUJOCO_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
INITIAL_ANKLE_LEFT = np.radians(8.0)
"""Dorsiflexion of the standing foot at the start [rad]."""
INITIAL_PENETRATION = 0.003
"""Depth of the lowest sole in the ground at the start [m], so that the leg is loaded at once."""


class Snapshot(NamedTuple):
    """State of a simulation: copies of it resume the walk bit for bit."""

    mujoco_state: Array
    """State of MuJoCo, devices included."""
    walker_state: Array
    """State vector of the walker (:mod:`klute_sim.walker.simulation.state`)."""


class WalkSimulator:
    """Simulate one walker. Step it inside :func:`klute_sim.plant.callbacks.device_callbacks`."""

    def __init__(self, model: mujoco.MjModel, body: Body, *, slope: float = 0.0, backend: str = "compiled") -> None:
        """Prepare a simulation of ``model`` (:func:`klute_sim.walker.person.build.build_walker_model`).

        ``slope`` is that of the ground [rad], and ``backend`` is ``"compiled"`` or ``"python"``; both give equal bits.
        """
        self.model, self.data, self.body = model, mujoco.MjData(model), body
        self.is_prosthetic = model.nactuator > 0
        self.actuator = DeviceActuator(model, PROSTHESIS_PREFIX + "muscle_tendon") if self.is_prosthetic else None
        self.settings = _build_settings(model, body, slope, self.is_prosthetic)
        self.state = np.zeros(layout.compute_state_size(self.settings.depth))
        self.muscle_rows = body.muscle_rows
        self._backend, self._functions = backend, backends.get_step_functions(backend)
        self._no_record = np.empty((0, self.record_width))
        self._sole_geoms = [g for g in range(model.ngeom) if model.geom_contype[g] == 1]

    @property
    def record_width(self) -> int:
        """Number of columns of a record (:func:`klute_sim.walker.simulation.stepping.take_steps`)."""
        n_values = 4 * int(self.model.nq) + int(self.model.nsensordata) + layout.DELAY_LINES
        return n_values + (N_BASE_STATES if self.is_prosthetic else 0)

    @property
    def time(self) -> float:
        """Time walked [s]."""
        return float(self.state[layout.STEP_COUNT]) * self.settings.dt

    def has_fallen(self) -> bool:
        """Return whether the walker has fallen."""
        return bool(stepping.has_fallen(self.settings, self.data.qpos))

    def reset(self, reflexes: Reflexes) -> None:
        """Place the walker in the initial state of ``reflexes``, whose gains it uses from now on."""
        self.left, self.right = np.ascontiguousarray(reflexes.left), np.ascontiguousarray(reflexes.right)
        model, data, initial = self.model, self.data, reflexes.get_initial()
        mujoco.mj_resetData(model, data)
        lean = initial["lean"]
        hip_left, hip_right = initial["hip_left"] + lean, initial["hip_right"] + lean
        data.qpos[:8] = (
            *(0.0, 1.0, lean + self.settings.slope),
            *(hip_left, initial["knee_left"], INITIAL_ANKLE_LEFT),
            *(hip_right, initial["knee_right"]),
        )
        data.qvel[0], data.qvel[1] = initial["speed"], initial["rise"]
        data.qvel[3], data.qvel[6] = initial["hip_rate_left"], initial["hip_rate_right"]
        mujoco.mj_kinematics(model, data)
        data.qpos[1] -= self._measure_lowest_sole() + INITIAL_PENETRATION
        callbacks.forward_without_devices(model, data)
        if self.actuator is not None:
            unit_length = self.actuator.get_unit_length(data)
            self.actuator.set_state(data, compute_taut_state(self.actuator.parameters, unit_length, 1e5))
        self._reset_walker_state(initial)

    def _measure_lowest_sole(self) -> float:
        data, model = self.data, self.model
        lowest = [float(data.geom_xpos[g, 2] - np.max(model.geom_size[g])) for g in self._sole_geoms]
        left = [h for h, g in zip(lowest, self._sole_geoms, strict=True) if model.geom(g).name.endswith("_left")]
        return min(left)

    def _reset_walker_state(self, initial: Mapping[str, float]) -> None:
        state, n = self.state, layout.N_MUSCLES
        state[:] = 0.0
        state[layout.FIBER_LENGTH : layout.FIBER_LENGTH + 2 * n] = 1.0
        state[layout.STIMULATION : layout.STIMULATION + 2 * n] = MIN_STIMULATION
        activation = np.full((2, n), MIN_STIMULATION)
        activation[:, MUSCLES.index("vasti")] = initial["vasti_activation"]
        activation[:, [MUSCLES.index("glutei"), MUSCLES.index("hamstrings")]] = initial["hip_activation"]
        activation[0, [MUSCLES.index("gastrocnemius"), MUSCLES.index("soleus")]] = initial["calf_activation"]
        state[layout.ACTIVATION : layout.ACTIVATION + 2 * n] = activation.ravel()
        state[layout.STANCE], state[layout.STRIKE_TIME] = 1.0, -0.5
        state[layout.TOE_OFF_SPEED : layout.TOE_OFF_SPEED + 2] = initial["speed"]
        state[layout.LOAD] = 1.0
        state[layout.STRIDE_TIME] = state[layout.PHASE_TIME] = stepping.NOMINAL_STRIDE_TIME
        self._functions.settle_muscles(self.settings, self.muscle_rows, self.data.qpos, state)
        self._functions.fill_delay_lines(self.settings, self.data.qpos, self.data.qvel, state)

    def take_steps(self, n_steps: int, *, push: float = 0.0, record: Array | None = None) -> int:
        """Take up to ``n_steps`` steps under a forward ``push`` on the hip [N]; return how many before a fall.

        ``record`` (steps, :attr:`record_width`) receives one row per step.
        """
        data = self.data
        return self._functions.take_steps(
            self.settings,
            self.muscle_rows,
            self.left,
            self.right,
            self.model,
            data,
            data.qpos,
            data.qvel,
            data.qfrc_applied,
            data.qfrc_actuator,
            data.sensordata,
            data.act,
            self.state,
            push,
            n_steps,
            self._no_record if record is None else record,
        )

    def __getstate__(self) -> dict[str, Any]:
        """Return the whole state without the functions of the backend, which belong to one process."""
        return {name: value for name, value in self.__dict__.items() if name != "_functions"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state of :meth:`__getstate__`."""
        self.__dict__.update(state)
        self._functions = backends.get_step_functions(self._backend)

    def save(self) -> Snapshot:
        """Return a copy of the whole state."""
        values = np.empty(mujoco.mj_stateSize(self.model, _MUJOCO_STATE))
        mujoco.mj_getState(self.model, self.data, values, _MUJOCO_STATE)
        return Snapshot(values, self.state.copy())

    def restore(self, snapshot: Snapshot) -> None:
        """Return to the state of ``snapshot``; raises InputError when it belongs to another model or time step."""
        size = mujoco.mj_stateSize(self.model, _MUJOCO_STATE)
        if len(snapshot.mujoco_state) != size or len(snapshot.walker_state) != len(self.state):
            raise InputError(
                f"the snapshot has {len(snapshot.mujoco_state)} and {len(snapshot.walker_state)} numbers; allowed: "
                f"{size} and {len(self.state)}, those of the same body and time step"
            )
        mujoco.mj_setState(self.model, self.data, snapshot.mujoco_state, _MUJOCO_STATE)
        self.state[:] = snapshot.walker_state


def _build_settings(model: mujoco.MjModel, body: Body, slope: float, is_prosthetic: bool) -> stepping.LoopSettings:
    nerves, dt = body.document.nerves, float(model.opt.timestep)
    delays = [
        max(1, round(1e-3 * delay / dt)) for delay in (nerves.hip_delay_ms, nerves.knee_delay_ms, nerves.ankle_delay_ms)
    ]
    return stepping.LoopSettings(
        dt=dt,
        body_weight=float(model.body_mass.sum()) * GRAVITY,
        slope=slope,
        activation_time_constant=1e-3 * nerves.activation_time_constant_ms,
        stance_on=nerves.stance_on_bw,
        stance_off=nerves.stance_off_bw,
        hip_delay=delays[0],
        knee_delay=delays[1],
        ankle_delay=delays[2],
        depth=max(delays) + 1,
        is_prosthetic=int(is_prosthetic),
        left_load=int(model.sensor("load_left").adr[0]) + 2,
        right_load=int(model.sensor("load_right").adr[0]) + 2,
        pylon_load=int(model.sensor(LOAD_CELL).adr[0]) + 2 if is_prosthetic else 0,
    )
