"""Sphinx extension: formulas as SVG from matplotlib's mathtext, without LaTeX and without a script from the network.

A formula has the colour and the size of the text around it, in light and dark mode, and its source as description.
"""

from html import escape
from typing import Any

from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextPath, text_to_path

UNITS_PER_EM = 100.0
"""Size of the font in the coordinates of the SVG."""
FONT = FontProperties(family="serif", size=UNITS_PER_EM, math_fontfamily="stix")
COMMANDS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C"}
"""Code of a path -> command of SVG."""
VERTICES_PER_COMMAND = {"M": 1, "L": 1, "Q": 2, "C": 3}


def _format_mathtext(source: str) -> str:
    return f"${' '.join(source.split())}$"


def measure_formula(source: str) -> tuple[float, float, float]:
    """Return width, height and depth below the line of the formula ``source`` in the coordinates of the SVG.

    Raises ValueError for a formula that mathtext cannot read.
    """
    width, height, depth, *_ = text_to_path.mathtext_parser.parse(_format_mathtext(source), text_to_path.DPI, FONT)
    return width, height, depth


def render_formula(source: str, *, is_block: bool = False) -> str:
    """Return the formula ``source`` (LaTeX as mathtext reads it) as an SVG element.

    Raises ValueError for a formula that mathtext cannot read.
    """
    width, height, depth = measure_formula(source)
    path = TextPath((0.0, 0.0), _format_mathtext(source), prop=FONT)
    ems = {name: f"{value / UNITS_PER_EM:.3f}em" for name, value in (("w", width), ("h", height), ("d", depth))}
    place = "" if is_block else f"; vertical-align: -{ems['d']}"
    return (
        f'<svg class="formula" role="img" aria-label="{escape(source.strip())}" fill="currentColor" '
        f'viewBox="0 {-(height - depth):.1f} {width:.1f} {height:.1f}" '
        f'style="width: {ems["w"]}; height: {ems["h"]}; max-width: 100%; overflow: visible{place}">'
        f'<path d="{_format_path(path)}"/></svg>'
    )


def _format_path(path: Any) -> str:
    """Return ``path`` as the data of an SVG path, y down."""
    parts, k = [], 0
    while k < len(path.codes):
        if path.codes[k] == Path.CLOSEPOLY:
            parts.append("Z")
            k += 1
            continue
        command = COMMANDS[path.codes[k]]
        points = path.vertices[k : k + VERTICES_PER_COMMAND[command]]
        parts.append(command + " ".join(f"{x:.1f} {-y:.1f}" for x, y in points))
        k += len(points)
    return "".join(parts)


def _visit_inline(writer: Any, node: Any) -> None:
    from docutils.nodes import SkipNode

    writer.body.append(render_formula(node.astext()))
    raise SkipNode


def _visit_block(writer: Any, node: Any) -> None:
    from docutils.nodes import SkipNode

    formula = render_formula(node.astext(), is_block=True)
    writer.body.append(f'<div class="math" style="overflow-x: auto; margin: 0.8em 0 0.8em 1.5em">{formula}</div>\n')
    raise SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Sphinx calls this."""
    app.add_html_math_renderer("formulas", (_visit_inline, None), (_visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
