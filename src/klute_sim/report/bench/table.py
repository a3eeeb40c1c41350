"""Metrics of a bench run as JSON, as CSV and as a table for a terminal, and remarks on the run."""

import math
from typing import Any

from rich.table import Table

from klute_sim import units
from klute_sim.bench.run import BenchResult, BenchTrial
from klute_sim.terminal_table import create_table

MIN_OVERLAP_PCT = 99.0
"""Smallest overlap [%] of pressure and motion that counts as complete."""

DISPLAY_ZERO_TOLERANCE = 5e-4
"""Magnitude below which a metric is shown as 0, in the metric's unit (N, J, s, mm/s, deg, ...)."""

TABLE_METRICS: dict[str, tuple[str, ...]] = {
    "isometric": ("force_n", "unit_length_mm"),
    "isokinetic": ("force_n", "force_ratio", "muscle_velocity_mm_per_s"),
    "quick-release": ("force_before_n", "force_lowest_n", "force_after_n", "stiffness_n_per_mm", "recovery_s"),
    "step": ("pressure_up_rise_s", "force_up_delay_s", "force_up_rise_s", "force_up_settling_s", "force_down_rise_s"),
    "frequency": ("pressure_gain", "pressure_phase_deg", "force_gain_n_per_bar", "force_phase_deg", "force_coherence"),
    "creep": (),
    "identification": (),
    "workloop": ("work_j", "work_shortening_j", "work_lengthening_j", "force_max_n", "overlap_pct"),
}
"""Kind of test -> metrics shown in the table (empty: all); results.csv has all of them."""

PHASED_PREFIX = "phased"
"""Start of the names of work-loop trials with phased activation."""

PER_DECADE_SUFFIX = "_pct_per_decade"
"""End of the keys of metrics in % per decade of time."""


def summarize_bench_run(result: BenchResult) -> dict[str, Any]:
    """Return everything except the recordings as JSON types; metrics that do not exist are null."""
    return {
        "protocol": result.protocol.name,
        "kind": result.protocol.kind,
        "device": result.device.name,
        "mujoco": result.use_mujoco,
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
            **{f"protocol.{key}": reason for key, reason in result.protocol.list_assumptions().items()},
            **result.device.spec.collect_assumptions(),
        },
        "remarks": collect_remarks(result),
    }


def build_table(result: BenchResult) -> Table:
    """Build the table of the most important metrics, with one row per trial."""
    first = result.trials[0]
    metrics = TABLE_METRICS[result.protocol.kind] or tuple(key for key in first.metrics if key != "ledger_residual_j")
    rig = "MuJoCo tester" if result.use_mujoco else "device only"
    table = create_table(title=f"{result.protocol.name}: {result.device.name}, {rig}")
    # Conditions that are constant are left to the files, unless all of them are constant.
    varied = [key for key in first.conditions if len({t.conditions[key] for t in result.trials}) > 1] or list(
        first.conditions
    )
    has_activation = result.protocol.kind == "workloop"
    if has_activation:
        has_phases = any(_is_phased(trial) for trial in result.trials)
        table.add_column("activation\n[% of cycle]" if has_phases else "activation", no_wrap=True)
        varied = [key for key in varied if not key.startswith(("phase", "duty"))]
    for key in (*varied, *metrics):
        table.add_column(_format_heading(key), justify="right")
    for trial in result.trials:
        cells = [*(f"{trial.conditions[key]:g}" for key in varied), *(_format_cell(trial, key) for key in metrics)]
        table.add_row(*([_format_activation(trial)] if has_activation else []), *cells)
    return table


def collect_remarks(result: BenchResult) -> list[str]:
    """Return remarks that limit or explain the results, one sentence each."""
    remarks = []
    assumptions = result.protocol.list_assumptions()
    if assumptions:
        remarks.append(
            f"Values that the protocol assumes, because the source does not print them: {', '.join(assumptions)}."
        )
    missed = [t.name for t in result.trials if math.isnan(t.metrics.get("force_n", 0.0))]
    if missed:
        remarks.append(
            f"{len(missed)} of {len(result.trials)} trials did not pass the measurement length at full speed: "
            f"{', '.join(missed[:4])}{' ...' if len(missed) > 4 else ''}."
        )
    remarks.extend(_describe_pressure_tracking(result))
    remarks.extend(_describe_negative_forces(result))
    remarks.extend(_describe_slack(result))
    remarks.extend(_describe_missing_velocity(result))
    if result.protocol.kind == "workloop":
        remarks.append("Positive work is done by the device on the crosshead.")
    return remarks


def _describe_pressure_tracking(result: BenchResult) -> list[str]:
    """Return, for work loops, where the pressure deviated from its command and what would help."""
    remarks = []
    has_valve = result.device.parameters.supply.fill_conductance > 0.0
    is_supply_short = any(
        (t.recording["pressure_command"] > t.recording["supply_pressure"]).any() for t in result.trials
    )
    if is_supply_short:
        cause = "the supply, or its tank, had less pressure than commanded."
    elif has_valve:
        cause = "the valve cannot follow the command fast or closely enough."
    else:
        cause = "a longer dwell_s would help."
    for is_phased in (False, True):
        trials = [t for t in result.trials if "overlap_pct" in t.metrics and _is_phased(t) == is_phased]
        n_late = sum(t.metrics["overlap_pct"] < MIN_OVERLAP_PCT for t in trials)
        if not n_late:
            continue
        kind = "phased" if is_phased else "concentric or eccentric"
        remarks.append(
            f"In {n_late} of {len(trials)} {kind} trials the pressure deviated from its command during the motion: "
            + ("with phased activation its rise and fall are part of the experiment." if is_phased else cause)
        )
    return remarks


def _describe_negative_forces(result: BenchResult) -> list[str]:
    """Return an explanation of forces below 0, if there are any."""
    lowest = {
        trial.name: min((v for k, v in trial.metrics.items() if k.startswith("force") and k.endswith("_n")), default=0)
        for trial in result.trials
    }
    below = [force for force in lowest.values() if force < -DISPLAY_ZERO_TOLERANCE]
    if not below:
        return []
    statement = f"In {len(below)} of {len(lowest)} trials a force is negative (minimum {min(below):.4g} N): "
    spec = result.device.spec
    if spec.muscle is None:
        part = "damper" if spec.damper else "cylinder"
        return [f"{statement}the {part} resists a motion that shortens it. Tension is positive."]
    damper = " While it shortens, its damper pushes, too." if spec.damper else ""
    return [
        f"{statement}the bare muscle pushes. The causes are its bladder and the friction offset of Table 3.1, which "
        f"grows with pressure and does not depend on direction.{damper} A tendon would be slack."
    ]


def _describe_slack(result: BenchResult) -> list[str]:
    """Return an explanation of isometric forces of 0, if there are any: the tendon of the unit is slack."""
    if result.protocol.kind != "isometric" or result.device.spec.tendon is None:
        return []
    n_slack = sum(abs(trial.metrics["force_n"]) < DISPLAY_ZERO_TOLERANCE for trial in result.trials)
    if not n_slack:
        return []
    return [f"In {n_slack} of {len(result.trials)} trials the force is 0: the tendon is slack at this length."]


def _describe_missing_velocity(result: BenchResult) -> list[str]:
    """Return why the forces of an isokinetic test do not depend on velocity, where nothing in the device does."""
    spec = result.device.spec
    if result.protocol.kind != "isokinetic" or spec.damper is not None or spec.effects:
        return []
    return [
        "Without a damper and without effects the force does not depend on velocity: trials with equal length and "
        "pressure have equal forces."
    ]


def _format_heading(key: str) -> str:
    """Return the heading of a column: the name of ``key`` with its unit below."""
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
    """Return the activation, which is the first word of the trial's name, and the phase of a phased activation."""
    word, second, *_ = trial.name.split("_")
    return f"phased {second.removesuffix('pct')}" if _is_phased(trial) else word
