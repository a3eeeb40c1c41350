"""Figures of results are pictures in a notebook."""

import io
import re
from pathlib import Path

import pytest
from PIL import Image

import klute_sim
from klute_sim.report.notebook_figure import NOTEBOOK_DPI, NotebookFigure
from klute_sim.report.style import FIGURE_WIDTH_INCHES, use_style

PACKAGE = Path(klute_sim.__file__).parent


def test_figure_is_a_picture_of_its_size_in_a_notebook() -> None:
    with use_style() as create_figure:
        figure = create_figure(2.0)
    assert isinstance(figure, NotebookFigure)
    figure.subplots().plot([0.0, 1.0], [0.0, 1.0])
    picture = Image.open(io.BytesIO(figure._repr_png_()))
    assert picture.size == (FIGURE_WIDTH_INCHES * NOTEBOOK_DPI, 2.0 * NOTEBOOK_DPI)
    assert len(picture.convert("L").getcolors()) > 10


@pytest.mark.parametrize("folder", ["api", "report"])
def test_no_result_makes_a_figure_that_a_notebook_shows_as_text(folder: str) -> None:
    calls = {
        path.relative_to(PACKAGE).as_posix(): call
        for path in (PACKAGE / folder).rglob("*.py")
        for call in re.findall(r"(?<!Notebook)\bFigure\(|pyplot", path.read_text("utf-8"))
    }
    calls.pop("report/notebook_figure.py", None)
    assert calls == {}
