"""Simulate a powered below-knee prosthesis with Klute's artificial muscle-tendon in MuJoCo.

Import the package as ``ks``; every public name loads its module at first use (PEP 562), so the import is fast::

    import klute_sim as ks

    run = ks.simulate_gait("klute-1-1-4-pair", mass=68)
    print(run)
"""

from importlib import import_module
from typing import Any

from klute_sim.envs.registration import register_environments as _register

__version__ = "0.1.0"

_MODULES = {
    "klute_sim.api.adaptation": ("AdaptationResult", "adapt_walker"),
    "klute_sim.api.assessment": ("Assessment", "assess"),
    "klute_sim.api.baselines": ("BaselineTable", "simulate_baselines"),
    "klute_sim.api.bench": ("BenchRun", "simulate_bench"),
    "klute_sim.api.comparison": ("ComparisonResult", "compare"),
    "klute_sim.api.dataset_draft": ("draft_dataset",),
    "klute_sim.api.design": ("DesignResult", "design"),
    "klute_sim.api.diagnosis": (
        "DiagnosisResult",
        "MeasurementPlan",
        "diagnose",
        "load_dataset",
        "load_example_dataset",
        "plan_measurements",
    ),
    "klute_sim.api.gait": ("GaitRun", "simulate_gait"),
    "klute_sim.api.joint_tuning": ("JointTuningResult", "tune_joint"),
    "klute_sim.api.joint": ("JointRun", "export_mjcf", "simulate_joint"),
    "klute_sim.api.mocap": ("DatasetImport", "GaitImport", "export_run", "import_dataset", "import_gait"),
    "klute_sim.api.reproduction": ("ReproductionResult", "reproduce"),
    "klute_sim.api.response": ("simulate_response",),
    "klute_sim.api.sweep": ("sweep", "sweep_joint", "sweep_walks"),
    "klute_sim.api.sweep_result": ("SweepResult",),
    "klute_sim.api.training": ("TrainingResult", "train"),
    "klute_sim.api.tuning": ("TuningResult", "tune"),
    "klute_sim.api.walk": ("WalkRun", "simulate_walk"),
    "klute_sim.api.walk_comparison": ("WalkComparison", "compare_walks"),
    "klute_sim.api.walk_tuning": ("WalkTuningResult", "tune_walk"),
    "klute_sim.datasets.dataset": ("Dataset",),
    "klute_sim.datasets.draft.draft": ("DatasetDraft",),
    "klute_sim.device.device": ("Device", "list_presets", "load_device"),
    "klute_sim.device.schema.document": ("Damper", "Tendon"),
    "klute_sim.device.schema.muscle": ("Muscle",),
    "klute_sim.device.schema.parts": ("Cylinder",),
    "klute_sim.device.schema.supply": ("Supply",),
    "klute_sim.effects.effect": ("Effect", "EffectForm", "EffectParameter"),
    "klute_sim.effects.catalogue": ("effect", "get_effects", "register_effect"),
    "klute_sim.errors": ("InputError", "KluteSimError", "MissingExtraError", "SimulationError"),
    "klute_sim.gait.reference": ("load_reference",),
    "klute_sim.recording.parquet": ("load_recording",),
    "klute_sim.recording.recording": ("Recording",),
}
"""Module -> its public names."""

_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = ["__version__", *sorted(_MODULE_OF)]


def __getattr__(name: str) -> Any:
    """Load a public name at its first use."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'klute_sim' has no attribute '{name}'; public names: {', '.join(__all__)}")
    value = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return list(__all__)


_register()
