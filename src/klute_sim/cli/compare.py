"""``klute-sim compare``."""

import json
from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common
from klute_sim.cli.option_sections import Command, section


@click.command("compare", cls=Command)
@click.argument("runs", metavar="[LABEL=]RUN...", nargs=-1, required=True)
@section("Comparison")
@click.option(
    "--over",
    "domain",
    type=click.Choice(["phase", "time"]),
    default=None,
    help="Axis: strides over the gait cycle [%], or whole recordings over their common time [s].  [default: phase if "
    "every recording has gait_phase, or a grf_vertical from which strides are detected; otherwise time]",
)
@click.option(
    "--channel",
    "channels",
    multiple=True,
    metavar="NAME",
    help="Channel to compare, or 'all'; may be repeated.  [default: the main channels]",
)
@click.option(
    "--reference",
    is_flag=True,
    help="Add the reference of the first gait run as the series 'human' (that of one subject: 'subject NAME'), with "
    "its standard deviation between subjects (strides).",
)
@click.option(
    "--baseline",
    metavar="LABEL",
    default=None,
    help="Series with which the other series are compared.  [default: the first RUN]",
)
@click.option(
    "--skip",
    "skip_strides",
    type=click.IntRange(0),
    default=None,
    metavar="N",
    help="Number of strides to skip at the start of each recording.  [default: 1 for simulated gait, 0 for measured "
    "gait]",
)
@section("Output")
@common.out_option("compare", "the results")
@click.option("--no-report", is_flag=True, help="Write only the numbers, without page, figures and rerun recording.")
@common.json_option()
def command(
    runs: tuple[str, ...],
    domain: Any,
    channels: tuple[str, ...],
    reference: bool,
    baseline: str | None,
    skip_strides: int | None,
    out: Path | None,
    no_report: bool,
    as_json: bool,
) -> None:
    """Compare simulated or measured recordings channel by channel.

    A RUN is a folder of klute-sim gait or klute-sim bench, or a recording: a Parquet or CSV file with a column 'time
    [s]' and columns 'name [unit]'. Runs with the same LABEL are repeats and form one series. A single run is shown as
    its mean stride with a band.

    Strides are resampled to 0 to 100 % of the gait cycle (column 'gait_phase [%]'). Mean and standard deviation are
    computed over strides, or, with --over time, over repeats. Bias, rms and largest difference are those of each series
    minus the baseline, in the unit of the channel.

    Writes comparison.json, comparison.csv (one row per channel), bands.parquet (the curves), index.html, one PNG
    file per trial and, with the optional extra 'rerun', comparison.rrd.

    \b
    Examples:
      klute-sim compare runs/gait-001 runs/gait-002
      klute-sim compare profile=runs/gait-001 machine=runs/gait-002 \\
        --reference --baseline human
      klute-sim compare simulated=runs/gait-001 measured=a.csv \\
        measured=b.csv --channel ankle_angle
      klute-sim compare me/strides_right.parquet
      klute-sim compare runs/bench-001 runs/bench-002
      klute-sim compare runs/gait-001 runs/gait-002 --over time \\
        --channel pressure --json
    """
    from klute_sim.api.comparison import compare
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import progress_bar, stderr_console, stdout_console
    from klute_sim.recording.run_folder import create_run_folder

    with create_run_folder("compare", out) as (folder, scratch):
        result = compare(
            runs,
            domain=domain,
            channels=channels,
            reference=reference,
            baseline=baseline,
            skip_strides=skip_strides,
        )
        with progress_bar("drawing") as progress:
            content, notes = result.write_files(scratch, folder, report=not no_report, progress=progress)
    if as_json:
        click.echo(json.dumps(content, indent=2, allow_nan=False))
    else:
        console = stdout_console()
        print_summary(console, result.format_summary())
        console.print(f"Run folder: {folder}  ({', '.join(content['files'])})", soft_wrap=True)
    for note in notes:
        stderr_console().print(note, soft_wrap=True)
