"""Tests of the architecture: imports follow the layers, laws are scalar, and files stay small."""

import ast
import json
import re
from pathlib import Path

import pytest
from PIL import Image

from tests.load_script import load_script

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "klute_sim"
FILES = sorted(SOURCE.rglob("*.py"))
MAX_LINES = 400
"""Largest number of lines of a file."""

architecture = load_script("architecture")


def test_every_package_has_a_layer() -> None:
    assert {file.parent.name for file in SOURCE.glob("*/__init__.py")} == set(architecture.LAYERS)


def test_packages_import_only_lower_layers() -> None:
    layers = architecture.LAYERS
    upward = [
        f"{file.relative_to(SOURCE)} imports {imported}"
        for file in FILES
        for package in file.relative_to(SOURCE).parts[:1]
        if package in layers
        for imported in architecture.find_imports(file)
        if imported != package and layers.get(imported, 0) >= layers[package]
    ]
    assert upward == []


def test_common_modules_import_no_package() -> None:
    for name in architecture.COMMON_MODULES - {""}:
        assert architecture.find_imports(SOURCE / f"{name}.py") == set(), name


def test_figure_shows_current_architecture() -> None:
    with Image.open(ROOT / "docs" / "pictures" / "architecture.png") as figure:
        drawn = json.loads(figure.text[architecture.METADATA_KEY])
    command = "python scripts/architecture.py docs/pictures/architecture.png"
    assert drawn == architecture.build_import_graph(), f"run `{command}`"


@pytest.mark.slow
def test_graph_leaves_out_only_implied_imports() -> None:
    graph = architecture.build_import_graph()

    def reachable(name: str) -> set[str]:
        return set(graph[name]).union(*(reachable(lower) for lower in graph[name]))

    for name in architecture.LAYERS:
        imports = architecture.find_package_imports(name)
        assert imports <= reachable(name), name
        assert set(graph[name]) <= imports, name


def test_documented_layers_match_code() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    documented = {name: int(layer) for layer, name in re.findall(r"^\| (\d+) \| `(\w+)/`", page, re.MULTILINE)}
    assert documented == architecture.LAYERS


@pytest.mark.parametrize("file", sorted((SOURCE / "laws").glob("*.py")), ids=lambda f: f.name)
def test_laws_are_scalar_functions(file: Path) -> None:
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            assert {alias.name for alias in node.names} <= {"math"}
        if isinstance(node, ast.ImportFrom):
            assert (node.module or "").split(".")[0] in {"typing", "collections", "klute_sim"}


def test_files_are_small() -> None:
    assert [str(file) for file in FILES if len(file.read_text("utf-8").splitlines()) > MAX_LINES] == []
