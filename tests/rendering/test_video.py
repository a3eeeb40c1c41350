"""Videos from images."""

from pathlib import Path

import numpy as np
from PIL import Image

from klute_sim.rendering.video import write_video

GREEN = (20, 210, 40)


def test_gif_keeps_a_colour_that_few_pixels_have(tmp_path: Path) -> None:
    """A muscle that is green in one image of thirty stays green beside a sky of many shades."""
    shades = np.linspace(120, 250, 64)
    sky = np.stack(np.broadcast_arrays(shades[:, None], shades[None, :], 240.0), axis=-1).astype(np.uint8)
    images = [np.roll(sky, k, axis=0) for k in range(30)]
    images[17][30:34, 30:34] = GREEN
    write_video(tmp_path / "muscle.gif", images, 25.0)
    with Image.open(tmp_path / "muscle.gif") as animation:
        assert animation.n_frames == 30
        animation.seek(17)
        shown = np.asarray(animation.convert("RGB"))
    assert np.abs(shown[30:34, 30:34].astype(int) - GREEN).max() < 12
    assert np.abs(shown.astype(int) - images[17]).mean() < 12
