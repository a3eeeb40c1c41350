"""``klute-sim compare``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common

if TYPE_CHECKING:
    from klute_sim.comparison.comparison import Comparison


RECORDING_FILE = "comparison.rrd"


@click.command("compare")
@click.argument("runs", metavar="[LABEL=]RUN...", nargs=-1, required=True)
@click.option(
    "--over",
    type=click.Choice(["phase", "time"]),
    default=None,
    help="Strides over the gait cycle [%], or whole recordings over their common time [s].  [default: phase if every "
    "recording has gait_phase, or a grf_vertical that shows its strides]",
)
@click.option(
    "--channel",
    "channels",
    multiple=True,
    metavar="NAME",
    help="Compare this channel; may be repeated; 'all' for every one.  [default: the main ones]",
)
@click.option(
    "--reference",
    is_flag=True,
    help="Put the human reference of the first walk beside, as the series 'human' with its ±1 sd between people.",
)
@click.option(
    "--to", metavar="LABEL", default=None, help="What the others are compared with.  [default: the first RUN]"
)
@click.option(
    "--skip",
    type=click.IntRange(0),
    default=None,
    metavar="N",
    help="Strides left out at the start of each recording.  [default: 1 of a simulated walk, 0 of a measured one]",
)
@common.out_option("compare", "the results")
@click.option("--no-report", is_flag=True, help="Write the numbers only: no page, picture, rerun recording.")
@common.json_option()
def command(
    runs: tuple[str, ...],
    over: Any,
    channels: tuple[str, ...],
    reference: bool,
    to: str | None,
    skip: int | None,
    out: Path | None,
    no_report: bool,
    as_json: bool,
) -> None:
    """Compare recordings, simulated or measured, channel by channel: how much they differ, and where.

    One alone is shown as the mean over its strides with their band.

    A RUN is a folder that gait or bench made, or a recording: Parquet or CSV with columns 'name [unit]' and 'time [s]'.
    Runs with the same LABEL are repeats of each other. Strides are brought to 0 to 100 % of the gait cycle (column
    'gait_phase [%]'); mean and standard deviation are over strides, or over repeats in time. The first RUN is what the
    others are compared with: bias, rms and largest difference are in the channel's own unit.

    Writes comparison.json, comparison.csv (a row per channel), bands.parquet (the curves), comparison.html, a PNG per
    trial and, with the extra 'rerun', comparison.rrd.

    \b
    Examples:
      klute-sim compare runs/gait-001 runs/gait-002
      klute-sim compare profile=runs/gait-001 machine=runs/gait-002 --reference --to human
      klute-sim compare simulated=runs/gait-001 measured=a.csv measured=b.csv --channel ankle_angle
      klute-sim compare me/strides_right.parquet
      klute-sim compare runs/bench-001 runs/bench-002
      klute-sim compare runs/gait-001 runs/gait-002 --over time --channel pressure --json
    """
    from klute_sim.cli.console import stderr_console, stdout_console
    from klute_sim.comparison import runs as given
    from klute_sim.comparison.comparison import ComparisonOptions, compare
    from klute_sim.recording import run_folder
    from klute_sim.report.comparison.table import build_tables, collect_remarks

    options = ComparisonOptions(
        domain=over, channels=channels, include_reference=reference, baseline=to, skip_strides=skip
    )
    with run_folder.create_run_folder("compare", out) as (folder, scratch):
        found = compare(given.read_runs(runs), options)
        told, missing = _write(found, folder, scratch, report=not no_report)
    if as_json:
        click.echo(_to_json(told))
    else:
        shown = stdout_console()
        for table in build_tables(found):
            shown.print(table)
        for remark in collect_remarks(found):
            shown.print(remark, soft_wrap=True)
        shown.print(f"Run folder: {folder}  ({', '.join(told['files'])})", soft_wrap=True)
    if missing:
        stderr_console().print(f"No comparison.rrd: {missing}.", soft_wrap=True)


def _write(comparison: "Comparison", folder: Path, scratch: Path, *, report: bool) -> tuple[dict[str, Any], str | None]:
    """Fill ``scratch``; what is in comparison.json, and what an optional extra would have added."""
    from klute_sim.comparison import results

    (scratch / "comparison.csv").write_text(results.format_csv(comparison), "utf-8")
    results.write_curves(comparison, scratch / "bands.parquet")
    missing = _write_report(comparison, scratch) if report else None
    files = [*sorted(file.name for file in scratch.iterdir()), "comparison.json"]
    told = {**results.as_json(comparison), "run": str(folder), "files": files}
    (scratch / "comparison.json").write_text(_to_json(told) + "\n", "utf-8")
    return told, missing


def _write_report(comparison: "Comparison", scratch: Path) -> str | None:
    from klute_sim.cli.console import progress_bar
    from klute_sim.errors import MissingExtraError
    from klute_sim.report.comparison import figures as comparison_figures
    from klute_sim.report.comparison import page as comparison_page
    from klute_sim.viewer.layouts import comparison as workbench

    pictures = {}
    with progress_bar("drawing") as progress:
        for number, (part, figure) in enumerate(comparison_figures.build_figures(comparison), start=1):
            file = scratch / f"{part.name or 'comparison'}.png"
            figure.savefig(file, dpi=comparison_figures.DPI)
            pictures[part.name] = file.read_bytes()
            progress(0.8 * number / min(len(comparison.parts), comparison_figures.MAX_FIGURES))
        missing, recording = None, RECORDING_FILE
        try:
            workbench.write_recording(comparison, scratch / RECORDING_FILE)
        except MissingExtraError as error:
            missing, recording = str(error), ""
        comparison_page.write_page(comparison, pictures, scratch / "comparison.html", recording)
    return missing


def _to_json(summary: dict[str, Any]) -> str:
    return json.dumps(summary, indent=2, allow_nan=False)
