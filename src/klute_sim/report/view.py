"""Opening a run in the rerun viewer, on this machine only."""

import shutil
import subprocess
import sys
from pathlib import Path

from klute_sim.errors import InputError, KluteSimError, MissingExtraError

LOOPBACK = "127.0.0.1"
"""The only address the viewer listens on; rerun's own default is every interface."""


def viewer_command(program: str, recording: Path, *, web: bool) -> list[str]:
    """Command line of the viewer on ``recording``, in a window or served to a browser of this machine."""
    command = [program, "--bind", LOOPBACK, "--port", "auto"]
    if web:
        command += ["--serve-web", "--web-viewer-port", "0"]
    return [*command, str(recording)]


def recording_of(run: Path) -> Path:
    """The .rrd file of a ``run`` folder (or the file itself); raises InputError if there is none."""
    file = run / "recording.rrd" if run.is_dir() else run
    if file.is_file() and file.suffix == ".rrd":
        return file
    if not run.exists():
        raise InputError(f"no run folder {run}")
    if (run / "recording.parquet").is_file():
        raise InputError(
            f"{run} has no recording.rrd: it was made without the extra 'rerun'; install it and run the gait again"
        )
    raise InputError(f"{run} is no run folder: it has no recording.rrd")


def viewer_program() -> str:
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


def open_viewer(run: Path, *, web: bool = False) -> None:
    """Show ``run`` until the viewer is closed; turns rerun's usage statistics off first.

    Raises InputError for a folder without a recording, MissingExtraError without rerun and KluteSimError when the
    viewer fails.
    """
    program = viewer_program()
    recording = recording_of(run)
    subprocess.run([program, "analytics", "disable"], capture_output=True, check=False)
    done = subprocess.run(viewer_command(program, recording, web=web), check=False)
    if done.returncode != 0:
        hint = "" if web else "; without a screen or graphics driver try --web"
        raise KluteSimError(f"the rerun viewer ended with code {done.returncode} on {recording}{hint}")
