"""``klute-sim plan``."""

import json
from pathlib import Path

import click

from klute_sim.cli import common
from klute_sim.cli.common import NonEmptyPath


@click.command("plan")
@click.argument("device_name", metavar="DEVICE")
@click.option("--out", type=NonEmptyPath(), required=True, metavar="FOLDER", help="New or empty folder for the plan.")
@click.option(
    "--repeats",
    type=int,
    default=2,
    show_default=True,
    metavar="N",
    help="Number of recordings of each protocol (2 to 26); the repeats measure the noise.",
)
@click.option(
    "--only",
    multiple=True,
    metavar="PROTOCOL",
    help="Protocol to plan (steps, ramps, sines, release, hold, slack, mixed); may be repeated.  [default: all]",
)
@click.option(
    "--simulate",
    is_flag=True,
    help="Also write simulated recordings with noise, to test the diagnosis. They are not measurements.",
)
@common.json_option()
def command(device_name: str, out: Path, repeats: int, only: tuple[str, ...], simulate: bool, as_json: bool) -> None:
    """Plan the measurements of a DEVICE (preset or device file) on a tensile tester.

    Writes one CSV file per protocol with the commands for the tester (time [s], length [mm] of the whole unit,
    pressure_command [bar]; 200 Hz), the device file, dataset.toml with the names of the files to record, and README.txt
    with instructions. README.txt also lists the changes of the rig that distinguish effects which the commands alone
    cannot distinguish.

    \b
    Examples:
      klute-sim plan klute-3-4-pair --out my-bench
      klute-sim plan my-device.toml --out short --only steps --only ramps --repeats 3
      klute-sim plan klute-3-4-pair --out trial-run --simulate
    """
    from klute_sim.api.diagnosis import plan_measurements
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import stdout_console
    from klute_sim.recording.run_folder import create_run_folder

    plan = plan_measurements(device_name, only=only, n_repeats=repeats, simulate=simulate)
    with create_run_folder("plan", out) as (folder, scratch):
        files = plan.write_files(scratch)
    if as_json:
        click.echo(json.dumps({"folder": str(folder), **plan.to_dict(), "files": files}, indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, plan.format_summary())
    console.print(f"Plan: {folder}; start with README.txt.", soft_wrap=True)
