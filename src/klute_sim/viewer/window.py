"""Open a folder of results in the rerun viewer, which listens on this machine only."""

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
"""Only address on which the viewer listens; the default of rerun is every interface."""


def build_viewer_command(program: str, rrd_path: Path, *, port: int, web_port: int | None = None) -> list[str]:
    """Return the command line of the viewer on ``rrd_path``: in a window or, with ``web_port``, in a browser."""
    command = [program, "--bind", LOOPBACK_ADDRESS, "--port", str(port)]
    if web_port is not None:
        command += ["--serve-web", "--web-viewer-port", str(web_port)]
    return [*command, str(rrd_path)]


def format_web_address(port: int, web_port: int) -> str:
    """Return the address of the viewer's page; ``notebook=1`` keeps the page from sending usage statistics."""
    proxy = quote(f"rerun+http://{LOOPBACK_ADDRESS}:{port}/proxy", safe="")
    return f"http://{LOOPBACK_ADDRESS}:{web_port}?url={proxy}&notebook=1"


def disable_statistics(environment: Mapping[str, str]) -> dict[str, str]:
    """Return ``environment`` with variables that keep rerun from sending usage statistics."""
    variables = {name: value for name, value in environment.items() if name != "FORCE_RERUN_ANALYTICS"}
    return {**variables, "CI": "1"}


def has_display(platform: str, environment: Mapping[str, str]) -> bool:
    """Return whether a window can be opened; on Linux ``environment`` must name a display server."""
    return platform != "linux" or any(map(environment.get, ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")))


def find_free_ports(count: int) -> list[int]:
    """Return ``count`` different free ports."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for port_socket in sockets:
            port_socket.bind((LOOPBACK_ADDRESS, 0))
        return [port_socket.getsockname()[1] for port_socket in sockets]
    finally:
        for port_socket in sockets:
            port_socket.close()


def find_viewer_program() -> str:
    """Return the path of the rerun viewer, next to this Python or on the PATH.

    Raises MissingExtraError without the extra.
    """
    python_folder = Path(sys.executable).parent
    program = shutil.which("rerun", path=str(python_folder)) or shutil.which("rerun")
    try:
        import rerun  # noqa: F401
    except ImportError:
        program = None
    if program is None:
        raise MissingExtraError("the rerun viewer", "rerun")
    return program


def open_viewer(path: Path, *, web: bool = False) -> None:
    """Show ``path`` in the viewer, without rerun's usage statistics, until the viewer is closed.

    Raises InputError for a folder without a recording, MissingExtraError without rerun, and KluteSimError without a
    display or when the viewer fails.
    """
    program = find_viewer_program()
    with ensure_recording(path) as recording:
        if not web and not has_display(sys.platform, os.environ):
            raise KluteSimError("the rerun viewer needs a display (DISPLAY is not set); try --web or --picture")
        port, web_port = find_free_ports(2)
        # At other log levels rerun prints the address of a page that sends statistics.
        environment = {**disable_statistics(os.environ), "RUST_LOG": "warn"}
        if web:
            print(f"Open {format_web_address(port, web_port)} (Ctrl+C ends)", flush=True)
        command = build_viewer_command(program, recording, port=port, web_port=web_port if web else None)
        completed = subprocess.run(command, env=environment, check=False)
        if completed.returncode != 0:
            hint = "" if web else "; without a display or graphics driver try --web or --picture"
            raise KluteSimError(f"the rerun viewer ended with code {completed.returncode} on {recording}{hint}")
