"""``klute-sim tune``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common
from klute_sim.cli.nonempty_path import NonEmptyPath

if TYPE_CHECKING:
    from klute_sim.tuning.search import TuningProblem


@click.command("tune")
@common.DEVICE_OPTION
@click.option(
    "--profile",
    "profile_file",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="CSV with columns gait_pct,pressure_bar to begin from.  [default: the hand-tuned one]",
)
@click.option("--with-device", is_flag=True, help="Tune orifices, springs, rest length and mounting, too.")
@click.option(
    "--also",
    "keys",
    multiple=True,
    metavar="KEY",
    help="A number of the device to tune, too, such as damper.bore_mm; may be given several times.",
)
@click.option(
    "--goal-human",
    is_flag=True,
    help="Count what is missing to the human ankle: 0.39 sd of moment, 3.31 W/kg, 0.218 J/kg, 15 degrees.",
)
@click.option(
    "--weight",
    "weights",
    multiple=True,
    metavar="PART=W",
    help="Of moment, angle, power [per sd²] or air [per g]; may be given several times.  [default: 1, 1, 1, 0.1]",
)
@common.MASS_OPTION
@click.option(
    "--budget",
    type=click.IntRange(1, 1_000_000),
    default=600,
    show_default=True,
    metavar="N",
    help="Walks to try, in whole rounds.",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, metavar="N", help="Of the search.")
@common.jobs_option()
@common.resumable_out_option("tune", "the search")
@common.json_option()
def command(
    device_name: str | None,
    profile_file: Path | None,
    with_device: bool,
    keys: tuple[str, ...],
    goal_human: bool,
    weights: tuple[str, ...],
    mass: float,
    budget: int,
    seed: int,
    jobs: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Tune a pressure profile, and the device with it if asked to, to walk like the human reference on little air.

    What is made small: the mean squared distance of net moment, angle and power from the reference in stance, in its
    standard deviations, plus 0.1 for every gram of air in a stride. A foot that catches in swing comes after every walk
    that does not; a muscle at its stop, a load that is not followed and a toe below 3 mm cost extra. The search is
    CMA-ES; the best tenth is walked again in finer steps, and the best of that is the result. Every walk is kept, so
    that the same command goes on where it was, also with a larger --budget.

    Writes tuned.csv (for gait --controller), device.toml if the device was tuned, tuning.png (tracking against air),
    tried.csv (a row per walk), tuning.json and a file per walk. Needs the extra 'tune'.

    \b
    Examples:
      klute-sim tune
      klute-sim tune --weight air=0.5 --budget 2000 --out thrifty
      klute-sim tune --with-device --goal-human --budget 4000 --out human
      klute-sim gait --controller human/tuned.csv --device human/device.toml
    """
    from klute_sim.controllers import pressure as control
    from klute_sim.device.device import DEFAULT_DEVICE, load_device
    from klute_sim.errors import InputError
    from klute_sim.tuning.design_variables import DEFAULT_DEVICE_KEYS, DesignSpace
    from klute_sim.tuning.objective import HUMAN_GOALS, Goals, make_weights
    from klute_sim.tuning.search import TuningProblem

    device = load_device(DEFAULT_DEVICE if device_name is None else device_name)
    profile = control.load_profile(profile_file) if profile_file else control.load_default_profile()
    turned = tuple(dict.fromkeys([*(DEFAULT_DEVICE_KEYS if with_device else ()), *keys]))
    parts = {}
    for text in weights:
        name, _, value = text.partition("=")
        try:
            parts[name] = float(value)
        except ValueError:
            raise InputError(f"--weight is '{text}'; allowed: a part and a number, as in air=0.5") from None
    question = TuningProblem(
        space=DesignSpace(device, profile, turned),
        mass=mass,
        weights=make_weights(parts),
        goals=HUMAN_GOALS if goal_human else Goals(),
        seed=seed,
    )
    result = _tune(question, budget, jobs, out)
    _report(result, as_json=as_json)


def _tune(problem: "TuningProblem", budget: int, n_jobs: int, out: Path | None) -> dict[str, Any]:
    from klute_sim.cli.console import progress_bar
    from klute_sim.parameter_sweep.local import LocalRunner
    from klute_sim.tuning import folder
    from klute_sim.tuning.search import MAX_REEVALUATIONS, REEVALUATED_FRACTION, import_cma, optimize, reevaluate

    import_cma()  # before a folder is made for what cannot be done
    store = folder.open_tuning_store(out, problem)
    expected = budget + min(REEVALUATED_FRACTION * budget, MAX_REEVALUATIONS)
    with progress_bar("tuning") as progress, LocalRunner(n_jobs) as processes:

        def told(done: int) -> None:
            progress(min(1.0, done / expected))

        tried = optimize(problem, budget, store, processes.run, told)
        finely = reevaluate(problem, tried, store, processes.run, told)
    return folder.write_results(store, problem, tried, finely)


def _report(result: dict[str, Any], *, as_json: bool) -> None:
    from rich import box
    from rich.table import Table

    from klute_sim.cli.console import stdout_console

    if as_json:
        click.echo(json.dumps(result, indent=2, allow_nan=False))
        return
    out = stdout_console()
    table = Table(box=box.SIMPLE_HEAD)
    for name in ("", "before", "tuned", "human"):
        table.add_column(name, justify="left" if not name else "right")
    for row in result["table"]:
        table.add_row(
            row["name"], *("-" if row[key] is None else f"{row[key]:.3f}" for key in ("before", "tuned", "human"))
        )
    out.print(table)
    better = 100.0 * (1.0 - result["cost"]["tuned"] / result["cost"]["before"])
    out.print(
        f"The objective fell by {better:.0f} % in {result['walks']} walks (seed {result['seed']}).", soft_wrap=True
    )
    for remark in result["remarks"]:
        out.print(remark, soft_wrap=True)
    out.print(f"Folder: {result['folder']}  ({', '.join(result['files'])})", soft_wrap=True)
