"""MuJoCo's user callbacks, shared with everybody else in the process.

``mjcb_act_dyn`` and ``mjcb_act_bias`` are one slot each for the whole process. The router sits in them only
while somebody steps inside :func:`installed`, answers for the actuators that were bound, passes every other
one on to whoever was there before (or to MuJoCo's neutral value, 0), and puts back what it found.

Compiling a model while a Python callback is installed fails inside MuJoCo, so compile outside.
"""

import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

import mujoco

Callback = Callable[[mujoco.MjModel, mujoco.MjData, int], float]


class Law(Protocol):
    """What can be bound to an actuator. Both must be pure functions of model and data."""

    def act_dyn(self, model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
        """Write the rates of the actuator's states into ``data.act_dot``."""

    def act_bias(self, model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
        """Actuator force [N]; a pull on a tendon is negative."""


_bound: weakref.WeakKeyDictionary[mujoco.MjModel, dict[int, Law]] = weakref.WeakKeyDictionary()
_before: dict[str, Callback | None] = {}
_lock = threading.RLock()
_asking = threading.local()
_depth = 0


def bind(model: mujoco.MjModel, actuator: int, law: Law) -> None:
    """Let ``law`` answer for ``actuator`` of this very ``model`` object, for as long as the model lives."""
    _bound.setdefault(model, {})[actuator] = law


def _neighbour(name: str, model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    """What whoever was in the slot before us says of an actuator that is not ours; 0 if nobody was."""
    previous = _before.get(name)
    if previous is None or getattr(_asking, "now", False):
        return 0.0
    _asking.now = True  # somebody who wrapped our callback and stayed would ask us back, without end
    try:
        return previous(model, data, actuator)
    finally:
        _asking.now = False


def _act_dyn(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    law = _bound.get(model, {}).get(actuator)
    if law is not None:
        return law.act_dyn(model, data, actuator)
    return _neighbour("act_dyn", model, data, actuator)


def _act_bias(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    law = _bound.get(model, {}).get(actuator)
    if law is not None:
        return law.act_bias(model, data, actuator)
    return _neighbour("act_bias", model, data, actuator)


_OURS: dict[str, Callback] = {"act_dyn": _act_dyn, "act_bias": _act_bias}


@contextmanager
def installed() -> Iterator[None]:
    """While inside, bound actuators follow their laws; may be nested and entered from several threads."""
    global _depth
    with _lock:
        if _depth == 0:
            for name, ours in _OURS.items():
                _before[name] = getattr(mujoco, f"get_mjcb_{name}")()
                getattr(mujoco, f"set_mjcb_{name}")(ours)
        _depth += 1
    try:
        yield
    finally:
        with _lock:
            _depth -= 1
            if _depth == 0:
                for name, ours in _OURS.items():
                    # Somebody who installed after us and is still there keeps the slot.
                    if getattr(mujoco, f"get_mjcb_{name}")() is ours:
                        getattr(mujoco, f"set_mjcb_{name}")(_before[name])
                _before.clear()
