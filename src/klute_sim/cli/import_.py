"""``klute-sim import``."""

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common, completion
from klute_sim.cli.common import NonEmptyPath
from klute_sim.cli.option_sections import Command, section

MIN_CADENCE, MAX_CADENCE = 48.0, 200.0
"""Allowed cadences [steps/min]: those of the allowed stride times."""


@click.command("import", cls=Command)
@click.argument("files", nargs=-1, required=True, metavar="FILES...", type=NonEmptyPath())
@section("Subject")
@click.option(
    "--mass",
    type=common.NumberWithUnit("kg"),
    default=None,
    metavar="KG",
    help="Body mass [kg].  [default: estimated from the ground reaction]",
)
@click.option(
    "--stature",
    type=common.NumberWithUnit("m"),
    default=None,
    metavar="M",
    help="Stature [m]; klute-sim gait uses it as its default.  [default: not stored]",
)
@common.REJECT_HEIGHT_OPTION
@click.option(
    "--side",
    type=click.Choice(["right", "left"]),
    default=None,
    help="Leg to import; with --dataset: side of the prosthesis.  [default: the leg with more strides]",
)
@section("Input")
@click.option(
    "--map",
    "map_file",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="TOML file with the columns, units, signs, zeros, markers and axes that cannot be detected from the names in "
    "the files (docs/import.md).",
)
@click.option(
    "--stride-duration",
    type=common.NumberWithUnit("s"),
    default=None,
    metavar="S",
    help="Duration [s] of the stride in a table over the gait cycle [%], which has no time.",
)
@click.option(
    "--cadence",
    type=common.NumberWithUnit("steps/min"),
    default=None,
    metavar="STEPS/MIN",
    help="Cadence in place of --stride-duration; a stride has two steps.",
)
@click.option(
    "--frame-rate",
    type=common.NumberWithUnit("Hz"),
    default=None,
    metavar="HZ",
    help="Frame rate [Hz] of Visual3D exports without the signal TIME.",
)
@common.ACCEPT_OPTION
@section("Processing")
@click.option(
    "--cutoff",
    type=common.NumberWithUnit("Hz"),
    default=None,
    metavar="HZ",
    help="Low-pass cut-off of angles and markers [Hz]; 0: no filter. Not with --dataset, which filters nothing.  "
    "[default: 6]",
)
@click.option(
    "--load-cutoff",
    type=common.NumberWithUnit("Hz"),
    default=None,
    metavar="HZ",
    help="Low-pass cut-off of ground reactions and moments [Hz]; 0: no filter. Not with --dataset.  [default: 20]",
)
@click.option(
    "--threshold",
    type=common.NumberWithUnit("N"),
    default=20.0,
    show_default=True,
    metavar="N",
    help="Vertical ground reaction [N] above which a foot counts as on the ground.",
)
@click.option(
    "--ankle-zero",
    type=click.Choice(["foot-flat", "file"]),
    default=None,
    help="Zero of the ankle angle: the flat foot in mid-stance, or the zero of the file.  [default: foot-flat; with "
    "--dataset: file]",
)
@click.option(
    "--ignore-events",
    is_flag=True,
    help="Cut strides at the foot strikes of the load, not at those that a C3D file lists.",
)
@section("Dataset")
@click.option(
    "--dataset",
    "as_dataset",
    is_flag=True,
    help="Create a dataset for klute-sim diagnose from trials with a prosthesis and from its log (docs/import.md).",
)
@click.option(
    "--device",
    shell_complete=completion.complete_device,
    default=None,
    metavar="NAME|FILE",
    help="With --dataset: prosthesis (preset or device file).",
)
@click.option(
    "--uncertain",
    multiple=True,
    metavar="KEY=SD",
    help="With --dataset: standard deviation of a device parameter, such as 'muscle.c10_kpa=10 %'; may be repeated.",
)
@click.option(
    "--repeats",
    type=int,
    default=None,
    metavar="N",
    help="With --dataset: number of consecutive trials that are repeats.  [default: trials with equal stride times and "
    "pressures]",
)
@section("Output")
@common.out_option("import", "the reference or the dataset")
@click.option("--verbose", is_flag=True, help="Print all decisions for each file; import.json always contains them.")
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
    stride_duration: float | None,
    cadence: float | None,
    frame_rate: float | None,
    ignore_events: bool,
    as_dataset: bool,
    device: str | None,
    uncertain: tuple[str, ...],
    repeats: int | None,
    accept: tuple[str, ...],
    out: Path | None,
    verbose: bool,
    as_json: bool,
) -> None:
    """Create a gait reference from motion-capture files, or a dataset for klute-sim diagnose.

    FILES are one or more trials: C3D (extra 'c3d'), OpenSim's .mot, .sto and .trc, CSV, Parquet, Visual3D's ASCII
    exports. A trial may consist of several files: angles, ground reaction, moments. Signs, axes, units and offsets are
    detected and reported with the reason, as is anything suspicious.

    Writes reference.csv, reference.toml, all strides (strides_right.parquet, strides_left.parquet) and import.json.
    With --dataset, writes dataset.toml, the trials as CSV files and import.json.

    \b
    Examples:
      klute-sim import trial.c3d --mass 70 --out my-subject
      klute-sim gait --reference my-subject
      klute-sim import ik.mot grf.mot id.sto --mass 70 --side left
      klute-sim import published-stride.csv --mass 70 --stride-duration 1.1
      klute-sim import walk1.csv walk2.csv --map my-columns.toml --json
      klute-sim import a.c3d a_log.csv b.c3d b_log.csv --dataset \\
        --device my.toml --side left --out my-trials
      klute-sim diagnose my-trials
    """
    from klute_sim.api.mocap import import_dataset, import_gait
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.recording.run_folder import create_run_folder

    reference_only = {
        "--cutoff": cutoff,
        "--load-cutoff": load_cutoff,
        "--stature": stature,
        "--stride-duration": stride_duration,
        "--cadence": cadence,
        "--ignore-events": ignore_events or None,
    }
    dataset_only = {"--device": device, "--uncertain": uncertain or None, "--repeats": repeats}
    _check_option_use(reference_only, dataset_only, as_dataset=as_dataset)
    common_options: dict[str, Any] = {"mass": mass, "side": side, "mapping": map_file, "contact_threshold": threshold}
    common_options |= {"frame_rate": frame_rate, "accept": accept}
    if ankle_zero is not None:
        common_options["ankle_zero"] = ankle_zero
    with create_run_folder("import", out) as (folder, scratch):
        if as_dataset:
            uncertainties = _parse_uncertainties(uncertain)
            with progress_bar("importing") as progress:
                dataset = import_dataset(
                    files,
                    _require_device(device),
                    uncertainties=uncertainties,
                    trials_per_group=repeats,
                    progress=progress,
                    **common_options,
                )
            content = dataset.write_files(scratch)
            summary = dataset.format_summary(content, verbose=verbose)
            next_step = f"Dataset: {folder}; diagnose it with klute-sim diagnose {folder}"
        else:
            cutoffs: dict[str, Any] = {"cutoff": cutoff, "load_cutoff": load_cutoff}
            with progress_bar("importing") as progress:
                gait = import_gait(
                    files,
                    stature=stature,
                    stride_time=_get_stride_time(stride_duration, cadence),
                    use_listed_events=not ignore_events,
                    progress=progress,
                    **{name: value for name, value in cutoffs.items() if value is not None},
                    **common_options,
                )
            content = gait.write_files(scratch)
            summary = gait.format_summary(verbose=verbose)
            next_step = f"Reference: {folder}; simulate it with klute-sim gait --reference {folder}"
    if as_json:
        click.echo(json.dumps({**content, "run": str(folder)}, indent=2, allow_nan=False))
    else:
        print_summary(stdout_console(), summary)
        stdout_console().print(next_step, soft_wrap=True)


def _check_option_use(reference_only: dict[str, Any], dataset_only: dict[str, Any], *, as_dataset: bool) -> None:
    """Raise InputError for an option of the other kind of import."""
    from klute_sim.errors import InputError

    for name, value in (reference_only if as_dataset else dataset_only).items():
        if value is None:
            continue
        if not as_dataset:
            raise InputError(f"{name} requires --dataset")
        reason = ": a dataset is not filtered" if "cutoff" in name else ""
        raise InputError(f"{name} cannot be combined with --dataset{reason}")


def _get_stride_time(stride_duration: float | None, cadence: float | None) -> float | None:
    """Return the stride time [s] by its duration [s] or by the cadence [steps/min]."""
    from klute_sim.errors import InputError

    if cadence is None:
        return stride_duration
    if stride_duration is not None:
        raise InputError("--cadence and --stride-duration state the same; pass one of them")
    if not MIN_CADENCE <= cadence <= MAX_CADENCE:
        raise InputError(f"cadence is {cadence:g}; allowed: {MIN_CADENCE:g} to {MAX_CADENCE:g} steps/min of both feet")
    return 120.0 / cadence


def _require_device(device: str | None) -> str:
    from klute_sim.errors import InputError

    if device is None:
        raise InputError("a dataset needs --device: the preset or the device file of the prosthesis")
    return device


def _parse_uncertainties(uncertain: tuple[str, ...]) -> dict[str, str | float]:
    """Return device parameter -> standard deviation, in per cent (text) or in the unit of the parameter (number)."""
    from klute_sim.errors import InputError

    uncertainties: dict[str, str | float] = {}
    for text in uncertain:
        key, equals, sd = text.partition("=")
        if not equals:
            raise InputError(f"--uncertain '{text}' does not have the form KEY=SD, such as 'muscle.c10_kpa=10 %'")
        uncertainties[key.strip()] = sd.strip()
        with suppress(ValueError):
            uncertainties[key.strip()] = float(sd)
    return uncertainties
