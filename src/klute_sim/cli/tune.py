"""``klute-sim tune``."""

import json
from pathlib import Path

import click

from klute_sim.cli import common


@click.command("tune")
@common.DEVICE_OPTION
@click.option(
    "--profile",
    "profile_path",
    type=common.NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="Initial profile: CSV with columns gait_pct,pressure_bar.  [default: the hand-tuned profile]",
)
@click.option("--with-device", is_flag=True, help="Also tune orifices, springs, resting length and mounting.")
@click.option(
    "--also",
    "device_keys",
    multiple=True,
    metavar="KEY",
    help="Also tune this number of the device, such as damper.bore_mm; may be repeated.",
)
@click.option(
    "--goal-human",
    is_flag=True,
    help="Penalize the shortfall from the human ankle: 0.39 sd of moment, 3.31 W/kg, 0.218 J/kg, 15 deg.",
)
@click.option(
    "--weight",
    "weights",
    multiple=True,
    metavar="TERM=W",
    help="Weight of moment, angle, power [1/sd²] or air [1/g]; may be repeated.  [default: 1, 1, 1, 0.1]",
)
@common.MASS_OPTION
@click.option(
    "--budget",
    type=click.IntRange(1, 1_000_000),
    default=600,
    show_default=True,
    metavar="N",
    help="Number of evaluations, rounded up to a whole generation.",
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
@common.resumable_out_option("tune", "the search")
@common.json_option()
def command(
    device_name: str,
    profile_path: Path | None,
    with_device: bool,
    device_keys: tuple[str, ...],
    goal_human: bool,
    weights: tuple[str, ...],
    mass: float,
    budget: int,
    seed: int,
    jobs: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Tune a pressure profile, optionally with the device, for human-like gait at low air consumption.

    Objective: the mean squared distance of net moment, angle and power from the reference in stance, in its standard
    deviations, plus 0.1 per gram of air in a stride. Penalties apply to a muscle at its stop, to poor load tracking and
    to a toe clearance below 3 mm; a foot that catches in swing costs more than any that does not. The search is CMA-ES.
    The best tenth of the evaluations is repeated with a finer time step, and the best of these is the result. Every
    evaluation is stored: the same command resumes an interrupted search, also with a larger --budget.

    Writes tuned.csv (for gait --controller), device.toml if the device is tuned, tuning.png (tracking error over air),
    a CSV file with a row per evaluation, tuning.json, and a file per evaluation. Needs the extra 'tune'.

    \b
    Examples:
      klute-sim tune
      klute-sim tune --weight air=0.5 --budget 2000 --out low-air
      klute-sim tune --with-device --goal-human --budget 4000 --out human
      klute-sim gait --controller human/tuned.csv --device human/device.toml
    """
    from klute_sim.api.rendering import print_summary
    from klute_sim.api.tuning import tune
    from klute_sim.cli.console import progress_bar, stdout_console

    with progress_bar("tuning") as progress:
        result = tune(
            device_name,
            profile=profile_path,
            with_device=with_device,
            device_keys=device_keys,
            goal_human=goal_human,
            weights=_parse_weights(weights),
            mass=mass,
            budget=budget,
            seed=seed,
            folder=out,
            n_jobs=jobs,
            progress=progress,
        )
        content = result.write_files(result.folder)
    if as_json:
        click.echo(json.dumps(content, indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, result.format_summary())
    console.print(f"Folder: {result.folder}  ({', '.join(content['files'])})", soft_wrap=True)


def _parse_weights(texts: tuple[str, ...]) -> dict[str, float]:
    from klute_sim.errors import InputError

    weights = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            weights[name] = float(value)
        except ValueError:
            raise InputError(f"--weight is '{text}'; allowed: a term and a number, such as air=0.5") from None
    return weights
