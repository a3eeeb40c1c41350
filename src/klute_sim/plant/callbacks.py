"""MuJoCo's user callbacks, shared with everybody else in the process.

``mjcb_act_dyn`` and ``mjcb_act_bias`` are one slot each for the whole process. The law sits in them only while
somebody steps inside :func:`installed`, answers for actuators that carry a device, leaves every other one to whoever
was there before (or to MuJoCo's neutral value, 0), and what was there is put back.

There are two installations of one source, equal to the last bit. *Compiled* (the default) is a pair of C functions
that run in any number of threads. *Python* is the reference: slow, one thread at a time, easy to step through; and
MuJoCo cannot compile a model while it is in. It is also what steps in when numba is missing, when MuJoCo's memory is
not laid out as expected, or when somebody else's callbacks were there first and have to be asked.
"""

import ctypes
import math
import os
import threading
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import mujoco

from klute_sim.device.backend import select as backend_select
from klute_sim.device.backend.packing import LAYOUT_ID
from klute_sim.device.dynamics import ZERO_INTERNAL_STATE
from klute_sim.errors import KluteSimError, KluteSimWarning, SimulationError
from klute_sim.plant import coupling

CALLBACK_NAMES = ("act_dyn", "act_bias")
_C_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)

_lock = threading.RLock()
_entry_counts: Counter[int] = Counter()
"""How often each thread is inside :func:`installed`."""
_saved_callbacks: dict[str, Any] = {}
"""What was in the slots when the first one came in."""
_installed_callbacks: dict[str, Any] = {}
"""What is in the slots while anybody is inside."""
_reentry_guard = threading.local()


@cache
def _load_compiled() -> tuple[Any, str]:
    """The module with the compiled callbacks and '', or None and why there are none."""
    try:
        from klute_sim.plant import compiled_callbacks

        compiled_callbacks.get_callbacks()
    except ImportError as error:
        return None, f"numba cannot be imported ({error})"
    except Exception as error:  # whatever a future numba or MuJoCo trips over, the reference still runs
        return None, f"the law cannot be compiled ({error})"
    return compiled_callbacks, ""


def choose_backend(backend: str = "auto") -> str:
    """``compiled`` or ``python``, as asked for and possible (:func:`klute_sim.device.backend.select.choose`)."""

    def obstacle() -> str:
        with _lock:
            return _load_compiled()[1]

    return backend_select.select_backend(backend, obstacle)


@contextmanager
def device_callbacks(backend: str = "auto") -> Iterator[str]:
    """While inside, actuators that carry a device follow it; gives the name of the law that is in force.

    May be nested and entered from several threads; whoever is first in decides which law. A thread on its way out gets
    a SimulationError if, under the compiled law, it has stepped a device without a finite state and was not told.
    Raises KluteSimError, or warns (KluteSimWarning) on the way out, if somebody else has put callbacks of their own
    over ours: devices give no force under those.
    """
    backend = choose_backend(backend)
    me = threading.get_ident()
    with _lock:
        if not _entry_counts:
            _install_callbacks(backend)
        elif not _is_in_place():
            raise KluteSimError("somebody else's callbacks were installed in MuJoCo over the device's: it has no force")
        if is_compiled_installed():
            if not _entry_counts[me]:
                _load_compiled()[0].pop_fault()  # what was not told before is not told now
            backend = "compiled"
        else:
            backend = "python"
        _entry_counts[me] += 1
    try:
        yield backend
    finally:
        with _lock:
            _entry_counts[me] -= 1
            outermost = not _entry_counts[me]
            if outermost:
                del _entry_counts[me]
            kept = bool(_entry_counts) or _restore_callbacks()
    if not kept:
        warnings.warn(
            "somebody else's callbacks were installed in MuJoCo over the device's: it had no force since",
            KluteSimWarning,
            stacklevel=3,
        )
    if outermost and backend == "compiled":
        fault = _load_compiled()[0].pop_fault()
        if fault is not None:
            raise _nonfinite_state_error(*fault)


def is_compiled_installed() -> bool:
    """Whether the compiled law is in MuJoCo's slots."""
    return bool(_installed_callbacks) and _installed_callbacks["act_dyn"] is not _act_dyn


def _is_in_place() -> bool:
    return all(getattr(mujoco, f"get_mjcb_{name}")() is ours for name, ours in _installed_callbacks.items())


def _install_callbacks(backend: str) -> None:
    _saved_callbacks.update({name: getattr(mujoco, f"get_mjcb_{name}")() for name in CALLBACK_NAMES})
    if backend == "compiled" and any(callback is not None for callback in _saved_callbacks.values()):
        warnings.warn(
            "other MuJoCo callbacks are installed: the law runs as Python, so that they are asked, too",
            KluteSimWarning,
            stacklevel=4,
        )
        backend = "python"
    if backend == "compiled":
        _installed_callbacks.update(_compiled_functions())
    else:
        _installed_callbacks.update({"act_dyn": _act_dyn, "act_bias": _act_bias})
    for name, callback in _installed_callbacks.items():
        getattr(mujoco, f"set_mjcb_{name}")(callback)


@cache
def _compiled_functions() -> dict[str, Any]:
    """The compiled callbacks, as MuJoCo takes them."""
    return {name: function.ctypes for name, function in _load_compiled()[0].get_callbacks()._asdict().items()}


def _restore_callbacks() -> bool:
    """Put back what was there; whether ours had stayed in place until now."""
    kept = _is_in_place()
    for name, ours in _installed_callbacks.items():
        # Somebody who installed after us and is still there keeps the slot.
        if getattr(mujoco, f"get_mjcb_{name}")() is ours:
            getattr(mujoco, f"set_mjcb_{name}")(_saved_callbacks[name])
    _saved_callbacks.clear()
    _installed_callbacks.clear()
    return kept


def _after_fork() -> None:
    """In the child only the forking thread goes on: what others had taken is given back."""
    global _lock
    _lock = threading.RLock()
    mine = _entry_counts.pop(threading.get_ident(), 0)
    others = bool(_entry_counts)
    _entry_counts.clear()
    if mine:
        _entry_counts[threading.get_ident()] = mine
    elif others:
        _restore_callbacks()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def step_model(model: mujoco.MjModel, data: mujoco.MjData, n_steps: int = 1) -> None:
    """Take ``count`` steps inside :func:`installed`.

    Raises SimulationError, with actuator, time and state, when a device has no finite state. Under the Python law the
    failed step is not taken; under the compiled law all ``count`` steps are, with no force from that device.
    """
    mujoco.mj_step(model, data, n_steps)
    if is_compiled_installed() and _load_compiled()[0].pending_faults:  # of anybody: the data itself says whose
        _raise_fault(model, data)


def _raise_fault(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Raise if a device of ``data`` has failed."""
    failed = [
        actuator
        for actuator in range(model.nactuator)
        if get_parameter_row(model, actuator) and not math.isfinite(data.act[model.actuator_actadr[actuator]])
    ]
    reported = _load_compiled()[0].pop_fault(data._address)
    if failed and reported:
        raise _nonfinite_state_error(*reported)


def pop_fault_messages() -> list[str]:
    """What the calling thread and MuJoCo's own threads have reported, one sentence each; it is then forgotten."""
    faults = _load_compiled()[0].pending_faults
    strangers = [thread for thread in list(faults) if thread not in _entry_counts or thread == threading.get_ident()]
    reports = [report for thread in strangers for report in faults.pop(thread, {}).values()]
    return [str(_nonfinite_state_error(*report)) for report in reports]


def _nonfinite_state_error(
    actuator: str, time: float, command: float, pressure: float, offset: float, length: float
) -> SimulationError:
    return SimulationError(
        f"actuator '{actuator}' has no finite state at t = {time:.4f} s: pressure command {command:.6g} bar, pressure "
        f"{pressure:.6g} bar, muscle {1e3 * offset:.6g} mm beyond its resting length, muscle-tendon length "
        f"{length:.6g} m"
    )


def get_parameter_row(model: mujoco.MjModel, actuator: int) -> tuple[float, ...] | None:
    """The parameters of the device on ``actuator``; None if it carries none, or has no place for its states."""
    if (
        model.nuser_actuator >= coupling.USER_ROW_SIZE
        and model.actuator_user[actuator, 0] == LAYOUT_ID
        and model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_USER
        and model.actuator_actnum[actuator] in (coupling.N_BASE_STATES, coupling.N_ALL_STATES)
    ):
        return tuple(model.actuator_user[actuator, : coupling.USER_ROW_SIZE].tolist())
    return None


def read_internal_state(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> tuple[float, ...]:
    """What the effects of the device on ``actuator`` remember; zeros if it has no states for that."""
    if model.actuator_actnum[actuator] == coupling.N_BASE_STATES:
        return ZERO_INTERNAL_STATE
    at = model.actuator_actadr[actuator]
    return tuple(data.act[at + coupling.N_BASE_STATES : at + coupling.N_ALL_STATES].tolist())


def _call_previous(name: str, model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    """What whoever was in the slot before us says of an actuator that is not ours; 0 if nobody was."""
    previous: Any = _saved_callbacks.get(name)
    if previous is None or getattr(_reentry_guard, "now", False):
        return 0.0
    _reentry_guard.now = True  # somebody who wrapped our callback and stayed would ask us back, without end
    try:
        if hasattr(previous, "argtypes"):  # a C function wants what is behind the Python objects
            return float(_C_CALLBACK.from_address(ctypes.addressof(previous))(model._address, data._address, actuator))
        return float(previous(model, data, actuator))
    finally:
        _reentry_guard.now = False


def _act_dyn(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    row = get_parameter_row(model, actuator)
    if row is None:
        return _call_previous("act_dyn", model, data, actuator)
    at = model.actuator_actadr[actuator]
    pressure, offset = data.act[at : at + coupling.N_BASE_STATES].tolist()
    memory = read_internal_state(model, data, actuator)
    command = float(data.ctrl[model.actuator_ctrladr[actuator]])
    length = float(data.actuator_length[model.actuator_outadr[actuator]])
    *found, after = coupling.compute_rates(row, pressure, offset, memory, command, length, model.opt.timestep)
    if not math.isfinite(found[0]):
        raise _nonfinite_state_error(model.actuator(actuator).name, data.time, command, pressure, offset, length)
    data.act_dot[at : at + coupling.N_BASE_STATES] = found
    if model.actuator_actnum[actuator] != coupling.N_BASE_STATES:
        rates = [(b - a) / model.opt.timestep for a, b in zip(memory, after, strict=True)]
        data.act_dot[at + coupling.N_BASE_STATES : at + coupling.N_ALL_STATES] = rates
    return 0.0


def _act_bias(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    row = get_parameter_row(model, actuator)
    if row is None:
        return _call_previous("act_bias", model, data, actuator)
    at, out = model.actuator_actadr[actuator], model.actuator_outadr[actuator]
    pressure, offset = data.act[at : at + 2].tolist()
    by_pressure, by_length = data.act_dot[at : at + 2].tolist()
    length, velocity = float(data.actuator_length[out]), float(data.actuator_velocity[out])
    memory = read_internal_state(model, data, actuator)
    return coupling.compute_force(
        row, pressure, offset, memory, by_pressure, by_length, length, velocity, model.opt.timestep
    )
