"""What a bench run comes to: a row per trial, a table for a terminal, and what a reader has to know beside it."""

import csv
import io
import math
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from klute_sim import units
from klute_sim.rigs.bench.run import Result, Trial

FULL = 99.0
"""Overlap of pressure and movement [%] below which it is said to be incomplete."""

SMALL = 5e-4
"""What is less is shown as 0: the readings are in N, J, s, mm/s, deg and their like."""

SHOWN: dict[str, tuple[str, ...]] = {
    "isometric": ("force_n", "unit_length_mm"),
    "isokinetic": ("force_n", "force_ratio", "muscle_velocity_mm_per_s"),
    "quick-release": ("force_before_n", "force_lowest_n", "force_after_n", "stiffness_n_per_mm", "recovery_s"),
    "step": ("pressure_up_rise_s", "force_up_delay_s", "force_up_rise_s", "force_up_settling_s", "force_down_rise_s"),
    "frequency": ("pressure_gain", "pressure_phase_deg", "force_gain_n_per_bar", "force_phase_deg", "force_coherence"),
    "creep": (),
    "workloop": ("work_j", "work_shortening_j", "work_lengthening_j", "force_max_n", "overlap_pct"),
}
"""Kind -> readings in the table; all are in results.csv. Empty: all."""

PHASED = "phased"
"""Activation of a work loop whose trials' names begin so."""

PER_DECADE = "_pct_per_decade"
"""End of a key whose unit is % per decade of time."""


def summary(result: Result) -> dict[str, Any]:
    """Everything but the recordings, as JSON types; what could not be read is null."""
    return {
        "protocol": result.protocol.name,
        "kind": result.protocol.kind,
        "device": result.device.name,
        "mujoco": result.mujoco,
        "step_ms": 1e3 * result.step,
        "trials": [
            {
                "name": trial.name,
                "setting": trial.setting,
                "readings": {key: None if math.isnan(value) else value for key, value in trial.readings.items()},
            }
            for trial in result.trials
        ],
        "assumptions": {
            **{f"protocol.{key}": why for key, why in result.protocol.assumed().items()},
            **result.device.spec.assumed(),
        },
        "remarks": remarks(result),
    }


def results_csv(result: Result) -> str:
    """One row per trial; what could not be read is an empty cell."""
    keys = ["trial", *dict.fromkeys(key for trial in result.trials for key in (*trial.setting, *trial.readings))]
    text = io.StringIO()
    writer = csv.DictWriter(text, keys, restval="", lineterminator="\n")
    writer.writeheader()
    for trial in result.trials:
        read = {key: "" if math.isnan(value) else repr(value) for key, value in trial.readings.items()}
        writer.writerow({"trial": trial.name, **trial.setting, **read})
    return text.getvalue()


def table(result: Result) -> Table:
    """The readings one looks at first, a row per trial."""
    first = result.trials[0]
    shown = SHOWN[result.protocol.kind] or tuple(key for key in first.readings if key != "ledger_residual_j")
    where = "MuJoCo tester" if result.mujoco else "device alone"
    made = Table(title=Text(f"{result.protocol.name}: {result.device.name}, {where}"), box=box.SIMPLE_HEAD)
    # What is the same in all trials is in the files, unless it is all there is.
    changed = [key for key in first.setting if len({t.setting[key] for t in result.trials}) > 1] or list(first.setting)
    named = result.protocol.kind == "workloop"
    if named:
        phased = any(_phased(trial) for trial in result.trials)
        made.add_column("activation\n[% of cycle]" if phased else "activation", no_wrap=True)
        changed = [key for key in changed if not key.startswith(("phase", "duty"))]
    for key in (*changed, *shown):
        made.add_column(_heading(key), justify="right")
    for trial in result.trials:
        cells = [*(f"{trial.setting[key]:g}" for key in changed), *(_cell(trial, key) for key in shown)]
        made.add_row(*([_activation(trial)] if named else []), *cells)
    return made


def remarks(result: Result) -> list[str]:
    """What a reader has to know beside the table, one sentence each."""
    said = []
    assumed = result.protocol.assumed()
    if assumed:
        said.append(f"Assumed in the protocol, not printed in the source: {', '.join(assumed)}.")
    nothing = [t.name for t in result.trials if math.isnan(t.readings.get("force_n", 0.0))]
    if nothing:
        said.append(
            f"In {len(nothing)} of {len(result.trials)} trials the length to read at was not passed at full speed: "
            f"{', '.join(nothing[:4])}{' ...' if len(nothing) > 4 else ''}."
        )
    said.extend(_late(result))
    said.extend(_pushing(result))
    if result.protocol.kind == "workloop":
        said.append("Positive work is done by the device on the crosshead.")
    return said


def _late(result: Result) -> list[str]:
    """Of work loops: where the pressure was not the commanded one, and whether a longer dwell would help."""
    said = []
    behind_valve = result.device.parameters.supply.fill > 0.0
    empty = any((t.recording["pressure_command"] > t.recording["supply_pressure"]).any() for t in result.trials)
    if empty:
        cure = "the supply, or the tank behind it, had less than was commanded."
    elif behind_valve:
        cure = "the valve does not follow so fast or so closely."
    else:
        cure = "with a longer dwell_s it would be."
    for phased in (False, True):
        own = [t for t in result.trials if "overlap_pct" in t.readings and _phased(t) == phased]
        late = [t.name for t in own if t.readings["overlap_pct"] < FULL]
        if not late:
            continue
        kind = "phased" if phased else "concentric or eccentric"
        said.append(
            f"In {len(late)} of {len(own)} {kind} trials the pressure was not the commanded one all the way: "
            + ("with phased activation its rise and fall are part of the experiment." if phased else cure)
        )
    return said


def _pushing(result: Result) -> list[str]:
    """What a force below 0 is."""
    lowest = {
        trial.name: min((v for k, v in trial.readings.items() if k.startswith("force") and k.endswith("_n")), default=0)
        for trial in result.trials
    }
    below = [force for force in lowest.values() if force < -SMALL]
    if not below:
        return []
    return [
        f"In {len(below)} of {len(lowest)} trials a force is below 0 (down to {min(below):.4g} N): there the bare "
        "muscle pushes, by its rubber and by the friction offset of Table 3.1, which has no sign and grows with "
        "pressure. A tendon would be slack."
    ]


def _heading(key: str) -> str:
    """Of a column, with its unit below."""
    name, unit = units.split(key)
    if key.endswith(PER_DECADE):
        name, unit = key.removesuffix(PER_DECADE), "% per decade"
    return f"{name.replace('_', ' ')}\n{f'[{unit}]' if unit else ''}"


def _cell(trial: Trial, key: str) -> str:
    value = trial.readings[key]
    return "-" if math.isnan(value) else f"{0.0 if abs(value) < SMALL else value:.4g}"


def _phased(trial: Trial) -> bool:
    return trial.name.startswith(PHASED)


def _activation(trial: Trial) -> str:
    """The first word of its name, and of a phased one the phase, too."""
    word, second, *_ = trial.name.split("_")
    return f"phased {second.removesuffix('pct')}" if _phased(trial) else word
