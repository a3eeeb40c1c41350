"""What the commands that simulate and record a run have in common."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from klute_sim.api.recorded_run import RecordedRun
    from klute_sim.api.rendering import Summary
    from klute_sim.types import ProgressCallback

CSV_OPTION = click.option("--csv", "with_csv", is_flag=True, help="Also write recording.csv.")
"""``--csv`` of a command that writes a recording."""


def backend_option(subject: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return ``--backend``; ``subject`` is what it computes."""
    return click.option(
        "--backend",
        type=click.Choice(["auto", "compiled", "python"]),
        default="auto",
        show_default=True,
        help=f"Implementation of {subject}: compiled code or plain Python; both give identical numbers. auto: compiled "
        "code if possible.",
    )


def simulate_and_write(
    kind: str,
    stage: str,
    simulate: "Callable[[ProgressCallback], RecordedRun]",
    *,
    out: Path | None,
    with_csv: bool,
    as_json: bool,
    format_details: "Callable[[Any], Summary] | None" = None,
) -> None:
    """Simulate a run, write its folder (None: the next ``runs/KIND-NNN``) and print its summary.

    ``simulate`` receives the callback of the progress bar, which begins with ``stage``; ``format_details`` of the run
    are printed after its summary.
    """
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import progress_bar, stderr_console, stdout_console
    from klute_sim.recording.run_folder import create_run_folder

    with create_run_folder(kind, out) as (folder, scratch):
        with progress_bar(stage) as progress:
            run = simulate(progress)
        with progress_bar("writing") as progress:
            summary, notes = run.write_files(scratch, folder, with_csv=with_csv, progress=progress)
    if as_json:
        click.echo(json.dumps(summary, indent=2, allow_nan=False))
    else:
        console = stdout_console()
        print_summary(console, run.format_summary())
        if format_details is not None:
            print_summary(console, format_details(run))
        console.print(f"Run folder: {folder}  ({', '.join(summary['files'])})", soft_wrap=True)
    for sentence in (*run.warnings, *notes):
        stderr_console().print(sentence, soft_wrap=True)
