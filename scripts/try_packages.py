"""Build the source distribution, a wheel from that alone, and try the wheel away from the checkout.

    python scripts/try_packages.py                        # the oldest and the newest dependencies; needs uv
    python scripts/try_packages.py --python 3.14 newest   # with another Python that uv finds
    python scripts/try_packages.py --suite "tests/laws" floor  # and tests of the source distribution, with the wheel

Each time a bare environment gets the wheel with the extras that --extras names, and commands run in an empty folder. A
line says what was installed, and how each went; the exit code is 1 if one failed.
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
REPORTED_PACKAGES = ("mujoco", "numpy", "scipy", "gymnasium", "numba", "pyarrow", "pydantic")
"""Packages whose versions are told."""
VERSION_SCRIPT = """
import importlib.metadata as of, sys, klute_sim
assert klute_sim.__file__.startswith(sys.prefix), klute_sim.__file__
print(".".join(map(str, sys.version_info[:3])), *(f"{n} {of.version(n)}" for n in sys.argv[1:]), sep=", ")
"""
ENVIRONMENT_SCRIPT = """
import gymnasium, klute_sim
from gymnasium.utils.env_checker import check_env
for name in ("AnkleGait-v1", "AnkleBench-v0"):
    check_env(gymnasium.make(f"klute_sim/{name}").unwrapped, skip_render_check=True)
"""
COMMAND_CHECKS = (
    ("klute-sim", "gait", "--strides", "1", "--json"),
    ("klute-sim", "bench", "isometric", "--json"),
    ("klute-sim", "diagnose", "example-dataset", "--example", "--no-report", "--out", "found", "--json"),
    ("python", "-c", ENVIRONMENT_SCRIPT),
)


class PackageCheckError(Exception):
    """Something failed; the message is what it printed."""


def run_command(command: list[str], cwd: Path, **variables: str) -> str:
    """What ``command`` prints, run in ``where``; raises TryingError if it fails."""
    kept = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run(command, cwd=cwd, env=kept | variables, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PackageCheckError(f"{' '.join(command)}\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done.stdout


def build_packages(folder: Path) -> tuple[Path, Path]:
    """The unpacked source distribution, and the wheel that was made of it."""
    build = [sys.executable, "-m", "hatchling", "build", "--directory"]
    run_command([*build, str(folder), "--target", "sdist"], ROOT)
    (packed,) = folder.glob("*.tar.gz")
    with tarfile.open(packed) as archive:
        archive.extractall(folder, filter="data")
    source = folder / packed.name.removesuffix(".tar.gz")
    run_command([*build, str(folder), "--target", "wheel"], source)
    (wheel,) = folder.glob("*.whl")
    return source, wheel


def check_wheel(wheel: Path, source: Path, resolution: str, options: argparse.Namespace) -> None:
    """Install ``wheel`` and run everything; raises TryingError at the first that fails."""
    with tempfile.TemporaryDirectory() as place:
        away, programs = Path(place) / "empty", Path(place) / "environment" / SCRIPTS_FOLDER
        away.mkdir()
        run_command(["uv", "venv", "--quiet", "--python", options.python, str(programs.parent)], away)
        install = ["uv", "pip", "install", "--quiet", "--python", str(programs / "python")]
        # What a wheel needs is not direct to uv, so what is to be old is taken from where the wheel has it from.
        project = tomllib.loads((source / "pyproject.toml").read_text("utf-8"))
        needed = list(project["project"]["dependencies"])
        for extra in filter(None, options.extras.split(",")):
            needed += project["project"]["optional-dependencies"][extra]
        needed += project["dependency-groups"]["dev"] if options.suite else []
        run_command([*install, "--resolution", RESOLUTIONS[resolution], *needed], away)
        run_command([*install, f"{wheel}[{options.extras}]" if options.extras else str(wheel)], away)
        path = f"{programs}{os.pathsep}{os.environ.get('PATH', os.defpath)}"
        print(
            f"{resolution}: Python",
            run_command(["python", "-c", VERSION_SCRIPT, *REPORTED_PACKAGES], away, PATH=path).strip(),
            flush=True,
        )
        for check in COMMAND_CHECKS:
            run_command(list(check), away, PATH=path)
            print("  passed:", " ".join(check[:2]) if check[0] == "klute-sim" else "the environments", flush=True)
        if options.suite:
            shutil.rmtree(source / "src", ignore_errors=True)  # so that nothing but the wheel can be imported
            told = run_command(["python", "-m", "pytest", "-q", *options.suite.split()], source, PATH=path)
            print("  passed:", told.strip().splitlines()[-1], flush=True)


def main(arguments: list[str]) -> int:
    """Build once, try every resolution that is asked for."""
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
    with tempfile.TemporaryDirectory() as place:
        try:
            source, wheel = build_packages(Path(place))
            for resolution in options.resolution or RESOLUTIONS:
                check_wheel(wheel, source, resolution, options)
        except PackageCheckError as problem:
            print(f"failed: {problem}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
