"""The same laws, compiled: copies of the law modules whose functions run through numba.

Nothing is written twice. A copy shares its module's code and classes; only its functions are compiled, and they
call the other copies. No floating-point liberties are taken: compiled and plain Python agree to the last bit
wherever ``sqrt`` is rounded correctly, as IEEE 754 asks.
"""

import hashlib
import inspect
import types
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba

from klute_sim.device import step, vector
from klute_sim.laws import damper, mckibben, pneumatics, tendon


def copy_of(module: types.ModuleType, **replaced: Any) -> types.ModuleType:
    """A copy of ``module`` whose functions are compiled when first used; ``replaced`` names differ from its own."""
    copy = types.ModuleType(f"{module.__name__} (compiled)")
    names = vars(copy)
    names.update({**vars(module), **replaced})
    for name, function in vars(module).items():
        if inspect.isfunction(function) and function.__module__ == module.__name__:
            mine = types.FunctionType(function.__code__, names, name, function.__defaults__)
            mine.__module__ = module.__name__
            # Division by zero gives inf or NaN, as in C: an exception could not leave a callback anyway.
            names[name] = numba.njit(mine, error_model="numpy")
    return copy


@cache
def device_law() -> dict[str, Any]:
    """The compiled functions that make up a device: ``advance``, ``tension``, ``unpack``."""
    laws = {"_damper": copy_of(damper), "_tendon": copy_of(tendon)}
    law = copy_of(step, mckibben=copy_of(mckibben), pneumatics=copy_of(pneumatics), **laws)
    return {"advance": law.advance, "tension": law.tension, "unpack": copy_of(vector).unpack}


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
    files = [folder / "units.py", *(f for part in ("laws", "device", "plant") for f in (folder / part).glob("*.py"))]
    content = b"".join(file.read_bytes() for file in sorted(files))
    return hashlib.sha256(content + constants.encode()).hexdigest()[:16]
