"""``klute-sim train``."""

import json
from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common
from klute_sim.cli.option_sections import Command, section


@click.command("train", cls=Command)
@section("Model")
@click.option(
    "--env",
    type=click.Choice(["gait", "walk", "joint"]),
    default=None,
    help="Gait rig, a person who walks by muscles and reflexes, or a joint with two muscles.  [default: gait, or as "
    "the configuration says]",
)
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
@common.slope_option("Nominal ground slope [deg], uphill positive.  [default: 0]", default=None)
@section("Training")
@click.option(
    "--minutes",
    type=click.FloatRange(min=0.0, min_open=True),
    default=None,
    metavar="MIN",
    help="Total training time [min]; pauses between resumed trainings do not count.  [default: 20]",
)
@click.option(
    "--steps",
    type=click.IntRange(min=1),
    default=None,
    metavar="N",
    help="Total number of environment steps, in place of --minutes; makes the training reproducible.",
)
@click.option("--seed", type=click.IntRange(min=0), default=None, metavar="N", help="Random seed.  [default: 0]")
@click.option(
    "--config",
    "config_path",
    type=common.NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="TOML file: algorithm, environment, domain randomisation.  [default: the configuration of --show-config]",
)
@section("Output")
@click.option(
    "--out",
    type=common.NonEmptyPath(),
    default=None,
    metavar="FOLDER",
    help="Folder for the training, or of the one to resume.  [default: runs/train-NNN]",
)
@click.option(
    "--show-config", is_flag=True, help="Print the default configuration, as a template for --config, and exit."
)
@common.json_option()
def command(
    env: str | None,
    minutes: float | None,
    steps: int | None,
    seed: int | None,
    config_path: Path | None,
    out: Path | None,
    show_config: bool,
    as_json: bool,
    **subject: Any,
) -> None:
    """Train a control policy and compare it with a baseline.

    The baseline is the hand-tuned profile on the gait rig, with --env walk the state machine, and with --env joint a
    PID controller of the angle. After the training, policy and baseline are simulated in the same episodes. Ctrl-C
    stops the training and keeps its checkpoint; the same command with the same --out resumes it, and with a larger
    --minutes or --steps trains on.

    The subject, such as --reference, replaces that of the configuration; its domain randomisation stays. The person of
    --env walk is always the same: of these options it takes --foot and --speed, the target. A joint has no subject; its
    configuration sets load and devices.

    Writes the configuration, the checkpoint, summary.json, index.html, figure.png and policy.npz. The last contains
    plain numbers, which klute_sim.controllers.policy evaluates with NumPy alone. Needs the optional extra 'rl'
    (Stable-Baselines3 and torch: docs/install.md, or https://download.pytorch.org/whl/cpu for torch without CUDA).

    \b
    Examples:
      klute-sim train --minutes 20 --seed 0 --out my-policy
      klute-sim train --out my-policy --minutes 40
      klute-sim train --reference my-subject --out mine
      klute-sim train --env walk --out my-walking-policy
      klute-sim train --env joint --steps 1000000 --out my-joint-policy
      klute-sim train --show-config
    """
    from klute_sim.errors import InputError
    from klute_sim.training.config import read_default_config

    if show_config:
        click.echo(read_default_config(env or "gait").decode(), nl=False)
        return
    if minutes is not None and steps is not None:
        raise InputError("--minutes and --steps exclude each other")
    from klute_sim.api.rendering import print_summary
    from klute_sim.api.training import train
    from klute_sim.cli.console import progress_bar, stderr_console, stdout_console

    with progress_bar("training") as progress:
        limits: dict[str, Any] = {"minutes": minutes, "steps": steps}
        result = train(config_path, env=env, seed=seed, folder=out, progress=progress, **limits, **subject)
    result.save()
    if result.n_resumed_steps:
        stderr_console().print(f"The training in {result.folder} resumed after {result.n_resumed_steps} steps.")
    if as_json:
        click.echo(json.dumps(result.summary, indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, result.format_summary())
    files = ", ".join(sorted(file.name for file in result.folder.iterdir()))
    console.print(f"Folder: {result.folder}  ({files})", soft_wrap=True)
