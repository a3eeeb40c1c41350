"""Colours of the pages: enough contrast in light and dark mode (WCAG AA), and no colour that ignores the mode."""

import re
from importlib import resources

import pytest

TEMPLATES = resources.files("klute_sim.report") / "templates"
TEXT_COLOURS = ("text", "muted", "link", "good", "bad", "doubt")
MIN_CONTRAST = 4.5
"""Contrast of normal text by WCAG 2.2, level AA."""


def read_colours() -> dict[str, dict[str, str]]:
    """Return mode -> name -> colour; the dark mode changes some of the light one."""
    light, dark = re.findall(r":root \{(.*?)\}", (TEMPLATES / "page.html").read_text("utf-8"), re.DOTALL)
    colours = {mode: dict(re.findall(r"--(\w+): (#\w+)", rule)) for mode, rule in (("light", light), ("dark", dark))}
    return {"light": colours["light"], "dark": colours["light"] | colours["dark"]}


def compute_luminance(colour: str) -> float:
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    channels = [int(digits[k : k + 2], 16) / 255.0 for k in (0, 2, 4)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("mode", ["light", "dark"])
@pytest.mark.parametrize("background", ["back", "panel"])
def test_text_has_enough_contrast(mode: str, background: str) -> None:
    colours = read_colours()[mode]
    behind = compute_luminance(colours[background])
    for name in TEXT_COLOURS:
        low, high = sorted((compute_luminance(colours[name]), behind))
        assert (high + 0.05) / (low + 0.05) >= MIN_CONTRAST, name


def test_pages_take_every_colour_from_the_mode() -> None:
    for template in TEMPLATES.iterdir():
        style = re.sub(r":root \{.*?\}", "", template.read_text("utf-8"), flags=re.DOTALL)
        assert re.findall(r"#[0-9a-f]{3,6}\b(?=[; ])", style) == [], template.name
