"""``klute-sim assumptions``."""

import json
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common

if TYPE_CHECKING:
    from klute_sim.device.device import Device
    from klute_sim.reproduction.assumptions import MetricsFunction

MIN_RELATIVE_CHANGE = 0.005
"""Relative change that is worth a word."""
MAX_CHANGES_SHOWN = 3
"""Changes told in the table, the largest."""


@click.command("assumptions")
@click.argument("names", metavar="[NAME|FILE]...", nargs=-1)
@click.option("--gait", is_flag=True, help="Say what each number changes in walking, too: a walk for each of them.")
@common.json_option("tables")
def command(names: tuple[str, ...], gait: bool, as_json: bool) -> None:
    """List every assumed number of devices: why it was assumed, and what it changes.

    A number is assumed where the page with it is missing from our copy of the source, or where nobody printed it.
    Each is moved by 10 % (a count by 1, a temperature by 10 degrees) and the device is put on a simulated bench again,
    at the crosshead length that puts the unchanged device at 0.96 of its resting length: isometric force, force while
    shortening at 300 and lengthening at 150 mm/s, time to 90 % of force after a pressure step, net work of a cycle at
    100 mm/s, air in the muscle. Without names: all devices that come with the package.

    \b
    Examples:
      klute-sim assumptions
      klute-sim assumptions klute-1-1-4-pair --gait
      klute-sim assumptions my-device.toml --json
    """
    from klute_sim.cli.console import progress_bar
    from klute_sim.device.device import list_presets, load_device
    from klute_sim.reproduction.assumptions import make_bench_metrics, perturb_assumptions

    devices = [load_device(name) for name in names or list_presets()]
    found: dict[str, Any] = {}
    with progress_bar("trying") as told:
        for number, device in enumerate(devices):
            rig = make_bench_metrics(device)
            outcomes = _merge_outputs(rig, _compute_gait_outputs) if gait and device.spec.mounting else rig

            def share(part: float, number: int = number) -> None:
                told((number + part) / len(devices))

            rows = perturb_assumptions(device, outcomes, share)
            found[device.name] = [
                {
                    "key": r.key,
                    "value": r.value,
                    "why": r.reason,
                    "tried_with": r.perturbed_value,
                    "changes": r.relative_changes,
                }
                for r in rows
            ]
    if as_json:
        click.echo(json.dumps(found, indent=2))
    else:
        _print(found, gait=gait)


def _merge_outputs(first: "MetricsFunction", second: "MetricsFunction") -> "MetricsFunction":
    return lambda device: {**first(device), **second(device)}


def _compute_gait_outputs(device: "Device") -> dict[str, float]:
    from klute_sim.controllers.pressure import load_default_profile
    from klute_sim.gait.metrics import compute_gait_metrics
    from klute_sim.gait.rig.rig import simulate_gait
    from klute_sim.gait.rig.setup import GaitOptions

    result = compute_gait_metrics(simulate_gait(device, load_default_profile(), GaitOptions(strides=3)))
    return {
        "walking: peak net moment": result.mean(lambda s: s.ankle_moment_peak_nm_per_kg) or 0.0,
        "walking: peak net power": result.mean(lambda s: s.ankle_power_peak_w_per_kg) or 0.0,
        "walking: positive work": result.mean(lambda s: s.ankle_work_positive_j_per_kg) or 0.0,
        "walking: air": result.mean(lambda s: s.air_g) or 0.0,
    }


def _print(results: dict[str, Any], *, gait: bool) -> None:
    from rich.table import Table

    from klute_sim.cli.console import stdout_console

    out = stdout_console()
    for name, rows in results.items():
        if not rows:
            out.print(f"{name}: no number is marked as assumed (klute-sim device says which have a source).\n")
            continue
        table = Table("number", "value", "why", "tried", "what that changes", title=name)
        for row in rows:
            changed = sorted(row["changes"].items(), key=lambda pair: -abs(pair[1]))
            told = [
                f"{what} {100.0 * by:+.1f} %"
                for what, by in changed[:MAX_CHANGES_SHOWN]
                if abs(by) >= MIN_RELATIVE_CHANGE
            ]
            nothing = "nothing here" if gait or not row["key"].startswith("mounting") else "nothing on a bench (--gait)"
            table.add_row(
                row["key"], f"{row['value']:g}", row["why"], f"{row['tried_with']:g}", "; ".join(told) or nothing
            )
        out.print(table)
    out.print(
        f"Up to {MAX_CHANGES_SHOWN} changes are shown, from {100 * MIN_RELATIVE_CHANGE:g} % on; --json has all. Numbers without any source: "
        "klute-sim device NAME.",
        soft_wrap=True,
    )
