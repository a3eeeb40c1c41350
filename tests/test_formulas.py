"""Formulas of the site: set as SVG in the colour of the text, with their source as description."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

DOCS = Path(__file__).parents[1] / "docs"
FORMULA = re.compile(r"\$\$(.+?)\$\$|(?<![\w$])\$([^$\n]+?)\$(?![\w$])", re.DOTALL)
CODE = re.compile(r"^```.*?^```|`[^`\n]+`", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def formulas() -> ModuleType:
    spec = importlib.util.spec_from_file_location("formulas", DOCS / "formulas.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_formula_has_the_colour_of_the_text_and_a_description(formulas: ModuleType) -> None:
    svg = formulas.render_formula(r"a < \dfrac{b}{c}")
    assert svg.startswith("<svg")
    assert 'aria-label="a &lt; \\dfrac{b}{c}"' in svg
    assert 'fill="currentColor"' in svg
    assert "vertical-align: -" in svg
    assert "#" not in svg
    assert re.fullmatch(r"[MLQCZ\d. -]+", svg.split(' d="')[1].split('"')[0])


def test_higher_formulas_take_more_room(formulas: ModuleType) -> None:
    heights = [
        float(re.search(r"height: ([\d.]+)em", formulas.render_formula(s))[1])  # type: ignore[index]
        for s in ("x", r"\sqrt{x}", r"\dfrac{x}{y}")
    ]
    assert heights == sorted(heights)
    assert heights[0] < 0.7 < heights[2] < 3.0


@pytest.mark.slow
def test_every_formula_of_the_pages_can_be_set(formulas: ModuleType) -> None:
    pages = [page for page in DOCS.rglob("*.md") if "$" in page.read_text("utf-8")]
    sources = {
        block or inline for page in pages for block, inline in FORMULA.findall(CODE.sub("", page.read_text("utf-8")))
    }
    assert len(sources) >= 100
    for source in sorted(sources):
        width, height, _ = formulas.measure_formula(source)
        assert width > 0.0 < height


def test_a_formula_with_a_mistake_is_an_error(formulas: ModuleType) -> None:
    with pytest.raises(ValueError, match="unknown"):
        formulas.render_formula(r"\unknown{x}")
