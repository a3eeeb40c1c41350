"""Tests of the documentation site: all pages are included, links resolve, and figures are current."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from tests.load_script import load_script

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the built site; warnings of Sphinx are errors."""
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]
    command += ["-d", str(out / "kept"), str(ROOT / "docs"), str(out / "html")]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    return out / "html"


@pytest.mark.slow
def test_site_contains_every_page(site: Path) -> None:
    pages = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    assert len(pages) > 50
    for page in pages:
        assert (site / page).is_file(), page


@pytest.mark.slow
def test_site_contains_documented_functions(site: Path) -> None:
    laws = (site / "api" / "laws.html").read_text("utf-8")
    assert 'id="klute_sim.laws.mckibben.gas_force"' in laws
    environment = (site / "api" / "control.html").read_text("utf-8")
    assert "<th" in environment  # Gymnasium's tables are tables
    assert "|---" not in environment


@pytest.mark.slow
def test_signatures_contain_python_only(site: Path) -> None:
    for page in (site / "api").glob("*.html"):
        text = page.read_text("utf-8")
        assert "~klute_sim" not in text, page.name
        assert re.findall(r"&lt;(?:function|lambda|factory)", text) == [], page.name


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_tutorial_has_the_outputs_and_figures_of_its_notebook(site: Path, notebook: Path) -> None:
    cells = json.loads(notebook.read_text("utf-8"))["cells"]
    page = (site / "tutorials" / f"{notebook.stem}.html").read_text("utf-8")
    assert page.count('class="cell docutils') == sum(cell["cell_type"] == "code" for cell in cells)
    assert "<table" in page
    assert "&lt;Figure" not in page
    descriptions = {cell["metadata"]["mystnb"]["image"]["alt"] for cell in cells if "plot()" in "".join(cell["source"])}
    figures = re.findall(r'<img alt="([^"]+)" src="\.\./(_images/[^"]+)"', page)
    assert {text for text, _ in figures} == descriptions
    assert len(figures) >= 1
    for _, path in figures:
        with Image.open(site / path) as figure:
            assert figure.width > 500
            assert len(figure.convert("L").getcolors()) > 10


@pytest.mark.slow
def test_links_to_notebooks_lead_to_the_tutorials(site: Path) -> None:
    page = (site / "guides" / "newcomer.html").read_text("utf-8")
    for notebook in NOTEBOOKS:
        assert f'href="../tutorials/{notebook.stem}.html"' in page


@pytest.mark.slow
def test_broken_link_is_an_error(tmp_path: Path) -> None:
    completed = build_small_site(tmp_path, "# Here\n\n[there](there.md)\n")
    assert completed.returncode != 0
    assert "there.md" in completed.stderr


@pytest.mark.slow
@pytest.mark.parametrize("source", ["1 + 1", "1 / 0"])
def test_failing_cell_of_a_notebook_is_an_error(tmp_path: Path, source: str) -> None:
    cells = [
        {"cell_type": "markdown", "id": "a", "metadata": {}, "source": "# Sums"},
        {"cell_type": "code", "id": "b", "metadata": {}, "source": source, "outputs": [], "execution_count": None},
    ]
    notebook = {"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 5}
    (tmp_path / "examples" / "notebooks").mkdir(parents=True)
    (tmp_path / "examples" / "notebooks" / "sums.ipynb").write_text(json.dumps(notebook), "utf-8")
    index = "# Here\n\n[Sums](../examples/notebooks/sums.ipynb)\n\n```{toctree}\ntutorials/sums\n```\n"
    completed = build_small_site(tmp_path, index)
    assert (completed.returncode == 0) == (source == "1 + 1"), completed.stderr
    if source == "1 / 0":
        assert "sums.ipynb" in completed.stderr
    else:
        assert 'href="tutorials/sums.html"' in (tmp_path / "html" / "index.html").read_text("utf-8")


def build_small_site(folder: Path, index: str) -> subprocess.CompletedProcess[str]:
    """Build a site with the page ``index`` and the configuration of the documentation in ``folder``."""
    docs = folder / "docs"
    docs.mkdir()
    (docs / "index.md").write_text(index, "utf-8")
    for name in ("conf.py", "formulas.py"):
        shutil.copy(ROOT / "docs" / name, docs)
    shutil.copytree(ROOT / "docs" / "static", docs / "static")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html", str(docs), str(folder / "html")]
    return subprocess.run(command, capture_output=True, text=True, env={**os.environ, "LC_ALL": "C"}, check=False)


@pytest.mark.parametrize("name", load_script("command_pictures").PICTURES)
def test_pictures_of_the_commands_are_current(name: str) -> None:
    command_pictures = load_script("command_pictures")
    drawn = command_pictures.read_digest(ROOT / "docs" / "pictures" / f"{name}.png")
    hint = f"run `python scripts/command_pictures.py docs/pictures --only {name}`"
    assert drawn == command_pictures.compute_digest(name), hint


def test_every_picture_is_on_a_page() -> None:
    text = "".join(path.read_text("utf-8") for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
    for path in (ROOT / "docs" / "pictures").iterdir():
        assert f"pictures/{path.name})" in text, path.name


def test_picture_depends_on_its_commands_and_on_the_code_that_draws_it(monkeypatch: pytest.MonkeyPatch) -> None:
    command_pictures = load_script("command_pictures")
    picture = command_pictures.PICTURES["gait"]
    digest = command_pictures.compute_digest("gait")
    for changed in (picture._replace(commands=("gait",)), picture._replace(sources=("report/walk/figure.py",))):
        monkeypatch.setitem(command_pictures.PICTURES, "gait", changed)
        assert command_pictures.compute_digest("gait") != digest


@pytest.mark.parametrize("name", ["first-walk.webp", "first-diagnosis.webp"])
def test_first_screen_begins_with_current_animations(name: str) -> None:
    first_screen = load_script("first_screen")
    path = ROOT / "docs" / "pictures" / name
    assert path.stat().st_size < 1_500_000
    assert first_screen.read_digest(path) == first_screen.compute_digest(), (
        "run `python scripts/first_screen.py docs/pictures`"
    )
    with Image.open(path) as animation:
        assert animation.n_frames > 20
        assert animation.info["loop"] == 0
        assert animation.width <= 1000
    for page, folder in (("README.md", "docs/pictures"), ("docs/index.md", "pictures")):
        beginning = (ROOT / page).read_text("utf-8").split("```sh")[0]
        assert f"]({folder}/{name})" in beginning, page
        assert re.search(rf"!\[[^\]]{{40,}}\]\({folder}/{name}\)", beginning), "it needs a description"


def test_picture_of_the_environments_is_current() -> None:
    first_screen = load_script("first_screen")
    path = ROOT / "docs" / "pictures" / first_screen.ENVIRONMENTS
    assert first_screen.read_digest(path) == first_screen.compute_digest(), (
        "run `python scripts/first_screen.py docs/pictures`"
    )
    assert f"](pictures/{path.name})" in (ROOT / "docs" / "environment.md").read_text("utf-8")


def test_every_picture_has_a_description() -> None:
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        for text in re.findall(r"!\[([^\]]*)\]\(", page.read_text("utf-8")):
            assert len(text) > 10, f"{page.name}: '{text}'"


def test_pictures_are_small_in_total() -> None:
    sizes = [path.stat().st_size for path in (ROOT / "docs").rglob("*") if path.suffix in (".png", ".webp", ".gif")]
    assert sum(sizes) < 15_000_000


def test_pictures_script_runs_every_figure_script() -> None:
    text = (ROOT / "scripts" / "pictures.py").read_text("utf-8")
    listed = {
        name
        for name in ("architecture.py", "command_pictures.py", "first_screen.py", "effect_pages.py")
        if f'"{name}"' in text
    }
    drawing = {path.name for path in (ROOT / "scripts").glob("*.py") if "docs/" in path.read_text("utf-8")}
    assert listed == drawing - {"pictures.py"}


@pytest.mark.long
def test_external_links_resolve(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "linkcheck", str(ROOT / "docs"), str(tmp_path)]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    if "NewConnectionError" in (tmp_path / "output.txt").read_text("utf-8"):
        pytest.skip("no network")
    assert completed.returncode == 0, completed.stderr
