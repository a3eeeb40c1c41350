"""``klute-sim export``."""

from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common
from klute_sim.cli.nonempty_path import NonEmptyPath

FILE_FORMATS = ("mot", "sto", "trc", "log", "csv", "parquet")


@click.command("export")
@click.argument("run", metavar="RUN", type=NonEmptyPath())
@click.option(
    "--format",
    "kinds",
    type=click.Choice(FILE_FORMATS),
    multiple=True,
    default=("mot", "sto"),
    show_default=True,
    help="May be repeated.",
)
@click.option(
    "--side", type=click.Choice(["right", "left"]), default="right", show_default=True, help="Whose names the leg gets."
)
@common.out_option("export", "the files")
def command(run: Path, kinds: tuple[str, ...], side: Any, out: Path | None) -> None:
    """Write a run's motion and loads for other programs.

    RUN is a folder of klute-sim gait, or of klute-sim import (its mean stride). mot: joint angles and ground reaction;
    sto: the ankle's moment; trc: virtual markers; all with OpenSim's names, axes and signs. log: what the prosthesis
    itself would have logged; csv and parquet: every channel, with our own names.

    \b
    Examples:
      klute-sim export runs/gait-001
      klute-sim export runs/gait-001 --format trc --format mot --out for-opensim
    """
    from klute_sim.cli.console import stdout_console
    from klute_sim.mocap import export
    from klute_sim.recording import run_folder

    recording = export.read_gait(run)
    with run_folder.create_run_folder("export", out) as (folder, scratch):
        files = export.write_files(recording, side, tuple(dict.fromkeys(kinds)), scratch)
    stdout_console().print(f"Exported: {folder}  ({', '.join(files)})", soft_wrap=True)
