"""Compile the walker's time steps: the source of ``stepping`` with MuJoCo's own step inside."""

import ctypes
import hashlib
import itertools
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import mujoco

from klute_sim.errors import KluteSimError
from klute_sim.plant import callbacks
from klute_sim.types import Array
from klute_sim.walker.person import muscles
from klute_sim.walker.reflexes import laws as reflexes
from klute_sim.walker.simulation import stepping
from klute_sim.walker.simulation.stepping import LoopSettings

_STEP_SYMBOL = "klute_sim_mj_step"
"""Symbol of MuJoCo's step in compiled code."""
_LIBRARY_PATTERNS = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")


class StepFunctions(NamedTuple):
    """Functions of a backend."""

    take_steps: Callable[..., int]
    """:func:`klute_sim.walker.simulation.stepping.take_steps`; its ``model`` and ``data`` are MuJoCo's objects."""
    settle_muscles: Callable[..., None]
    """:func:`klute_sim.walker.simulation.stepping.settle_muscles`."""
    fill_delay_lines: Callable[..., None]
    """:func:`klute_sim.walker.simulation.stepping.fill_delay_lines`."""


def get_step_functions(backend: str) -> StepFunctions:
    """Return the functions of ``backend``, ``"compiled"`` or ``"python"``."""
    return _compile() if backend == "compiled" else _build_python()


def _to_tuple(values: Array, n: int) -> tuple[float, ...]:
    return tuple(values[:n].tolist())


@cache
def _build_python() -> StepFunctions:
    stepping.step_model, stepping.to_tuple = callbacks.step_model, _to_tuple
    return StepFunctions(stepping.take_steps, stepping.settle_muscles, stepping.fill_delay_lines)


@cache
def _compile() -> StepFunctions:
    import llvmlite.binding
    import numba
    from numba import types
    from numba.np.unsafe.ndarray import to_fixed_tuple

    from klute_sim.device.backend.compiled import compile_cached, compile_module

    llvmlite.binding.add_symbol(_STEP_SYMBOL, _find_step_address())
    step_model = types.ExternalFunction(_STEP_SYMBOL, types.void(types.int64, types.int64))
    names = {"step_model": step_model, "to_tuple": to_fixed_tuple}
    modules: dict[str, Any] = {"muscles": compile_module(muscles), "reflexes": compile_module(reflexes)}
    module = compile_module(stepping, **modules, **names)
    series, table = types.float64[::1], types.float64[:, ::1]
    number_types = [types.float64] * 6 + [types.int64] * 8
    settings = types.NamedTuple(number_types, LoopSettings)
    constants = _hash_sources()

    decorate = partial(numba.njit, nogil=True)  # walks in several threads run in parallel
    take_steps = compile_cached(
        decorate,
        module.take_steps,
        types.int64(
            settings, table, *[series] * 2, *[types.int64] * 2, *[series] * 7, types.float64, types.int64, table
        ),
        constants,
    )
    settle = compile_cached(decorate, module.settle_muscles, types.void(settings, table, series, series), constants)
    fill = compile_cached(decorate, module.fill_delay_lines, types.void(settings, series, series, series), constants)

    def take_steps_at_addresses(
        settings: LoopSettings,
        muscle_rows: Array,
        left: Array,
        right: Array,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        *others: Any,
    ) -> int:
        n_steps: int = take_steps(settings, muscle_rows, left, right, model._address, data._address, *others)
        return n_steps

    return StepFunctions(take_steps_at_addresses, settle, fill)


def _find_step_address() -> int:
    folder = Path(mujoco.__file__).parent
    libraries = list(itertools.chain.from_iterable(folder.glob(pattern) for pattern in _LIBRARY_PATTERNS))
    if not libraries:
        raise KluteSimError(f"the library of MuJoCo is not in {folder}; use the backend 'python'")
    address = ctypes.cast(ctypes.CDLL(str(libraries[0])).mj_step, ctypes.c_void_p).value
    assert address is not None
    return address


def _hash_sources() -> str:
    """Return a hash of the walker's sources; the cache of numba follows only the file of a function."""
    files = sorted(Path(stepping.__file__).parents[1].rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
