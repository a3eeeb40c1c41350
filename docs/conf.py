"""How the site is made: ``python -m sphinx -W --keep-going -b html docs runs/site``."""

import filecmp
import re
import shutil
import sys
from itertools import groupby
from pathlib import Path
from typing import Any

from klute_sim import __version__

project = "klute-sim"
author = "The klute-sim authors"
project_copyright = author
release = version = __version__
sys.path.insert(0, str(Path(__file__).parent))  # for the extension of this folder
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "formulas"]
myst_enable_extensions = ["dollarmath"]
nb_execution_mode = "force"
nb_execution_in_temp = True  # notebooks write files
nb_execution_raise_on_error = True
nb_execution_timeout = 900
nb_merge_streams = True
html_math_renderer = "formulas"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_theme = "furo"
html_title = f"klute-sim {release}"
html_show_sphinx = False
myst_heading_anchors = 4
autodoc_member_order = "bysource"
autodoc_preserve_defaults = (
    True  # the repr of a default such as a lambda is not Python, and signatures would stay unparsed
)
PAGES_OF_EFFECTS = "effects/README"
NOTEBOOKS_FOLDER = "examples/notebooks"
TUTORIALS_FOLDER = "tutorials"


def _copy_notebooks(app: Any) -> None:
    """Copy the notebooks of the repository to the pages; a copy keeps its time, so that only a new one runs again."""
    tutorials = Path(app.srcdir) / TUTORIALS_FOLDER
    tutorials.mkdir(exist_ok=True)
    notebooks = {path.name: path for path in (Path(app.srcdir).parent / NOTEBOOKS_FOLDER).glob("*.ipynb")}
    for copy in tutorials.glob("*.ipynb"):
        if copy.name not in notebooks:
            copy.unlink()
    for name, notebook in notebooks.items():
        if not ((tutorials / name).is_file() and filecmp.cmp(notebook, tutorials / name, shallow=False)):
            shutil.copy2(notebook, tutorials / name)


def _link_tutorials(app: Any, name: str, source: list[str]) -> None:
    """Let links to notebooks, which work where the pages are read as files, lead to their executed copies."""
    source[0] = re.sub(rf"\]\((?:\.\./)+{NOTEBOOKS_FOLDER}/", f"](/{TUTORIALS_FOLDER}/", source[0])


def _list_their_pages(app: Any, name: str, source: list[str]) -> None:
    """Let the catalogue's page, which a script writes to be read anywhere, be the parent of its effects' pages."""
    if name == PAGES_OF_EFFECTS:
        source[0] += "\n```{toctree}\n:hidden:\n:glob:\n\n*\n```\n"


def _tables(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Turn the Markdown tables of the environments' docstrings, Gymnasium's custom, into Sphinx's own."""
    written: list[str] = []
    for in_table, group in groupby(lines, lambda line: line.lstrip().startswith("|")):
        block = list(group)
        if not in_table:
            written += block
            continue
        written += ["", ".. list-table::", "   :header-rows: 1", ""]
        for line in block:
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            if all(re.fullmatch(":?-+:?", cell) for cell in cells):
                continue
            written += [f"   {'*' if k == 0 else ' '} - {cell}" for k, cell in enumerate(cells)]
        written.append("")
    lines[:] = written


def _clean_signature(
    app: Any, what: str, name: str, thing: Any, options: Any, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """Replace defaults that are not Python, which leave a signature unparsed and show `~package.module.Name`."""
    return signature and re.sub(r"<[^<>]*>", "...", signature), returns


def setup(app: Any) -> None:
    """Sphinx calls this."""
    app.connect("builder-inited", _copy_notebooks)
    app.connect("source-read", _link_tutorials)
    app.connect("source-read", _list_their_pages)
    app.connect("autodoc-process-docstring", _tables)
    app.connect("autodoc-process-signature", _clean_signature)
