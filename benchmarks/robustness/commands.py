"""The commands whose processes are killed, with small inputs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests import synthetic_gait

import klute_sim as ks
from klute_sim.api.diagnosis import write_example_dataset

RUN_FOLDER = "out"
"""Output folder of every command."""


@dataclass(frozen=True)
class Command:
    """A command line, its inputs, and what of its output must survive a kill."""

    name: str
    arguments: tuple[str, ...]
    results: tuple[str, ...]
    """Patterns of the files that are complete when they exist, and equal after every run."""
    prepare: Callable[[Path], None] = lambda folder: None
    """Writes the inputs into a folder."""


def _write_capture(folder: Path) -> None:
    synthetic_gait.c3d(folder, synthetic_gait.Walker())


def _write_dataset(folder: Path) -> None:
    """Write the first second of one group of trials of the example, with one uncertain number."""
    write_example_dataset(folder / "data")
    file = folder / "data" / "dataset.toml"
    head, *trials = file.read_text("utf-8").split("[[trial]]")
    lines = [line for line in head.splitlines() if not line.startswith(('"tendon', '"damper', '"muscle.friction'))]
    file.write_text("\n[[trial]]".join(["\n".join(lines), *(trial for trial in trials if "fit_1" in trial)]), "utf-8")
    for table in (folder / "data").glob("*.csv"):
        rows = table.read_text("utf-8").splitlines(keepends=True)
        table.write_text("".join(rows[:200]), "utf-8")


def _write_gait_run(folder: Path) -> None:
    ks.simulate_gait(strides=2, time_step=1e-3).save(folder / "run")


_COMMANDS = (
    Command(
        "gait",
        ("gait", "--strides", "1", "--step", "1", "--out", RUN_FOLDER),
        ("out/recording.parquet", "out/summary.json", "out/device.toml"),
    ),
    Command(
        "sweep",
        (
            "sweep",
            "--mass",
            "60,65,70,75,80,85",
            "--strides",
            "1",
            "--step",
            "1",
            "--jobs",
            "2",
            "--out",
            RUN_FOLDER,
        ),
        ("out/cases/*.json", "out/sweep.parquet", "out/sweep.json"),
    ),
    Command(
        "tune",
        ("tune", "--budget", "8", "--jobs", "2", "--out", RUN_FOLDER),
        ("out/cases/*.json", "out/tuned.csv", "out/evaluations.csv", "out/tune.json"),
    ),
    Command("train", ("train", "--steps", "4000", "--out", RUN_FOLDER), ("out/config.toml",)),
    Command(
        "diagnose",
        ("diagnose", "data", "--only", "seal_friction", "--jobs", "2", "--no-report", "--out", RUN_FOLDER),
        ("out/verdict.json", "data/*"),
        _write_dataset,
    ),
    Command(
        "import",
        ("import", "walk.c3d", "--mass", "70", "--stature", "1.8", "--out", RUN_FOLDER),
        ("out/*",),
        _write_capture,
    ),
    Command("bench", ("bench", "ramps", "--out", RUN_FOLDER), ("out/results.csv", "out/*.parquet")),
    Command("design", ("design", "--mass", "70", "--out", RUN_FOLDER), ("out/device.toml", "out/profile.csv")),
    Command(
        "compare",
        ("compare", "run", "run", "--out", RUN_FOLDER),
        ("out/comparison.csv", "out/bands.parquet"),
        _write_gait_run,
    ),
    Command("export", ("export", "run", "--out", RUN_FOLDER), ("out/*",), _write_gait_run),
    Command("plan", ("plan", "klute-3-4-pair", "--out", RUN_FOLDER), ("out/*",)),
    Command("reproduce", ("reproduce", "--out", RUN_FOLDER), ("out/items.json", "out/device.toml")),
)
COMMANDS = {command.name: command for command in _COMMANDS}
"""Command by name."""
