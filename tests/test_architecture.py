"""The house: imports go down its floors, files stay small, style and types are clean."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from tests.load_script import script

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "klute_sim"
FILES = sorted(SOURCE.rglob("*.py"))


house = script("house")


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(SOURCE)))
def test_imports_go_down(file: Path) -> None:
    home = "cli" if file.name == "__main__.py" else file.relative_to(SOURCE).parts[0]
    floors, imported = house.FLOORS, house.imported(file)
    if home not in floors:
        assert not imported
        return
    for other in imported:
        assert other == home or floors[other] < floors[home], f"{home} imports {other}"


def test_the_picture_of_the_house_is_of_this_house() -> None:
    with Image.open(ROOT / "docs" / "pictures" / "house.png") as picture:
        drawn = json.loads(picture.text[house.KEY])
    assert drawn == house.house(), "run `python scripts/house.py docs/pictures/house.png`"


def test_the_picture_leaves_out_only_what_follows() -> None:
    graph = house.house()

    def reached(name: str) -> set[str]:
        return set(graph[name]).union(*(reached(below) for below in graph[name]))

    for name in house.FLOORS:
        direct = set().union(*(house.imported(file) for file in (SOURCE / name).rglob("*.py"))) - {name}
        assert direct <= reached(name), name
        assert set(graph[name]) <= direct, name


def test_the_documented_floors_are_the_ones_that_are_kept() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    told = {name: int(floor) for floor, name in re.findall(r"^\| (\d+) \| `(\w+)/`", page, re.MULTILINE)}
    assert told == house.FLOORS


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
