"""The site: every page is in it, nothing in it leads nowhere, and its pictures are of this program."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from tests.load_script import script

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as it is put on the web; a warning of Sphinx is an error."""
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]
    command += ["-d", str(out / "kept"), str(ROOT / "docs"), str(out / "html")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out / "html"


def test_every_page_is_there(site: Path) -> None:
    pages = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    assert len(pages) > 50
    for page in pages:
        assert (site / page).is_file(), page


def test_the_documented_functions_are_there(site: Path) -> None:
    laws = (site / "api" / "laws.html").read_text("utf-8")
    assert 'id="klute_sim.laws.mckibben.gas_force"' in laws
    environment = (site / "api" / "control.html").read_text("utf-8")
    assert "<th" in environment  # Gymnasium's tables are tables
    assert "|---" not in environment


def test_a_page_that_leads_nowhere_is_refused(tmp_path: Path) -> None:
    (tmp_path / "index.md").write_text("# Here\n\n[there](there.md)\n", "utf-8")
    (tmp_path / "conf.py").write_text((ROOT / "docs" / "conf.py").read_text("utf-8"), "utf-8")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html", str(tmp_path), str(tmp_path / "html")]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "LC_ALL": "C"}, check=False)
    assert done.returncode != 0
    assert "there.md" in done.stderr


@pytest.mark.parametrize("name", ["gait", "diagnose"])
def test_the_pictures_of_the_workbench_are_of_this_workbench(name: str) -> None:
    view_pictures = script("view_pictures")
    assert name in view_pictures.SHOWN
    with Image.open(ROOT / "docs" / "pictures" / f"view-{name}.png") as picture:
        drawn = picture.text[view_pictures.KEY]
    assert drawn == view_pictures.digest(), "run `python scripts/view_pictures.py docs/pictures`, and look at them"


def test_every_script_of_pictures_is_in_the_one_that_makes_all() -> None:
    text = (ROOT / "scripts" / "pictures.py").read_text("utf-8")
    told = {name for name in ("house.py", "view_pictures.py", "effect_pages.py") if f'"{name}"' in text}
    drawing = {path.name for path in (ROOT / "scripts").glob("*.py") if "docs/" in path.read_text("utf-8")}
    assert told == drawing - {"pictures.py"}


@pytest.mark.long
def test_links_to_elsewhere_lead_somewhere(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "linkcheck", str(ROOT / "docs"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "NewConnectionError" in (tmp_path / "output.txt").read_text("utf-8"):
        pytest.skip("no network")
    assert done.returncode == 0, done.stderr
