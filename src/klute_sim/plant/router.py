"""MuJoCo's user callbacks, shared with everybody else in the process.

``mjcb_act_dyn`` and ``mjcb_act_bias`` are one slot each for the whole process. The law sits in them only while
somebody steps inside :func:`installed`, answers for actuators that carry a device, leaves every other one to whoever
was there before (or to MuJoCo's neutral value, 0), and what was there is put back.

There are two installations of one source, equal to the last bit. *Compiled* (the default) is a pair of C functions
that run in any number of threads. *Python* is the reference: slow, one thread at a time, easy to step through; and
MuJoCo cannot compile a model while it is in. It is also what steps in when numba is missing, when MuJoCo's memory is
not laid out as expected, or when somebody else's callbacks were there first and have to be asked.
"""

import math
import os
import threading
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import mujoco

from klute_sim.device import installation
from klute_sim.device.vector import SIGNATURE
from klute_sim.errors import KluteSimWarning, SimulationError
from klute_sim.plant import coupling

Callback = Callable[[mujoco.MjModel, mujoco.MjData, int], float]
SLOTS = ("act_dyn", "act_bias")

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

    May be nested and entered from several threads; whoever is first in decides which law. Raises SimulationError on
    the way out if, under the compiled law, a device had no finite state and nobody was told.
    """
    law = choose(law)
    me = threading.get_ident()
    with _lock:
        if not _inside:
            _install(law)
        _inside[me] += 1
        in_force = "python" if _ours["act_dyn"] is _act_dyn else "compiled"
    try:
        yield in_force
    finally:
        with _lock:
            _inside[me] -= 1
            if not _inside[me]:
                del _inside[me]
            if not _inside:
                _restore()
    if not _inside and in_force == "compiled":
        _raise_fault()


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
        _compiled()[0].faults.clear()
        _ours.update(_functions())
    else:
        _ours.update({"act_dyn": _act_dyn, "act_bias": _act_bias})
    for name, callback in _ours.items():
        getattr(mujoco, f"set_mjcb_{name}")(callback)


@cache
def _functions() -> dict[str, Any]:
    """The compiled callbacks, as MuJoCo takes them."""
    return {name: function.ctypes for name, function in _compiled()[0].callbacks()._asdict().items()}


def _restore() -> None:
    for name, ours in _ours.items():
        # Somebody who installed after us and is still there keeps the slot.
        if getattr(mujoco, f"get_mjcb_{name}")() is ours:
            getattr(mujoco, f"set_mjcb_{name}")(_before[name])
    _before.clear()


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
    _raise_fault(data)


def _raise_fault(data: mujoco.MjData | None = None) -> None:
    """Raise for the first report about ``data`` (about anything: None) and drop the others."""
    if _ours.get("act_dyn") is _act_dyn:  # the reference raises by itself
        return
    native, _ = _compiled()
    address = None if data is None else data._address
    concerned = [fault for fault in native.faults if address in (None, fault.data)]
    if concerned:
        native.faults[:] = [fault for fault in native.faults if fault not in concerned]
        raise _no_finite_state(*concerned[0][1:])


def _no_finite_state(
    actuator: str, time: float, command: float, pressure: float, offset: float, length: float
) -> SimulationError:
    return SimulationError(
        f"actuator '{actuator}' has no finite state at t = {time:.4f} s: pressure command {command:.6g} bar, pressure "
        f"{pressure:.6g} bar, muscle {1e3 * offset:.6g} mm beyond its resting length, muscle-tendon length "
        f"{length:.6g} m"
    )


def row_of(model: mujoco.MjModel, actuator: int) -> list[float] | None:
    """The parameters of the device on ``actuator``; None if it carries none."""
    if model.nuser_actuator >= coupling.ROW and model.actuator_user[actuator, 0] == SIGNATURE:
        row: list[float] = model.actuator_user[actuator, : coupling.ROW].tolist()
        return row
    return None


def _neighbour(name: str, model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    """What whoever was in the slot before us says of an actuator that is not ours; 0 if nobody was."""
    previous: Callback | None = _before.get(name)
    if previous is None or getattr(_asking, "now", False):
        return 0.0
    _asking.now = True  # somebody who wrapped our callback and stayed would ask us back, without end
    try:
        return previous(model, data, actuator)
    finally:
        _asking.now = False


def _act_dyn(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    row = row_of(model, actuator)
    if row is None:
        return _neighbour("act_dyn", model, data, actuator)
    at = model.actuator_actadr[actuator]
    pressure, offset = data.act[at : at + 2].tolist()
    command = float(data.ctrl[model.actuator_ctrladr[actuator]])
    length = float(data.actuator_length[model.actuator_outadr[actuator]])
    found = coupling.rates(row, pressure, offset, command, length, model.opt.timestep)
    if not math.isfinite(found[0]):
        raise _no_finite_state(model.actuator(actuator).name, data.time, command, pressure, offset, length)
    data.act_dot[at : at + 2] = found
    return 0.0


def _act_bias(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    row = row_of(model, actuator)
    if row is None:
        return _neighbour("act_bias", model, data, actuator)
    at, out = model.actuator_actadr[actuator], model.actuator_outadr[actuator]
    pressure, offset = data.act[at : at + 2].tolist()
    by_pressure, by_length = data.act_dot[at : at + 2].tolist()
    length, velocity = float(data.actuator_length[out]), float(data.actuator_velocity[out])
    return coupling.force(row, pressure, offset, by_pressure, by_length, length, velocity, model.opt.timestep)
