"""The cache of fits: which code its entries depend on, and which settings."""

import ast
from pathlib import Path

import pytest

import klute_sim
from klute_sim.api.diagnosis import load_example_dataset
from klute_sim.diagnosis import workflow
from klute_sim.diagnosis.fitting.fit_cache import FIT_MODULES, FitCache
from klute_sim.diagnosis.result import DiagnosisOptions

ROOT = Path(klute_sim.__file__).parent
UNRELATED_MODULES = {"bench", "controllers", "errors", "provenance", "recording", "types"}
"""Modules that this code imports, and that do not change a fit: protocols to propose, and controllers of other rigs."""


def test_cache_depends_on_all_code_that_a_fit_imports() -> None:
    """After a change of any other module, an interrupted diagnosis would continue with fits of the old code."""
    paths = [ROOT / name for name in FIT_MODULES]
    assert all(path.exists() for path in paths)
    files = [file for path in paths for file in (path.rglob("*.py") if path.is_dir() else [path])]
    nodes = [node for file in files for node in ast.walk(ast.parse(file.read_text("utf-8")))]
    modules = [node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module]
    imported = {module.split(".")[1] for module in modules if module.startswith("klute_sim.")}
    assert imported - {name.removesuffix(".py") for name in FIT_MODULES} <= UNRELATED_MODULES


def test_cache_does_not_depend_on_the_number_of_threads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keys = []

    def stop(digest: str) -> FitCache:
        keys.append(digest)
        raise KeyboardInterrupt

    monkeypatch.setattr(workflow, "FitCache", stop)
    dataset = load_example_dataset(tmp_path)
    for options in (DiagnosisOptions(n_jobs=1), DiagnosisOptions(n_jobs=2), DiagnosisOptions(n_jobs=1, seed=3)):
        with pytest.raises(KeyboardInterrupt):
            workflow.diagnose(dataset, options)
    assert keys[0] == keys[1] != keys[2]
