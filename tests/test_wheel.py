"""Test that the wheel from the source distribution is complete and runs outside of the checkout."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.load_script import load_script


@pytest.mark.slow
def test_wheel_runs_outside_of_checkout(tmp_path: Path) -> None:
    source, wheel = load_script("try_packages").build_packages(tmp_path)
    for required in (
        "tests/conftest.py",
        "docs/conf.py",
        "examples",
        "scripts/env.py",
        "LICENSE",
        "requirements-dev.lock",
        "requirements-extras.lock",
    ):
        assert (source / required).exists(), required
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    files = {str(file.relative_to(site / "klute_sim")) for file in (site / "klute_sim").rglob("*")}
    required_files = {
        "py.typed",
        "models/ankle.xml",
        "models/bench.xml",
        "models/gait_rig.xml",
        "controllers/tuned_profile.csv",
        "training/gait.toml",
        "training/walk.toml",
    }
    assert {str(Path(name)) for name in required_files} <= files
    code = (
        "import klute_sim, sys; from klute_sim.plant import models; from klute_sim.cli import main\n"
        "print(klute_sim.__file__, models.get_models_folder(), file=sys.stderr)\n"
        "main(['gait', '--strides', '1', '--json'])"
    )
    environment = {**os.environ, "PYTHONPATH": str(site)}
    completed = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert completed.returncode == 0, completed.stderr
    assert completed.stderr.count(str(site)) == 2
    assert json.loads(completed.stdout)["strides"] == 1
