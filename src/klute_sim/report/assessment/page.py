"""Page of an assessment: one self-contained HTML file that works offline."""

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from klute_sim.provenance import collect_versions
from klute_sim.report.html import render_template

TEMPLATE = "assessment.html"


def write_page(context: Mapping[str, Any], pictures: Sequence[bytes], path: Path) -> None:
    """Write the page with the texts ``context`` to ``path``; names in it are escaped.

    ``pictures`` are PNG files in the order of the persons; an empty one is left out.
    """
    images = [base64.b64encode(picture).decode("ascii") for picture in pictures]
    path.write_text(render_template(TEMPLATE, **context, images=images, versions=collect_versions()), "utf-8")
