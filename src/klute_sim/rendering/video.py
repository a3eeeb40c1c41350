"""Videos from images: GIF and WebP with Pillow, MP4 (H.264) with imageio-ffmpeg of the optional extra 'video'."""

import importlib.util
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from klute_sim.errors import InputError, MissingExtraError

ANIMATION_SUFFIXES = (".gif", ".webp")
"""Endings of looping animations."""
VIDEO_SUFFIXES = (*ANIMATION_SUFFIXES, ".mp4")
"""Endings of all videos."""
FRAME_RATE = 25.0
"""Frames per second of the videos of simulations."""
MAX_SECONDS = 600.0
"""Longest video of a simulation [s]."""
N_COLOURS = 256
"""Number of colours of a GIF."""
COLOUR_MASK = np.uint8(0xF8)
"""Bits of red, green and blue by which colours are distinguished when those of a GIF are chosen."""
WEBP_QUALITY = 70
"""Quality of a WebP animation, of 100."""


def check_video_path(path: Path) -> None:
    """Raise InputError when the ending of ``path`` is no video, and MissingExtraError when its encoder is missing."""
    if path.suffix.lower() not in VIDEO_SUFFIXES:
        raise InputError(f"{path} is no video file; allowed endings: {', '.join(VIDEO_SUFFIXES)}")
    if path.suffix.lower() == ".mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise MissingExtraError("an MP4 video (a GIF or WebP does not)", "video")


def write_video(path: Path, images: Iterable[NDArray[np.uint8]], frame_rate: float) -> None:
    """Write ``images`` (height, width, 3) as a video with ``frame_rate`` [1/s]; its kind follows from the ending.

    Animations loop. An MP4 needs an even number of pixels in each direction, so that an odd last row or column is left
    out. Raises as :func:`check_video_path` does.
    """
    check_video_path(path)
    if path.suffix.lower() == ".mp4":
        _write_mp4(path, images, frame_rate)
        return
    frames = [Image.fromarray(image) for image in images]
    duration_ms = round(1000.0 / frame_rate)
    if path.suffix.lower() == ".webp":
        options = {"quality": WEBP_QUALITY, "method": 4}
        frames[0].save(path, None, save_all=True, append_images=frames[1:], duration=duration_ms, loop=0, **options)
        return
    # One palette for all frames: colours do not flicker, and unchanged pixels cost nothing.
    palette = _choose_palette(frames)
    reduced = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    first, *others = reduced
    first.save(path, None, save_all=True, append_images=others, duration=duration_ms, loop=0, disposal=1)


def _choose_palette(frames: Sequence[Image.Image]) -> Image.Image:
    """Return an image whose palette suits all ``frames``.

    Every colour counts once, however many pixels have it: a muscle that turns green in a few frames stays green.
    """
    colours = np.unique(
        np.concatenate([np.unique(np.asarray(frame).reshape(-1, 3) & COLOUR_MASK, axis=0) for frame in frames]), axis=0
    )
    return Image.fromarray(colours[np.newaxis]).quantize(N_COLOURS, Image.Quantize.MEDIANCUT)


def _write_mp4(path: Path, images: Iterable[NDArray[np.uint8]], frame_rate: float) -> None:
    import imageio_ffmpeg

    writer = None
    for image in images:
        even = np.ascontiguousarray(image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2])
        if writer is None:
            size = (even.shape[1], even.shape[0])
            writer = imageio_ffmpeg.write_frames(str(path), size, fps=frame_rate, macro_block_size=2)
            writer.send(None)
        writer.send(even)
    if writer is not None:
        writer.close()
