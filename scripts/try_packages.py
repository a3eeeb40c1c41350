"""Build the source distribution and a wheel from it, and test the wheel outside of the checkout.

    python scripts/try_packages.py                        # the oldest and the newest dependencies; needs uv
    python scripts/try_packages.py --python 3.13 newest   # another Python version that uv finds
    python scripts/try_packages.py --suite "tests/laws" floor  # also run tests of the source distribution

Each run installs the wheel with the extras of --extras into an empty environment and executes commands in an empty
folder. The output lists the installed versions and the result of each command; the exit code is 1 after a failure.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
RESOLUTIONS = {"floor": "lowest-direct", "newest": "highest"}
SCRIPTS_FOLDER = "Scripts" if os.name == "nt" else "bin"
REPORTED_PACKAGES = ("mujoco-core", "numpy", "scipy", "gymnasium", "numba", "pyarrow", "pydantic")
"""Packages whose versions are reported."""
VERSION_SCRIPT = """
import importlib.metadata as of, sys, klute_sim
assert klute_sim.__file__.startswith(sys.prefix), klute_sim.__file__
print(".".join(map(str, sys.version_info[:3])), *(f"{n} {of.version(n)}" for n in sys.argv[1:]), sep=", ")
"""
ENVIRONMENT_SCRIPT = """
import gymnasium, klute_sim
from gymnasium.utils.env_checker import check_env
for name in ("AnkleGait-v2", "AnkleWalk-v0", "AnkleBench-v0"):
    check_env(gymnasium.make(f"klute_sim/{name}").unwrapped, skip_render_check=True)
"""
COMMAND_CHECKS = (
    ("klute-sim", "gait", "--strides", "1", "--json"),
    ("klute-sim", "bench", "isometric", "--json"),
    ("klute-sim", "diagnose", "example-dataset", "--example", "--no-report", "--out", "found", "--json"),
    ("python", "-c", ENVIRONMENT_SCRIPT),
)


class PackageCheckError(Exception):
    """A check failed; the message is its output."""


def run_command(command: list[str], cwd: Path, **variables: str) -> str:
    """Return the output of ``command`` in the folder ``cwd``; raises PackageCheckError when it fails."""
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    completed = subprocess.run(
        command, cwd=cwd, env=environment | variables, capture_output=True, text=True, check=False
    )
    if completed.returncode:
        raise PackageCheckError(f"{' '.join(command)}\n{completed.stdout[-3000:]}{completed.stderr[-3000:]}")
    return completed.stdout


def build_packages(folder: Path) -> tuple[Path, Path]:
    """Return the unpacked source distribution and the wheel built from it."""
    build_command = [sys.executable, "-m", "hatchling", "build", "--directory"]
    run_command([*build_command, str(folder), "--target", "sdist"], ROOT)
    (archive_path,) = folder.glob("*.tar.gz")
    with tarfile.open(archive_path) as archive:
        # Python 3.11.2, that of Debian 12, has no extraction filters; the archive is our own.
        archive.extraction_filter = getattr(tarfile, "data_filter", None)
        archive.extractall(folder)
    source = folder / archive_path.name.removesuffix(".tar.gz")
    run_command([*build_command, str(folder), "--target", "wheel"], source)
    (wheel,) = folder.glob("*.whl")
    return source, wheel


def check_wheel(wheel: Path, source: Path, resolution: str, options: argparse.Namespace) -> None:
    """Install ``wheel`` and run all checks; raises PackageCheckError at the first failure."""
    with tempfile.TemporaryDirectory() as temporary:
        empty_folder, programs = Path(temporary) / "empty", Path(temporary) / "environment" / SCRIPTS_FOLDER
        empty_folder.mkdir()
        run_command(["uv", "venv", "--quiet", "--python", options.python, str(programs.parent)], empty_folder)
        install = ["uv", "pip", "install", "--quiet", "--python", str(programs / "python")]
        # uv's lowest-direct does not apply to dependencies of a wheel, so they are installed from pyproject.toml.
        project = tomllib.loads((source / "pyproject.toml").read_text("utf-8"))
        requirements = list(project["project"]["dependencies"])
        for extra in filter(None, options.extras.split(",")):
            requirements += project["project"]["optional-dependencies"][extra]
        requirements += project["dependency-groups"]["dev"] if options.suite else []
        run_command([*install, "--resolution", RESOLUTIONS[resolution], *requirements], empty_folder)
        run_command([*install, f"{wheel}[{options.extras}]" if options.extras else str(wheel)], empty_folder)
        path = f"{programs}{os.pathsep}{os.environ.get('PATH', os.defpath)}"
        print(
            f"{resolution}: Python",
            run_command(["python", "-c", VERSION_SCRIPT, *REPORTED_PACKAGES], empty_folder, PATH=path).strip(),
            flush=True,
        )
        for check in COMMAND_CHECKS:
            run_command(list(check), empty_folder, PATH=path)
            print("  passed:", " ".join(check[:2]) if check[0] == "klute-sim" else "the environments", flush=True)
        if options.suite:
            shutil.rmtree(source / "src", ignore_errors=True)  # so that nothing but the wheel can be imported
            output = run_command(["python", "-m", "pytest", "-q", *options.suite.split()], source, PATH=path)
            print("  passed:", output.strip().splitlines()[-1], flush=True)


def main(arguments: list[str]) -> int:
    """Build the packages once and check each requested resolution."""
    layout = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=layout)
    parser.add_argument("resolution", nargs="*", choices=[*RESOLUTIONS, []], help="which dependencies (default: both)")
    parser.add_argument("--python", default="3.11", help="version of Python (default: 3.11, the oldest supported)")
    parser.add_argument("--extras", default="rerun,c3d,tune", help="of the wheel, comma-separated")
    parser.add_argument(
        "--suite", metavar="PYTEST", help="run the source distribution's tests, with pytest's arguments"
    )
    options = parser.parse_args(arguments)
    if shutil.which("uv") is None:
        print("This needs uv: pip install uv, and try again.", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as temporary:
        try:
            source, wheel = build_packages(Path(temporary))
            for resolution in options.resolution or RESOLUTIONS:
                check_wheel(wheel, source, resolution, options)
        except PackageCheckError as error:
            print(f"failed: {error}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
