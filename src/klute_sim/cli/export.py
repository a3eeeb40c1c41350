"""``klute-sim export``."""

from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common
from klute_sim.cli.common import NonEmptyPath

FILE_FORMATS = ("mot", "sto", "trc", "log", "csv", "parquet")


@click.command("export")
@click.argument("run", metavar="RUN", type=NonEmptyPath())
@click.option(
    "--format",
    "formats",
    type=click.Choice(FILE_FORMATS),
    multiple=True,
    default=("mot", "sto"),
    show_default=True,
    help="File format; may be repeated.",
)
@click.option(
    "--side",
    type=click.Choice(["right", "left"]),
    default="right",
    show_default=True,
    help="Body side in the names of the exported quantities.",
)
@common.out_option("export", "the files")
def command(run: Path, formats: tuple[str, ...], side: Any, out: Path | None) -> None:
    """Export motion and loads of a run for other programs.

    RUN is a folder of klute-sim gait, or of klute-sim import, whose mean stride is exported. Writes the files of each
    chosen format:

    \b
      mot            joint angles and ground reaction, as in OpenSim
      sto            moments of hip, knee and ankle, as in OpenSim
      trc            virtual markers, as in OpenSim
      log            channels that the prosthesis would log
      csv, parquet   all channels

    "As in OpenSim" means its names, axes and signs; the other formats keep the names of klute-sim.

    \b
    Examples:
      klute-sim export runs/gait-001
      klute-sim export runs/gait-001 --format trc --format mot --out for-opensim
    """
    from klute_sim.api.mocap import export_run
    from klute_sim.cli.console import stdout_console

    folder, files = export_run(run, out, formats=formats, side=side)
    stdout_console().print(f"Exported: {folder}  ({', '.join(files)})", soft_wrap=True)
