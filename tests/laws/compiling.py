"""Compiled copies of law modules, for tests that hold them against the plain ones."""

import importlib.util
import inspect
import types

import numba


def compiled(module: types.ModuleType, **replaced: types.ModuleType) -> types.ModuleType:
    """A copy of ``module`` whose functions are compiled and which uses the ``replaced`` modules."""
    assert module.__file__ is not None
    spec = importlib.util.spec_from_file_location(module.__name__ + "_compiled", module.__file__)
    assert spec is not None
    assert spec.loader is not None
    copy = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(copy)
    own = {name: f for name, f in vars(copy).items() if inspect.isfunction(f) and f.__module__ == copy.__name__}
    vars(copy).update(replaced)
    vars(copy).update({name: numba.njit(f) for name, f in own.items()})
    return copy
