"""``klute-sim walk`` and its subcommands."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common, completion, recorded_run
from klute_sim.cli.option_sections import Command, Group, section


def _device_option(what: str) -> common.Decorator:
    return click.option(
        "--device",
        shell_complete=completion.complete_device,
        default=None,
        metavar="NAME|FILE",
        help=f"{what}: name of a preset, or a device file.  [default: klute-1-1-4-pair]",
    )


def _seconds_option(help_text: str) -> common.Decorator:
    return click.option(
        "--seconds", type=common.NumberWithUnit("s"), default=20.0, show_default=True, metavar="S", help=help_text
    )


def condition_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of prosthesis and controller; the command receives them under the keywords of the public API."""
    options = (
        _device_option("Device"),
        click.option(
            "--controller",
            default=None,
            metavar="SPEC",
            help="Pressure controller: machine (state machine that uses the sensors of the prosthesis), profile "
            "(pressure over the phase that the load cell tells), off, constant:BAR, or a file (.csv, .toml, .npz).  "
            "[default: machine]",
        ),
        common.SPRING_FOOT_OPTION,
        click.option("--intact", is_flag=True, help="Walk on two legs of flesh, without a prosthesis."),
        common.FOOT_OPTION,
        click.option(
            "--align",
            "alignment",
            type=common.NumberWithUnit("degrees"),
            default=None,
            metavar="DEG",
            help="Angle by which the prosthesis is turned against the limb [deg], dorsiflexion positive.  [default: "
            "that of the device file, or 0]",
        ),
    )
    for option in reversed(options):
        function = option(function)
    return function


@click.group("walk", cls=Group, invoke_without_command=True)
@section("Model")
@condition_options
@click.option(
    "--walker",
    default=None,
    metavar="NAME|FILE",
    help="Walker: name of a shipped one (klute-sim walk list), or the file of one.  [default: one that has adapted to "
    "this prosthesis and controller, or to the nearest]",
)
@section("Conditions")
@click.option(
    "--push",
    type=common.PushType(),
    default=None,
    metavar="NS@PCT",
    help="Push on the hip within 0.1 s: impulse [N·s], forward positive, and phase of the right leg's stride [%] (0 if "
    "left out), in the first stride after 5 s; the walk must last 7 s.  [default: no push]",
)
@click.option(
    "--uneven",
    type=common.NumberWithUnit("mm"),
    default=0.0,
    show_default=True,
    metavar="MM",
    help="Largest height of the blocks of 0.5 m that lie on the ground [mm].",
)
@common.slope_option("Ground slope [deg], uphill positive.")
@section("Simulation")
@_seconds_option("Duration [s]; a fall ends the walk earlier.")
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, metavar="N", help="Random seed of uneven ground."
)
@click.option(
    "--step",
    "step_ms",
    type=common.NumberWithUnit("ms"),
    default=1.0,
    show_default=True,
    metavar="MS",
    help="Time step [ms].",
)
@recorded_run.backend_option("walker and device")
@section("Output")
@common.out_option("walk", "the walk")
@recorded_run.CSV_OPTION
@common.json_option()
@click.pass_context
def command(
    context: click.Context,
    /,
    step_ms: float,
    out: Path | None,
    with_csv: bool,
    as_json: bool,
    **walk: Any,
) -> None:
    """Simulate a person who walks by muscles and reflexes.

    A planar model of 7 segments and 14 muscles (75 kg, 1.75 m) walks on two legs, or on one and a prosthesis. Nothing
    prescribes its motion or its load: speed, steps, ground reactions, joint angles, metabolic cost and falls are
    predictions. The reflexes come from a walker file, which was adapted to one prosthesis and controller. With another
    one the walk is acute: it shows what happens before the person adapts.

    Writes recording.parquet, summary.json, index.html, figure.png, walker.toml, with a device device.toml and, with
    the optional extra 'rerun', recording.rrd.

    \b
    Examples:
      klute-sim walk
      klute-sim walk --intact --seconds 60
      klute-sim walk --controller off
      klute-sim walk --push 10@40 --uneven 5
      klute-sim walk --spring-foot 8 --json | python -m json.tool
      klute-sim walk list
      klute-sim walk compare machine constant:3
      klute-sim walk adapt --controller constant:3 --evaluations 4000
    """
    if context.invoked_subcommand is not None:
        return
    from klute_sim.api.walk import simulate_walk

    recorded_run.simulate_and_write(
        "walk",
        "walking",
        lambda progress: simulate_walk(time_step=1e-3 * step_ms, progress=progress, **walk),
        out=out,
        with_csv=with_csv,
        as_json=as_json,
    )


@command.command("list", short_help="List the shipped walkers.")
def list_command() -> None:
    """List the shipped walkers: condition, seed, cost and evaluations of their search."""
    from klute_sim.api.walk import build_walker_table
    from klute_sim.cli.console import stdout_console

    stdout_console().print(build_walker_table())


@command.command("compare")
@click.argument("a")
@click.argument("b")
@_device_option("Device of the controllers")
@common.FOOT_OPTION
@click.option(
    "--walker",
    "walkers",
    multiple=True,
    metavar="NAME|FILE",
    help="Walker: name of a shipped one, or the file of one; may be repeated.  [default: those adapted to A or B]",
)
@click.option(
    "--acute", is_flag=True, help="Let the walkers adapted to A walk under B as well, before they adapt to it."
)
@_seconds_option("Duration of each walk [s].")
@common.json_option()
def compare_command(a: str, b: str, as_json: bool, **comparison: Any) -> None:
    """Compare two conditions A and B over several walkers.

    A condition is a controller (machine, profile, off, constant:BAR, or a file) or spring-foot:STIFFNESS. Where several
    walkers have adapted to each condition, each group walks under its own (Welch's interval). Otherwise, and with
    --walker or --acute, the same walkers walk under both (paired). The table shows the difference of the mean of each
    outcome with its 95 % interval; a sign is named only where the interval excludes zero. Falls are listed apart.

    \b
    Examples:
      klute-sim walk compare machine spring-foot:6
      klute-sim walk compare machine constant:3
      klute-sim walk compare machine my-machine.toml --walker machine-1 \\
        --walker mine/adapted.toml
    """
    from klute_sim.api.walk_comparison import compare_walks
    from klute_sim.cli.console import progress_bar

    with progress_bar("walking") as progress:
        result = compare_walks(a, b, progress=progress, **comparison)
    _print_result(result, as_json)


@command.command("adapt", cls=Command, short_help="Adapt the reflexes of a walker to a prosthesis and a controller.")
@section("Model")
@condition_options
@section("Search")
@click.option(
    "--start",
    default=None,
    metavar="NAME|FILE",
    help="Walker from which the search starts.  [default: the shipped one that is nearest to the condition]",
)
@click.option(
    "--speed",
    type=common.NumberWithUnit("m/s"),
    default=1.25,
    show_default=True,
    metavar="M/S",
    help="Speed that the walker should reach [m/s].",
)
@click.option(
    "--evaluations",
    type=click.IntRange(1, 1_000_000),
    default=4000,
    show_default=True,
    metavar="N",
    help="Number of walks, rounded up to whole generations of the search.",
)
@click.option(
    "--sigma",
    type=common.NumberWithUnit(),
    default=0.5,
    show_default=True,
    metavar="X",
    help="Initial standard deviation of the search, in the widths of the gains.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    metavar="N",
    help="Random seed of search and ground.",
)
@common.jobs_option("Number of threads; 0: one per core.  [default: 0]", default=None)
@common.ray_option()
@section("Output")
@common.resumable_out_option("adapt", "the search")
@common.json_option()
def adapt_command(jobs: int | None, out: Path | None, as_json: bool, **adaptation: Any) -> None:
    """Adapt the reflexes of a walker to a prosthesis and a controller, or to two legs of flesh.

    The search method is CMA-ES. A walk of 18 s costs its metabolic energy per distance and its deviation from the
    speed, plus penalties for squared activations, load above 1.2 body weights, knees on their stops, dorsiflexion in
    swing and a leaning trunk. Its last part leads over blocks of up to 10 mm, with pushes of 10 N·s forward and
    backward before; a fall costs more than any walk. The best walker is accepted if it walks three times as long on
    level ground.

    Writes adapted.toml (for walk --walker), adaptation.json, costs.csv and index.html; the same command resumes an
    interrupted search, also with more --evaluations. Needs the optional extra 'tune'.

    \b
    Examples:
      klute-sim walk adapt --spring-foot 6 --evaluations 4000 --out soft-foot
      klute-sim walk --spring-foot 6 --walker soft-foot/adapted.toml
    """
    from klute_sim.api.adaptation import adapt_walker
    from klute_sim.cli.console import progress_bar, stdout_console

    common.check_ray_options(adaptation["ray_address"], jobs)
    with progress_bar("adapting") as progress:
        result = adapt_walker(folder=out, n_jobs=jobs or 0, progress=progress, **adaptation)
    _print_result(result, as_json)
    if not as_json:
        files = ", ".join(result.summary["files"])
        stdout_console().print(f"Folder: {result.folder}  ({files})", soft_wrap=True)


def _print_result(result: Any, as_json: bool) -> None:
    """Print ``result`` of the public API, which has a summary, as one JSON object or for people."""
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import stdout_console

    if as_json:
        click.echo(json.dumps(result.summary, indent=2, allow_nan=False))
    else:
        print_summary(stdout_console(), result.format_summary())
