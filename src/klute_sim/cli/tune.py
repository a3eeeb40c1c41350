"""``klute-sim tune``."""

import json
from pathlib import Path
from typing import Any

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
    help="Number of the device to tune in addition, such as damper.bore_mm; may be repeated.",
)
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
    help="Weight of the TERM moment, angle, power [1/sd²] or air [1/g]; may be repeated.  [default: moment=1, angle=1, "
    "power=1, air=0.1]",
)
@common.subject_options
@click.option(
    "--budget",
    type=click.IntRange(1, 1_000_000),
    default=600,
    show_default=True,
    metavar="N",
    help="Number of evaluations, rounded up to whole generations of the search.",
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
    budget: int,
    seed: int,
    jobs: int,
    out: Path | None,
    as_json: bool,
    **subject: Any,
) -> None:
    """Tune a pressure profile, and optionally the device, for human-like gait at low air consumption.

    The objective is the mean squared distance of net moment, angle and power from the reference in stance, in standard
    deviations of the reference, plus 0.1 per gram of air in a stride. Penalties apply to a peak moment that differs by
    more than 5 % from that of the reference, to a muscle at its stop, to poor load tracking and to a toe clearance
    below 3 mm. A gait in which the foot catches in swing always costs more than a gait in which it does not. Standard
    deviations that --reference does not state, or that --speed and --slope make doubtful, are assumed and reported as
    such.

    The search method is CMA-ES. At the end, the best tenth of the evaluations is repeated with a finer time step, and
    the best of these is the result. Every evaluation is stored: the same command resumes an interrupted search, also
    with a larger --budget.

    Writes tuned.csv (for gait --controller), device.toml if the device is tuned, tuning.png (tracking error over air),
    a CSV file with one row per evaluation, tuning.json, and one file per evaluation. Needs the optional extra 'tune'.

    \b
    Examples:
      klute-sim tune
      klute-sim tune --weight air=0.5 --budget 2000 --out low-air
      klute-sim tune --reference my-subject --out mine
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
            budget=budget,
            seed=seed,
            folder=out,
            n_jobs=jobs,
            progress=progress,
            **subject,
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
