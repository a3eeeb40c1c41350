"""First sentence, results table and remarks of a walk, for a terminal."""

from typing import Any

from rich.table import Table

from klute_sim.terminal_table import create_table

LEG_ROWS: tuple[tuple[str, str, str, str], ...] = (
    ("step length", "m", ".3f", "step_length"),
    ("stride time", "s", ".3f", "stride_time"),
    ("  sd between strides", "s", ".3f", "stride_time_sd"),
    ("stance", "of stride", ".2f", "stance_share"),
    ("peak vertical reaction (15 ms)", "body wt", ".2f", "peak_load_bw"),
)
"""Label, unit, format and key of the rows of a leg."""
CURVE_LABELS = {
    "hip": ("hip angle", "deg", ".1f"),
    "knee": ("knee angle", "deg", ".1f"),
    "ankle": ("ankle angle", "deg", ".1f"),
    "grf_vertical": ("vertical reaction", "body wt", ".2f"),
    "grf_forward": ("fore-aft reaction", "body wt", ".3f"),
}
"""Label, unit and format of the rms difference to able-bodied adults."""


MIN_CORRELATION, MAX_RMS_DEG = 0.8, 10.0
"""Correlation below which, and rms difference above which, a remark calls a joint angle unlike that of people."""


def format_headline(summary: dict[str, Any]) -> str:
    """Return in one sentence how far and how fast the person walked, at what cost, or when it fell."""
    name = summary["prosthesis"] or "intact person"
    if summary["has_fallen"]:
        start = f"{name}: falls after {summary['duration_s']:.1f} s and {summary['distance_m']:.1f} m"
    else:
        start = f"{name}: walks {summary['duration_s']:.4g} s and {summary['distance_m']:.1f} m without a fall"
    speed, minetti = summary["speed_m_per_s"], summary["cost_minetti_j_per_kg_m"]
    if speed is None or minetti is None:
        return f"{start}; {summary['kind']}."
    return f"{start}, at {speed:.2f} m/s and a metabolic cost of {minetti:.2f} J/kg/m; {summary['kind']}."


def build_table(summary: dict[str, Any]) -> Table:
    """Build the table of both legs, and below it the likeness of each leg to able-bodied adults."""
    right = "right" if summary["prosthesis"] is None else "right (prosthesis)"
    table = create_table(title="mean of the strides after 3 s")
    table.add_column("", min_width=15)
    table.add_column("unit", style="dim", no_wrap=True)
    table.add_column("left", justify="right", style="bold", no_wrap=True)
    table.add_column(right, justify="right", style="bold")
    legs = [summary["legs"].get(side) for side in ("left", "right")]
    for label, unit, form, key in LEG_ROWS:
        table.add_row(label, unit, *("-" if leg is None else format(leg[key], form) for leg in legs))
    table.add_section()
    for curve, (label, unit, form) in CURVE_LABELS.items():
        cells = [None if leg is None else leg["likeness"][curve] for leg in legs]
        table.add_row(
            f"{label}, to human",
            f"r; rms {unit}",
            *("-" if c is None else f"{c['correlation']:.2f}; {format(c['rms'], form)}" for c in cells),
        )
    return table


def collect_remarks(summary: dict[str, Any]) -> list[str]:
    """Return remarks that complete or limit the results, one sentence each."""
    remarks = []
    if not summary["legs"]:
        advice = "" if summary["has_fallen"] else ": walk longer"
        remarks.append(f"No stride is complete after the first 3 s, so there is no mean stride{advice}.")
    if summary["push_n_s"] and not summary["has_been_pushed"]:
        remarks.append("The person falls before the push.")
    elif summary["push_n_s"]:
        remarks.append(
            f"Push on the hip: {summary['push_n_s']:+g} N·s at {summary['push_phase_pct']:g} % of the right leg's "
            "first stride after 5 s."
        )
    if summary["cost_bhargava_j_per_kg_m"] is not None:
        remarks.append(
            f"Metabolic cost of the muscles: {summary['cost_minetti_j_per_kg_m']:.2f} J/kg/m (Minetti and Alexander), "
            f"{summary['cost_bhargava_j_per_kg_m']:.2f} (Bhargava et al.), without the basal rate; compare conditions "
            "in per cent, and trust a difference only if both laws show it."
        )
    if summary["step_asymmetry"] is not None:
        remarks.append(
            f"Step asymmetry (left - right)/(left + right): {summary['step_asymmetry']:+.3f}."
            + (
                ""
                if summary["device_work_net_j"] is None
                else f" Work of the device per stride: {summary['device_work_net_j']:+.1f} J net, "
                f"{summary['device_work_positive_j']:.1f} J positive."
            )
        )
    walker = summary["walker"]["name"]
    if summary["is_acute"]:
        remarks.append(
            f"Walker: {walker}, which has adapted to another condition. The walk is acute: it shows what happens "
            "before the person adapts to this one."
        )
    else:
        remarks.append(f"Walker: {walker}, adapted to this condition.")
    differences = [
        f"{joint} of the {'prosthetic' if summary['prosthesis'] and side == 'right' else side} leg "
        f"(r = {leg['likeness'][joint]['correlation']:.2f}, {leg['likeness'][joint]['rms']:.0f} deg rms)"
        for side, leg in summary["legs"].items()
        for joint in ("hip", "knee", "ankle")
        if leg["likeness"][joint]["correlation"] < MIN_CORRELATION or leg["likeness"][joint]["rms"] > MAX_RMS_DEG
    ]
    if differences:
        remarks.append(f"Joint angles that differ from those of people: {'; '.join(differences)}.")
    remarks.append(
        "Predicted by a planar model of 7 segments and 14 muscles: nothing is said about balance sideways, the socket, "
        "or how real people adapt (docs/walk.md)."
    )
    return remarks
