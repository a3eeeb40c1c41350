"""``klute-sim export``."""

from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common
from klute_sim.cli.common import NonEmptyPath

FILE_FORMATS = ("mot", "sto", "trc", "log", "csv", "parquet", "mjcf")


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
@click.option(
    "--model",
    type=NonEmptyPath(),
    default=None,
    metavar="NAME|FILE",
    help="For --format mjcf: model of the package or MJCF file whose tendons get the device.  [default: hanging_mass]",
)
@click.option(
    "--tendon",
    "tendons",
    multiple=True,
    metavar="NAME",
    help="For --format mjcf: tendon that gets the device; may be repeated.  [default: all]",
)
@common.out_option("export", "the files")
def command(
    run: Path, formats: tuple[str, ...], side: Any, model: Path | None, tendons: tuple[str, ...], out: Path | None
) -> None:
    """Export motion and loads of a run for other programs, or a device as MJCF.

    RUN is a folder of klute-sim gait, or of klute-sim import, whose mean stride is exported; with --format mjcf it is a
    device. Writes the files of each chosen format:

    \b
      mot            joint angles and ground reaction, as in OpenSim
      sto            moments of hip, knee and ankle, as in OpenSim
      trc            virtual markers, as in OpenSim
      log            channels that the prosthesis would log
      csv, parquet   all channels
      mjcf           MuJoCo model with the device on tendons (docs/mechanisms.md)

    "As in OpenSim" means its names, axes and signs; the other formats keep the names of klute-sim.

    \b
    Examples:
      klute-sim export runs/gait-001
      klute-sim export runs/gait-001 --format trc --format mot --out for-opensim
      klute-sim export klute-3-4-pair --format mjcf --model my-arm.xml \\
        --tendon assist
    """
    from klute_sim.cli.console import stdout_console
    from klute_sim.errors import InputError

    if "mjcf" in formats:
        if set(formats) != {"mjcf"}:
            raise InputError("--format mjcf exports a device, the other formats a run; give it alone")
        from klute_sim.api.joint import export_mjcf

        device = dict.fromkeys(tendons, run) if tendons else run
        folder = export_mjcf(device, out, model=model or "hanging_mass")
        files = sorted(file.name for file in folder.iterdir() if file.is_file() and not file.name.startswith("."))
        stdout_console().print(f"Exported: {folder}  ({', '.join(files)})", soft_wrap=True)
        return
    if model is not None or tendons:
        raise InputError(f"{'--tendon' if tendons else '--model'} belongs to --format mjcf")
    from klute_sim.api.mocap import export_run

    folder, files = export_run(run, out, formats=formats, side=side)
    stdout_console().print(f"Exported: {folder}  ({', '.join(files)})", soft_wrap=True)
