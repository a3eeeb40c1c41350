"""``klute-sim train``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common
from klute_sim.cli.given_path import GivenPath

if TYPE_CHECKING:
    from klute_sim.learn.training import Training

MINUTES = 20.0


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
    type=GivenPath(),
    default=None,
    metavar="FILE",
    help="TOML: algorithm, environment, what is randomised.  [default: the shipped one]",
)
@click.option(
    "--out",
    type=GivenPath(),
    default=None,
    metavar="FOLDER",
    help="New or empty folder for the training, or the one to resume.  [default: runs/train-NNN]",
)
@click.option("--resume", is_flag=True, help="Go on with the training in --out, from its last checkpoint.")
@click.option("--show-config", is_flag=True, help="Print the shipped configuration, to start from, and stop.")
@common.as_json()
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
    numbers, which klute_sim.control.policy runs on NumPy alone.

    A checkpoint is a pickle, which can run code: resume only what you have trained, or trust.

    \b
    Examples:
      klute-sim train --minutes 20 --seed 0 --out walker
      klute-sim train --resume --out walker --minutes 40
      klute-sim train --show-config
    """
    from klute_sim.cli.console import progress_bar
    from klute_sim.errors import InputError
    from klute_sim.learn import config, training

    if show_config:
        click.echo(config.default().decode(), nl=False)
        return
    if minutes is not None and steps is not None:
        raise InputError("--minutes and --steps exclude each other")
    if resume:
        if out is None:
            raise InputError("--resume needs --out FOLDER, the training to go on with")
        if seed is not None or config_file is not None:
            raise InputError("--resume keeps seed and configuration: leave --seed and --config out")
        run = training.resume(out)
    else:
        run = _begin(config_file, 0 if seed is None else seed, out)
    limit = MINUTES if minutes is None and steps is None else minutes
    try:
        with progress_bar("training") as told:
            run.run(limit, steps, told)
    except KeyboardInterrupt:
        _interrupted(run)
        raise
    _finish(run, as_json=as_json)


def _begin(config_file: Path | None, seed: int, out: Path | None) -> "Training":
    from klute_sim.errors import KluteSimError
    from klute_sim.learn import config, training
    from klute_sim.recording import run_folder

    chosen, content = config.load(config_file)
    folder = run_folder.lasting("train", out)
    try:
        return training.begin(folder, chosen, content, seed)
    except KluteSimError:
        folder.rmdir()
        raise


def _interrupted(run: "Training") -> None:
    from klute_sim.cli.console import notes

    kept = f"Kept after {run.progress.steps} steps in {run.folder}; go on with"
    notes().print(f"{kept}: klute-sim train --resume --out {run.folder}", soft_wrap=True)


def _finish(run: "Training", *, as_json: bool) -> None:
    from klute_sim.cli.console import console, progress_bar
    from klute_sim.learn.evaluate import compared
    from klute_sim.report import training_figure

    policy, config, progress = run.policy(), run.config, run.progress
    with progress_bar("comparing"):
        found = compared(policy, config.environment, config.evaluation_episodes, progress.seed)
    result: dict[str, Any] = {
        "algorithm": config.algorithm,
        "seed": progress.seed,
        "minutes": progress.minutes,
        "steps": progress.steps,
        **found,
        "folder": str(run.folder),
    }
    policy.save(run.folder / "policy.npz")
    training_figure.draw(progress.rows, result, run.folder / "learning_curve.png")
    (run.folder / "summary.json").write_text(json.dumps(result, indent=2, allow_nan=False) + "\n", "utf-8")
    if as_json:
        click.echo(json.dumps(result, indent=2, allow_nan=False))
        return
    out = console()
    out.print(_table(result))
    out.print(
        f"The policy is better in {result['better_in']} of {result['episodes']} episodes, by "
        f"{result['gain']:.2f} ± {result['gain_standard_error']:.2f} on the average (standard error).",
        soft_wrap=True,
    )
    files = ", ".join(sorted(file.name for file in run.folder.iterdir()))
    out.print(f"Folder: {run.folder}  ({files})", soft_wrap=True)


def _table(result: dict[str, Any]) -> Any:
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
