"""``klute-sim import``."""

import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common
from klute_sim.cli.nonempty_path import NonEmptyPath

if TYPE_CHECKING:
    from klute_sim.mocap.dataset_import import DatasetOptions
    from klute_sim.mocap.options import ImportOptions
    from klute_sim.mocap.reference_import import ImportedReference


@click.command("import")
@click.argument("files", nargs=-1, required=True, metavar="FILES...", type=NonEmptyPath())
@click.option(
    "--mass",
    type=common.NumberWithUnit("kg"),
    default=None,
    metavar="KG",
    help="Body mass.  [default: from the ground reaction]",
)
@click.option("--stature", type=common.NumberWithUnit("m"), default=None, metavar="M", help="Noted for klute-sim gait.")
@common.REJECT_HEIGHT_OPTION
@click.option(
    "--side",
    type=click.Choice(["right", "left"]),
    default=None,
    help="The leg to import; of a dataset the one with the prosthesis.  [default: the one with more strides]",
)
@click.option(
    "--map",
    "map_file",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="TOML: columns, units, signs, zeros, markers and axes that are not as their names say (docs/import.md).",
)
@click.option(
    "--cutoff",
    type=common.NumberWithUnit("Hz"),
    default=None,
    metavar="HZ",
    help="Low-pass of angles and markers; 0: none.  [default: 6]",
)
@click.option(
    "--load-cutoff",
    type=common.NumberWithUnit("Hz"),
    default=None,
    metavar="HZ",
    help="Of ground reactions and moments.  [default: 20]",
)
@click.option(
    "--threshold",
    type=common.NumberWithUnit("N"),
    default=20.0,
    show_default=True,
    metavar="N",
    help="Vertical load of a foot on the ground.",
)
@click.option(
    "--ankle-zero",
    type=click.Choice(["foot-flat", "file"]),
    default=None,
    help="Whether 0 degrees of the ankle is moved to where the foot is flat in mid-stance.  [default: foot-flat; of a "
    "dataset: file]",
)
@click.option(
    "--dataset",
    "as_dataset",
    is_flag=True,
    help="Make a dataset for klute-sim diagnose, of walks with a prosthesis and its own log (docs/import.md).",
)
@click.option("--device", default=None, metavar="NAME|FILE", help="Of a dataset: the prosthesis that was walked on.")
@click.option(
    "--uncertain",
    multiple=True,
    metavar="KEY=SPREAD",
    help="Of a dataset: a number of the device known only so well, as 'muscle.c10_kpa=10 %'; may be repeated.",
)
@click.option(
    "--repeats",
    type=int,
    default=None,
    metavar="N",
    help="Of a dataset: N trials on end are repeats.  [default: those with equal stride times and pressures]",
)
@common.out_option("import", "the reference or the dataset")
@click.option("--verbose", is_flag=True, help="Show what was decided for every file by itself, as in import.json.")
@common.json_option()
def command(
    files: tuple[Path, ...],
    mass: float | None,
    stature: float | None,
    side: Any,
    map_file: Path | None,
    cutoff: float | None,
    load_cutoff: float | None,
    threshold: float,
    ankle_zero: Any,
    as_dataset: bool,
    device: str | None,
    uncertain: tuple[str, ...],
    repeats: int | None,
    out: Path | None,
    verbose: bool,
    as_json: bool,
) -> None:
    """Make a reference for klute-sim gait of a laboratory's own files, or a dataset for klute-sim diagnose.

    FILES are one or more trials: C3D (extra 'c3d'), OpenSim's .mot, .sto and .trc, CSV, Parquet. A trial may be several
    files, side by side: angles, ground reaction, moments. Signs, axes, units and zeros are found out, and told with the
    reason; so is all that looks wrong.

    Writes reference.csv, reference.toml, all strides (strides_right.parquet, strides_left.parquet) and import.json;
    with --dataset dataset.toml, the trials as CSV and import.json.

    \b
    Examples:
      klute-sim import trial.c3d --mass 70 --out my-subject
      klute-sim gait --reference my-subject
      klute-sim import ik.mot grf.mot id.sto --mass 70 --side left
      klute-sim import walk1.csv walk2.csv --map my-columns.toml --json
      klute-sim import a.c3d a_log.csv b.c3d b_log.csv --dataset --device my.toml --side left --out my-walks
      klute-sim diagnose my-walks
    """
    from klute_sim.errors import InputError
    from klute_sim.mocap.options import LOAD_CUTOFF_HZ, MOTION_CUTOFF_HZ, ImportOptions
    from klute_sim.mocap.parsing import mapping

    filters = {"--cutoff": cutoff, "--load-cutoff": load_cutoff, "--stature": stature}
    alone = {"--device": device, "--uncertain": uncertain or None, "--repeats": repeats}
    misplaced = [name for name, value in (filters if as_dataset else alone).items() if value is not None]
    if misplaced:
        what = "makes no sense with" if as_dataset else "goes with"
        raise InputError(f"{misplaced[0]} {what} --dataset{': nothing is filtered' * ('cutoff' in misplaced[0])}")
    options = ImportOptions(
        mass=mass,
        stature=stature,
        side=side,
        motion_cutoff=MOTION_CUTOFF_HZ if cutoff is None else cutoff,
        load_cutoff=LOAD_CUTOFF_HZ if load_cutoff is None else load_cutoff,
        contact_threshold=threshold,
        ankle_zero=ankle_zero or ("file" if as_dataset else "foot-flat"),
        mapping=mapping.read(map_file),
    )
    if as_dataset:
        _import_dataset(
            files, options, _parse_dataset_options(device, uncertain, repeats), out, verbose=verbose, as_json=as_json
        )
    else:
        _import_reference(files, options, out, verbose=verbose, as_json=as_json)


def _import_reference(
    files: tuple[Path, ...], options: "ImportOptions", out: Path | None, *, verbose: bool, as_json: bool
) -> None:
    from klute_sim.cli.console import progress_bar
    from klute_sim.mocap import reference_folder as folders
    from klute_sim.mocap import reference_import
    from klute_sim.recording import run_folder

    with run_folder.create_run_folder("import", out) as (folder, scratch):
        with progress_bar("importing") as progress:
            imported = reference_import.import_reference(files, options, progress)
        result = folders.write_reference(imported, scratch)
    if as_json:
        click.echo(json.dumps({**result, "run": str(folder)}, indent=2, allow_nan=False))
    else:
        _print_reference(imported, result, folder, verbose=verbose)


def _parse_dataset_options(device: str | None, uncertain: tuple[str, ...], repeats: int | None) -> "DatasetOptions":
    from klute_sim.errors import InputError
    from klute_sim.mocap.dataset_import import DatasetOptions

    if device is None:
        raise InputError("a dataset needs --device: the preset or the device file of the prosthesis that was walked on")
    spreads: dict[str, str | float] = {}
    for word in uncertain:
        key, equals, spread = word.partition("=")
        if not equals:
            raise InputError(f"--uncertain '{word}' is not of the form KEY=SPREAD, such as 'muscle.c10_kpa=10 %'")
        spreads[key.strip()] = spread.strip()
        with suppress(ValueError):  # a number by itself has the unit of the key
            spreads[key.strip()] = float(spread)
    return DatasetOptions(device=device, uncertainties=spreads, trials_per_group=repeats)


def _import_dataset(
    files: tuple[Path, ...],
    options: "ImportOptions",
    dataset_options: "DatasetOptions",
    out: Path | None,
    *,
    verbose: bool,
    as_json: bool,
) -> None:
    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.mocap import dataset_import
    from klute_sim.recording import run_folder
    from klute_sim.report.mocap import table as mocap_table

    with run_folder.create_run_folder("import", out) as (folder, scratch):
        with progress_bar("importing") as progress:
            gathered = dataset_import.import_dataset(files, options, dataset_options, progress)
        result = dataset_import.write_dataset(gathered, scratch)
    if as_json:
        click.echo(json.dumps({**result, "run": str(folder)}, indent=2, allow_nan=False))
        return
    shown = stdout_console()
    _print_findings(result, verbose=verbose)
    shown.print(mocap_table.build_trials_table(result))
    split = result["split"]
    uses = ", ".join(f"{len(split[use])} to {use}" for use in ("fit", "select", "show"))
    shown.print(f"Use: {uses}; {split['how']}.", soft_wrap=True)
    shown.print(f"Dataset: {folder}; look into it with klute-sim diagnose {folder}", soft_wrap=True)


def _print_reference(imported: "ImportedReference", result: dict[str, Any], folder: Path, *, verbose: bool) -> None:
    from klute_sim.cli.console import stdout_console

    out = stdout_console()
    out.print(_summarize_strides(imported), soft_wrap=True)
    _print_findings(result, verbose=verbose)
    out.print(f"Reference: {folder}; walk it with klute-sim gait --reference {folder}", soft_wrap=True)


def _print_findings(result: dict[str, Any], *, verbose: bool) -> None:
    """What is suspicious and missing, and what was found, mapped and derived."""
    from klute_sim.cli.console import stdout_console
    from klute_sim.report.mocap import table as mocap_table

    out = stdout_console()
    for title in ("suspicious", "missing", "derived"):
        for sentence in result[title] if verbose else mocap_table.collect_sentences(result, title):
            out.print(f"{title.capitalize()}: {sentence}", soft_wrap=True)
    out.print(mocap_table.build_files_table(result))
    out.print(mocap_table.build_channels_table(result, all_files=verbose))
    if not verbose:
        out.print("Mapped file by file: --verbose, or import.json", soft_wrap=True)


def _summarize_strides(imported: "ImportedReference") -> str:
    from klute_sim.mocap.reference_folder import describe_filters

    count = len(imported.strides[imported.side])
    speed = "" if imported.walking_speed is None else f", {imported.walking_speed:.2f} m/s"
    filters = describe_filters(imported)
    return (
        f"{count} stride{'' if count == 1 else 's'} of the {imported.side} leg: {imported.stride_time:.3f} s{speed}, "
        f"toe-off at {imported.toe_off:.1f} %, {imported.mass:.1f} kg. Filters: angles {filters['angles']}; "
        f"loads {filters['loads']}."
    )
