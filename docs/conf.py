"""How the site is made: ``python -m sphinx -W --keep-going -b html docs runs/site``."""

import re
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
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "formulas"]
myst_enable_extensions = ["dollarmath"]
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
    app.connect("source-read", _list_their_pages)
    app.connect("autodoc-process-docstring", _tables)
    app.connect("autodoc-process-signature", _clean_signature)
