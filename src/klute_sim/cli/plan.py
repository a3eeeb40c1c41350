"""``klute-sim plan``."""

import json
from pathlib import Path

import click

from klute_sim.cli import common, completion
from klute_sim.cli.common import NonEmptyPath
from klute_sim.cli.option_sections import Command, section


@click.command("plan", cls=Command)
@click.argument("device_name", metavar="DEVICE", shell_complete=completion.complete_device)
@section("Model")
@click.option(
    "--model",
    metavar="NAME|FILE",
    help="Plan tests of a joint or a free load instead: a model of the package, or an MJCF file with one joint. --only "
    "names its tests then (steps, sines, multisine, co-contraction, quick-release).",
)
@section("Conditions")
@click.option(
    "--only",
    shell_complete=completion.complete_identification_protocol,
    multiple=True,
    metavar="PROTOCOL",
    help="Protocol to plan (steps, ramps, sines, release, hold, slack, mixed); may be repeated.  [default: all "
    "that reveal something of the device]",
)
@click.option(
    "--repeats",
    type=int,
    default=2,
    show_default=True,
    metavar="N",
    help="Number of recordings of each protocol (2 to 26); the repeats measure the noise.",
)
@common.pressure_options("With --model: ")
@click.option(
    "--load",
    type=common.NumberWithUnit("N m, or N on a slide"),
    default=None,
    metavar="VALUE",
    help="With --model: load of co-contraction and quick-release [N m; N on a slide].  [default: none, without them]",
)
@section("Output")
@click.option(
    "--simulate",
    is_flag=True,
    help="Also write simulated recordings with noise, to test the diagnosis. They are not measurements.",
)
@click.option("--out", type=NonEmptyPath(), required=True, metavar="FOLDER", help="New or empty folder for the plan.")
@common.json_option()
@click.pass_context
def command(
    context: click.Context,
    device_name: str,
    out: Path,
    repeats: int,
    only: tuple[str, ...],
    model: str | None,
    mean_bar: float,
    difference_bar: float,
    load: float | None,
    simulate: bool,
    as_json: bool,
) -> None:
    """Plan the measurements of a DEVICE (preset or device file) on a tensile tester, or with --model on a joint.

    Writes one CSV file per protocol with the commands for the tester (time [s], length [mm] of the whole unit, and with
    a supply pressure_command [bar]; 200 Hz), the device file, dataset.toml with the names of the files to record, and
    README.txt with instructions. README.txt also lists the changes of the rig that distinguish effects which the
    commands alone cannot distinguish.

    \b
    Examples:
      klute-sim plan klute-3-4-pair --out my-bench
      klute-sim plan my-device.toml --out short --only steps --only ramps \\
        --repeats 3
      klute-sim plan klute-3-4-pair --out trial-run --simulate
      klute-sim plan klute-3-4-pair --model antagonist_joint --load -2 \\
        --out my-joint
    """
    from klute_sim.api.diagnosis import MeasurementPlan, plan_measurements
    from klute_sim.api.joint_plan import JointPlan, plan_joint_measurements
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import stdout_console
    from klute_sim.errors import InputError
    from klute_sim.recording.run_folder import create_run_folder

    plan: MeasurementPlan | JointPlan
    if model is None:
        for name, option in {"mean_bar": "--mean", "difference_bar": "--difference", "load": "--load"}.items():
            if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
                raise InputError(f"{option} belongs to a joint; name its model with --model, or remove {option}")
        plan = plan_measurements(device_name, only=only, n_repeats=repeats, simulate=simulate)
    else:
        plan = plan_joint_measurements(
            device_name,
            model=model,
            only=only,
            n_repeats=repeats,
            mean_pressure_bar=mean_bar,
            difference_bar=difference_bar,
            load=load,
            simulate=simulate,
        )
    with create_run_folder("plan", out) as (folder, scratch):
        files = plan.write_files(scratch)
    if as_json:
        click.echo(json.dumps({"folder": str(folder), **plan.to_dict(), "files": files}, indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, plan.format_summary())
    console.print(f"Plan: {folder}; start with README.txt.", soft_wrap=True)
