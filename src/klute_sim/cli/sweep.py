"""``klute-sim sweep``."""

import json
from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common, completion
from klute_sim.cli.option_sections import Command, section

REFERENCE_SPEED = "reference"
"""Keyword for the speed that reference and leg length imply."""


def _parse_numbers(context: click.Context, option: click.Parameter, values: tuple[str, ...]) -> list[float]:
    """Return each number once, in the order given."""
    return list(dict.fromkeys(_parse_number(text, option, "a number") for text in _split_values(values)))


def _parse_speeds(context: click.Context, option: click.Parameter, values: tuple[str, ...]) -> list[float | None]:
    """Return each speed once, in the order given; None for the keyword of the reference speed."""
    expected = f"a number or {REFERENCE_SPEED!r}"
    return list(
        dict.fromkeys(
            None if text == REFERENCE_SPEED else _parse_number(text, option, expected) for text in _split_values(values)
        )
    )


def _parse_lists(context: click.Context, option: click.Parameter, values: tuple[str, ...]) -> dict[str, list[float]]:
    """Return the values of each number, given as ``NAME=V,...``."""
    lists = {}
    for value in values:
        name, separator, numbers = value.partition("=")
        if not separator:
            example = EXAMPLE_LISTS[str(option.name)]
            raise click.BadParameter(f"'{value}' is not of the form {example}", param=option)
        lists[name.strip()] = _parse_numbers(context, option, (numbers,))
    return lists


def _split_values(values: tuple[str, ...]) -> list[str]:
    return [text.strip() for value in values for text in value.split(",")]


def _parse_number(text: str, option: click.Parameter, expected: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise click.BadParameter(f"'{text}' is not {expected}", param=option) from None


GAIT, WALK, JOINT = ("gait",), ("walk",), ("joint",)
OPTION_RIGS = {
    **dict.fromkeys(("speeds", "references", "stride_times", "accept", "masses", "statures", "strides"), GAIT),
    **dict.fromkeys(("controllers", "slopes", "spring_feet", "feet"), (*GAIT, *WALK)),
    **dict.fromkeys(("machine", "walkers", "uneven", "pushes"), WALK),
    **dict.fromkeys(("seconds", "seed"), (*WALK, *JOINT)),
    **dict.fromkeys(("gains", "loads", "episodes"), JOINT),
}
"""Option -> rigs that take it."""
WALK_STEP_MS = 1.0
"""Default time step of a predicted walk [ms]."""
WALK_SECONDS, EPISODE_SECONDS = 20.0, 5.0
"""Default duration of a predicted walk and of an episode of the joint [s]."""
EXAMPLE_LISTS = {"machine": "push_off_bar=3.4,4.4", "gains": "proportional=2,4"}
"""Option -> an example of its values."""


@click.command("sweep", cls=Command)
@section("Model")
@common.RIG_OPTION
@click.option(
    "--device",
    "devices",
    shell_complete=completion.complete_device,
    multiple=True,
    metavar="NAME|FILE",
    help="Device: name of a preset, or a device file; may be repeated.  [default: klute-1-1-4-pair]",
)
@click.option(
    "--controller",
    "controllers",
    multiple=True,
    metavar="SPEC",
    help="Pressure controller, as in 'klute-sim gait': profile, off, constant:BAR, machine, or a file; may be "
    "repeated.  [default: profile, or machine with --rig walk]",
)
@click.option(
    "--machine",
    callback=_parse_lists,
    multiple=True,
    metavar="NUMBER=V,...",
    help="With --rig walk: values of a number of the state machine, such as push_off_bar=3.4,4.4 (pressure) or "
    "lean_deg=10,14 (timing of push-off); may be repeated for every combination.",
)
@click.option(
    "--gain",
    "gains",
    callback=_parse_lists,
    multiple=True,
    metavar="NAME=V,...",
    help="With --rig joint: values of a gain of the PID controller, proportional [1/rad], integral [1/(rad s)], "
    "derivative [s/rad] or mean (action, -1 to 1); may be repeated for every combination.",
)
@click.option(
    "--spring-foot",
    "spring_feet",
    callback=_parse_numbers,
    multiple=True,
    metavar="STIFFNESS,...",
    help="Stiffnesses [N·m/deg] of passive feet, simulated in addition to --device; without --device, only these feet "
    "are simulated.  [default: no passive foot]",
)
@click.option(
    "--foot",
    "feet",
    multiple=True,
    metavar="NAME",
    help=f"{common.FOOT_HELP}; may be repeated.  [default: that of the device, or rigid]",
)
@common.WALKERS_OPTION
@section("Subject")
@click.option(
    "--reference",
    "references",
    multiple=True,
    metavar="FILE|FOLDER",
    help="Reference gait: a folder from klute-sim import, a CSV file (docs/gait.md), a pattern in quotes for several, "
    "or 'able-bodied', the reference of this package; may be repeated.  [default: able-bodied]",
)
@click.option(
    "--stride-time",
    "stride_times",
    callback=_parse_numbers,
    multiple=True,
    metavar="S,...",
    help="Stride times of --reference [s].  [default: the value in its folder, or 1.1]",
)
@common.ACCEPT_OPTION
@click.option(
    "--mass",
    "masses",
    callback=_parse_numbers,
    multiple=True,
    metavar="KG,...",
    help="Body masses [kg].  [default: the value in the folder of --reference, or 75]",
)
@click.option(
    "--stature",
    "statures",
    callback=_parse_numbers,
    multiple=True,
    metavar="M,...",
    help="Statures [m].  [default: the value in the folder of --reference, or 1.75]",
)
@common.REJECT_HEIGHT_OPTION
@section("Conditions")
@click.option(
    "--speed",
    "speeds",
    callback=_parse_speeds,
    multiple=True,
    metavar="M/S,...",
    help="Walking speeds [m/s]; 'reference' means the speed computed from reference and leg length.  [default: "
    "reference]",
)
@click.option(
    "--slope",
    "slopes",
    callback=_parse_numbers,
    multiple=True,
    metavar="DEG,...",
    help="Ground slopes [deg], uphill positive; limb kinematics on slopes are assumed.  [default: 0]",
)
@click.option(
    "--uneven",
    callback=_parse_numbers,
    multiple=True,
    metavar="MM,...",
    help="With --rig walk: largest heights of the blocks of 0.5 m on the ground [mm].  [default: 0]",
)
@common.PUSHES_OPTION
@click.option(
    "--load",
    "loads",
    callback=_parse_numbers,
    multiple=True,
    metavar="KG,...",
    help="With --rig joint: masses at the end of the lever [kg].  [default: that of the model, 1]",
)
@section("Simulation")
@common.strides_option("Number of strides per case")
@click.option(
    "--seconds",
    type=common.NumberWithUnit("s"),
    default=None,
    metavar="S",
    help="With --rig walk or joint: duration of a walk or an episode [s].  [default: 20, or 5 with --rig joint]",
)
@click.option(
    "--episodes",
    type=click.IntRange(1, 1000),
    default=8,
    metavar="N",
    help="With --rig joint: episodes of each combination, each with another target.  [default: 8]",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    metavar="N",
    help="With --rig walk or joint: random seed of uneven ground, or of the first target.  [default: 0]",
)
@common.TIME_STEP_OPTION
@common.jobs_option(default=None)
@common.ray_option()
@section("Output")
@common.resumable_out_option("sweep", "the sweep")
@click.option("--csv", "with_csv", is_flag=True, help="Also write sweep.csv.")
@common.json_option()
@click.pass_context
def command(
    context: click.Context,
    /,
    rig: str,
    speeds: list[float | None],
    slopes: list[float],
    references: tuple[str, ...],
    stride_times: list[float],
    accept: tuple[str, ...],
    masses: list[float],
    statures: list[float],
    strides: int,
    machine: dict[str, list[float]],
    walkers: tuple[str, ...],
    uneven: list[float],
    pushes: tuple[tuple[float, float], ...],
    gains: dict[str, list[float]],
    loads: list[float],
    episodes: int,
    seconds: float | None,
    seed: int,
    step_ms: float,
    jobs: int | None,
    ray_address: str | None,
    out: Path | None,
    with_csv: bool,
    as_json: bool,
    **conditions: Any,
) -> None:
    """Simulate every combination of devices, controllers, references, subjects, speeds and slopes.

    Each combination is simulated like one call of 'klute-sim gait', or with --rig walk of 'klute-sim walk' with every
    walker, on all cores or on a cluster, and gives one row of the table. With --rig joint, a PID controller moves a
    lever between two devices (klute_sim/AntagonistJoint-v0) along random targets, for every combination of devices,
    gains and loads. If a combination fails, its row states the
    reason. Finished cases are stored at once: after an interrupt, the same command with the same --out resumes the
    sweep.

    Writes sweep.parquet (one row per combination, columns 'name [unit]'), index.html with figure.png, sweep.json (the
    plan with the device files) and one file per case.

    \b
    Examples:
      klute-sim sweep --mass 60,75,90 --speed reference,1.0,1.4
      klute-sim sweep --slope -5,0,5 --controller profile --controller off
      klute-sim sweep --reference anna --reference ben --reference able-bodied
      klute-sim sweep --reference 'subjects/*' --controller profile \\
        --controller machine
      klute-sim sweep --device klute-1-1-4-pair --spring-foot 4,6,8
      klute-sim sweep --foot rigid --foot sach --foot sach+shoe
      klute-sim sweep --device klute-1-1-4-pair --device my.toml \\
        --controller profile --controller off
      klute-sim sweep --controller constant:2 --controller mine.csv \\
        --out my-sweep --csv
      klute-sim sweep --rig walk --machine push_off_bar=3.4,3.9,4.4 \\
        --machine lean_deg=10,14,18
      klute-sim sweep --rig walk --spring-foot 4,6,8 --push 10@25 --push -10@25
      klute-sim sweep --rig joint --gain proportional=2,4,8 \\
        --gain integral=0,25 --load 0.5,1,2
      klute-sim sweep --mass 60,75,90 --ray local
      klute-sim sweep --mass 60,75,90 --ray 10.0.0.1:6379 --json \\
        | python -m json.tool
    """
    from klute_sim.api.rendering import print_summary
    from klute_sim.api.sweep import sweep, sweep_joint, sweep_walks
    from klute_sim.cli.console import progress_bar, stderr_console, stdout_console
    from klute_sim.parameter_sweep.plan import ABLE_BODIED_REFERENCE

    common.check_ray_options(ray_address, jobs)
    common.check_rig_options(context, rig, OPTION_RIGS)
    execution: dict[str, Any] = {"folder": out, "n_jobs": jobs or 0, "ray_address": ray_address}
    conditions["slopes"] = slopes or [0.0]
    with progress_bar("simulating") as progress:
        if rig == "joint":
            result = sweep_joint(
                conditions["devices"],
                gains=gains,
                loads=loads or [None],
                episodes=episodes,
                seconds=EPISODE_SECONDS if seconds is None else seconds,
                seed=seed,
                time_step=1e-3 * step_ms,
                progress=progress,
                **execution,
            )
        elif rig == "walk":
            result = sweep_walks(
                **conditions,
                machine=machine,
                walkers=walkers,
                uneven=uneven or [0.0],
                pushes=pushes or [(0.0, 0.0)],
                seconds=WALK_SECONDS if seconds is None else seconds,
                seed=seed,
                time_step=1e-3 * (step_ms if common.is_given(context, "step_ms") else WALK_STEP_MS),
                progress=progress,
                **execution,
            )
        else:
            result = sweep(
                **conditions,
                speeds=speeds or [None],
                references=references or [ABLE_BODIED_REFERENCE],
                stride_times=stride_times or [None],
                accept=accept,
                masses=masses or [None],
                statures=statures or [None],
                strides=strides,
                time_step=1e-3 * step_ms,
                progress=progress,
                **execution,
            )
    result.save(with_csv=with_csv)
    if result.n_resumed:
        stderr_console().print(f"{result.n_resumed} cases were already finished and were not simulated again.")
    if as_json:
        content = {
            "folder": str(result.folder),
            "resumed": result.n_resumed,
            "failed": result.n_failed,
            "rows": result.rows,
        }
        click.echo(json.dumps(content, indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, result.format_summary())
    written = (file.name for pattern in ("figure.png", "sweep.*") for file in sorted(result.folder.glob(pattern)))
    files = ["index.html", *written]
    console.print(f"Sweep folder: {result.folder}  ({', '.join(files)})", soft_wrap=True)
