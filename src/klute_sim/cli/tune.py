"""``klute-sim tune``."""

import json
from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common
from klute_sim.cli.option_sections import Command, section

GAIT, WALK, JOINT = ("gait",), ("walk",), ("joint",)
GAIT_NAMES = ("profile_path", "goal_human", "reference", "stride_time", "accept", "mass", "stature", "slope")
OPTION_RIGS = {
    **dict.fromkeys(GAIT_NAMES, GAIT),
    **dict.fromkeys(("foot", "speed"), (*GAIT, *WALK)),
    **dict.fromkeys(("machine", "walkers", "uneven", "pushes"), WALK),
    **dict.fromkeys(("controller_keys", "seconds"), (*WALK, *JOINT)),
    **dict.fromkeys(("gains", "load", "episodes"), JOINT),
}
"""Option -> rigs that take it."""
EXAMPLES = {"--weight": "air=0.5", "--gain": "proportional=4"}
"""Option -> an example of its value."""
GAIT_BUDGET, BUDGET = 600, 150
"""Default number of evaluations on the gait rig and elsewhere."""
WALK_SECONDS, EPISODE_SECONDS = 10.0, 5.0
"""Default duration of a predicted walk and of an episode of the joint [s]."""


@click.command("tune", cls=Command)
@section("Model")
@common.RIG_OPTION
@common.DEVICE_OPTION
@common.FOOT_OPTION
@common.WALKERS_OPTION
@common.subject_options
@click.option(
    "--uneven",
    type=common.NumberWithUnit("mm"),
    default=0.0,
    metavar="MM",
    help="With --rig walk: largest height of the blocks of 0.5 m on the ground [mm].  [default: 0]",
)
@common.PUSHES_OPTION
@click.option(
    "--load",
    type=common.NumberWithUnit("kg"),
    default=None,
    metavar="KG",
    help="With --rig joint: mass at the end of the lever [kg].  [default: that of the model, 1]",
)
@section("Simulation")
@click.option(
    "--seconds",
    type=common.NumberWithUnit("s"),
    default=None,
    metavar="S",
    help="With --rig walk or joint: duration of a walk or an episode [s]; the best points walk twice as long at the "
    "end.  [default: 10, or 5 with --rig joint]",
)
@click.option(
    "--episodes",
    type=click.IntRange(1, 1000),
    default=8,
    metavar="N",
    help="With --rig joint: episodes of an evaluation; the best points have twice as many at the end.  [default: 8]",
)
@section("Objective")
@click.option(
    "--goal-human",
    is_flag=True,
    help="Penalize a gait that misses the goals of the human ankle: rms moment distance of at most 0.39 sd, peak "
    "power of at least 3.31 W/kg, net work of at least 0.218 J/kg, peak plantarflexion of at least 15 deg; with "
    "--reference, the last three in proportion to the ankle of the reference.",
)
@click.option(
    "--weight",
    "weights",
    multiple=True,
    metavar="TERM=W",
    help="Weight of the TERM moment, angle, power [1/sd²] or air [1/g], or with --rig walk effort [kg·m/J], speed "
    "[s/m] or symmetry [1], or with --rig joint angle [1/deg] or smoothness [1]; may be repeated.  [default: moment=1, "
    "angle=1, power=1, air=0.1; effort=1, speed=10, symmetry=10; angle=1, smoothness=10]",
)
@section("Search")
@click.option(
    "--profile",
    "profile_path",
    type=common.NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="Initial profile: CSV with columns gait_pct,pressure_bar.  [default: the hand-tuned profile]",
)
@click.option(
    "--machine",
    type=common.NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="With --rig walk: initial state machine (.toml).  [default: the state machine of the package]",
)
@click.option(
    "--gain",
    "gains",
    multiple=True,
    metavar="NAME=V",
    help="With --rig joint: initial gain of the PID controller, proportional [1/rad], integral [1/(rad s)], "
    "derivative [s/rad] or mean (action, -1 to 1); may be repeated.  [default: the gains of the package]",
)
@click.option(
    "--only",
    "controller_keys",
    multiple=True,
    metavar="NUMBER",
    help="Number to tune: with --rig walk of the state machine, such as push_off_bar; with --rig joint a gain; may be "
    "repeated.  [default: all pressures, and lean_deg; all gains]",
)
@click.option("--with-device", is_flag=True, help="Also tune orifices, springs, resting length and mounting.")
@click.option(
    "--also",
    "device_keys",
    multiple=True,
    metavar="KEY",
    help="Number of the device to tune in addition, such as damper.bore_mm; may be repeated.",
)
@click.option(
    "--budget",
    type=click.IntRange(1, 1_000_000),
    default=None,
    metavar="N",
    help="Number of evaluations, rounded up to whole generations of the search.  [default: 600; 150 with --rig walk or "
    "joint]",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    metavar="N",
    help="Random seed of the search.",
)
@common.jobs_option()
@section("Output")
@common.resumable_out_option("tune", "the search")
@common.json_option()
@click.pass_context
def command(
    context: click.Context,
    /,
    rig: str,
    device_name: str,
    profile_path: Path | None,
    goal_human: bool,
    machine: Path | None,
    gains: tuple[str, ...],
    load: float | None,
    episodes: int,
    controller_keys: tuple[str, ...],
    walkers: tuple[str, ...],
    seconds: float | None,
    uneven: float,
    pushes: tuple[tuple[float, float], ...],
    weights: tuple[str, ...],
    budget: int | None,
    jobs: int,
    out: Path | None,
    as_json: bool,
    with_device: bool,
    device_keys: tuple[str, ...],
    seed: int,
    foot: str | None,
    speed: float | None,
    **subject: Any,
) -> None:
    """Tune a pressure profile, and optionally the device, for human-like gait at low air consumption.

    The objective is the mean squared distance of net moment, angle and power from the reference in stance, in standard
    deviations of the reference, plus 0.1 per gram of air in a stride. Penalties apply to a peak moment that differs by
    more than 8 % from that of the reference, to a muscle at its stop, to poor load tracking and to a toe clearance
    below 3 mm. A gait in which the foot catches in swing always costs more than a gait in which it does not. Standard
    deviations that --reference does not state, or that --speed and --slope make doubtful, are assumed and reported as
    such.

    The search method is CMA-ES. At the end, the best tenth of the evaluations is repeated with a finer time step, and
    the best of these is the result. Every evaluation is stored: the same command resumes an interrupted search, also
    with a larger --budget.

    With --rig walk it tunes the state machine, and optionally the device, for persons who walk by muscles and reflexes:
    metabolic cost, deviation from the speed (--speed, 1.25 m/s by default) and step asymmetry, and falls, which cost
    more than any walk. The persons do not adapt to what is tuned. It writes tuned.toml in place of tuned.csv.

    With --rig joint it tunes the PID controller, and optionally the devices, of a lever between two devices
    (klute_sim/AntagonistJoint-v0) for small errors of the angle and calm commands. It writes tuned.toml, the gains.

    Writes index.html with figure.png, tuned.csv (for gait --controller), device.toml if the device is tuned, a CSV file
    with one row per evaluation, tuning.json, and one file per evaluation. Needs the optional extra 'tune'.

    \b
    Examples:
      klute-sim tune
      klute-sim tune --weight air=0.5 --budget 2000 --out low-air
      klute-sim tune --reference my-subject --out mine
      klute-sim tune --with-device --goal-human --budget 4000 --out human
      klute-sim gait --controller human/tuned.csv --device human/device.toml
      klute-sim tune --rig walk --only push_off_bar --only lean_deg --out walking
      klute-sim walk --controller walking/tuned.toml
      klute-sim tune --rig joint --load 2 --only proportional \\
        --only integral --out heavy
    """
    from klute_sim.api.joint_tuning import JointTuningResult, tune_joint
    from klute_sim.api.rendering import print_summary
    from klute_sim.api.tuning import TuningResult, tune
    from klute_sim.api.walk_tuning import WalkTuningResult, tune_walk
    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.envs.antagonist_joint import DEFAULT_JOINT_DEVICE

    common.check_rig_options(context, rig, OPTION_RIGS)
    search: dict[str, Any] = {"with_device": with_device, "device_keys": device_keys, "seed": seed}
    search |= {"weights": _parse_numbers("--weight", weights), "folder": out, "n_jobs": jobs}
    result: TuningResult | WalkTuningResult | JointTuningResult
    with progress_bar("tuning") as progress:
        if rig == "joint":
            joint: dict[str, Any] = {"gain_keys": controller_keys} if controller_keys else {}
            result = tune_joint(
                device_name if common.is_given(context, "device_name") else DEFAULT_JOINT_DEVICE,
                gains=_parse_numbers("--gain", gains),
                load=load,
                episodes=episodes,
                seconds=EPISODE_SECONDS if seconds is None else seconds,
                budget=budget or BUDGET,
                progress=progress,
                **joint,
                **search,
            )
        elif rig == "walk":
            walk: dict[str, Any] = {"machine_keys": controller_keys} if controller_keys else {}
            walk |= {} if speed is None else {"speed": speed}
            result = tune_walk(
                device_name,
                machine=machine,
                foot=foot,
                walkers=walkers,
                seconds=WALK_SECONDS if seconds is None else seconds,
                uneven=uneven,
                pushes=pushes or [(0.0, 0.0)],
                budget=budget or BUDGET,
                progress=progress,
                **walk,
                **search,
            )
        else:
            result = tune(
                device_name,
                profile=profile_path,
                foot=foot,
                goal_human=goal_human,
                budget=budget or GAIT_BUDGET,
                speed=speed,
                progress=progress,
                **search,
                **subject,
            )
        content = result.write_files(result.folder)
    if as_json:
        click.echo(json.dumps(content, indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, result.format_summary())
    console.print(f"Folder: {result.folder}  ({', '.join(content['files'])})", soft_wrap=True)


def _parse_numbers(option: str, texts: tuple[str, ...]) -> dict[str, float]:
    from klute_sim.errors import InputError

    numbers = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            numbers[name] = float(value)
        except ValueError:
            raise InputError(
                f"{option} is '{text}'; allowed: a name and a number, such as {EXAMPLES[option]}"
            ) from None
    return numbers
