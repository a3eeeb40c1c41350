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

from klute_sim.device import dynamics
from klute_sim.device.backend import packing
from klute_sim.effects import catalogue

EXPORTED_STEP_FUNCTIONS = (
    "advance_state",
    "compute_tension",
    "step_internal_state",
    "compute_muscle_damper_force",
    "compute_tendon_force",
    "apply_supply_effects",
    "get_gas_state",
)
"""Functions of :mod:`klute_sim.device.dynamics` that other compiled code calls."""


def compile_module(module: types.ModuleType, **overrides: Any) -> types.ModuleType:
    """A copy of ``module`` whose functions are compiled when first used; ``replaced`` names differ from its own.

    What it uses of the laws and effects, modules or functions, is compiled likewise.
    """
    copy = types.ModuleType(f"{module.__name__} (compiled)")
    names = vars(copy)
    names.update(vars(module))
    for name, value in vars(module).items():
        if inspect.ismodule(value) and _is_compilable_module(value.__name__):
            names[name] = _get_compiled_module(value)
        elif inspect.isfunction(value) and value.__module__ == module.__name__:
            mine = types.FunctionType(value.__code__, names, name, value.__defaults__)
            mine.__module__ = module.__name__
            names[name] = _compile_function(mine)
        elif inspect.isfunction(value) and _is_compilable_module(value.__module__):
            names[name] = getattr(_get_compiled_module(sys.modules[value.__module__]), value.__name__)
    names.update(overrides)
    return copy


def _compile_function(function: Any) -> Any:
    # Division by zero gives inf or NaN, as in C: an exception could not leave a callback anyway.
    return numba.njit(function, error_model="numpy", forceinline=True)


def _is_compilable_module(module: str) -> bool:
    # Not the catalogue and its hooks: they are assembled from the laws, not run with them.
    plain = module.startswith(("klute_sim.laws.", "klute_sim.effects.")) and module not in _PYTHON_ONLY_MODULES
    return plain or module == "klute_sim_users_effects"


_PYTHON_ONLY_MODULES = ("klute_sim.effects.catalogue", "klute_sim.effects.chain", "klute_sim.effects.effect")


@cache
def _get_compiled_module(module: types.ModuleType) -> types.ModuleType:
    return compile_module(module)


def _get_compiled_function(function: Any) -> Any:
    return getattr(_get_compiled_module(sys.modules[function.__module__]), function.__name__)


@cache
def compile_device_functions() -> dict[str, Any]:
    """The compiled functions that make up a device: :data:`DEVICE` of its step, and ``unpack``."""
    law = compile_module(
        dynamics, effect_chain=catalogue.chain_device_effects(_get_compiled_function, _compile_function)
    )
    return {
        **{name: getattr(law, name) for name in EXPORTED_STEP_FUNCTIONS},
        "unpack_parameters": compile_module(packing).unpack_parameters,
    }


def compile_cached(decorator: Callable[..., Any], function: Any, signature: Any, constants: str = "") -> Any:
    """``function`` of a copied module, compiled now by ``wrap`` (``numba.njit`` or ``cfunc``) or taken from the disk.

    numba's own cache looks only at the file of the function itself: it would keep the machine code of a law that has
    changed since. The compiled function is therefore named after all sources and ``constants`` it is made of.
    """
    mine = function.py_func
    mine.__qualname__ = f"{mine.__name__}_{_hash_sources(constants)}"
    try:
        return decorator(signature, cache=True, error_model="numpy")(mine)
    except (OSError, RuntimeError):  # nowhere to keep it: a full disk, or no folder that may be written
        return decorator(signature, error_model="numpy")(mine)


@cache
def _hash_sources(constants: str) -> str:
    folder = Path(dynamics.__file__).parents[1]
    files = [
        folder / "units.py",
        *(f for part in ("laws", "effects", "device", "plant") for f in (folder / part).rglob("*.py")),
    ]
    content = b"".join(file.read_bytes() for file in sorted(files))
    return hashlib.sha256(content + catalogue.read_user_source() + constants.encode()).hexdigest()[:16]
