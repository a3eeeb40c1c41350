"""Makes ``gymnasium.make("klute_sim/...")`` work after ``import klute_sim``, without importing Gymnasium.

Importing Gymnasium takes longer than everything ``klute-sim --help`` does. So the environments are registered now if
Gymnasium is there already, and otherwise at the moment somebody imports it.
"""

import importlib.abc
import importlib.machinery
import importlib.util
import sys
import types
from collections.abc import Sequence

ENVIRONMENTS = {
    "klute_sim/AnkleGait-v1": {
        "entry_point": "klute_sim.envs.ankle_gait:AnkleGaitEnv",
        "vector_entry_point": "klute_sim.envs.ankle_gait_vector:AnkleGaitVectorEnv",
    },
    "klute_sim/AnkleBench-v0": {"entry_point": "klute_sim.envs.ankle_bench:AnkleBenchEnv"},
}
"""Name -> where it is."""


def register_environments() -> None:
    """Tell Gymnasium of our environments, now or as soon as it is imported."""
    if "gymnasium" in sys.modules:
        import gymnasium

        for name, places in ENVIRONMENTS.items():
            if name not in gymnasium.registry:
                gymnasium.register(name, places["entry_point"], vector_entry_point=places.get("vector_entry_point"))
    elif not any(isinstance(finder, _GymnasiumImportHook) for finder in sys.meta_path):
        sys.meta_path.insert(0, _GymnasiumImportHook())


class _GymnasiumImportHook(importlib.abc.MetaPathFinder):
    """Waits until Gymnasium has been imported; finds nothing itself."""

    def __init__(self) -> None:
        self._finding_spec = False

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """What the others find; Gymnasium's loader then ends with our registration."""
        if fullname != "gymnasium" or self._finding_spec:
            return None
        self._finding_spec = True
        try:
            found = importlib.util.find_spec(fullname)
        finally:
            self._finding_spec = False
        if found is not None and found.loader is not None:
            execute = found.loader.exec_module

            def exec_module(module: types.ModuleType) -> None:
                execute(module)
                if self in sys.meta_path:  # the module may be loaded again, or twice
                    sys.meta_path.remove(self)
                register_environments()

            found.loader.exec_module = exec_module  # type: ignore[method-assign]
        return found
