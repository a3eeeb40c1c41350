"""Tests of the documentation: every command and every Python block runs, and tables are complete."""

import contextlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.command_line import run

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(console|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)
SLOW_PAGES = {
    *("bench.md", "compare.md", "design.md", "diagnose.md", "dissertation.md", "environment.md"),
    *("gait.md", "import.md", "python.md", "sweep.md", "tuning.md", "view.md", "walk.md"),
}
"""Pages with commands of many seconds, such as whole diagnoses."""
PAGES_WITH_OWN_PROCESS = {"README.md", "effects.md", "python.md"}
"""Pages whose Python starts as a user's process does, or adds effects to the law, which a process builds once."""
BLOCKS = [
    pytest.param(
        page.name, kind, text, id=f"{page.name}-{number}", marks=[pytest.mark.slow] if page.name in SLOW_PAGES else []
    )
    for page in PAGES
    for number, (kind, text) in enumerate(BLOCK.findall(page.read_text("utf-8")))
]
LINK = re.compile(r"\]\((?!https?:)([^)#]+)")


def environment() -> dict[str, str]:
    return {**os.environ, "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}


@pytest.mark.usefixtures("in_process_runner")
@pytest.mark.parametrize(("page", "kind", "text"), BLOCKS)
def test_block_runs(page: str, kind: str, text: str, tmp_path: Path) -> None:
    """Most blocks share a process, which saves their imports and lets environments share the path of the hip."""
    if kind == "python" and page not in PAGES_WITH_OWN_PROCESS:
        with contextlib.chdir(tmp_path):
            exec(compile(text, page, "exec"), {"__name__": "__main__"})
        return
    if kind == "python":
        commands = [[sys.executable, "-c", text]]
    else:
        commands = [line.removeprefix("$ ").split() for line in text.splitlines() if line.startswith("$ ")]
        assert commands
    for command in commands:
        if command[0] == "klute-sim" and page != "README.md":
            completed = run(*command[1:], cwd=tmp_path)
        else:
            completed = subprocess.run(
                command, cwd=tmp_path, env=environment(), capture_output=True, text=True, check=False
            )
        assert completed.returncode == 0, completed.stderr


@pytest.mark.slow
def test_example_improves_in_a_few_generations(tmp_path: Path) -> None:
    example = str(ROOT / "examples" / "cross_entropy.py")
    command = [sys.executable, example, "--generations", "4", "--candidates", "16", "--strides", "1"]
    completed = subprocess.run(command, cwd=tmp_path, env=environment(), capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    lines = completed.stdout.splitlines()
    assert len(lines) == 6
    gain, error = re.fullmatch(
        r"learned: [\d.]+, a gain of (-?[\d.]+) \+- ([\d.]+) \(standard error\)", lines[-1]
    ).groups()
    assert float(gain) > 2.0 * float(error)


def test_documentation_has_commands_and_python() -> None:
    kinds = [block.values[1] for block in BLOCKS]
    assert kinds.count("python") >= 4
    assert kinds.count("console") >= 3


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_resolve(page: Path) -> None:
    for target in LINK.findall(page.read_text("utf-8")):
        assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_readme_commands_are_those_of_ci() -> None:
    readme = (ROOT / "README.md").read_text("utf-8")
    assert "python3 scripts/env.py klute-sim gait\n" in readme
    test_command = "python3 scripts/env.py pytest"
    assert f"\n{test_command}\n" in readme
    assert test_command in (ROOT / ".ci" / "run").read_text("utf-8")


def test_documented_device_keys_are_complete() -> None:
    from klute_sim.device.schema import document, muscle, parts, supply

    page = (ROOT / "docs" / "devices.md").read_text("utf-8")
    sections = (muscle.Muscle, parts.Cylinder, document.Damper, document.Tendon, supply.Supply)
    for section in (*sections, document.Mounting, document.PublishedMeasurement):
        for key in section.model_fields:
            assert f"`{key}`" in page, key


def test_documented_reference_columns_are_complete() -> None:
    from klute_sim.gait import reference

    page = (ROOT / "docs" / "gait.md").read_text("utf-8")
    for column in (reference.PHASE_COLUMN, *reference.REQUIRED_COLUMNS, *reference.DEVIATION_COLUMNS):
        assert f"`{column}`" in page, column


def test_documented_channels_are_complete() -> None:
    from klute_sim import bench
    from klute_sim.device.energy import ledger
    from klute_sim.gait.rig import measurements, rig

    page = (ROOT / "docs" / "recordings.md").read_text("utf-8")
    named = [*(name for name, *_ in (*rig.REFERENCE_CHANNELS, *rig.REFERENCE_DEVIATIONS))]
    for channel in (*measurements.MEASURED_COLUMNS, *bench.CHANNELS, *ledger.COLUMN_HEADINGS, *named):
        assert f"`{channel.split(' ')[0]}`" in page, channel


def test_python_guide_has_fifteen_short_tasks_with_public_names_only() -> None:
    page = (ROOT / "docs" / "python.md").read_text("utf-8")
    tasks = re.findall(r"^### .*?\n\n```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert len(tasks) == 15
    for task in tasks:
        assert len([line for line in task.splitlines() if line.strip()]) <= 10, task
        assert "klute_sim." not in task, task
