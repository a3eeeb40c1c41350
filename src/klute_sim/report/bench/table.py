"""What a bench run comes to: a row per trial, a table for a terminal, and what a reader has to know beside it."""

import csv
import io
import math
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from klute_sim import units
from klute_sim.bench.run import BenchResult, BenchTrial

MIN_OVERLAP_PCT = 99.0
"""Overlap of pressure and movement [%] below which it is said to be incomplete."""

DISPLAY_ZERO_TOLERANCE = 5e-4
"""What is less is shown as 0: the readings are in N, J, s, mm/s, deg and their like."""

TABLE_METRICS: dict[str, tuple[str, ...]] = {
    "isometric": ("force_n", "unit_length_mm"),
    "isokinetic": ("force_n", "force_ratio", "muscle_velocity_mm_per_s"),
    "quick-release": ("force_before_n", "force_lowest_n", "force_after_n", "stiffness_n_per_mm", "recovery_s"),
    "step": ("pressure_up_rise_s", "force_up_delay_s", "force_up_rise_s", "force_up_settling_s", "force_down_rise_s"),
    "frequency": ("pressure_gain", "pressure_phase_deg", "force_gain_n_per_bar", "force_phase_deg", "force_coherence"),
    "creep": (),
    "workloop": ("work_j", "work_shortening_j", "work_lengthening_j", "force_max_n", "overlap_pct"),
}
"""Kind -> readings in the table; all are in results.csv. Empty: all."""

PHASED_PREFIX = "phased"
"""Activation of a work loop whose trials' names begin so."""

PER_DECADE_SUFFIX = "_pct_per_decade"
"""End of a key whose unit is % per decade of time."""


def summarize_bench_run(result: BenchResult) -> dict[str, Any]:
    """Everything but the recordings, as JSON types; what could not be read is null."""
    return {
        "protocol": result.protocol.name,
        "kind": result.protocol.kind,
        "device": result.device.name,
        "mujoco": result.use_mujoco,
        "step_ms": 1e3 * result.dt,
        "trials": [
            {
                "name": trial.name,
                "setting": trial.conditions,
                "readings": {key: None if math.isnan(value) else value for key, value in trial.metrics.items()},
            }
            for trial in result.trials
        ],
        "assumptions": {
            **{f"protocol.{key}": why for key, why in result.protocol.list_assumptions().items()},
            **result.device.spec.collect_assumptions(),
        },
        "remarks": collect_remarks(result),
    }


def format_results_csv(result: BenchResult) -> str:
    """One row per trial; what could not be read is an empty cell."""
    keys = ["trial", *dict.fromkeys(key for trial in result.trials for key in (*trial.conditions, *trial.metrics))]
    text = io.StringIO()
    writer = csv.DictWriter(text, keys, restval="", lineterminator="\n")
    writer.writeheader()
    for trial in result.trials:
        read = {key: "" if math.isnan(value) else repr(value) for key, value in trial.metrics.items()}
        writer.writerow({"trial": trial.name, **trial.conditions, **read})
    return text.getvalue()


def build_table(result: BenchResult) -> Table:
    """The readings one looks at first, a row per trial."""
    first = result.trials[0]
    shown = TABLE_METRICS[result.protocol.kind] or tuple(key for key in first.metrics if key != "ledger_residual_j")
    where = "MuJoCo tester" if result.use_mujoco else "device alone"
    made = Table(title=Text(f"{result.protocol.name}: {result.device.name}, {where}"), box=box.SIMPLE_HEAD)
    # What is the same in all trials is in the files, unless it is all there is.
    changed = [key for key in first.conditions if len({t.conditions[key] for t in result.trials}) > 1] or list(
        first.conditions
    )
    named = result.protocol.kind == "workloop"
    if named:
        phased = any(_is_phased(trial) for trial in result.trials)
        made.add_column("activation\n[% of cycle]" if phased else "activation", no_wrap=True)
        changed = [key for key in changed if not key.startswith(("phase", "duty"))]
    for key in (*changed, *shown):
        made.add_column(_format_heading(key), justify="right")
    for trial in result.trials:
        cells = [*(f"{trial.conditions[key]:g}" for key in changed), *(_format_cell(trial, key) for key in shown)]
        made.add_row(*([_format_activation(trial)] if named else []), *cells)
    return made


def collect_remarks(result: BenchResult) -> list[str]:
    """What a reader has to know beside the table, one sentence each."""
    said = []
    assumed = result.protocol.list_assumptions()
    if assumed:
        said.append(f"Assumed in the protocol, not printed in the source: {', '.join(assumed)}.")
    nothing = [t.name for t in result.trials if math.isnan(t.metrics.get("force_n", 0.0))]
    if nothing:
        said.append(
            f"In {len(nothing)} of {len(result.trials)} trials the length to read at was not passed at full speed: "
            f"{', '.join(nothing[:4])}{' ...' if len(nothing) > 4 else ''}."
        )
    said.extend(_describe_pressure_tracking(result))
    said.extend(_describe_negative_forces(result))
    if result.protocol.kind == "workloop":
        said.append("Positive work is done by the device on the crosshead.")
    return said


def _describe_pressure_tracking(result: BenchResult) -> list[str]:
    """Of work loops: where the pressure was not the commanded one, and whether a longer dwell would help."""
    said = []
    behind_valve = result.device.parameters.supply.fill_conductance > 0.0
    empty = any((t.recording["pressure_command"] > t.recording["supply_pressure"]).any() for t in result.trials)
    if empty:
        cure = "the supply, or the tank behind it, had less than was commanded."
    elif behind_valve:
        cure = "the valve does not follow so fast or so closely."
    else:
        cure = "with a longer dwell_s it would be."
    for phased in (False, True):
        own = [t for t in result.trials if "overlap_pct" in t.metrics and _is_phased(t) == phased]
        late = [t.name for t in own if t.metrics["overlap_pct"] < MIN_OVERLAP_PCT]
        if not late:
            continue
        kind = "phased" if phased else "concentric or eccentric"
        said.append(
            f"In {len(late)} of {len(own)} {kind} trials the pressure was not the commanded one all the way: "
            + ("with phased activation its rise and fall are part of the experiment." if phased else cure)
        )
    return said


def _describe_negative_forces(result: BenchResult) -> list[str]:
    """What a force below 0 is."""
    lowest = {
        trial.name: min((v for k, v in trial.metrics.items() if k.startswith("force") and k.endswith("_n")), default=0)
        for trial in result.trials
    }
    below = [force for force in lowest.values() if force < -DISPLAY_ZERO_TOLERANCE]
    if not below:
        return []
    return [
        f"In {len(below)} of {len(lowest)} trials a force is below 0 (down to {min(below):.4g} N): there the bare "
        "muscle pushes, by its rubber and by the friction offset of Table 3.1, which has no sign and grows with "
        "pressure. A tendon would be slack."
    ]


def _format_heading(key: str) -> str:
    """Of a column, with its unit below."""
    name, unit = units.split_unit(key)
    if key.endswith(PER_DECADE_SUFFIX):
        name, unit = key.removesuffix(PER_DECADE_SUFFIX), "% per decade"
    return f"{name.replace('_', ' ')}\n{f'[{unit}]' if unit else ''}"


def _format_cell(trial: BenchTrial, key: str) -> str:
    value = trial.metrics[key]
    return "-" if math.isnan(value) else f"{0.0 if abs(value) < DISPLAY_ZERO_TOLERANCE else value:.4g}"


def _is_phased(trial: BenchTrial) -> bool:
    return trial.name.startswith(PHASED_PREFIX)


def _format_activation(trial: BenchTrial) -> str:
    """The first word of its name, and of a phased one the phase, too."""
    word, second, *_ = trial.name.split("_")
    return f"phased {second.removesuffix('pct')}" if _is_phased(trial) else word
