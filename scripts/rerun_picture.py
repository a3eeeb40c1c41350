"""Draw a rerun recording without a screen: one picture per view of its layout, and one of the whole.

    python scripts/rerun_picture.py runs/gait-001 pictures --time 2.7

Needs the extra 'rerun' and a Vulkan driver; without a graphics card a software one will do (on Debian and Ubuntu the
package mesa-vulkan-drivers).
"""

import argparse
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from klute_sim.report.view import LOOPBACK, free_ports, recording_of, viewer_program, without_statistics

from klute_sim.errors import KluteSimError


def draw(recording: Path, folder: Path, seconds: float) -> list[Path]:
    """Pictures of ``recording`` at ``seconds`` on its timeline, in ``folder``; raises RuntimeError without a viewer."""
    folder.mkdir(parents=True, exist_ok=True)
    (port,) = free_ports(1)
    # Not ViewerClient.spawn: that listens on every interface.
    options = ["--headless", "--hide-welcome-screen", "--bind", LOOPBACK, "--port", str(port)]
    quiet = subprocess.DEVNULL
    command = [viewer_program(), *options, str(recording)]
    # A group of its own: `rerun` is a script that starts the viewer, and both have to end.
    viewer = subprocess.Popen(
        command, env=without_statistics(os.environ), stdout=quiet, stderr=quiet, start_new_session=True
    )
    try:
        return photograph(connect(viewer, port), folder, seconds)
    finally:
        with suppress(ProcessLookupError):  # it ended by itself, as it does without a graphics driver
            os.killpg(viewer.pid, signal.SIGTERM)
        viewer.wait(timeout=10.0)


def connect(viewer: "subprocess.Popen[bytes]", port: int) -> Any:
    """Client of ``viewer`` once it has loaded its recording; raises RuntimeError if it never does."""
    import rerun as rr

    deadline = time.monotonic() + 60.0
    while viewer.poll() is None and time.monotonic() < deadline:
        try:
            client = rr.experimental.ViewerClient(f"rerun+http://{LOOPBACK}:{port}/proxy")
            state = client.get_state()
            if state.views and not state.loading:
                return client
        except (ConnectionError, RuntimeError):
            pass
        time.sleep(0.2)
    raise RuntimeError("the viewer did not start")


def photograph(client: Any, folder: Path, seconds: float) -> list[Path]:
    """The whole window and each view, paused at ``seconds``."""
    client.set_time("time", duration=seconds, play_state="paused")
    time.sleep(6.0)  # until the viewer's notices have faded
    made = [folder / "whole.png"]
    client.save_screenshot(str(made[0]))
    for number, view in enumerate(client.get_state().views):
        made.append(folder / f"view-{number}.png")
        client.save_screenshot(str(made[-1]), view_id=view.view_id)
    return made


def main() -> int:
    """Entry point; exit code 1 with one sentence when there is nothing to draw or no way to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="run folder or .rrd file")
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--time", type=float, default=2.7, help="seconds on the timeline (default: %(default)s)")
    options = parser.parse_args()
    try:
        for picture in draw(recording_of(options.run), options.folder, options.time):
            print(picture)
    except KluteSimError as error:
        print(f"rerun_picture: {error}", file=sys.stderr)
        return 1
    except (ImportError, OSError, RuntimeError) as error:
        print(f"rerun_picture: no picture: {error}; is there a Vulkan driver?", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
