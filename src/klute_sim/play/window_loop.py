"""A session in a window, steered with keys."""

import queue
import time

from klute_sim.errors import InputError
from klute_sim.play.session import PlaySession
from klute_sim.rendering.window import ViewerWindow

FEATURE = "klute-sim play"
"""What needs the window, in errors."""
PAUSE_INTERVAL = 0.02
"""Time between two looks at the keys while the simulation is paused [s]."""


def play_in_window(session: PlaySession, camera: str) -> None:
    """Run ``session`` in a window on ``camera`` until the user closes it.

    Raises MissingExtraError without the optional extra 'rendering', and RenderingError without a display.
    """
    keys: queue.SimpleQueue[int] = queue.SimpleQueue()
    note = ""
    window = _open_window(session, camera, keys)
    try:
        model = session.model
        while window.is_open:
            while not keys.empty():
                note = _press(session, keys.get())
            if session.model is not model:  # another speed or slope is another model, and a window shows one model
                window.close()
                window, model = _open_window(session, camera, keys), session.model
            if session.advance():
                note = "the walk ended and started again"
            if session.controls.is_paused:
                time.sleep(PAUSE_INTERVAL)
            window.show(session.controls.describe() + (f"\n\n{note}" if note else ""))
    finally:
        window.close()


def _open_window(session: PlaySession, camera: str, keys: "queue.SimpleQueue[int]") -> ViewerWindow:
    return ViewerWindow(session.model, session.data, camera, FEATURE, keys.put)


def _press(session: PlaySession, key: int) -> str:
    """Hand a key to ``session``; return why it has no effect, or ''."""
    try:
        session.set_controls(session.controls.press(key))
    except InputError as error:
        return str(error)
    return ""
