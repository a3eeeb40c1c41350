"""Captions in the images of a video: phase of the gait cycle, time and pressure at a frame, with units."""

from functools import cache
from math import isfinite
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

FONT_FILE = "DejaVuSans.ttf"
"""Font of the captions, which comes with Matplotlib."""
LINES_PER_IMAGE = 24
"""Height of an image over the size of its caption."""
MIN_FONT_SIZE, MAX_FONT_SIZE = 9, 40
"""Smallest and largest size of a caption [pixels]; an image that has no room for the smallest has none."""
TEXT_COLOUR, PANEL_COLOUR, PANEL_OPACITY = (20, 20, 20), (255, 255, 255), 0.8
"""Colours of text and panel, RGB, and opacity of the panel, which keeps the text legible on every background."""
FIGURE_SPACE, UNKNOWN = "\u2007", "\u2013"
"""Space as wide as a digit, so that captions do not jump from frame to frame, and a dash for an unknown value."""


def format_caption(
    *, time: float, gait_cycle: float | None = None, is_estimate: bool = False, pressure: float = np.nan, name: str = ""
) -> str:
    """Return the caption at ``time`` [s], with the ``pressure`` [bar] of the device unless it is NaN.

    ``gait_cycle`` is its phase [%]; None: there is none; NaN: it is unknown. ``is_estimate``: it is estimated from the
    stride before. ``name`` is that of the trial.
    """
    parts = [name] if name else []
    if gait_cycle is not None:
        phase = f"{gait_cycle:.0f}" if isfinite(gait_cycle) else UNKNOWN
        parts.append(f"gait cycle {phase.rjust(3, FIGURE_SPACE)} %{' (estimated)' if is_estimate else ''}")
    parts.append(f"time {f'{time:.2f}'.rjust(5, FIGURE_SPACE)} s")
    if isfinite(pressure):
        parts.append(f"pressure {pressure:.2f} bar")
    return (3 * " ").join(parts)


def draw_caption(image: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    """Return ``image`` (height, width, 3) with ``text`` at its upper left; as it is if there is no room."""
    height, width = image.shape[:2]
    size = min(max(height // LINES_PER_IMAGE, MIN_FONT_SIZE), MAX_FONT_SIZE)
    while size >= MIN_FONT_SIZE and _measure_panel(text, size)[0] > width:
        size -= 1
    panel_width, panel_height = _measure_panel(text, size)
    if size < MIN_FONT_SIZE or panel_height > height:
        return image
    captioned = image.copy()
    panel = captioned[:panel_height, :panel_width]
    panel[:] = np.rint((1.0 - PANEL_OPACITY) * panel + PANEL_OPACITY * np.array(PANEL_COLOUR))
    picture = Image.fromarray(captioned)
    ImageDraw.Draw(picture).text(
        (0.5 * size, 0.5 * panel_height), text, fill=TEXT_COLOUR, font=_load_font(size), anchor="lm"
    )
    return np.asarray(picture)


def _measure_panel(text: str, size: int) -> tuple[int, int]:
    """Return width and height of the panel [pixels] with half a letter around the text."""
    return round(_load_font(size).getlength(text) + size), 2 * size


@cache
def _load_font(size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / FONT_FILE), size)
