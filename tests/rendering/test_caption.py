"""Captions in images of a video."""

import numpy as np
import pytest

from klute_sim.rendering import caption
from klute_sim.rendering.caption import draw_caption, format_caption

TEXT = format_caption(time=1.234, gait_cycle=7.4, pressure=2.0)


def read(text: str) -> str:
    """Return ``text`` with ordinary spaces."""
    return " ".join(text.replace(caption.FIGURE_SPACE, " ").split())


def test_caption_has_units_and_says_what_is_estimated_or_unknown() -> None:
    assert read(TEXT) == "gait cycle 7 % time 1.23 s pressure 2.00 bar"
    assert read(format_caption(time=12.0, name="cycle-1")) == "cycle-1 time 12.00 s"
    assert (
        read(format_caption(time=0.0, gait_cycle=99.6, is_estimate=True)) == "gait cycle 100 % (estimated) time 0.00 s"
    )
    assert read(format_caption(time=0.0, gait_cycle=np.nan)) == "gait cycle – % time 0.00 s"


def test_captions_are_equally_long_so_that_they_do_not_jump() -> None:
    texts = [format_caption(time=t, gait_cycle=c, pressure=1.5) for t, c in ((0.1, np.nan), (0.1, 3.0), (12.3, 100.0))]
    widths = [caption._load_font(20).getlength(text.replace(caption.UNKNOWN, "0")) for text in texts]
    assert np.ptp(widths) < 0.5


@pytest.mark.parametrize("size", [(480, 640), (240, 320), (1080, 1920)])
@pytest.mark.parametrize("level", [0, 128, 240])
def test_caption_is_dark_on_light_in_the_upper_left_only(size: tuple[int, int], level: int) -> None:
    image = np.full((*size, 3), level, dtype=np.uint8)
    captioned = draw_caption(image, TEXT)
    changed = np.argwhere((captioned != level).any(axis=-1))
    assert changed.max(axis=0)[0] < size[0] / 10
    assert changed.min() == 0
    panel = captioned[: changed[:, 0].max() + 1, : changed[:, 1].max() + 1]
    assert panel.min() < 60
    assert np.median(panel) >= 200
    assert (image == level).all()


def test_long_captions_shrink_and_small_images_have_none() -> None:
    image = np.full((120, 320, 3), 90, dtype=np.uint8)
    long_text = format_caption(time=1.0, name="2bar_0.96_concentric_300mm_per_s")
    assert caption._measure_panel(long_text, 15)[0] > 320
    assert (draw_caption(np.repeat(image, 3, axis=0), long_text)[0] != 90).any(axis=-1).sum() <= 320
    small = image[:32, :48]
    assert draw_caption(small, TEXT) is small
