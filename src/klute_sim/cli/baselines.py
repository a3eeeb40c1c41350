"""``klute-sim baselines``."""

import json
from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common
from klute_sim.cli.option_sections import Command, section


@click.command("baselines", cls=Command)
@section("Model")
@click.option(
    "--only",
    multiple=True,
    metavar="NAME",
    help="Baseline to simulate, or own: only those of --device and --controller; may be repeated.  [default: all]",
)
@common.USER_DEVICES_OPTION
@common.USER_CONTROLLERS_OPTION
@common.FOOT_OPTION
@section("Subject")
@common.REFERENCE_OPTION
@common.STRIDE_TIME_OPTION
@common.ACCEPT_OPTION
@common.mass_option()
@common.STATURE_OPTION
@common.REJECT_HEIGHT_OPTION
@section("Conditions")
@common.SPEED_OPTION
@common.slope_option("Ground slope of the conditions uphill and downhill [deg].", default=5.0)
@section("Simulation")
@common.strides_option("Number of strides per run")
@common.TIME_STEP_OPTION
@common.jobs_option()
@section("Output")
@common.resumable_out_option("baselines", "the runs")
@common.json_option("the tables")
def command(
    only: tuple[str, ...],
    devices: tuple[str, ...],
    controllers: tuple[str, ...],
    strides: int,
    step_ms: float,
    jobs: int,
    out: Path | None,
    as_json: bool,
    **subject: Any,
) -> None:
    """Simulate passive feet and standard controllers, with which a new device or controller can be compared.

    The controllers are off, constant, hand-tuned, machine, tuned and trained. Each baseline is simulated at the speed
    of the reference, at 0.8 and 1.25 times this speed, and 5 degrees uphill and downhill. So are your own devices and
    controllers: the n-th --controller commands the n-th --device, and one that stands alone belongs to all.

    The distance to human gait is given only on level ground at the speed of the reference, because the reference was
    measured there. For the other conditions we assume that thigh angle, shank angle and ground reaction stay the same
    in space, and that their time scales with the speed.

    Writes index.html, figure.png, baselines.json, table.json and one file per run.

    \b
    Examples:
      klute-sim baselines
      klute-sim baselines --only hand-tuned --only machine --mass 90
      klute-sim baselines --reference my-subject --device my.toml \\
        --controller mine.csv
      klute-sim baselines --only own --controller mine.csv --controller machine
    """
    from klute_sim.api.baselines import simulate_baselines
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import progress_bar, stdout_console

    with progress_bar("simulating") as progress:
        result = simulate_baselines(
            only,
            own=common.pair_devices_with_controllers(devices, controllers),
            strides=strides,
            time_step=1e-3 * step_ms,
            folder=out,
            n_jobs=jobs,
            progress=progress,
            **subject,
        )
    result.save()
    if as_json:
        click.echo(json.dumps(result.to_json(), indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, result.format_summary())
    console.print(f"Folder: {result.folder}  (index.html, figure.png, table.json)", soft_wrap=True)
