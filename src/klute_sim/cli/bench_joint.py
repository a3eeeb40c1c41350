"""``klute-sim bench joint``, ``bench mass`` and ``bench knee``."""

import json
from pathlib import Path

import click

from klute_sim.cli import common, completion
from klute_sim.cli.option_sections import Command, section

MODELS = {"joint": "antagonist_joint", "mass": "hanging_mass", "knee": "knee_jig"}
"""Word after ``klute-sim bench`` -> model."""


@click.command("joint", cls=Command)
@click.argument("test", metavar="[TEST]", default="steps")
@click.argument("device_name", metavar="[DEVICE|FILE]", required=False, shell_complete=completion.complete_device)
@section("Model")
@click.option(
    "--device",
    "tendon_devices",
    multiple=True,
    metavar="TENDON=NAME|FILE",
    help="Device of one tendon, in place of DEVICE; may be repeated.",
)
@click.option(
    "--model", "model_path", type=common.NonEmptyPath(), metavar="FILE", help="MJCF file of your own, with one joint."
)
@click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="NUMBER=VALUE",
    help="Change a number of the model, in its unit in MJCF; may be repeated.",
)
@section("Conditions")
@common.pressure_options()
@click.option(
    "--load",
    type=common.NumberWithUnit("N m, or N on a slide"),
    default=None,
    metavar="VALUE",
    help="Load of co-contraction and quick-release [N m; N on a slide].  [default: -2 N m, or -50 N]",
)
@click.option(
    "--response",
    type=common.NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="With sines: measured frequency response (CSV with frequency [Hz], gain [deg/bar], [mm/bar], [dB] or [1], and "
    "phase [deg]) to compare with; the sines get its frequencies.",
)
@section("Simulation")
@common.TIME_STEP_OPTION
@section("Output")
@click.option("--list", "as_list", is_flag=True, help="List the tests.")
@click.option("--numbers", "as_numbers", is_flag=True, help="List the numbers of the model that --set changes.")
@common.out_option("joint", "the run")
@common.json_option()
@click.pass_context
def command(
    context: click.Context,
    test: str,
    device_name: str | None,
    tendon_devices: tuple[str, ...],
    model_path: Path | None,
    as_list: bool,
    as_numbers: bool,
    mean_bar: float,
    difference_bar: float,
    load: float | None,
    changes: tuple[str, ...],
    response: Path | None,
    step_ms: float,
    out: Path | None,
    as_json: bool,
) -> None:
    """Test a DEVICE on a joint (bench joint), a hanging mass (bench mass) or a knee on a jig (bench knee).

    TEST is steps (default), sines, multisine, co-contraction or quick-release. DEVICE is a preset or a device file for
    every tendon (default: klute-3-4-pair). Antagonists get a mean pressure plus and minus a difference. The frame is
    moved until the muscles fit; dimensions, masses and stops of the models are assumed.

    Writes summary.json, results.csv (one row per trial), index.html, figure.png, model.xml, one device file per
    tendon and one Parquet file per trial.

    \b
    Examples:
      klute-sim bench joint
      klute-sim bench joint sines klute-3-4-pair --mean 2 --difference 0.5
      klute-sim bench joint sines --response bode.csv --mean 2 --difference 0.3
      klute-sim bench joint steps --device flexor=klute-3-4-pair \\
        --device extensor=mine.toml
      klute-sim bench mass quick-release klute-1-1-4-pair --load -100
      klute-sim bench knee multisine --set model.geom.foot.mass=1.2 --out knee
    """
    from klute_sim.errors import InputError

    if as_list:
        _list_tests(as_json=as_json)
        return
    model = model_path or MODELS[(context.info_name or "joint").split()[-1]]
    if as_numbers:
        _list_numbers(model, as_json=as_json)
        return
    from klute_sim.api.inputs import DeviceLike
    from klute_sim.api.joint import DEFAULT_DEVICE, simulate_joint
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.recording.run_folder import create_run_folder

    device: DeviceLike | dict[str, DeviceLike] = device_name or DEFAULT_DEVICE
    if tendon_devices:
        if device_name is not None:
            raise InputError("DEVICE and --device exclude each other; name one device for all, or one for each tendon")
        device = dict(_split(text, "--device", "flexor=klute-3-4-pair") for text in tendon_devices)
    numbers = {
        name: _parse_number(name, text)
        for name, text in (_split(text, "--set", "model.geom.load.mass=2") for text in changes)
    }
    with create_run_folder("joint", out) as (folder, scratch):
        with progress_bar("testing") as progress:
            run = simulate_joint(
                device,
                test,
                model=model,
                mean_pressure_bar=mean_bar,
                difference_bar=difference_bar,
                load=load,
                numbers=numbers,
                response=response,
                time_step=1e-3 * step_ms,
                progress=progress,
            )
        summary = run.write_files(scratch, folder)
    if as_json:
        click.echo(json.dumps(summary, indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, run.format_summary())
    console.print(
        f"Run folder: {folder}  (index.html, figure.png, results.csv, model.xml, {len(run.recordings)} Parquet files)",
        soft_wrap=True,
    )


def _split(text: str, option: str, example: str) -> tuple[str, str]:
    from klute_sim.errors import InputError

    name, separator, value = text.partition("=")
    if not (separator and name and value):
        raise InputError(f"{option} '{text}' has no name and value; write for example {option} {example}")
    return name, value


def _parse_number(name: str, text: str) -> float:
    from klute_sim.errors import InputError

    try:
        return float(text)
    except ValueError:
        raise InputError(f"--set {name}: '{text}' is not a number") from None


def _list_tests(*, as_json: bool) -> None:
    from klute_sim.mechanism.protocols import TESTS

    if as_json:
        click.echo(json.dumps([{"name": name, "description": text} for name, (text, _) in TESTS.items()], indent=2))
        return
    for name, (text, _) in TESTS.items():
        click.echo(f"{name:16} {text}")


def _list_numbers(model: str | Path, *, as_json: bool) -> None:
    from klute_sim.plant.mjcf.model_file import load_model_file
    from klute_sim.plant.mjcf.model_numbers import collect_model_numbers

    numbers = collect_model_numbers(load_model_file(model).make_spec())
    if as_json:
        click.echo(json.dumps(numbers, indent=2))
        return
    for name, value in numbers.items():
        click.echo(f"{name:44} {value:g}")
