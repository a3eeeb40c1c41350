"""``klute-sim train``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common
from klute_sim.cli.nonempty_path import NonEmptyPath

if TYPE_CHECKING:
    from klute_sim.training.training import Training

DEFAULT_TRAINING_MINUTES = 20.0


@click.command("train")
@click.option(
    "--minutes",
    type=click.FloatRange(min=0.0, min_open=True),
    default=None,
    metavar="MIN",
    help="Train for so long in all, interruptions left out.  [default: 20]",
)
@click.option(
    "--steps",
    type=click.IntRange(min=1),
    default=None,
    metavar="N",
    help="Train for so many steps of the environment in all instead: a run that can be repeated.",
)
@click.option("--seed", type=click.IntRange(min=0), default=None, help="Of everything random.  [default: 0]")
@click.option(
    "--config",
    "config_file",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="TOML: algorithm, environment, what is randomised.  [default: the shipped one]",
)
@click.option(
    "--out",
    type=NonEmptyPath(),
    default=None,
    metavar="FOLDER",
    help="New or empty folder for the training, or the one to resume.  [default: runs/train-NNN]",
)
@click.option("--resume", is_flag=True, help="Go on with the training in --out, from its last checkpoint.")
@click.option("--show-config", is_flag=True, help="Print the shipped configuration, to start from, and stop.")
@common.json_option()
def command(
    minutes: float | None,
    steps: int | None,
    seed: int | None,
    config_file: Path | None,
    out: Path | None,
    resume: bool,
    show_config: bool,
    as_json: bool,
) -> None:
    """Train a policy to walk, and compare it with the hand-tuned profile.

    Needs the optional extra 'rl' (Stable-Baselines3; pip install '.[rl]' in the project's folder). Ctrl-C keeps what
    was learned. At the end policy and hand-tuned profile walk the same episodes, and policy.npz is written: plain
    numbers, which klute_sim.controllers.policy runs on NumPy alone.

    A checkpoint is a pickle, which can run code: resume only what you have trained, or trust.

    \b
    Examples:
      klute-sim train --minutes 20 --seed 0 --out walker
      klute-sim train --resume --out walker --minutes 40
      klute-sim train --show-config
    """
    from klute_sim.cli.console import progress_bar
    from klute_sim.errors import InputError
    from klute_sim.training import config, training

    if show_config:
        click.echo(config.read_default_config().decode(), nl=False)
        return
    if minutes is not None and steps is not None:
        raise InputError("--minutes and --steps exclude each other")
    if resume:
        if out is None:
            raise InputError("--resume needs --out FOLDER, the training to go on with")
        if seed is not None or config_file is not None:
            raise InputError("--resume keeps seed and configuration: leave --seed and --config out")
        run = training.resume_training(out)
    else:
        run = _start_training(config_file, 0 if seed is None else seed, out)
    limit = DEFAULT_TRAINING_MINUTES if minutes is None and steps is None else minutes
    try:
        with progress_bar("training") as told:
            run.run(limit, steps, told)
    except KeyboardInterrupt:
        _print_resume_hint(run)
        raise
    _evaluate_and_write(run, as_json=as_json)


def _start_training(config_file: Path | None, seed: int, out: Path | None) -> "Training":
    from klute_sim.errors import KluteSimError
    from klute_sim.recording import run_folder
    from klute_sim.training import config, training

    chosen, content = config.load_config(config_file)
    folder = run_folder.create_persistent_folder("train", out)
    try:
        return training.start_training(folder, chosen, content, seed)
    except KluteSimError:
        folder.rmdir()
        raise


def _print_resume_hint(training: "Training") -> None:
    from klute_sim.cli.console import stderr_console

    kept = f"Kept after {training.progress.steps} steps in {training.folder}; go on with"
    stderr_console().print(f"{kept}: klute-sim train --resume --out {training.folder}", soft_wrap=True)


def _evaluate_and_write(training: "Training", *, as_json: bool) -> None:
    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.report import training_figure
    from klute_sim.training.evaluate import compare_with_profile

    policy, config, progress = training.export_policy(), training.config, training.progress
    with progress_bar("comparing"):
        found = compare_with_profile(policy, config.environment, config.evaluation_episodes, progress.seed)
    result: dict[str, Any] = {
        "algorithm": config.algorithm,
        "seed": progress.seed,
        "minutes": progress.minutes,
        "steps": progress.steps,
        **found,
        "folder": str(training.folder),
    }
    policy.save(training.folder / "policy.npz")
    training_figure.save_figure(progress.learning_curve, result, training.folder / "learning_curve.png")
    (training.folder / "summary.json").write_text(json.dumps(result, indent=2, allow_nan=False) + "\n", "utf-8")
    if as_json:
        click.echo(json.dumps(result, indent=2, allow_nan=False))
        return
    out = stdout_console()
    out.print(_build_table(result))
    out.print(
        f"The policy is better in {result['better_in']} of {result['episodes']} episodes, by "
        f"{result['gain']:.2f} ± {result['gain_standard_error']:.2f} on the average (standard error).",
        soft_wrap=True,
    )
    files = ", ".join(sorted(file.name for file in training.folder.iterdir()))
    out.print(f"Folder: {training.folder}  ({files})", soft_wrap=True)


def _build_table(result: dict[str, Any]) -> Any:
    from rich import box
    from rich.table import Table

    title = (
        f"{result['algorithm'].upper()}, seed {result['seed']}: {result['steps']} steps in {result['minutes']:.1f} min"
    )
    table = Table(title=title, box=box.SIMPLE_HEAD)
    table.add_column("mean of an episode")
    table.add_column("policy", justify="right", style="bold")
    table.add_column("hand-tuned\nprofile", justify="right")
    for name, value in result["policy"].items():
        digits = 3 if name == "air_g" else 2
        table.add_row(name.replace("_", " "), f"{value:.{digits}f}", f"{result['profile'][name]:.{digits}f}")
    return table
