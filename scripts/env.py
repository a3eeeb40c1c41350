"""Create the environment of the project if it is missing or outdated, then run a command in it.

    python3 scripts/env.py pytest                        # any command; its exit code is passed on
    python3 scripts/env.py                               # only create .venv
    python3 scripts/env.py --environment extras pytest   # in .venv-extras, which also has Ray and OpenSim
    python3 scripts/env.py --environment newest pytest   # in .venv-newest, without a lock file

Requires only Python 3.11 or later; uses uv if it is installed and pip otherwise. The script owns the environment: an
incomplete or outdated one is deleted and created again.
"""

import argparse
import hashlib
import importlib.util
import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any


def unsupported_python_message(major: int, minor: int) -> str:
    """Return the reason why this version of Python is unsupported, or an empty string."""
    if (major, minor) >= (3, 11):
        return ""
    return f"klute-sim requires Python 3.11 or later; this is {major}.{minor}."


# The whole file uses the syntax of Python 3.6, so that an old Python reaches this message.
if unsupported_python_message(*sys.version_info[:2]):
    sys.stderr.write(unsupported_python_message(*sys.version_info[:2]) + "\n")
    sys.exit(2)

ROOT = Path(__file__).resolve().parent.parent
ENVIRONMENT_FOLDERS = {"locked": ".venv", "extras": ".venv-extras", "newest": ".venv-newest", "floor": ".venv-floor"}
LOCK_FILES = {"locked": "requirements-dev.lock", "extras": "requirements-extras.lock"}
"""Environments whose versions are fixed, and where."""
IS_WINDOWS = os.name == "nt"
SCRIPTS_FOLDER = "Scripts" if IS_WINDOWS else "bin"


class EnvironmentSetupError(Exception):
    """The environment cannot be created; the message is the advice to the user."""


def read_project(root: Path) -> dict[str, Any]:
    """Return the tables of pyproject.toml that determine the installation."""
    import tomllib  # new in Python 3.11

    content = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    return {name: content.get(name, {}) for name in ("build-system", "project", "dependency-groups")}


def compute_stamp(root: Path, environment: str) -> str:
    """Return a hash of everything that determines the content of the environment."""
    lock = (root / LOCK_FILES[environment]).read_text(encoding="utf-8") if environment in LOCK_FILES else ""
    inputs = [environment, sys.version_info[:2], str(root), read_project(root), lock]
    return hashlib.sha256(json.dumps(inputs).encode()).hexdigest()


def run_setup_step(description: str, command: list[str], advice: str) -> None:
    """Print ``description`` and run ``command``, with its output on stderr; raises EnvironmentSetupError with
    ``advice``.
    """
    print(f"env: {description}", file=sys.stderr, flush=True)
    if subprocess.run(command, cwd=ROOT, stdout=sys.stderr, check=False).returncode:
        raise EnvironmentSetupError(advice)


def create_environment(folder: Path, environment: str) -> None:
    """Create the environment from scratch."""
    uv = shutil.which("uv")
    if environment == "floor" and not uv:
        raise EnvironmentSetupError("--environment floor needs uv: pip install uv, and try again.")
    if not uv and not (importlib.util.find_spec("venv") and importlib.util.find_spec("ensurepip")):
        raise EnvironmentSetupError("this Python lacks venv: install python3-venv, or uv, and try again.")
    if folder.exists():
        shutil.rmtree(folder)
    python = str(folder / SCRIPTS_FOLDER / "python")
    # Not sys.executable itself, which may lie in the folder just deleted.
    base = getattr(sys, "_base_executable", sys.executable)
    create_command = [uv, "venv", "--quiet", "--python", base] if uv else [base, "-m", "venv"]
    install_command = [uv, "pip", "install", "--python", python] if uv else [python, "-m", "pip", "install"]
    tool = "uv" if uv else "pip"
    retry_advice = "see the message above, check the network connection and the disk, and try again."
    run_setup_step(f"making {folder.name} with {tool}", [*create_command, str(folder)], retry_advice)
    if environment in LOCK_FILES:
        # A lock file is complete, and most of its modules are never imported: nothing to resolve, nothing to compile.
        fast = ["--no-deps"] if uv else ["--no-deps", "--no-compile"]
        install_arguments = [["-r", LOCK_FILES[environment], *fast], ["--no-deps", "-e", "."]]
    else:
        lowest = ["--resolution", "lowest-direct"] if environment == "floor" else []
        # The group is spelt out because pip before 25.1 cannot read one.
        install_arguments = [[*lowest, "-e", ".[all]", *read_project(ROOT)["dependency-groups"]["dev"]]]
    for arguments in install_arguments:
        name = f"the packages of {arguments[1]}" if arguments[0] == "-r" else "klute-sim"
        run_setup_step(f"installing {name}", [*install_command, "--quiet", *arguments], retry_advice)


def run_in_environment(command: list[str], folder: Path) -> int:
    """Run a command in the environment and return its exit code."""
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONHOME"}
    variables["VIRTUAL_ENV"] = str(folder)
    variables["PATH"] = os.pathsep.join([str(folder / SCRIPTS_FOLDER), os.environ.get("PATH", os.defpath)])
    program = shutil.which(command[0], path=variables["PATH"])
    if program is None:
        print(f"env: there is no command {command[0]!r} in {folder.name}.", file=sys.stderr)
        return 127
    if not IS_WINDOWS:
        os.execve(program, [program, *command[1:]], variables)  # signals then reach the command alone
    process = subprocess.Popen([program, *command[1:]], env=variables)
    while True:
        try:
            return process.wait()
        except KeyboardInterrupt:
            continue  # the command got it too, and ends in its own way


def main(arguments: list[str]) -> int:
    """Create the environment if necessary and run the command in it."""
    layout = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=layout)
    parser.add_argument(
        "--environment", choices=ENVIRONMENT_FOLDERS, default="locked", help="which packages to install"
    )
    parser.add_argument("command", nargs=argparse.REMAINDER, help="what to run in the environment")
    options = parser.parse_args(arguments)
    folder = ROOT / ENVIRONMENT_FOLDERS[options.environment]
    stamp = folder / "klute-sim-stamp"
    try:
        expected_stamp = compute_stamp(ROOT, options.environment)
        python = folder / SCRIPTS_FOLDER / ("python.exe" if IS_WINDOWS else "python")
        if not (python.exists() and stamp.is_file() and stamp.read_text(encoding="utf-8") == expected_stamp):
            create_environment(folder, options.environment)
            stamp.write_text(expected_stamp, encoding="utf-8")
    except (EnvironmentSetupError, OSError, ValueError) as error:
        print(f"env: the environment is not ready: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    if options.command:
        return run_in_environment(options.command, folder)
    activate = str(folder / SCRIPTS_FOLDER / "activate")
    print("To activate it:", activate if IS_WINDOWS else f"source {shlex.quote(activate)}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
