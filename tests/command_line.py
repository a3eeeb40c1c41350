"""Commands as a user types them, run in the process of the tests, because most of a command's time is importing.

The commands of the README, and those of :func:`run_in_subprocess`, run in processes of their own.
"""

import contextlib
import io
import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from unittest import mock

from klute_sim.cli import main
from klute_sim.cli.console import stderr_console, stdout_console

COLUMNS = "130"


def run(*arguments: str, cwd: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run ``klute-sim ARGUMENTS`` in the folder ``cwd``.

    With a catalogue the command has a process of its own: a process builds its law once, of the effects known by then.
    """
    if "--catalogue" in arguments or "KLUTE_SIM_CATALOGUE" in environment:
        return run_in_subprocess(*arguments, cwd=cwd, **environment)
    out, err, handler = io.StringIO(), io.StringIO(), signal.getsignal(signal.SIGTERM)
    code: object = 0
    with (
        contextlib.chdir(cwd or Path.cwd()),
        mock.patch.dict(os.environ, {"COLUMNS": COLUMNS, **environment}),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        warnings.catch_warnings(),
    ):
        warnings.resetwarnings()
        stdout_console.cache_clear()
        stderr_console.cache_clear()
        try:
            main(arguments)
        except SystemExit as exit_request:
            code = exit_request.code
        finally:
            signal.signal(signal.SIGTERM, handler)
    return subprocess.CompletedProcess(["klute-sim", *arguments], int(str(code)), out.getvalue(), err.getvalue())


def run_in_subprocess(*arguments: str, cwd: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run ``klute-sim ARGUMENTS`` in a process of its own, for what changes how Python starts."""
    return subprocess.run(
        [sys.executable, "-m", "klute_sim", *arguments],
        cwd=cwd,
        env={**os.environ, "COLUMNS": COLUMNS, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
