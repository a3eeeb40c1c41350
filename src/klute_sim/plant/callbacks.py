"""MuJoCo's user callbacks, shared with all other code in the process.

MuJoCo has one slot ``mjcb_act_dyn`` and one slot ``mjcb_act_bias`` for the whole process. The device's callbacks occupy
them only inside :func:`device_callbacks`. They serve actuators that carry a device. For every other actuator they call
the callbacks that were installed before, or return MuJoCo's neutral value, 0. At the end the previous callbacks are
restored. Inside an *isolated* context, as of an environment, no callback of other code is called at all.

Under the compiled backend MuJoCo's profiler (``data.timer``) measures no durations, unless other code has installed a
timer of its own: reading the clock would take a fifth of the time of a small model.

There are two backends of one source, which agree to the last bit. *Compiled* (the default) is a pair of C functions
that run in any number of threads. *Python* is the reference: slow, one thread at a time, easy to debug, and MuJoCo
cannot compile a model while it is installed in another thread, so that :func:`compile_model` waits. The Python backend
also replaces the compiled one when numba is missing, when MuJoCo's structs have an unknown layout, or when other code's
callbacks are installed and must be called.
"""

import copy
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
from klute_sim.device.nonfinite import MATH_ERRORS
from klute_sim.errors import KluteSimError, KluteSimWarning, SimulationError
from klute_sim.plant import callback_slots, coupling
from klute_sim.plant.python_friction import find_friction_force, find_friction_rate

CALLBACK_NAMES = ("act_dyn", "act_bias")
"""MuJoCo's callbacks that the device uses."""
TIMER_NAME = "time"
"""MuJoCo's callback that reads the clock for its profiler."""
_C_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)

MAX_COMPILATION_WAIT = 20.0
"""Maximum time for which a compilation waits for other threads [s]."""

_lock = threading.Condition(threading.RLock())
_entry_counts: Counter[int] = Counter()
"""Number of nested :func:`device_callbacks` of each thread."""
_saved_callbacks: dict[str, Any] = {}
"""Callbacks that were installed before the first :func:`device_callbacks`."""
_installed_callbacks: dict[str, Any] = {}
"""Callbacks of the device that are installed now."""
_isolated_callbacks: dict[str, Any] = {}
"""Callbacks of other code that an isolated context has removed."""
_waiting_compilations = 0
"""Number of compilations that wait until other threads leave their contexts."""
_reentry_guard = threading.local()


@cache
def _load_compiled() -> tuple[Any, str]:
    """Return the module of the compiled callbacks and '', or None and the reason why there are none."""
    try:
        from klute_sim.plant import compiled_callbacks, struct_layout

        with _without_callbacks():
            struct_layout.get_layout()
        compiled_callbacks.get_callbacks()
    except ImportError as error:
        return None, f"numba cannot be imported ({error})"
    except Exception as error:  # after any error of a future numba or MuJoCo the Python backend still runs
        return None, f"the device cannot be compiled ({error})"
    return compiled_callbacks, ""


def choose_backend(backend: str = "auto") -> str:
    """Return ``compiled`` or ``python``, as requested and possible.

    Warnings and errors are those of :func:`klute_sim.device.backend.select.select_backend`.
    """

    def find_incompatibility() -> str:
        with _lock:
            return _load_compiled()[1]

    return backend_select.select_backend(backend, find_incompatibility)


def compile_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the model of ``spec``; MuJoCo would call callbacks meanwhile, so none is installed.

    Raises KluteSimError when other threads need their callbacks for too long.
    """
    with _without_callbacks():
        return spec.compile()


@contextmanager
def _without_callbacks() -> Iterator[None]:
    """Remove Python callbacks for the duration of the context, when no other thread needs them."""
    global _waiting_compilations
    with _lock:
        _waiting_compilations += 1
        try:
            is_free = _lock.wait_for(_can_compile, MAX_COMPILATION_WAIT)
        finally:
            _waiting_compilations -= 1
        if not is_free:
            raise KluteSimError(
                "MuJoCo cannot compile a model while other threads step with Python callbacks; create models before, "
                "or use the compiled backend"
            )
        has_other_threads = any(thread != threading.get_ident() for thread in _entry_counts)
        removed = {} if has_other_threads else callback_slots.remove_callbacks()
        try:
            yield
        finally:
            callback_slots.restore_callbacks(removed)
            _lock.notify_all()


def _can_compile() -> bool:
    """Return whether no other thread steps with Python callbacks."""
    if all(thread == threading.get_ident() for thread in _entry_counts):
        return True
    return is_compiled_installed() and not _has_callbacks_of_other_code()


def _has_callbacks_of_other_code() -> bool:
    callbacks = {slot: callback_slots.get_callback(slot) for slot in callback_slots.SLOTS}
    return any(
        callback is not None and callback is not _installed_callbacks.get(slot) for slot, callback in callbacks.items()
    )


@contextmanager
def device_callbacks(backend: str = "auto", *, is_isolated: bool = False) -> Iterator[str]:
    """Install the device's callbacks in MuJoCo for the duration of the context; yield the name of the active backend.

    ``is_isolated`` removes the callbacks of other code for the duration, in all slots and, as MuJoCo has one set of
    slots, for all threads. An isolated context and one that calls callbacks of other code cannot overlap.

    The context is reentrant and may be entered from several threads; the outermost caller selects the backend. On exit
    a thread gets a SimulationError if, under the compiled backend, it has stepped a device without a finite state and
    that has not been reported yet. Raises KluteSimError on entry, or warns (KluteSimWarning) on exit, when other code
    has replaced the device's callbacks, because devices give no force then.
    """
    backend = choose_backend(backend)
    thread = threading.get_ident()
    with _lock:
        while _waiting_compilations and not _entry_counts:
            _lock.wait()
        if not _entry_counts:
            if is_isolated:
                _isolated_callbacks.update(callback_slots.remove_callbacks())
            _install_callbacks(backend)
        elif (_has_callbacks_of_other_code() and not _isolated_callbacks) if is_isolated else _isolated_callbacks:
            raise KluteSimError(
                "an environment and other code with callbacks of its own step in MuJoCo at the same time; let one end "
                "first, or remove the callbacks"
            )
        elif not _is_in_place():
            raise KluteSimError(
                "other code has replaced the device's callbacks in MuJoCo, so the device gives no force; restore them"
            )
        if is_compiled_installed():
            if not _entry_counts[thread]:
                _load_compiled()[0].pop_fault()  # a fault from before this context
            backend = "compiled"
        else:
            backend = "python"
        _entry_counts[thread] += 1
    try:
        yield backend
    finally:
        with _lock:
            _entry_counts[thread] -= 1
            is_outermost = not _entry_counts[thread]
            if is_outermost:
                del _entry_counts[thread]
            stayed_in_place = bool(_entry_counts) or _restore_callbacks()
            _lock.notify_all()
    if not stayed_in_place:
        warnings.warn(
            "other code has replaced the device's callbacks in MuJoCo, so the device has given no force since",
            KluteSimWarning,
            stacklevel=3,
        )
    if is_outermost and backend == "compiled":
        fault = _load_compiled()[0].pop_fault()
        if fault is not None:
            raise _make_nonfinite_state_error(*fault)


def is_compiled_installed() -> bool:
    """Return whether the compiled callbacks are installed in MuJoCo."""
    return bool(_installed_callbacks) and _installed_callbacks["act_dyn"] is not _act_dyn


def _is_in_place() -> bool:
    return all(callback_slots.get_callback(name) is callback for name, callback in _installed_callbacks.items())


def _install_callbacks(backend: str) -> None:
    _saved_callbacks.update({name: callback_slots.get_callback(name) for name in CALLBACK_NAMES})
    if backend == "compiled" and any(callback is not None for callback in _saved_callbacks.values()):
        warnings.warn(
            "other MuJoCo callbacks are installed: the device runs as Python, so that they are called too",
            KluteSimWarning,
            stacklevel=4,
        )
        backend = "python"
    if backend == "compiled":
        functions = _get_compiled_functions()
        _installed_callbacks.update({name: functions[name] for name in CALLBACK_NAMES})
        # MuJoCo's profiler reads the clock some 20 times a step, which takes longer than small models do.
        if callback_slots.get_callback(TIMER_NAME) is None:
            _saved_callbacks[TIMER_NAME] = None
            _installed_callbacks[TIMER_NAME] = functions[TIMER_NAME]
    else:
        _installed_callbacks.update({"act_dyn": _act_dyn, "act_bias": _act_bias})
    for name, callback in _installed_callbacks.items():
        callback_slots.set_callback(name, callback)


@cache
def _get_compiled_functions() -> dict[str, Any]:
    """Return the compiled callbacks as ctypes functions."""
    return {name: function.ctypes for name, function in _load_compiled()[0].get_callbacks()._asdict().items()}


def _restore_callbacks() -> bool:
    """Restore the previous callbacks; return whether the device's callbacks were still in place."""
    stayed_in_place = _is_in_place()
    for name, callback in _installed_callbacks.items():
        # Other code that has installed a callback since then keeps the slot.
        if callback_slots.get_callback(name) is callback:
            callback_slots.set_callback(name, _saved_callbacks[name])
    _saved_callbacks.clear()
    _installed_callbacks.clear()
    callback_slots.restore_callbacks(_isolated_callbacks)
    return stayed_in_place


def _after_fork() -> None:
    """Keep the contexts of the forking thread in the child process; release those of all other threads."""
    global _lock, _waiting_compilations
    _lock, _waiting_compilations = threading.Condition(threading.RLock()), 0
    entry_count = _entry_counts.pop(threading.get_ident(), 0)
    other_threads_entered = bool(_entry_counts)
    _entry_counts.clear()
    if entry_count:
        _entry_counts[threading.get_ident()] = entry_count
    elif other_threads_entered:
        _restore_callbacks()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def step_model(model: mujoco.MjModel, data: mujoco.MjData, n_steps: int = 1) -> None:
    """Take ``n_steps`` steps inside :func:`device_callbacks`.

    Raises SimulationError, with actuator, time and state, when a device has no finite state. The Python backend does
    not take the failed step; the compiled backend takes all steps, without force from that device.
    """
    mujoco.mj_step(model, data, n_steps)
    # A pending fault may belong to another simulation; the data decide.
    if is_compiled_installed() and _load_compiled()[0].pending_faults:
        _raise_fault(model, data)


def _raise_fault(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Raise SimulationError if a device of ``data`` has failed."""
    has_failed = any(
        get_parameter_row(model, actuator) and not math.isfinite(data.act[model.actuator_actadr[actuator]])
        for actuator in range(model.nactuator)
    )
    fault = _load_compiled()[0].pop_fault(data._address)
    if has_failed and fault:
        raise _make_nonfinite_state_error(*fault)


def pop_fault_messages() -> list[str]:
    """Return and clear the faults of the calling thread and of MuJoCo's own threads, one sentence each."""
    faults = _load_compiled()[0].pending_faults
    threads = [thread for thread in list(faults) if thread not in _entry_counts or thread == threading.get_ident()]
    popped = [fault for thread in threads for fault in faults.pop(thread, {}).values()]
    return [str(_make_nonfinite_state_error(*fault)) for fault in popped]


def _make_nonfinite_state_error(
    actuator: str, time: float, command: float, pressure: float, offset: float, length: float
) -> SimulationError:
    return SimulationError(
        f"actuator '{actuator}' has no finite state at t = {time:.4f} s: pressure command {command:.6g} bar, pressure "
        f"{pressure:.6g} bar, muscle {1e3 * offset:.6g} mm beyond its resting length, muscle-tendon length "
        f"{length:.6g} m"
    )


def forward_without_devices(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Evaluate ``data`` as if its actuators carried no devices, also while another thread has installed callbacks."""
    model_without_devices = copy.copy(model)  # other threads may step the model itself
    model_without_devices.actuator_user[:, :1] = 0.0
    mujoco.mj_forward(model_without_devices, data)


def get_parameter_row(model: mujoco.MjModel, actuator: int) -> tuple[float, ...] | None:
    """Return the parameter row of the device on ``actuator``; None without a device or without room for its states."""
    if (
        model.nuser_actuator >= coupling.USER_ROW_SIZE
        and model.actuator_user[actuator, 0] == LAYOUT_ID
        and model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_USER
        and model.actuator_actnum[actuator] in (coupling.N_BASE_STATES, coupling.N_ALL_STATES)
    ):
        return tuple(model.actuator_user[actuator, : coupling.USER_ROW_SIZE].tolist())
    return None


def read_internal_state(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> tuple[float, ...]:
    """Return the internal state of the device on ``actuator``; zeros if the model has no room for it."""
    if model.actuator_actnum[actuator] == coupling.N_BASE_STATES:
        return ZERO_INTERNAL_STATE
    start = model.actuator_actadr[actuator]
    return tuple(data.act[start + coupling.N_BASE_STATES : start + coupling.N_ALL_STATES].tolist())


def _call_previous(name: str, model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    """Call the previous callback for an actuator without device; return 0 if there was none."""
    previous: Any = _saved_callbacks.get(name)
    if previous is None or getattr(_reentry_guard, "is_active", False):
        return 0.0
    _reentry_guard.is_active = True  # without this, a callback that wraps the device callback would recurse without end
    try:
        if hasattr(previous, "argtypes"):  # a C function takes the addresses of the structs
            return float(_C_CALLBACK.from_address(ctypes.addressof(previous))(model._address, data._address, actuator))
        return float(previous(model, data, actuator))
    finally:
        _reentry_guard.is_active = False


def _act_dyn(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    """Write the rates of the device's states, or return that of a friction: ``mjcb_act_dyn``."""
    row = get_parameter_row(model, actuator)
    if row is None:
        rate = find_friction_rate(model, data, actuator)
        return _call_previous("act_dyn", model, data, actuator) if rate is None else rate
    start = model.actuator_actadr[actuator]
    pressure, offset = data.act[start : start + coupling.N_BASE_STATES].tolist()
    internal_state = read_internal_state(model, data, actuator)
    command = float(data.ctrl[model.actuator_ctrladr[actuator]])
    length = float(data.actuator_length[model.actuator_outadr[actuator]])
    try:
        *rates, next_internal_state = coupling.compute_rates(
            row, pressure, offset, internal_state, command, length, model.opt.timestep
        )
    except MATH_ERRORS:
        rates, next_internal_state = [math.nan, 0.0], internal_state
    if not math.isfinite(rates[0]):
        raise _make_nonfinite_state_error(model.actuator(actuator).name, data.time, command, pressure, offset, length)
    data.act_dot[start : start + coupling.N_BASE_STATES] = rates
    if model.actuator_actnum[actuator] != coupling.N_BASE_STATES:
        internal_rates = [
            (after - before) / model.opt.timestep
            for before, after in zip(internal_state, next_internal_state, strict=True)
        ]
        data.act_dot[start + coupling.N_BASE_STATES : start + coupling.N_ALL_STATES] = internal_rates
    return 0.0


def _act_bias(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    """Return the actuator force of a device or a friction: ``mjcb_act_bias``."""
    row = get_parameter_row(model, actuator)
    if row is None:
        force = find_friction_force(model, data, actuator)
        return _call_previous("act_bias", model, data, actuator) if force is None else force
    start, out = model.actuator_actadr[actuator], model.actuator_outadr[actuator]
    pressure, offset = data.act[start : start + 2].tolist()
    pressure_rate, length_rate = data.act_dot[start : start + 2].tolist()
    length, velocity = float(data.actuator_length[out]), float(data.actuator_velocity[out])
    internal_state = read_internal_state(model, data, actuator)
    return coupling.compute_force(
        row,
        pressure,
        offset,
        internal_state,
        pressure_rate,
        length_rate,
        length,
        velocity,
        model.opt.timestep,
    )
