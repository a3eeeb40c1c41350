"""``klute-sim import``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli.given_path import GivenPath

if TYPE_CHECKING:
    from klute_sim.motion.importing import Imported


@click.command("import")
@click.argument("files", nargs=-1, required=True, metavar="FILES...", type=GivenPath())
@click.option("--mass", type=float, default=None, metavar="KG", help="Body mass.  [default: from the ground reaction]")
@click.option("--stature", type=float, default=None, metavar="M", help="Noted for klute-sim gait.")
@click.option("--side", type=click.Choice(["right", "left"]), default=None, help="[default: the one with more strides]")
@click.option(
    "--map",
    "map_file",
    type=GivenPath(),
    default=None,
    metavar="FILE",
    help="TOML: columns, units, signs, zeros, markers and axes that are not as their names say (docs/import.md).",
)
@click.option(
    "--cutoff",
    type=float,
    default=6.0,
    show_default=True,
    metavar="HZ",
    help="Low-pass of angles and markers; 0: none.",
)
@click.option(
    "--load-cutoff", type=float, default=20.0, show_default=True, metavar="HZ", help="Of ground reactions and moments."
)
@click.option(
    "--threshold",
    type=float,
    default=20.0,
    show_default=True,
    metavar="N",
    help="Vertical load of a foot on the ground.",
)
@click.option(
    "--ankle-zero",
    type=click.Choice(["foot-flat", "file"]),
    default="foot-flat",
    show_default=True,
    help="Whether 0 degrees of the ankle is moved to where the foot is flat in mid-stance.",
)
@click.option(
    "--out",
    type=GivenPath(),
    default=None,
    metavar="FOLDER",
    help="New or empty folder for the reference.  [default: runs/import-NNN]",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of the table.")
def command(
    files: tuple[Path, ...],
    mass: float | None,
    stature: float | None,
    side: Any,
    map_file: Path | None,
    cutoff: float,
    load_cutoff: float,
    threshold: float,
    ankle_zero: Any,
    out: Path | None,
    as_json: bool,
) -> None:
    """Make a reference for klute-sim gait of a laboratory's own files.

    FILES are one or more trials: C3D (extra 'c3d'), OpenSim's .mot, .sto and .trc, CSV, Parquet. A trial may be several
    files, side by side: angles, ground reaction, moments. Signs, axes, units and zeros are found out, and told with the
    reason; so is all that looks wrong.

    Writes reference.csv, reference.toml, all strides (strides_right.parquet, strides_left.parquet) and import.json.

    \b
    Examples:
      klute-sim import trial.c3d --mass 70 --out my-subject
      klute-sim gait --reference my-subject
      klute-sim import ik.mot grf.mot id.sto --mass 70 --side left
      klute-sim import walk1.csv walk2.csv --map my-columns.toml --json
    """
    from klute_sim.cli.console import progress_bar
    from klute_sim.motion import folder as folders
    from klute_sim.motion import importing, mapping
    from klute_sim.motion.options import ImportOptions
    from klute_sim.recording import run_folder

    options = ImportOptions(
        mass=mass,
        stature=stature,
        side=side,
        cutoff=cutoff,
        load_cutoff=load_cutoff,
        threshold=threshold,
        ankle_zero=ankle_zero,
        chosen=mapping.read(map_file),
    )
    with run_folder.new("import", out) as (folder, scratch):
        with progress_bar("importing") as progress:
            imported = importing.run(files, options, progress)
        result = folders.write(imported, scratch)
    if as_json:
        click.echo(json.dumps({**result, "run": str(folder)}, indent=2, allow_nan=False))
    else:
        _print(imported, result, folder)


def _print(imported: "Imported", result: dict[str, Any], folder: Path) -> None:
    from rich.table import Table

    from klute_sim.cli.console import console

    out = console()
    files = Table("file", "kind", "seconds", "Hz", "holds", title="Found")
    for entry in result["found"]:
        rate = "-" if entry["rate_hz"] is None else f"{entry['rate_hz']:g}"
        files.add_row(entry["file"], entry["kind"], f"{entry['seconds']:.2f}", rate, ", ".join(entry["holds"]))
    out.print(files)
    channels = Table("channel", "side", "from", "unit", "sign", "zero", "why", title="Mapped")
    for entry in result["mapped"]:
        channels.add_row(
            *(entry["channel"], entry["side"], entry["column"], entry["unit"]),
            *(f"{entry['sign']:+d}", f"{entry['zero']:g}", entry["why"]),
        )
    out.print(channels)
    for title in ("derived", "missing", "suspicious"):
        for sentence in result[title]:
            out.print(f"{title.capitalize()}: {sentence}", soft_wrap=True)
    out.print(_words(imported), soft_wrap=True)
    out.print(f"Reference: {folder}; walk it with klute-sim gait --reference {folder}", soft_wrap=True)


def _words(imported: "Imported") -> str:
    from klute_sim.motion.folder import described

    count = len(imported.strides[imported.side])
    speed = "" if imported.speed is None else f", {imported.speed:.2f} m/s"
    filters = described(imported)
    return (
        f"{count} stride{'' if count == 1 else 's'} of the {imported.side} leg: {imported.stride_time:.3f} s{speed}, "
        f"toe-off at {imported.toe_off:.1f} %, {imported.mass:.1f} kg. Filters: angles {filters['angles']}; "
        f"loads {filters['loads']}."
    )
