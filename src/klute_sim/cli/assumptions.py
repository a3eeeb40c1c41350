"""``klute-sim assumptions``."""

import json
from typing import Any

import click

from klute_sim.cli import common

MIN_RELATIVE_CHANGE = 0.005
"""Smallest relative change that the table lists."""
MAX_CHANGES_SHOWN = 3
"""Largest number of changes that the table lists for each number."""


@click.command("assumptions")
@click.argument("names", metavar="[NAME|FILE]...", nargs=-1)
@click.option(
    "--gait", is_flag=True, help="Also compute the changes in gait; this takes one gait simulation per number."
)
@common.json_option("tables")
def command(names: tuple[str, ...], gait: bool, as_json: bool) -> None:
    """List the assumed numbers of devices with their reasons and their influence.

    Without NAME or FILE, prints all presets. A number is assumed where the source does not print it, or where its page
    is missing from this copy of the source.

    Each number is changed by 10 % (a count by 1, a temperature by 10 degrees), and the bench test of the device is
    simulated again. Its metrics are the isometric force, the force while shortening at 300 mm/s and while lengthening
    at 150 mm/s, the time to 90 % of the force after a pressure step, the net work of a cycle at 100 mm/s, and the air
    in the muscle. In all tests the unit has the length at which the unchanged muscle has 0.96 of its resting length.

    \b
    Examples:
      klute-sim assumptions
      klute-sim assumptions klute-1-1-4-pair --gait
      klute-sim assumptions my-device.toml --json
    """
    from klute_sim.cli.console import progress_bar
    from klute_sim.device.device import list_presets, load_device
    from klute_sim.reproduction.assumptions import (
        compute_gait_run_metrics,
        make_bench_metrics,
        merge_metrics,
        perturb_assumptions,
    )

    devices = [load_device(name) for name in names or list_presets()]
    results: dict[str, Any] = {}
    with progress_bar("changing assumptions") as progress:
        for index, device in enumerate(devices):
            bench_metrics = make_bench_metrics(device)
            with_gait = gait and device.spec.mounting
            metrics = merge_metrics(bench_metrics, compute_gait_run_metrics) if with_gait else bench_metrics

            def report(fraction: float, stage: str, index: int = index, name: str = device.name) -> None:
                progress((index + fraction) / len(devices), f"{name}: {stage}")

            results[device.name] = [
                {
                    "key": effect.key,
                    "value": effect.value,
                    "why": effect.reason,
                    "tried_with": effect.perturbed_value,
                    "changes": effect.relative_changes,
                }
                for effect in perturb_assumptions(device, metrics, report)
            ]
    if as_json:
        click.echo(json.dumps(results, indent=2))
    else:
        _print(results, gait=gait)


def _print(results: dict[str, Any], *, gait: bool) -> None:
    from klute_sim.cli.console import stdout_console
    from klute_sim.terminal_table import create_table

    console = stdout_console()
    for name, rows in results.items():
        if not rows:
            console.print(f"{name}: no number is marked as assumed (klute-sim device lists the sources).\n")
            continue
        table = create_table("number", "value", "reason", "changed to", "relative changes", title=name)
        for row in rows:
            largest = sorted(row["changes"].items(), key=lambda pair: -abs(pair[1]))[:MAX_CHANGES_SHOWN]
            changes = "; ".join(
                f"{metric} {100.0 * change:+.1f} %" for metric, change in largest if abs(change) >= MIN_RELATIVE_CHANGE
            )
            needs_gait = row["key"].startswith("mounting") and not gait
            no_change = "none on the bench (see --gait)" if needs_gait else "none"
            table.add_row(row["key"], f"{row['value']:g}", row["why"], f"{row['tried_with']:g}", changes or no_change)
        console.print(table)
    console.print(
        f"The table lists up to {MAX_CHANGES_SHOWN} changes of at least {100 * MIN_RELATIVE_CHANGE:g} %; --json lists "
        "all. Numbers without a source: klute-sim device NAME.",
        soft_wrap=True,
    )
