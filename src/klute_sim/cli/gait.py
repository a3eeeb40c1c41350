"""``klute-sim gait``."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common
from klute_sim.cli.nonempty_path import NonEmptyPath

if TYPE_CHECKING:
    from klute_sim.controllers.parse import Controller
    from klute_sim.device.device import Device
    from klute_sim.gait.rig.setup import GaitOptions
    from klute_sim.recording.recording import Recording


@click.command("gait")
@common.DEVICE_OPTION
@click.option(
    "--controller",
    "controller_word",
    default=None,
    metavar="WORD",
    help="profile (tuned by hand), off, constant:BAR, machine (states seen by its own sensors), or a file: a profile "
    "over gait phase (.csv), a state machine (.toml), a trained policy (.npz).  [default: profile, or off]",
)
@click.option(
    "--spring-foot",
    type=common.NumberWithUnit("N·m/deg"),
    default=None,
    metavar="STIFFNESS",
    help="A passive foot in place of the device, as most people wear; those have 3 to 15 [N·m/deg].",
)
@click.option(
    "--reference",
    "reference_file",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE|FOLDER",
    help="Gait cycle: a folder made by klute-sim import, or a CSV of docs/gait.md.  [default: able-bodied adults]",
)
@click.option(
    "--stride-time",
    type=common.NumberWithUnit("s"),
    default=None,
    metavar="S",
    help="Stride time of --reference [s].  [default: what its folder states, or 1.1]",
)
@click.option(
    "--mass",
    type=common.NumberWithUnit("kg"),
    default=None,
    metavar="KG",
    help="Body mass [kg].  [default: what the folder of --reference states, or 75]",
)
@click.option(
    "--stature",
    type=common.NumberWithUnit("m"),
    default=None,
    metavar="M",
    help="Stature [m].  [default: what the folder of --reference states, or 1.75]",
)
@common.REJECT_HEIGHT_OPTION
@click.option(
    "--speed",
    type=common.NumberWithUnit("m/s"),
    default=None,
    metavar="M/S",
    help="Walking speed [m/s]; scales the stride time.  [default: what reference and legs imply]",
)
@click.option(
    "--slope",
    type=common.NumberWithUnit("degrees"),
    default=0.0,
    show_default=True,
    metavar="DEG",
    help="Of the ground, uphill positive; the limb's motion on it is assumed [degrees].",
)
@common.strides_option("Strides to walk")
@common.TIME_STEP_OPTION
@click.option(
    "--law",
    type=click.Choice(["auto", "compiled", "python"]),
    default="auto",
    show_default=True,
    help="The device's law compiled, or as plain Python (the reference: same bits); auto: compiled if possible.",
)
@common.out_option("gait", "the run")
@click.option("--csv", "with_csv", is_flag=True, help="Write recording.csv, too.")
@common.json_option()
def command(
    device_name: str | None,
    controller_word: str | None,
    spring_foot: float | None,
    reference_file: Path | None,
    stride_time: float | None,
    mass: float | None,
    stature: float | None,
    speed: float | None,
    slope: float,
    strides: int,
    step_ms: float,
    law: str,
    out: Path | None,
    with_csv: bool,
    as_json: bool,
) -> None:
    """Walk the prosthesis on measured human gait.

    The residual limb follows the reference's motion and the reference's vertical load is applied to it; the ankle is
    moved by the device, its passive parts and the ground alone. Ankle angle, net moment, power, work and centre of
    pressure are outcomes; vertical ground reaction is tracked, not predicted, and fore-aft reaction partly so.

    Writes recording.parquet, summary.json, report.png, device.toml and, with the extra 'rerun', recording.rrd.

    \b
    Examples:
      klute-sim gait
      klute-sim gait --controller off --strides 3
      klute-sim gait --slope -5 --speed 1.0 --controller machine
      klute-sim gait --spring-foot 6
      klute-sim gait --device my-device.toml --mass 82 --stature 1.80 --speed 1.3
      klute-sim gait --json | python -m json.tool
    """
    from klute_sim.cli.console import stderr_console
    from klute_sim.controllers import parse
    from klute_sim.device.device import DEFAULT_DEVICE, load_device
    from klute_sim.errors import InputError
    from klute_sim.gait import reference
    from klute_sim.gait.rig.setup import GaitOptions
    from klute_sim.gait.spring_foot import SpringFoot
    from klute_sim.recording import run_folder

    device = load_device(DEFAULT_DEVICE if device_name is None else device_name)
    chosen = parse.parse_controller(
        controller_word if controller_word is not None else "off" if spring_foot else "profile"
    )
    if spring_foot is not None and controller_word not in (None, "off"):
        raise InputError("a spring foot takes no pressure: --spring-foot goes with --controller off, or without one")
    foot = None if spring_foot is None else SpringFoot(stiffness=math.degrees(spring_foot))
    beyond = _check_supply_pressure(device, chosen)
    if stride_time is not None and reference_file is None:
        raise InputError("--stride-time goes with --reference")
    human = reference.load_default_reference()
    if reference_file is not None:
        human = reference.load_reference(reference_file, stride_time)
    options = GaitOptions(
        mass=_first_not_none(mass, human.mass, GaitOptions.mass),
        stature=_first_not_none(stature, human.stature, GaitOptions.stature),
        speed=speed,
        slope=math.radians(slope),
        strides=strides,
        dt=1e-3 * step_ms,
        reference=human,
        spring_foot=foot,
    )
    with run_folder.create_run_folder("gait", out) as (folder, scratch):
        recording = _simulate(device, chosen, options, law)
        result, missing = _write(recording, device, options, folder, scratch, with_csv=with_csv)
    _report(recording, result, missing, as_json=as_json)
    if beyond:
        stderr_console().print(beyond, soft_wrap=True)


def _first_not_none(*values: float | None) -> float:
    """The first that is one."""
    return next(value for value in values if value is not None)


def _check_supply_pressure(device: "Device", controller: "Controller") -> str:
    """What to say of a profile that asks for more than the supply has; raises InputError for a constant that does."""
    from klute_sim.controllers.pressure import ConstantPressure, PressureProfile
    from klute_sim.errors import InputError
    from klute_sim.units import BAR

    most = device.parameters.supply.max_pressure / BAR
    if isinstance(controller, ConstantPressure) and controller.gauge_pressure / BAR > most:
        raise InputError(
            f"pressure is {controller.gauge_pressure / BAR:g} bar; the supply of '{device.name}' has {most:g} bar"
        )
    if isinstance(controller, PressureProfile) and max(controller.pressure_bar) > most:
        return f"The profile asks for up to {max(controller.pressure_bar):g} bar; the supply has {most:g} bar."
    return ""


def _simulate(device: "Device", controller: "Controller", options: "GaitOptions", backend: str) -> "Recording":
    from klute_sim.cli.console import progress_bar
    from klute_sim.gait.rig.rig import simulate_gait

    with progress_bar("walking") as progress:
        return simulate_gait(device, controller, options, progress, backend)


def _write(
    recording: "Recording", device: "Device", options: "GaitOptions", folder: Path, scratch: Path, *, with_csv: bool
) -> tuple[dict[str, Any], str | None]:
    """Fill ``scratch``; the summary, and what an optional extra would have added."""
    from klute_sim.cli.console import progress_bar
    from klute_sim.errors import MissingExtraError
    from klute_sim.gait.metrics import compute_gait_metrics, summarize_gait_run
    from klute_sim.gait.rig.build import build_gait_model
    from klute_sim.recording import csv, parquet
    from klute_sim.report.gait import figure
    from klute_sim.viewer.layouts import gait as workbench

    missing = None
    with progress_bar("writing") as progress:
        (scratch / "device.toml").write_bytes(device.content)
        parquet.write(recording, scratch / "recording.parquet")
        if with_csv:
            csv.write(recording, scratch / "recording.csv")
        progress(0.2)
        figure.save_figure(recording, scratch / "report.png")
        progress(0.6)
        try:
            model = build_gait_model(device, mass=options.mass, stature=options.stature, dt=options.dt)
            workbench.write_recording(recording, model, scratch / "recording.rrd")
        except MissingExtraError as error:
            missing = str(error)
        files = [*sorted(file.name for file in scratch.iterdir()), "summary.json"]
        result = {**summarize_gait_run(recording, compute_gait_metrics(recording)), "run": str(folder), "files": files}
        (scratch / "summary.json").write_text(_to_json(result) + "\n", "utf-8")
    return result, missing


def _to_json(result: dict[str, Any]) -> str:
    return json.dumps(result, indent=2, allow_nan=False)


def _report(recording: "Recording", result: dict[str, Any], missing: str | None, *, as_json: bool) -> None:
    from klute_sim.cli.console import stderr_console, stdout_console
    from klute_sim.gait.metrics import compute_gait_metrics
    from klute_sim.report.gait.table import build_table, collect_remarks

    if as_json:
        click.echo(_to_json(result))
    else:
        out = stdout_console()
        out.print(build_table(recording, compute_gait_metrics(recording), out.width))
        for remark in collect_remarks(result):
            out.print(remark, soft_wrap=True)
        out.print(f"Run folder: {result['run']}  ({', '.join(result['files'])})", soft_wrap=True)
    if missing:
        stderr_console().print(f"No recording.rrd: {missing}.", soft_wrap=True)
