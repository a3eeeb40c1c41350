"""The house: imports go down its floors, files stay small, style and types are clean."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "klute_sim"
FLOORS = {
    **{"laws": 1, "effects": 2, "device": 3, "plant": 4, "recording": 4, "dataset": 5, "formats": 5, "control": 5},
    **{"rigs": 6, "compare": 6, "diagnose": 7, "envs": 7, "design": 7, "motion": 7, "reproduce": 8, "learn": 8},
    **{"report": 9, "sweep": 10, "tuning": 11, "baselines": 11, "cli": 12},
}
EVERYBODYS = {"errors", "units", "provenance", "registration", ""}
FILES = sorted(SOURCE.rglob("*.py"))


def imported(file: Path) -> set[str]:
    """Floors of klute_sim that ``file`` imports from."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        names = [node.module] if isinstance(node, ast.ImportFrom) else []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            if name and name.split(".")[0] == "klute_sim":
                found.add(([*name.split("."), ""])[1])
    return found - EVERYBODYS


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(SOURCE)))
def test_imports_go_down(file: Path) -> None:
    home = "cli" if file.name == "__main__.py" else file.relative_to(SOURCE).parts[0]
    if home not in FLOORS:
        assert not imported(file)
        return
    for other in imported(file):
        assert other == home or FLOORS[other] < FLOORS[home], f"{home} imports {other}"


@pytest.mark.parametrize("file", sorted((SOURCE / "laws").glob("*.py")), ids=lambda f: f.name)
def test_laws_know_only_scalars(file: Path) -> None:
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            assert {alias.name for alias in node.names} <= {"math"}
        if isinstance(node, ast.ImportFrom):
            assert (node.module or "").split(".")[0] in {"typing", "collections", "klute_sim"}


def test_files_fit_on_a_few_screens() -> None:
    for file in FILES:
        assert len(file.read_text("utf-8").splitlines()) <= 400, file


@pytest.mark.parametrize(
    "command",
    [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"]],
    ids=" ".join,
)
def test_style_and_types(command: list[str]) -> None:
    if command == ["mypy"] and Path(sys.prefix).name == ".venv-floor":
        pytest.skip("the oldest NumPy and SciPy annotate less; types are checked on the locked versions")
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
