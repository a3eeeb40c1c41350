"""MuJoCo's slots for callbacks, of which the whole process has one each."""

from typing import Any

import mujoco

SLOTS = ("act_bias", "act_dyn", "act_gain", "contactfilter", "control", "passive", "sensor", "time")
"""Names of the slots."""
_GETTERS = {slot: getattr(mujoco, f"get_mjcb_{slot}") for slot in SLOTS}
_SETTERS = {slot: getattr(mujoco, f"set_mjcb_{slot}") for slot in SLOTS}


def get_callback(slot: str) -> Any:
    """Return the callback in ``slot``; None if it is empty."""
    return _GETTERS[slot]()


def set_callback(slot: str, callback: Any) -> None:
    """Install ``callback`` in ``slot``; None empties it."""
    _SETTERS[slot](callback)


def remove_callbacks() -> dict[str, Any]:
    """Empty all slots; return what was in them."""
    removed = {slot: callback for slot, get in _GETTERS.items() if (callback := get()) is not None}
    for slot in removed:
        set_callback(slot, None)
    return removed


def restore_callbacks(removed: dict[str, Any]) -> None:
    """Install what :func:`remove_callbacks` returned, except where other code has filled the slot since."""
    for slot, callback in removed.items():
        if get_callback(slot) is None:
            set_callback(slot, callback)
    removed.clear()
