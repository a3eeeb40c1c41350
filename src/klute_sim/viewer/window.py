"""Opening a folder in the rerun viewer, on this machine only."""

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote

from klute_sim.errors import KluteSimError, MissingExtraError
from klute_sim.viewer.folders import ensure_recording

LOOPBACK_ADDRESS = "127.0.0.1"
"""The only address the viewer listens on; rerun's own default is every interface."""


def build_viewer_command(program: str, rrd_path: Path, *, port: int, web_port: int | None = None) -> list[str]:
    """Command line of the viewer on ``recording``, in a window or, with ``web_port``, served to a browser."""
    command = [program, "--bind", LOOPBACK_ADDRESS, "--port", str(port)]
    if web_port is not None:
        command += ["--serve-web", "--web-viewer-port", str(web_port)]
    return [*command, str(rrd_path)]


def format_web_address(port: int, web_port: int) -> str:
    """Page of the served viewer; it reports usage from the browser unless told that it sits in a notebook."""
    return f"http://{LOOPBACK_ADDRESS}:{web_port}?url={quote(f'rerun+http://{LOOPBACK_ADDRESS}:{port}/proxy', safe='')}&notebook=1"


def disable_statistics(environment: Mapping[str, str]) -> dict[str, str]:
    """``environment`` in which rerun sends no usage statistics, as on a CI machine; its settings stay the user's."""
    quiet = {name: value for name, value in environment.items() if name != "FORCE_RERUN_ANALYTICS"}
    return {**quiet, "CI": "1"}


def has_display(platform: str, environment: Mapping[str, str]) -> bool:
    """Whether a window can be opened, as far as ``environment`` tells: on Linux a display server has to be named."""
    return platform != "linux" or any(map(environment.get, ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")))


def find_free_ports(count: int) -> list[int]:
    """Different ports that nobody listens on."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for each in sockets:
            each.bind((LOOPBACK_ADDRESS, 0))
        return [each.getsockname()[1] for each in sockets]
    finally:
        for each in sockets:
            each.close()


def find_viewer_program() -> str:
    """Path of the rerun viewer, beside this Python or on the PATH; raises MissingExtraError without the extra."""
    beside = Path(sys.executable).parent
    program = shutil.which("rerun", path=str(beside)) or shutil.which("rerun")
    try:
        import rerun  # noqa: F401
    except ImportError:
        program = None
    if program is None:
        raise MissingExtraError("the rerun viewer", "rerun")
    return program


def open_viewer(path: Path, *, web: bool = False) -> None:
    """Show ``run`` until the viewer is closed, without rerun's usage statistics.

    Raises InputError for a folder without a recording, MissingExtraError without rerun and KluteSimError without a
    screen, or when the viewer fails.
    """
    program = find_viewer_program()
    with ensure_recording(path) as recording:
        if not web and not has_display(sys.platform, os.environ):
            raise KluteSimError("there is no screen for the rerun viewer (DISPLAY is not set); try --web or --picture")
        port, web_port = find_free_ports(2)
        # Or rerun would name its page, which reports, and tell what it listens to.
        environment = {**disable_statistics(os.environ), "RUST_LOG": "warn"}
        if web:
            print(f"Open {format_web_address(port, web_port)} (Ctrl+C ends)", flush=True)
        command = build_viewer_command(program, recording, port=port, web_port=web_port if web else None)
        done = subprocess.run(command, env=environment, check=False)
        if done.returncode != 0:
            hint = "" if web else "; without a screen or graphics driver try --web or --picture"
            raise KluteSimError(f"the rerun viewer ended with code {done.returncode} on {recording}{hint}")
