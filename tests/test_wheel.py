"""A wheel made of the source distribution carries everything the program needs, and runs away from the checkout."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

from tests.load_script import script


def test_the_wheel_runs_by_itself(tmp_path: Path) -> None:
    source, wheel = script("try_packages").built(tmp_path)
    for part in ("tests/conftest.py", "docs/conf.py", "examples", "scripts/env.py", "LICENSE", "requirements-dev.lock"):
        assert (source / part).exists(), part
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    inside = {str(file.relative_to(site / "klute_sim")) for file in (site / "klute_sim").rglob("*")}
    wanted = {
        "py.typed",
        "models/ankle.xml",
        "models/bench.xml",
        "models/gait_rig.xml",
        "control/tuned_profile.csv",
        "learn/default.toml",
    }
    assert {str(Path(name)) for name in wanted} <= inside
    code = (
        "import klute_sim, sys; from klute_sim.plant import models; from klute_sim.cli import main\n"
        "print(klute_sim.__file__, models.folder(), file=sys.stderr)\n"
        "main(['gait', '--strides', '1', '--json'])"
    )
    away = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=away, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.count(str(site)) == 2
    assert json.loads(done.stdout)["strides"] == 1
