"""Registration of the environments with Gymnasium, without importing it.

Importing Gymnasium takes longer than ``klute-sim --help``. The environments are therefore registered at once if
Gymnasium is already imported, and otherwise when it is imported.
"""

import importlib.abc
import importlib.machinery
import importlib.util
import sys
import types
from collections.abc import Sequence

ENVIRONMENTS = {
    "klute_sim/AnkleGait-v2": {
        "entry_point": "klute_sim.envs.ankle_gait:AnkleGaitEnv",
        "vector_entry_point": "klute_sim.envs.ankle_gait_vector:AnkleGaitVectorEnv",
    },
    "klute_sim/AnkleWalk-v0": {
        "entry_point": "klute_sim.envs.ankle_walk:AnkleWalkEnv",
        "vector_entry_point": "klute_sim.envs.ankle_walk_vector:AnkleWalkVectorEnv",
    },
    "klute_sim/AnkleBench-v0": {
        "entry_point": "klute_sim.envs.ankle_bench:AnkleBenchEnv",
        "vector_entry_point": "klute_sim.envs.ankle_bench_vector:AnkleBenchVectorEnv",
    },
    "klute_sim/AntagonistJoint-v0": {
        "entry_point": "klute_sim.envs.antagonist_joint:AntagonistJointEnv",
        "vector_entry_point": "klute_sim.envs.antagonist_joint_vector:AntagonistJointVectorEnv",
    },
}
"""Entry points of each environment."""


def register_environments() -> None:
    """Register the environments with Gymnasium, now or when it is imported."""
    if "gymnasium" in sys.modules:
        import gymnasium

        for name, entry_points in ENVIRONMENTS.items():
            if name not in gymnasium.registry:
                gymnasium.register(
                    name, entry_points["entry_point"], vector_entry_point=entry_points["vector_entry_point"]
                )
    elif not any(isinstance(finder, _GymnasiumImportHook) for finder in sys.meta_path):
        sys.meta_path.insert(0, _GymnasiumImportHook())


class _GymnasiumImportHook(importlib.abc.MetaPathFinder):
    """Import hook that registers the environments after Gymnasium is imported; it finds no modules itself."""

    def __init__(self) -> None:
        self._finding_spec = False

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return the module spec of the other finders, with a loader that registers the environments at its end."""
        if fullname != "gymnasium" or self._finding_spec:
            return None
        self._finding_spec = True
        try:
            spec = importlib.util.find_spec(fullname)
        finally:
            self._finding_spec = False
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def exec_module(module: types.ModuleType) -> None:
                execute(module)
                if self in sys.meta_path:  # the module may be loaded repeatedly
                    sys.meta_path.remove(self)
                register_environments()

            spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec
