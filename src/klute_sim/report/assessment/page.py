"""Page of an assessment: one self-contained HTML file that works offline."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from klute_sim.provenance import collect_versions
from klute_sim.recording.atomic_file import write_atomically
from klute_sim.report.html import render_template
from klute_sim.report.run_page import PAGE_FILE, encode_picture, list_files

TEMPLATE = "assessment.html"


def write_page(context: Mapping[str, Any], pictures: Sequence[str], folder: Path) -> None:
    """Write the page with the texts ``context`` into ``folder``; names in it are escaped.

    ``pictures`` are names of PNG files of the folder in the order of the persons; an empty one is left out.
    """
    images = [encode_picture(folder / name) if name else "" for name in pictures]
    page = render_template(TEMPLATE, **context, images=images, files=list_files(folder), versions=collect_versions())
    write_atomically(folder / PAGE_FILE, page)
