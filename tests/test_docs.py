"""Every command and every piece of Python in the documentation runs."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(console|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)
BLOCKS = [
    pytest.param(kind, text, id=f"{page.name}-{number}")
    for page in PAGES
    for number, (kind, text) in enumerate(BLOCK.findall(page.read_text("utf-8")))
]
LINK = re.compile(r"\]\((?!https?:)([^)#]+)")


def environment() -> dict[str, str]:
    return {**os.environ, "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}


@pytest.mark.parametrize(("kind", "text"), BLOCKS)
def test_block_runs(kind: str, text: str, tmp_path: Path) -> None:
    if kind == "python":
        commands = [[sys.executable, "-c", text]]
    else:
        commands = [line.removeprefix("$ ").split() for line in text.splitlines() if line.startswith("$ ")]
        assert commands
    for command in commands:
        done = subprocess.run(command, cwd=tmp_path, env=environment(), capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_the_example_learns_in_a_few_generations(tmp_path: Path) -> None:
    example = str(ROOT / "examples" / "cross_entropy.py")
    command = [sys.executable, example, "--generations", "4", "--candidates", "16", "--strides", "1"]
    done = subprocess.run(command, cwd=tmp_path, env=environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 6
    assert float(lines[-1].removeprefix("learned: ")) > float(lines[0].removeprefix("hand-tuned profile: "))


def test_there_are_blocks_of_both_kinds() -> None:
    kinds = [block.values[0] for block in BLOCKS]
    assert kinds.count("python") >= 4
    assert kinds.count("console") >= 3


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text("utf-8")):
        assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_readme_commands_are_the_ones_ci_runs() -> None:
    readme = (ROOT / "README.md").read_text("utf-8")
    assert "python3 scripts/env.py klute-sim gait\n" in readme
    test_command = "python3 scripts/env.py pytest"
    assert f"\n{test_command}\n" in readme
    assert test_command in (ROOT / ".ci" / "run").read_text("utf-8")


def test_the_documented_table_of_device_keys_is_complete() -> None:
    from klute_sim.device.schema import document

    page = (ROOT / "docs" / "devices.md").read_text("utf-8")
    sections = (document.MuscleSection, document.DamperSection, document.TendonSection, document.SupplySection)
    for section in (*sections, document.MountingSection, document.PublishedMeasurement):
        for key in section.model_fields:
            assert f"`{key}`" in page, key


def test_the_documented_reference_columns_are_complete() -> None:
    from klute_sim.gait import reference

    page = (ROOT / "docs" / "gait.md").read_text("utf-8")
    for column in (reference.PHASE_COLUMN, *reference.REQUIRED_COLUMNS, *reference.DEVIATION_COLUMNS):
        assert f"`{column}`" in page, column


def test_the_documented_channels_are_complete() -> None:
    from klute_sim import bench
    from klute_sim.device.energy import ledger
    from klute_sim.gait.rig import measurements, rig

    page = (ROOT / "docs" / "recordings.md").read_text("utf-8")
    named = [*(name for name, *_ in (*rig.REFERENCE_CHANNELS, *rig.REFERENCE_DEVIATIONS))]
    for channel in (*measurements.MEASURED_COLUMNS, *bench.CHANNELS, *ledger.COLUMN_HEADINGS, *named):
        assert f"`{channel.split(' ')[0]}`" in page, channel
