"""``klute-sim assess``."""

import json
from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common
from klute_sim.cli.option_sections import Command, section


@click.command("assess", cls=Command)
@click.argument("references", nargs=-1, type=common.NonEmptyPath(), metavar="[REFERENCE]...")
@section("Model")
@click.option(
    "--only",
    multiple=True,
    metavar="NAME",
    help="Baseline to assess, or own: only those of --device and --controller; may be repeated.  [default: all]",
)
@common.USER_DEVICES_OPTION
@common.USER_CONTROLLERS_OPTION
@common.FOOT_OPTION
@section("Subject")
@common.STRIDE_TIME_OPTION
@common.ACCEPT_OPTION
@common.mass_option("the value in the folder of the reference, or 75")
@common.STATURE_OPTION
@common.REJECT_HEIGHT_OPTION
@section("Conditions")
@common.SPEED_OPTION
@section("Simulation")
@common.strides_option("Number of strides per gait")
@common.TIME_STEP_OPTION
@section("Output")
@common.out_option("assess", "the page")
@common.json_option("the tables")
def command(
    references: tuple[Path, ...],
    only: tuple[str, ...],
    devices: tuple[str, ...],
    controllers: tuple[str, ...],
    strides: int,
    step_ms: float,
    out: Path | None,
    as_json: bool,
    **subject: Any,
) -> None:
    """Assess whether a prosthesis serves a person, with how much air, and where it falls short.

    A REFERENCE is the gait of a person: a folder from klute-sim import, or a CSV file (docs/gait.md); without one,
    able-bodied adults. Every baseline walks on level ground as each person, and so do your own devices and controllers:
    the n-th --controller commands the n-th --device, and one that stands alone belongs to all.

    Each gait is compared with the person's own ankle: peak moment, peak power, net work, range, load, toe clearance and
    supply pressure. The limits are assumed and listed on the page.

    Writes index.html (tables, figures and a sentence for each shortfall) and assessment.json.

    \b
    Examples:
      klute-sim assess my-subject
      klute-sim assess my-subject --controller mine/tuned.csv \\
        --device my.toml --out page
      klute-sim assess anna ben --only tuned --only machine
      klute-sim assess my-subject --json | python -m json.tool
    """
    from klute_sim.api.assessment import assess
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.recording.run_folder import create_run_folder

    with create_run_folder("assess", out) as (folder, scratch):
        with progress_bar("simulating") as progress:
            result = assess(
                references or None,
                only=only,
                own=common.pair_devices_with_controllers(devices, controllers),
                strides=strides,
                time_step=1e-3 * step_ms,
                progress=progress,
                **subject,
            )
        content = result.write_files(scratch, folder)
    if as_json:
        click.echo(json.dumps(content, indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, result.format_summary())
    console.print(f"Folder: {folder}  ({', '.join(content['files'])})", soft_wrap=True)
