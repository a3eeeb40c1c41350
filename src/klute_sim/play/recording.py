"""A session as a video, without a display."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from klute_sim.envs.base.task import CONTROL_INTERVAL
from klute_sim.errors import InputError
from klute_sim.play.session import PlaySession
from klute_sim.rendering.caption import draw_caption
from klute_sim.rendering.frames import FrameSource, RenderOptions
from klute_sim.rendering.video import FRAME_RATE, MAX_SECONDS, check_video_path, write_video
from klute_sim.types import ProgressCallback

STEPS_PER_FRAME = round(1.0 / (FRAME_RATE * CONTROL_INTERVAL))
"""Steps of 10 ms for a frame."""


def record_video(
    session: PlaySession,
    path: Path,
    *,
    seconds: float,
    camera: str,
    size: tuple[int, int],
    progress: ProgressCallback = lambda fraction, stage: None,
) -> None:
    """Write ``seconds`` of ``session``, seen from ``camera``, to ``path`` (.gif, .webp or .mp4) in real time.

    Each image has a caption: phase of the gait cycle, time and pressure. ``size`` is width and height [pixels]. Raises
    InputError when a value is out of range, MissingExtraError and RenderingError when a library is missing.
    """
    if not 0.0 < seconds <= MAX_SECONDS:
        raise InputError(f"a video of {seconds:g} s; allowed: above 0, up to {MAX_SECONDS:g} s")
    check_video_path(path)
    options = RenderOptions(render_mode="rgb_array", width=size[0], height=size[1], camera=camera)
    source = FrameSource(options)
    n_frames = max(1, round(seconds * FRAME_RATE))

    def draw() -> Iterator[NDArray[np.uint8]]:
        for number in range(n_frames):
            for _ in range(STEPS_PER_FRAME):
                session.advance()
            progress(number / n_frames, "drawing")
            image = source.draw(session.model, session.data)
            assert image is not None  # the mode rgb_array always has an image
            yield draw_caption(np.asarray(image, dtype=np.uint8), session.describe_state())

    try:
        write_video(path, draw(), FRAME_RATE)
    finally:
        source.close()
    progress(1.0, "drawing")
