"""``klute-sim baselines``."""

import json
from pathlib import Path

import click

from klute_sim.cli import common


@click.command("baselines")
@click.option(
    "--only", multiple=True, metavar="NAME", help="Simulate only this baseline; may be repeated.  [default: all]"
)
@common.MASS_OPTION
@common.strides_option("Number of strides per run")
@common.TIME_STEP_OPTION
@common.jobs_option()
@common.resumable_out_option("baselines", "the runs")
@common.json_option("the tables")
def command(
    only: tuple[str, ...], mass: float, strides: int, step_ms: float, jobs: int, out: Path | None, as_json: bool
) -> None:
    """Simulate the baseline feet and controllers: passive feet, off, constant, hand-tuned, machine, tuned, trained.

    Each baseline is simulated at the speed of the reference, at 0.8 and 1.25 of it, and 5 degrees uphill and downhill.
    The distance to the human is given only on the level at the speed of the reference, where it was measured. In the
    other conditions the angles of thigh and shank and the ground reaction are those of the reference in space, with
    time scaled by the speed (assumed).

    Writes baselines.json, table.json and a file per run.

    \b
    Examples:
      klute-sim baselines
      klute-sim baselines --only hand-tuned --only machine --mass 90
    """
    from klute_sim.api.baselines import simulate_baselines
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import progress_bar, stdout_console

    with progress_bar("simulating") as progress:
        result = simulate_baselines(
            only,
            mass=mass,
            strides=strides,
            time_step=1e-3 * step_ms,
            folder=out,
            n_jobs=jobs,
            progress=progress,
        )
    result.save()
    if as_json:
        click.echo(json.dumps(result.to_json(), indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, result.format_summary())
    console.print(f"Folder: {result.folder}", soft_wrap=True)
