"""Metrics of a joint test as JSON, as CSV and as a table for a terminal."""

import math
from typing import Any

from rich.table import Table

from klute_sim import units
from klute_sim.mechanism.run import JointTestResult
from klute_sim.terminal_table import create_table
from klute_sim.units import BAR

DEVICE_METRICS = ("work_", "ledger_residual_", "air_drawn_")
"""Beginnings of the metrics of each device, which only the files hold."""


def summarize_joint_test(result: JointTestResult) -> dict[str, Any]:
    """Return everything except the recordings as JSON types; metrics that do not exist are null."""
    return {
        "test": result.test,
        "model": result.file.name,
        "devices": {name: device.name for name, device in result.devices.items()},
        "joint": result.joint,
        "numbers": dict(result.numbers),
        "mean_bar": result.settings.mean_pressure / BAR,
        "difference_bar": result.settings.difference / BAR,
        "load": result.settings.load,
        "step_ms": 1e3 * result.dt,
        "trials": [
            {
                "name": trial.name,
                "conditions": trial.conditions,
                "metrics": {key: None if math.isnan(value) else value for key, value in trial.metrics.items()},
            }
            for trial in result.trials
        ],
        "assumptions": {
            "model": "dimensions, masses, damping and stops of the models of the package are assumed",
            **{
                f"{name}: {key}": reason
                for name, device in result.devices.items()
                for key, reason in device.spec.collect_assumptions().items()
            },
        },
    }


def build_table(result: JointTestResult) -> Table:
    """Build the table of the metrics of the joint, with one row per trial."""
    devices = ", ".join(f"{name}: {device.name}" for name, device in result.devices.items())
    table = create_table(title=f"{result.test}: {result.file.name} ({devices})")
    first = result.trials[0]
    keys = [key for key in first.metrics if not key.startswith(DEVICE_METRICS)]
    for key in (*first.conditions, *keys):
        name, unit = split_name(result, key)
        table.add_column(f"{name}\n{f'[{unit}]' if unit else ''}", justify="right")
    for trial in result.trials:
        values = {**trial.conditions, **trial.metrics}
        table.add_row(*(_format(values[key]) for key in (*first.conditions, *keys)))
    return table


def split_name(result: JointTestResult, key: str) -> tuple[str, str]:
    """Return a condition or metric ``key`` in words, and its unit; '' if it has none."""
    name, unit = ("load", "N·m" if result.unit == "deg" else "N") if key == "load" else units.split_unit(key)
    return name.replace("_", " "), unit


def _format(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4g}"
