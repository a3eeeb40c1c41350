"""The Rerun viewer itself opens a recording without a display, and every view shows its data without complaint."""

import shutil
import socket
import sys
import time
from pathlib import Path
from typing import Any

import matplotlib.image
import pytest

from tests.command_line import run

pytestmark = pytest.mark.extras

LOADING_TIME_S = 60.0
"""Maximum time in which the viewer must have loaded the recording [s]."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("rerun")
    folder = tmp_path_factory.mktemp("gait")
    completed = run("gait", "--strides", "1", "--step", "1", "--out", "walk", cwd=folder)
    assert completed.returncode == 0, completed.stderr
    return folder / "walk" / "recording.rrd"


def find_free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])


def load_state(client: Any) -> Any:
    end = time.monotonic() + LOADING_TIME_S
    while (state := client.get_state()).loading or not state.views:
        assert time.monotonic() < end, "the viewer is still loading"
        time.sleep(0.2)
    return state


def test_viewer_shows_every_view_without_an_error(recording: Path, tmp_path: Path) -> None:
    from rerun.experimental import ViewerClient

    program = shutil.which("rerun", path=Path(sys.executable).parent)
    try:
        client = ViewerClient.spawn(headless=True, port=find_free_port(), executable_path=program)
    except (RuntimeError, ConnectionError) as error:  # it needs Vulkan, in software at least
        pytest.skip(f"the Rerun viewer does not start here ({error})")
    with client:
        client.open(str(recording))
        state = load_state(client)
        assert len(state.recordings) == 1
        assert len(state.views) > 5
        assert [report for view in state.views for report in view.reports] == []
        client.save_screenshot(str(tmp_path / "window.png"))
        errors = [entry for entry in client.get_logs() if entry.level.upper() == "ERROR"]
    assert errors == []
    window = matplotlib.image.imread(tmp_path / "window.png")
    assert len({tuple(colour) for row in window[::7, ::7, :3] for colour in row}) > 20
