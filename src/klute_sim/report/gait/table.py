"""The results table of a gait run, for a terminal."""

from collections.abc import Callable
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from klute_sim.gait.metrics import AnkleMetrics, GaitMetrics, StrideMetrics, compute_reference_metrics, is_level_ground
from klute_sim.recording.recording import Recording

MAX_STRIDE_COLUMNS = 5
"""Strides shown beside the mean, where the width allows: the last ones."""
BASE_WIDTH_CHARS, STRIDE_COLUMN_WIDTH_CHARS = 61, 9
"""Characters that the table takes without stride columns, and each of those."""

MAX_GRF_TRACKING_RMS_BW = 0.15
"""Vertical tracking error [body weights, rms] beyond which the load was not followed; the default walk has 0.085."""

ANKLE_ROWS: tuple[tuple[str, str, str, Callable[[AnkleMetrics], float | None]], ...] = (
    ("ankle range", "deg", ".1f", lambda s: s.ankle_range_deg),
    ("peak net moment", "N·m/kg", ".3f", lambda s: s.ankle_moment_peak_nm_per_kg),
    ("  at", "% cycle", ".1f", lambda s: s.ankle_moment_peak_pct),
    ("peak net power (15 ms mean)", "W/kg", ".2f", lambda s: s.ankle_power_peak_w_per_kg),
    ("  at", "% cycle", ".1f", lambda s: s.ankle_power_peak_pct),
    ("net ankle work", "J/kg", "+.3f", lambda s: s.ankle_work_net_j_per_kg),
    ("positive ankle work", "J/kg", ".3f", lambda s: s.ankle_work_positive_j_per_kg),
    ("energy return in stance", "1", ".2f", lambda s: s.energy_return),
    ("quasi-stiffness", "N·m/kg/deg", ".3f", lambda s: s.quasi_stiffness_nm_per_kg_deg),
    ("first contact", "% cycle", ".1f", lambda s: s.first_contact_pct),
    ("toe-off", "% cycle", ".1f", lambda s: s.toe_off_pct),
    ("fore-aft reaction, braking", "body wt", "+.3f", lambda s: s.grf_forward_min_bw),
    ("fore-aft reaction, push-off", "body wt", "+.3f", lambda s: s.grf_forward_max_bw),
    ("vertical hump 1 (tracked)", "body wt", ".3f", lambda s: s.grf_vertical_peaks_bw[0]),
    ("vertical hump 2 (tracked)", "body wt", ".3f", lambda s: s.grf_vertical_peaks_bw[1]),
)
"""What a human ankle has, too: label, unit, format, reading."""

RIG_ROWS: tuple[tuple[str, str, str, Callable[[StrideMetrics], float | None]], ...] = (
    ("vertical tracking error, rms", "body wt", ".3f", lambda s: s.grf_vertical_tracking_rms_bw),
    ("angle to human, stance rms", "sd", ".2f", lambda s: s.angle_distance_sd.stance_rms),
    ("angle to human, swing rms", "sd", ".2f", lambda s: s.angle_distance_sd.swing_rms),
    ("moment to human, stance rms", "sd", ".2f", lambda s: s.moment_distance_sd.stance_rms),
    ("power to human, stance rms", "sd", ".2f", lambda s: s.power_distance_sd.stance_rms),
    ("toe clearance in mid-swing", "mm", ".1f", lambda s: s.toe_clearance_mm),
    ("roll-over radius", "m", ".3f", lambda s: s.rollover_radius_m),
    ("actuator's own peak moment", "N·m/kg", ".3f", lambda s: s.actuator_moment_peak_nm_per_kg),
    ("actuator's own net work", "J/kg", "+.3f", lambda s: s.actuator_work_net_j_per_kg),
    ("friction offset's work", "J/kg", "+.3f", lambda s: s.friction_offset_work_j_per_kg),
    ("air drawn (its gas assumed)", "g", ".2f", lambda s: s.air_g),
    ("air leaked", "g", ".3f", lambda s: s.air_leaked_g),
    ("energy not accounted for", "%", "+.4f", lambda s: round(s.ledger_residual_pct, 4) + 0.0),
)
"""What only the prosthesis on the rig has."""

MIN_LEDGER_ENERGY_J = 0.005
"""Energy in a stride [J]."""
LEDGER_LABELS = {
    "gas": "from the gas",
    "friction": "from the friction offset",
    "damper": "from the damper",
    "stop": "from the length stops",
    "bladder": "from the bladders' store",
    "tendon": "from the tendon's store",
    "solver": "from the time step",
    "delivered": "delivered",
}
"""Of the energy ledger; each effect has a line besides."""


def build_table(recording: Recording, metrics: GaitMetrics, width: int) -> Table:
    """Human reference, mean and the last strides, one row per outcome, in ``width`` characters."""
    human = compute_reference_metrics(recording)
    room = max(1, min(MAX_STRIDE_COLUMNS, (width - BASE_WIDTH_CHARS) // STRIDE_COLUMN_WIDTH_CHARS))
    shown = list(enumerate(metrics.strides, start=1))[-room:]
    first = len(metrics.strides) - len(metrics.steady_strides) + 1
    strides = "1 stride" if len(metrics.strides) == 1 else f"last {len(shown)} of {len(metrics.strides)} strides"
    title = f"{recording.provenance['device']['name']}, {strides}"
    result = Table(title=Text(title), box=box.SIMPLE_HEAD)
    result.add_column("")  # where the terminal is narrow, words wrap and numbers do not
    result.add_column("unit", style="dim")
    result.add_column("human" if is_level_ground(recording) else "human,\nlevel", justify="right", no_wrap=True)
    result.add_column(f"mean\n{first}-{len(metrics.strides)}", justify="right", style="bold", no_wrap=True)
    for number, _ in shown:
        result.add_column(f"stride\n{number}", justify="right", no_wrap=True)
    for label, unit, form, reading in ANKLE_ROWS:
        cells = [reading(human), metrics.mean(reading), *(reading(stride) for _, stride in shown)]
        result.add_row(label, unit, *(_format_cell(value, form) for value in cells))
    result.add_section()
    for label, unit, form, own in RIG_ROWS:
        cells = [None, metrics.mean(own), *(own(stride) for _, stride in shown)]
        result.add_row(label, unit, *(_format_cell(value, form) for value in cells))
    result.add_section()
    for line, label in _build_ledger_rows(metrics).items():
        cells = [None, metrics.mean(lambda s, n=line: s.ledger_j[n]), *(s.ledger_j[line] for _, s in shown)]  # type: ignore[misc]
        result.add_row(label, "J", *(_format_cell(value, "+.2f") for value in cells))
    return result


def _build_ledger_rows(metrics: GaitMetrics) -> dict[str, str]:
    """Line -> label of what gave or took anything worth a line, the effects one by one before what is delivered."""
    stride = metrics.strides[-1].ledger_j
    effects = {
        name: f"from {name.removeprefix('effect_')}"
        for name in stride
        if name not in LEDGER_LABELS and name != "effects"
    }
    rows = {**LEDGER_LABELS, **effects}
    rows["delivered"] = rows.pop("delivered")
    return {
        name: label for name, label in rows.items() if name == "delivered" or abs(stride[name]) >= MIN_LEDGER_ENERGY_J
    }


def collect_remarks(summary: dict[str, Any]) -> list[str]:
    """What a reader has to know beside the table, one sentence each."""
    owner = summary["reference_speed_m_per_s"]
    own = "" if owner is None else f", whose owner went at {owner:.2f} m/s (--speed scales the stride time)"
    said = [
        f"Walker: {summary['mass_kg']:.4g} kg, {summary['stature_m']:.4g} m, {summary['speed_m_per_s']:.2f} m/s in "
        f"strides of {summary['stride_time_s']:.3f} s, on the gait '{summary['reference']}'{own}."
    ]
    if summary["touches_in_swing"]:
        said.append("The foot touches the ground in swing: it trips, and the later strides mean little.")
    said.append(
        "Vertical ground reaction is tracked, not predicted: the reference's load is applied. Fore-aft reaction is "
        "partly prescribed."
    )
    if summary["slope_deg"]:
        way = "rises" if summary["slope_deg"] > 0.0 else "falls"
        said.append(
            f"The ground {way} by {abs(summary['slope_deg']):g} degrees, where nobody's gait was measured: limb and "
            "load follow the level reference in space, the ankle makes up for the slope (assumed), and no distance is "
            "given."
        )
    if summary["grf_vertical_tracking_rms_bw"] > MAX_GRF_TRACKING_RMS_BW:
        said.append(
            f"The load was not followed here (rms {summary['grf_vertical_tracking_rms_bw']:.2f} body weights): the "
            "ankle did not carry what the reference's does, so moments and powers are not those of walking."
        )
    short = [k for k, stride in enumerate(summary["per_stride"], start=1) if stride["short_of_supply_pct"] > 0.0]
    if short:
        said.append(
            f"From stride {short[0]} on, the supply had less pressure at times than was commanded: the means hide that "
            "its tank runs empty, or that the command is beyond it."
        )
    below, unsourced = summary["below_friction_fit_pct"], len(summary["without_source"])
    fade = f", among them how the muscle's friction fades below 2 bar, where {below:.0f} % of the stride is"
    more = f" {unsourced} of the device's numbers have no source." if unsourced else ""
    said.append(
        f"{len(summary['assumptions'])} assumptions are in it (summary.json lists them)"
        f"{fade if below and summary['friction_offset_work_j_per_kg'] else ''}.{more}"
    )
    return said


def _format_cell(value: float | None, format_spec: str) -> str:
    return "-" if value is None else format(value, format_spec)
