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

from klute_sim.device import installation
from klute_sim.device.step import NO_MEMORY
from klute_sim.device.vector import SIGNATURE
from klute_sim.errors import KluteSimError, KluteSimWarning, SimulationError
from klute_sim.plant import coupling

SLOTS = ("act_dyn", "act_bias")
_PLAIN = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)

_lock = threading.RLock()
_inside: Counter[int] = Counter()
"""How often each thread is inside :func:`installed`."""
_before: dict[str, Any] = {}
"""What was in the slots when the first one came in."""
_ours: dict[str, Any] = {}
"""What is in the slots while anybody is inside."""
_asking = threading.local()


@cache
def _compiled() -> tuple[Any, str]:
    """The module with the compiled callbacks and '', or None and why there are none."""
    try:
        from klute_sim.plant import native

        native.callbacks()
    except ImportError as error:
        return None, f"numba cannot be imported ({error})"
    except Exception as error:  # whatever a future numba or MuJoCo trips over, the reference still runs
        return None, f"the law cannot be compiled ({error})"
    return native, ""


def choose(law: str = "auto") -> str:
    """``compiled`` or ``python``, as asked for and possible (:func:`klute_sim.device.installation.choose`)."""

    def obstacle() -> str:
        with _lock:
            return _compiled()[1]

    return installation.choose(law, obstacle)


@contextmanager
def installed(law: str = "auto") -> Iterator[str]:
    """While inside, actuators that carry a device follow it; gives the name of the law that is in force.

    May be nested and entered from several threads; whoever is first in decides which law. A thread on its way out gets
    a SimulationError if, under the compiled law, it has stepped a device without a finite state and was not told.
    Raises KluteSimError, or warns (KluteSimWarning) on the way out, if somebody else has put callbacks of their own
    over ours: devices give no force under those.
    """
    law = choose(law)
    me = threading.get_ident()
    with _lock:
        if not _inside:
            _install(law)
        elif not _in_place():
            raise KluteSimError("somebody else's callbacks were installed in MuJoCo over the device's: it has no force")
        if compiled_in_force():
            if not _inside[me]:
                _compiled()[0].take()  # what was not told before is not told now
            law = "compiled"
        else:
            law = "python"
        _inside[me] += 1
    try:
        yield law
    finally:
        with _lock:
            _inside[me] -= 1
            outermost = not _inside[me]
            if outermost:
                del _inside[me]
            kept = bool(_inside) or _restore()
    if not kept:
        warnings.warn(
            "somebody else's callbacks were installed in MuJoCo over the device's: it had no force since",
            KluteSimWarning,
            stacklevel=3,
        )
    if outermost and law == "compiled":
        fault = _compiled()[0].take()
        if fault is not None:
            raise _no_finite_state(*fault)


def compiled_in_force() -> bool:
    """Whether the compiled law is in MuJoCo's slots."""
    return bool(_ours) and _ours["act_dyn"] is not _act_dyn


def _in_place() -> bool:
    return all(getattr(mujoco, f"get_mjcb_{name}")() is ours for name, ours in _ours.items())


def _install(law: str) -> None:
    _before.update({name: getattr(mujoco, f"get_mjcb_{name}")() for name in SLOTS})
    if law == "compiled" and any(callback is not None for callback in _before.values()):
        warnings.warn(
            "other MuJoCo callbacks are installed: the law runs as Python, so that they are asked, too",
            KluteSimWarning,
            stacklevel=4,
        )
        law = "python"
    if law == "compiled":
        _ours.update(_functions())
    else:
        _ours.update({"act_dyn": _act_dyn, "act_bias": _act_bias})
    for name, callback in _ours.items():
        getattr(mujoco, f"set_mjcb_{name}")(callback)


@cache
def _functions() -> dict[str, Any]:
    """The compiled callbacks, as MuJoCo takes them."""
    return {name: function.ctypes for name, function in _compiled()[0].callbacks()._asdict().items()}


def _restore() -> bool:
    """Put back what was there; whether ours had stayed in place until now."""
    kept = _in_place()
    for name, ours in _ours.items():
        # Somebody who installed after us and is still there keeps the slot.
        if getattr(mujoco, f"get_mjcb_{name}")() is ours:
            getattr(mujoco, f"set_mjcb_{name}")(_before[name])
    _before.clear()
    _ours.clear()
    return kept


def _after_fork() -> None:
    """In the child only the forking thread goes on: what others had taken is given back."""
    global _lock
    _lock = threading.RLock()
    mine = _inside.pop(threading.get_ident(), 0)
    others = bool(_inside)
    _inside.clear()
    if mine:
        _inside[threading.get_ident()] = mine
    elif others:
        _restore()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def step(model: mujoco.MjModel, data: mujoco.MjData, count: int = 1) -> None:
    """Take ``count`` steps inside :func:`installed`.

    Raises SimulationError, with actuator, time and state, when a device has no finite state. Under the Python law the
    failed step is not taken; under the compiled law all ``count`` steps are, with no force from that device.
    """
    mujoco.mj_step(model, data, count)
    if compiled_in_force() and _compiled()[0].faults:  # of anybody: the data itself says whose
        _raise_fault(model, data)


def _raise_fault(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Raise if a device of ``data`` has failed."""
    failed = [
        actuator
        for actuator in range(model.nactuator)
        if row_of(model, actuator) and not math.isfinite(data.act[model.actuator_actadr[actuator]])
    ]
    reported = _compiled()[0].take(data._address)
    if failed and reported:
        raise _no_finite_state(*reported)


def take_reports() -> list[str]:
    """What the calling thread and MuJoCo's own threads have reported, one sentence each; it is then forgotten."""
    faults = _compiled()[0].faults
    strangers = [thread for thread in list(faults) if thread not in _inside or thread == threading.get_ident()]
    reports = [report for thread in strangers for report in faults.pop(thread, {}).values()]
    return [str(_no_finite_state(*report)) for report in reports]


def _no_finite_state(
    actuator: str, time: float, command: float, pressure: float, offset: float, length: float
) -> SimulationError:
    return SimulationError(
        f"actuator '{actuator}' has no finite state at t = {time:.4f} s: pressure command {command:.6g} bar, pressure "
        f"{pressure:.6g} bar, muscle {1e3 * offset:.6g} mm beyond its resting length, muscle-tendon length "
        f"{length:.6g} m"
    )


def row_of(model: mujoco.MjModel, actuator: int) -> tuple[float, ...] | None:
    """The parameters of the device on ``actuator``; None if it carries none, or has no place for its states."""
    if (
        model.nuser_actuator >= coupling.ROW
        and model.actuator_user[actuator, 0] == SIGNATURE
        and model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_USER
        and model.actuator_actnum[actuator] in (coupling.STATES, coupling.ALL_STATES)
    ):
        return tuple(model.actuator_user[actuator, : coupling.ROW].tolist())
    return None


def remembered(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> tuple[float, ...]:
    """What the effects of the device on ``actuator`` remember; zeros if it has no states for that."""
    if model.actuator_actnum[actuator] == coupling.STATES:
        return NO_MEMORY
    at = model.actuator_actadr[actuator]
    return tuple(data.act[at + coupling.STATES : at + coupling.ALL_STATES].tolist())


def _neighbour(name: str, model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    """What whoever was in the slot before us says of an actuator that is not ours; 0 if nobody was."""
    previous: Any = _before.get(name)
    if previous is None or getattr(_asking, "now", False):
        return 0.0
    _asking.now = True  # somebody who wrapped our callback and stayed would ask us back, without end
    try:
        if hasattr(previous, "argtypes"):  # a C function wants what is behind the Python objects
            return float(_PLAIN.from_address(ctypes.addressof(previous))(model._address, data._address, actuator))
        return float(previous(model, data, actuator))
    finally:
        _asking.now = False


def _act_dyn(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    row = row_of(model, actuator)
    if row is None:
        return _neighbour("act_dyn", model, data, actuator)
    at = model.actuator_actadr[actuator]
    pressure, offset = data.act[at : at + coupling.STATES].tolist()
    memory = remembered(model, data, actuator)
    command = float(data.ctrl[model.actuator_ctrladr[actuator]])
    length = float(data.actuator_length[model.actuator_outadr[actuator]])
    *found, after = coupling.rates(row, pressure, offset, memory, command, length, model.opt.timestep)
    if not math.isfinite(found[0]):
        raise _no_finite_state(model.actuator(actuator).name, data.time, command, pressure, offset, length)
    data.act_dot[at : at + coupling.STATES] = found
    if model.actuator_actnum[actuator] != coupling.STATES:
        rates = [(b - a) / model.opt.timestep for a, b in zip(memory, after, strict=True)]
        data.act_dot[at + coupling.STATES : at + coupling.ALL_STATES] = rates
    return 0.0


def _act_bias(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    row = row_of(model, actuator)
    if row is None:
        return _neighbour("act_bias", model, data, actuator)
    at, out = model.actuator_actadr[actuator], model.actuator_outadr[actuator]
    pressure, offset = data.act[at : at + 2].tolist()
    by_pressure, by_length = data.act_dot[at : at + 2].tolist()
    length, velocity = float(data.actuator_length[out]), float(data.actuator_velocity[out])
    memory = remembered(model, data, actuator)
    return coupling.force(row, pressure, offset, memory, by_pressure, by_length, length, velocity, model.opt.timestep)
