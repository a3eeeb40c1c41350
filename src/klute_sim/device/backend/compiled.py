"""The compiled backend: copies of the model's modules whose functions run through numba.

No formula is written twice. A copy shares the code and the classes of its module; its functions are compiled, and they
call the compiled functions of the other copies. Floating-point operations keep their order (no fast-math): the
compiled and the Python backend agree to the last bit wherever ``sqrt`` is rounded correctly, as IEEE 754 requires.
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
from klute_sim.device.backend.notice import announce_slow_compilation
from klute_sim.effects import catalogue

EXPORTED_STEP_FUNCTIONS = (
    "advance_state",
    "compute_tension",
    "step_internal_state",
    "compute_muscle_force",
    "compute_tendon_force",
    "apply_supply_effects",
    "get_gas_state",
    "get_dead_time",
)
"""Functions of :mod:`klute_sim.device.dynamics` that other compiled code calls."""

_COMPILABLE_PACKAGES = ("klute_sim.laws.", "klute_sim.effects.")
_COMPILABLE_MODULES = ("klute_sim.device.delay",)
_PYTHON_ONLY_MODULES = tuple(f"klute_sim.effects.{name}" for name in ("catalogue", "chain", "effect", "validation"))
"""Modules that assemble the effects and run only as plain Python."""
_SOURCE_FOLDERS = ("laws", "effects", "device", "plant")
"""Packages whose source determines the machine code."""


def compile_module(module: types.ModuleType, *, makes_arrays: bool = False, **overrides: Any) -> types.ModuleType:
    """Return a copy of ``module`` whose functions are compiled at their first call, which must be from compiled code.

    Laws and effects that the module uses, as modules or as functions, are compiled likewise. ``makes_arrays`` says
    whether functions of the module allocate or return arrays. ``overrides`` replace names of the copy.
    """
    copy = types.ModuleType(f"{module.__name__} (compiled)")
    names = vars(copy)
    names.update(vars(module))
    for name, value in vars(module).items():
        if inspect.ismodule(value) and _is_compilable_module(value.__name__):
            names[name] = _get_compiled_module(value)
        elif inspect.isfunction(value) and value.__module__ == module.__name__:
            function = types.FunctionType(value.__code__, names, name, value.__defaults__)
            function.__module__ = module.__name__
            names[name] = _compile_function(function, makes_arrays=makes_arrays)
        elif inspect.isfunction(value) and _is_compilable_module(value.__module__):
            names[name] = getattr(_get_compiled_module(sys.modules[value.__module__]), value.__name__)
    names.update(overrides)
    return copy


def _compile_function(function: Any, *, makes_arrays: bool = False) -> Any:
    # Division by zero gives inf or NaN, as in C: an exception could not leave a callback anyway.
    # Wrappers for calls from Python and C would convert every number of every effect, and double the compile time.
    # Numba's memory management (NRT) counts the references to each array that a function passes on, which would take
    # four fifths of a time step. Laws need it only where a user's allocates arrays.
    return numba.njit(
        function,
        error_model="numpy",
        forceinline=True,
        no_cpython_wrapper=True,
        no_cfunc_wrapper=True,
        _nrt=makes_arrays or _is_users_module(function.__module__),
    )


def _is_compilable_module(module: str) -> bool:
    if module in _PYTHON_ONLY_MODULES:
        return False
    if module.startswith(_COMPILABLE_PACKAGES) or module in _COMPILABLE_MODULES:
        return True
    return _is_users_module(module)


def _is_users_module(module: str) -> bool:
    return any(module == user_module.__name__ for user_module in catalogue.get_user_modules())


@cache
def _get_compiled_module(module: types.ModuleType) -> types.ModuleType:
    return compile_module(module)


def _get_compiled_function(function: Any) -> Any:
    module, name = sys.modules[function.__module__], function.__name__
    if getattr(module, name, None) is function:
        return getattr(_get_compiled_module(module), name)
    return _compile_function(function)  # a law that the user defined inside a function


@cache
def compile_device_functions() -> dict[str, Any]:
    """Return the compiled functions of a device: :data:`EXPORTED_STEP_FUNCTIONS` and ``unpack_parameters``."""
    chain = catalogue.chain_device_effects(_get_compiled_function, _compile_function)
    compiled_dynamics = compile_module(dynamics, effect_chain=chain)
    return {
        **{name: getattr(compiled_dynamics, name) for name in EXPORTED_STEP_FUNCTIONS},
        "unpack_parameters": compile_module(packing).unpack_parameters,
    }


def compile_cached(
    decorator: Callable[..., Any], function: Any, signature: Any, constants: str = "", *, makes_arrays: bool = False
) -> Any:
    """Return ``function`` of a copied module, compiled for ``signature`` or loaded from the cache on disk.

    ``decorator`` is ``numba.njit`` or ``numba.cfunc``. The cache of numba follows only the file of the function
    itself, so it would keep the machine code of a law that has changed since. The name of the compiled function
    therefore contains a hash of all sources and ``constants`` that determine its code. ``makes_arrays`` is that of
    :func:`compile_module`.
    """
    options = {"error_model": "numpy", "_nrt": makes_arrays}
    python_function = function.py_func
    python_function.__qualname__ = f"{python_function.__name__}_{_hash_sources(constants)}"
    with announce_slow_compilation():
        try:
            return decorator(signature, cache=True, **options)(python_function)
        except (OSError, RuntimeError):  # a full disk, or no writable folder: compile without cache
            return decorator(signature, **options)(python_function)


@cache
def _hash_sources(constants: str) -> str:
    package = Path(dynamics.__file__).parents[1]
    files = [
        package / "units.py",
        package / "constants.py",
        *(file for folder in _SOURCE_FOLDERS for file in (package / folder).rglob("*.py")),
    ]
    content = b"".join(file.read_bytes() for file in sorted(files))
    return hashlib.sha256(content + catalogue.read_user_source() + constants.encode()).hexdigest()[:16]
