"""The same laws, compiled: copies of the law modules whose functions run through numba.

Nothing is written twice. A copy shares its module's code and classes; only its functions are compiled, and they
call the other copies. No floating-point liberties are taken: compiled and plain Python agree to the last bit
wherever ``sqrt`` is rounded correctly, as IEEE 754 asks.
"""

import hashlib
import inspect
import sys
import types
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba

from klute_sim.device import step, vector
from klute_sim.effects import catalogue

DEVICE = ("advance", "tension", "remembered", "muscle_side", "tendon_side")
"""Functions of :mod:`klute_sim.device.step` that other compiled code calls."""


def copy_of(module: types.ModuleType, **replaced: Any) -> types.ModuleType:
    """A copy of ``module`` whose functions are compiled when first used; ``replaced`` names differ from its own.

    What it uses of the laws and effects, modules or functions, is compiled likewise.
    """
    copy = types.ModuleType(f"{module.__name__} (compiled)")
    names = vars(copy)
    names.update(vars(module))
    for name, value in vars(module).items():
        if inspect.ismodule(value) and _is_law(value.__name__):
            names[name] = _law(value)
        elif inspect.isfunction(value) and value.__module__ == module.__name__:
            mine = types.FunctionType(value.__code__, names, name, value.__defaults__)
            mine.__module__ = module.__name__
            names[name] = _compile(mine)
        elif inspect.isfunction(value) and _is_law(value.__module__):
            names[name] = getattr(_law(sys.modules[value.__module__]), value.__name__)
    names.update(replaced)
    return copy


def _compile(function: Any) -> Any:
    # Division by zero gives inf or NaN, as in C: an exception could not leave a callback anyway.
    return numba.njit(function, error_model="numpy", forceinline=True)


def _is_law(module: str) -> bool:
    # Not the catalogue and its hooks: they are assembled from the laws, not run with them.
    plain = module.startswith(("klute_sim.laws.", "klute_sim.effects.")) and module not in _NO_LAWS
    return plain or module == "klute_sim_users_effects"


_NO_LAWS = ("klute_sim.effects.catalogue", "klute_sim.effects.hooks", "klute_sim.effects.effect")


@cache
def _law(module: types.ModuleType) -> types.ModuleType:
    return copy_of(module)


def _compiled_law(law: Any) -> Any:
    return getattr(_law(sys.modules[law.__module__]), law.__name__)


@cache
def device_law() -> dict[str, Any]:
    """The compiled functions that make up a device: :data:`DEVICE` of its step, and ``unpack``."""
    law = copy_of(step, hooks=catalogue.assembled(_compiled_law, _compile))
    return {**{name: getattr(law, name) for name in DEVICE}, "unpack": copy_of(vector).unpack}


def ready(wrap: Callable[..., Any], function: Any, signature: Any, constants: str = "") -> Any:
    """``function`` of a copied module, compiled now by ``wrap`` (``numba.njit`` or ``cfunc``) or taken from the disk.

    numba's own cache looks only at the file of the function itself: it would keep the machine code of a law that has
    changed since. The compiled function is therefore named after all sources and ``constants`` it is made of.
    """
    mine = function.py_func
    mine.__qualname__ = f"{mine.__name__}_{_digest(constants)}"
    try:
        return wrap(signature, cache=True, error_model="numpy")(mine)
    except (OSError, RuntimeError):  # nowhere to keep it: a full disk, or no folder that may be written
        return wrap(signature, error_model="numpy")(mine)


@cache
def _digest(constants: str) -> str:
    folder = Path(step.__file__).parents[1]
    files = [
        folder / "units.py",
        *(f for part in ("laws", "effects", "device", "plant") for f in (folder / part).glob("*.py")),
    ]
    content = b"".join(file.read_bytes() for file in sorted(files))
    return hashlib.sha256(content + catalogue.source() + constants.encode()).hexdigest()[:16]
