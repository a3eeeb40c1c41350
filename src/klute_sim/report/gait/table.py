"""Results table of a gait run and remarks on it, for a terminal."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from rich.table import Table

from klute_sim.device.schema.foot import RIGID_FOOT
from klute_sim.gait.metrics import (
    AnkleMetrics,
    GaitMetrics,
    StrideMetrics,
    compute_reference_metrics,
    is_level_ground,
    is_spring_foot,
)
from klute_sim.gait.reference import DEFAULT_NAME, MAX_GRF_TRACKING_RMS_BW
from klute_sim.gait.rig.hip_path import FORWARD_TOLERANCE_BW, MAX_LEARNING_STRIDES, VERTICAL_TOLERANCE_BW
from klute_sim.recording.recording import Recording
from klute_sim.report.gait.reference_text import shorten_reference_name
from klute_sim.terminal_table import abbreviate, create_table

Row: TypeAlias = tuple[str, str, str, Callable[[StrideMetrics], float | None]]
"""Label, unit, number format, and metric of a stride."""
MIN_LABEL_WIDTH_CHARS = 15
"""Width [characters] of the longest word of a label."""
ANKLE_ROWS: tuple[tuple[str, str, str, Callable[[AnkleMetrics], float | None]], ...] = (
    ("ankle range", "deg", ".1f", lambda s: s.ankle_range_deg),
    ("peak net moment", "N·m/kg", ".3f", lambda s: s.ankle_moment_peak_nm_per_kg),
    ("  at", "% cycle", ".1f", lambda s: s.ankle_moment_peak_pct),
    ("peak net power (15 ms mean)", "W/kg", ".2f", lambda s: s.ankle_power_peak_w_per_kg),
    ("  at", "% cycle", ".1f", lambda s: s.ankle_power_peak_pct),
    ("net ankle work", "J/kg", "+.3f", lambda s: s.ankle_work_net_j_per_kg),
    ("positive ankle work", "J/kg", ".3f", lambda s: s.ankle_work_positive_j_per_kg),
    ("energy return in stance", "ratio", ".2f", lambda s: s.energy_return),
    ("quasi-stiffness", "N·m/kg/deg", ".3f", lambda s: s.quasi_stiffness_nm_per_kg_deg),
    ("first contact", "% cycle", ".1f", lambda s: s.first_contact_pct),
    ("toe-off", "% cycle", ".1f", lambda s: s.toe_off_pct),
    ("fore-aft reaction, braking", "body wt", "+.3f", lambda s: s.grf_forward_min_bw),
    ("fore-aft reaction, push-off", "body wt", "+.3f", lambda s: s.grf_forward_max_bw),
    ("vertical peak 1 (tracked)", "body wt", ".3f", lambda s: s.grf_vertical_peaks_bw[0]),
    ("vertical peak 2 (tracked)", "body wt", ".3f", lambda s: s.grf_vertical_peaks_bw[1]),
)
"""Rows for metrics that the human reference has, too: label, unit, number format, metric of a stride."""

RIG_ROWS: tuple[tuple[str, str, str, Callable[[StrideMetrics], float | None]], ...] = (
    ("vertical load error, stance rms", "body wt", ".3f", lambda s: s.grf_vertical_tracking_rms_bw),
    ("fore-aft load error, stance rms", "body wt", ".3f", lambda s: s.grf_forward_tracking_rms_bw),
    ("largest loading rate (5 ms)", "body wt/s", ".1f", lambda s: s.loading_rate_max_bw_per_s),
    ("angle vs human, stance rms", "sd", ".2f", lambda s: s.angle_distance_sd.stance_rms),
    ("angle vs human, swing rms", "sd", ".2f", lambda s: s.angle_distance_sd.swing_rms),
    ("moment vs human, stance rms", "sd", ".2f", lambda s: s.moment_distance_sd.stance_rms),
    ("power vs human, stance rms", "sd", ".2f", lambda s: s.power_distance_sd.stance_rms),
    ("toe clearance in mid-swing", "mm", ".1f", lambda s: s.toe_clearance_mm),
    ("roll-over radius", "m", ".3f", lambda s: s.rollover_radius_m),
)
"""Rows for metrics that a person does not have: label, unit, number format, metric of a stride."""
DEVICE_ROWS: tuple[tuple[str, str, str, Callable[[StrideMetrics], float | None]], ...] = (
    ("actuator peak moment", "N·m/kg", ".3f", lambda s: s.actuator_moment_peak_nm_per_kg),
    ("actuator net work", "J/kg", "+.3f", lambda s: s.actuator_work_net_j_per_kg),
    ("energy from friction offset", "J/kg", "+.3f", lambda s: s.friction_offset_work_j_per_kg),
    ("air drawn (gas model assumed)", "g", ".2f", lambda s: s.air_g),
    ("air leaked", "g", ".3f", lambda s: s.air_leaked_g),
    ("energy not accounted for", "%", ".4f", lambda s: s.ledger_residual_pct),
    ("force not accounted for", "N", ".1e", lambda s: s.force_residual_max_n),
)
"""Rows for metrics that a spring foot does not have: label, unit, number format, metric of a stride."""

PEAK_CHANNELS = {"peak net moment": "ankle_moment", "peak net power (15 ms mean)": "ankle_power"}
"""Row -> channel whose human standard deviation, at the peak of the human mean, is the unit of its difference."""
MAX_STRIDE_COLUMNS = 5
"""Largest number of strides beside each other; more do not fit into 80 columns."""
MAX_USUAL_ALIGNMENT_DEG = 5.0
"""Largest alignment [deg] to a reference of the user without a remark (assumed)."""
MIN_LEDGER_ENERGY_J = 0.005
"""Smallest energy per stride [J] for which a ledger line is shown."""
MAX_PERCENTAGE_RATIO = 3.0
"""Largest ratio of two values whose difference is in percent; beyond, the reference is near zero (assumed)."""
LEARNING_GROWTH = 2.5
"""Proposed number of learning strides over one that was too small: 100 instead of 40 (assumed)."""
STALLED_FRACTION = 0.6
"""Fraction of the learning strides before which the best one shows that learning has stalled (assumed)."""
LEDGER_LABELS = {
    "gas": "energy from the gas",
    "friction": "energy from friction offset",
    "damper": "energy from the damper",
    "stop": "energy from length stops",
    "bladder": "energy from the bladders",
    "tendon": "energy from the tendon",
    "delivered": "energy delivered",
    "residual": "net energy not accounted for",
}
"""Line of the energy ledger -> its label; effects have lines of their own."""


def build_table(recording: Recording, metrics: GaitMetrics) -> Table:
    """Build the table of human reference, mean over the steady strides, and difference, one row per metric.

    Where the standard deviation of people is known, the difference is in its unit; that of a phase is in % of the
    cycle, and others are in % of the value of the reference, or in their unit where the signs differ or that value is
    near zero.
    """
    human = compute_reference_metrics(recording)
    human_deviations = _compute_peak_deviations(recording)
    table = _create_table(_format_title(recording, metrics))
    name = shorten_reference_name(recording.provenance["reference"]["name"])
    table.add_column(name if is_level_ground(recording) else f"{name},\nlevel", justify="right", no_wrap=True)
    table.add_column("prosthesis", justify="right", style="bold", no_wrap=True)
    table.add_column("difference", justify="right", no_wrap=True)
    for label, unit, format_spec, ankle_metric in ANKLE_ROWS:
        expected, value = ankle_metric(human), metrics.mean(ankle_metric)
        table.add_row(
            label,
            unit,
            _format_cell(expected, format_spec),
            _format_cell(value, format_spec),
            _format_difference(value, expected, unit, human_deviations.get(label), format_spec),
        )
    table.add_section()
    for section in _list_sections_without_reference(recording, metrics):
        for label, unit, format_spec, metric in section:
            value = metrics.mean(metric)
            if value is not None or unit != "sd":  # a reference without standard deviations has no distances in them
                label = label.replace("vs human", f"vs {name}")
                table.add_row(label, unit, "-", _format_cell(value, format_spec), "")
        table.add_section()
    return table


def build_stride_table(recording: Recording, metrics: GaitMetrics) -> Table:
    """Build the table of the last strides beside each other, and their standard deviation, one row per metric."""
    shown = metrics.strides[-MAX_STRIDE_COLUMNS:]
    first = len(metrics.strides) - len(shown) + 1
    table = _create_table(f"{recording.provenance['device']['name']}, stride by stride")
    for number in range(first, len(metrics.strides) + 1):
        table.add_column(str(number), justify="right", no_wrap=True)
    name = shorten_reference_name(recording.provenance["reference"]["name"])
    table.add_column("± sd", justify="right", style="dim", no_wrap=True)
    for section in (ANKLE_ROWS, *_list_sections_without_reference(recording, metrics)):
        for label, unit, format_spec, metric in section:
            deviation = metrics.standard_deviation(metric)
            cells = [_format_cell(metric(stride), format_spec) for stride in shown]
            label = label.replace("vs human", f"vs {name}")
            table.add_row(label, unit, *cells, _format_cell(deviation, format_spec.removeprefix("+")))
        table.add_section()
    return table


def _create_table(title: str) -> Table:
    table = create_table(title=title)
    table.add_column("", min_width=MIN_LABEL_WIDTH_CHARS)  # in a narrow terminal, labels wrap and numbers do not
    table.add_column("unit", style="dim", no_wrap=True)
    return table


def _list_sections_without_reference(recording: Recording, metrics: GaitMetrics) -> list[Sequence[Row]]:
    if is_spring_foot(recording):
        return [RIG_ROWS]
    ledger: list[Row] = [
        (label, "J", "+.2f", lambda stride, line=line: stride.ledger_j[line])  # type: ignore[misc]
        for line, label in _build_ledger_rows(metrics).items()
    ]
    return [(*RIG_ROWS, *DEVICE_ROWS), ledger]


def _compute_peak_deviations(recording: Recording) -> dict[str, float]:
    """Return row -> standard deviation of people at the peak of the human mean, per kg; none on slopes or without it.

    The spread of the peak itself is not known; that of the curve at the peak stands for it (assumed).
    """
    mass, deviations = recording.provenance["options"]["mass_kg"], {}
    for label, channel in PEAK_CHANNELS.items():
        if is_level_ground(recording) and f"reference_{channel}_sd" in recording:
            peak = int(np.argmax(recording[f"reference_{channel}"]))
            deviations[label] = float(recording[f"reference_{channel}_sd"][peak]) / mass
    return deviations


def _format_difference(
    value: float | None, human: float | None, unit: str, deviation: float | None, format_spec: str
) -> str:
    if value is None or human is None:
        return ""
    if deviation:
        return f"{(value - human) / deviation:+.1f} sd"
    if unit == "% cycle":
        return f"{value - human:+.1f}"
    if value * human <= 0.0 or abs(value) > MAX_PERCENTAGE_RATIO * abs(human):  # a percentage would say nothing
        return f"{value - human:+{format_spec.removeprefix('+')}} {unit}".removesuffix(" ratio")
    return f"{round(100.0 * (value - human) / abs(human)):+d} %"


def _format_title(recording: Recording, metrics: GaitMetrics) -> str:
    name, last = recording.provenance["device"]["name"], len(metrics.strides)
    first = last - len(metrics.steady_strides) + 1
    if first == last:
        return f"{name}, stride {last}"
    return f"{name}, mean of strides {first} to {last}"


def _build_ledger_rows(metrics: GaitMetrics) -> dict[str, str]:
    """Return line -> label of the lines with a relevant energy; effects come one by one before the delivered energy."""
    stride = metrics.strides[-1].ledger_j
    effects = {
        name: f"energy from {name.removeprefix('effect_')}"
        for name in stride
        if name not in LEDGER_LABELS and name != "effects"
    }
    rows = {**LEDGER_LABELS, **effects}
    rows |= {name: rows.pop(name) for name in ("delivered", "residual")}
    return {
        name: label for name, label in rows.items() if name == "delivered" or abs(stride[name]) >= MIN_LEDGER_ENERGY_J
    }


def collect_remarks(summary: dict[str, Any]) -> list[str]:
    """Return remarks that limit or explain the results, one sentence each."""
    reference_speed = summary["reference_speed_m_per_s"]
    origin = (
        ""
        if reference_speed is None
        else f", measured at {reference_speed:.2f} m/s. The speed of the rig follows from the angles of the reference, "
        "the leg length (from the stature, assumed unless the reference or --stature states it) and the stride time, "
        "which --speed changes"
    )
    remarks = [
        f"Subject: {summary['mass_kg']:.4g} kg, {summary['stature_m']:.4g} m. Speed: {summary['speed_m_per_s']:.2f} "
        f"m/s. Stride time: {summary['stride_time_s']:.3f} s. Reference gait: {summary['reference']}{origin}."
    ]
    if summary["foot"] != RIGID_FOOT:
        remarks.append(f"Foot: {summary['foot']}, with assumed numbers (summary.json lists them).")
    if summary["touches_in_swing"]:
        remarks.append("The foot touches the ground in swing: it trips, and later strides are not meaningful.")
    remarks.append(
        f"The ground reaction is tracked, not predicted: {_describe_learning(summary['hip_path'])}. Limb angles are "
        "prescribed; what the ankle does is predicted."
    )
    remarks.append(
        f"Alignment: the prosthesis is turned by {summary['alignment_deg']:+.1f} degrees against the limb "
        "(dorsiflexion positive)."
    )
    is_users_reference = summary["reference"] != DEFAULT_NAME
    if is_users_reference and abs(summary["alignment_deg"]) > MAX_USUAL_ALIGNMENT_DEG:
        remarks.append(
            f"That is more than {MAX_USUAL_ALIGNMENT_DEG:g} degrees: the zeros of the ankle angles of the reference "
            "and of the prosthesis probably differ; check the zero of the reference (docs/import.md)."
        )
    if summary["contact_lost_in_stance"]:
        remarks.append("The foot leaves the ground for an instant in stance.")
    if summary["slope_deg"]:
        direction = "rises" if summary["slope_deg"] > 0.0 else "falls"
        has_distance = summary["distance_to_reference"]["moment_distance_sd"]["stance_rms"] is not None
        remarks.append(
            f"The ground {direction} by {abs(summary['slope_deg']):g} degrees, for which there is no measured "
            "reference: limb and load follow the level reference in space, the ankle compensates for the slope "
            f"(assumed){'' if has_distance else ', and no distance to the reference is given'}."
        )
    if summary["grf_vertical_tracking_rms_bw"] > MAX_GRF_TRACKING_RMS_BW:
        remarks.append(
            f"The load was not tracked (rms error {summary['grf_vertical_tracking_rms_bw']:.2f} body weights): the "
            "ankle did not carry the reference's load, so moments and powers are not those of walking."
        )
    short_strides = [
        k for k, stride in enumerate(summary["per_stride"], start=1) if stride["short_of_supply_pct"] > 0.0
    ]
    if short_strides:
        remarks.append(
            f"From stride {short_strides[0]} on, the supply pressure was at times below the commanded pressure: the "
            "tank runs empty, or the command exceeds the supply. The means hide this."
        )
    below_fit, unsourced = summary["below_friction_fit_pct"], summary["without_source"]
    numbers = f"{len(unsourced)} {'number' if len(unsourced) == 1 else 'numbers'} without a source"
    fade = f"; for {below_fit:.0f} % of the stride the pressure is below 2 bar, where the friction is extrapolated"
    remarks.append(
        f"The result rests on {len(summary['assumptions'])} assumptions (see summary.json)"
        f"{f' and {numbers}: {abbreviate(unsourced)}' if unsourced else ''}"
        f"{fade if below_fit and summary['friction_offset_work_j_per_kg'] else ''}."
    )
    return remarks


def _describe_learning(hip_path: Mapping[str, Any]) -> str:
    """Return how the rig got the path of the hip, whether its learning converged, and what to do otherwise."""
    if not hip_path["learning_strides"]:
        return "the rig follows the planned path of the hip"
    errors = (
        f"rms errors in stance {hip_path['vertical_residual_bw']:.4f} body weights vertical and "
        f"{hip_path['forward_residual_bw']:.4f} fore-aft"
    )
    aims = f"{VERTICAL_TOLERANCE_BW:g} and {FORWARD_TOLERANCE_BW:g}"
    if hip_path["has_converged"]:
        return (
            f"the rig learned the path of the hip in {hip_path['learning_strides']} strides, until the foot carried "
            f"the load of the reference ({errors}; aims {aims})"
        )
    limit, best = hip_path["max_learning_strides"], hip_path["learning_strides"]
    more = min(round(LEARNING_GROWTH * limit), MAX_LEARNING_STRIDES)
    if best > STALLED_FRACTION * limit and more > limit:
        advice = f"pass --learning-strides {more}"
    else:
        advice = "more strides are unlikely to help, so loads and moments differ from the reference by that much"
    return (
        f"the rig has NOT learned the path of the hip in {limit} strides: on the best one, stride {best}, the foot "
        f"carries the load of the reference with {errors}; the aims are {aims}, and both must be reached; {advice}"
    )


def _format_cell(value: float | None, format_spec: str) -> str:
    return "-" if value is None else format(value, format_spec)
