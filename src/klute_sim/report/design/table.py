"""Tables and remarks of a design for a terminal."""

from typing import Any

from rich.table import Table

from klute_sim.sizing.parts.actuator import MIN_TESTED_SLENDERNESS
from klute_sim.terminal_table import create_table

PRESSURE_TOLERANCE_RATIO = 1.02
"""Largest ratio of cylinder pressure to allowed pressure that is attributed to rounding of the orifices."""
CURVE_LABELS = (
    ("actuator_only", "actuator only"),
    ("ideal_damper", "with ideal damper"),
    ("fixed_orifices", "with fixed orifices"),
)


def build_tables(summary: dict[str, Any]) -> list[Table]:
    """Build the tables of the ``summary`` of a design, in reading order."""
    tables = [
        _build_target_table(summary["target"]),
        _build_actuator_table(summary),
        _build_sizing_table(summary),
        _build_envelope_table(summary),
        _build_force_velocity_error_table(summary),
    ]
    if summary["demand"]:
        tables.append(_build_demand_table(summary["demand"]))
    return [*tables, _build_sensitivity_table(summary)]


def _create_table(title: str, *headings: str) -> Table:
    table = create_table(title=title)
    for index, heading in enumerate(headings):
        table.add_column(heading, justify="right" if index else "left", no_wrap=index > 0)
    return table


def _build_target_table(target: dict[str, Any]) -> Table:
    """Build the table of the muscle or gait that the device emulates."""
    target_name = f"muscle '{target['muscle']}'" if target["mass_kg"] is None else f"gait at {target['mass_kg']:g} kg"
    result = _create_table(f"Target: {target_name}", "", "unit", "")
    rows: list[tuple[str, str, float | None, str]] = [
        ("F0", "N", target["f0_n"], "that of the actuators"),
        ("l0", "mm", target["l0_mm"], "that of the actuators"),
    ]
    if target["mass_kg"] is not None:
        rows = [("peak ankle moment", "N·m", target["peak_moment_nm"], "")]
    for label, unit, value, default in rows:
        result.add_row(label, unit, default if value is None else f"{value:.4g}")
    assumed = " (assumed)" if target["vmax_assumed"] else ""
    result.add_row("Vmax", "mm/s", f"{target['vmax_mm_per_s']:.4g}{assumed}")
    for label, key in (("a/F0", "a_over_f0"), ("b/Vmax", "b_over_vmax"), ("saturation/F0", "saturation")):
        result.add_row(label, "1", f"{target[key]:.4g}")
    return result


def _build_actuator_table(summary: dict[str, Any]) -> Table:
    required = "" if summary["required_force_n"] is None else f" for {summary['required_force_n']:.0f} N"
    title = f"Actuators of Table 3.1{required} at {summary['supply_pressure_bar']:g} bar"
    f0 = f"F0 each\n(L/L0 {summary['design_ratio']:g})"
    headings = ("row", "L0\n[mm]", f"{f0} [N]", "L/L0 at\npeak", "each at\npeak [N]", "count", "all at\npeak [N]")
    result = _create_table(title, *headings, "gas\n[mL]")
    for row in summary["rows"]:
        is_selected = row["actuator"] == summary["actuator"]
        weak = "" if row["is_sufficient"] else " (too weak)"
        result.add_row(
            f"{row['label']}{' (selected)' if is_selected else ''}{weak}",
            f"{row['resting_length_mm']:.0f}",
            f"{row['isometric_force_n']:.0f}",
            f"{row['length_ratio']:.3f}",
            f"{row['available_force_n']:.0f}",
            f"{row['count']}",
            f"{row['total_available_force_n']:.0f}",
            f"{row['gas_ml']:.0f}",
            style="bold" if is_selected else None,
        )
    return result


def _build_sizing_table(summary: dict[str, Any]) -> Table:
    damper, tendon = summary["damper"], summary["tendon"]
    result = _create_table("Damper and tendon", "", "unit", "concentric", "eccentric")
    for label, unit, key, format_spec in (
        ("design speed", "mm/s", "speed_mm_per_s", ".0f"),
        ("damping force at that speed", "N", "design_force_n", ".0f"),
        ("orifice (4.6)", "mm", "orifice_mm", ".3f"),
        ("damping force with rounded orifice", "N", "as_built_force_n", ".0f"),
        ("cylinder pressure", "MPa", "pressure_mpa", ".2f"),
        ("oil speed in the orifice", "m/s", "jet_speed_m_per_s", ".0f"),
        ("cavitation number", "1", "cavitation_number", ".3f"),
        ("refill passage, minimum", "mm", "refill_passage_mm", ".2f"),
    ):
        result.add_row(label, unit, *(format(damper[side][key], format_spec) for side in ("concentric", "eccentric")))
    if damper["bore_is_fixed"]:
        result.add_row("bore, given", "mm", f"{damper['bore_mm']:.2f}", "")
        result.add_row("bore required by (4.2)", "mm", f"{damper['required_bore_mm']:.2f}", "")
    else:
        result.add_row("bore (4.2)", "mm", f"{damper['bore_mm']:.2f}", "")
    springs = f"{tendon['stiffness_1_n_per_mm']:.1f} + {tendon['stiffness_2_n_per_mm']:.1f}"
    result.add_row("tendon springs", "N/mm", springs, "")
    lengths = f"{tendon['engagement_mm']:.1f} of {tendon['slack_length_mm']:.0f}"
    result.add_row("second spring engages at", "mm", lengths, "")
    return result


def _build_envelope_table(summary: dict[str, Any]) -> Table:
    result = _create_table("Design envelope (2.5)", "", "allowed", "value", "")
    for row in summary["envelope"]:
        value = "not defined" if row["value"] is None else f"{row['value']:.2f}"
        allowed = f"{row['low']:g}" if row["low"] == row["high"] else f"{row['low']:g} to {row['high']:g}"
        result.add_row(row["name"], allowed, value, "met" if row["is_met"] else "not met")
    return result


def _build_force_velocity_error_table(summary: dict[str, Any]) -> Table:
    result = _create_table("Rms distance to Hill's force-velocity curve [F0]", "", "concentric", "eccentric")
    for key, label in CURVE_LABELS:
        rms_error = summary["rms_error_f0"][key]
        result.add_row(label, f"{rms_error['concentric']:.3f}", f"{rms_error['eccentric']:.3f}")
    return result


def _build_demand_table(demand: dict[str, Any]) -> Table:
    result = _create_table("Demand of a stride (assumed: the tendon alone carries the moment)", "", "unit", "")
    required = (
        "more than 20" if demand["max_required_pressure_bar"] is None else f"{demand['max_required_pressure_bar']:.2f}"
    )
    for label, unit, value in (
        ("peak tendon force", "N", f"{demand['tendon_peak_n']:.0f} at {demand['tendon_peak_phase_pct']:.0f} %"),
        ("isometric force then, supply pressure", "N", f"{demand['max_isometric_force_at_peak_n']:.0f}"),
        ("isometric force then, commanded pressure", "N", f"{demand['commanded_isometric_force_at_peak_n']:.0f}"),
        ("static moment / peak moment", "1", f"{demand['peak_moment_fraction']:.2f}"),
        (
            "minimum of isometric force / (tendon + damper force)",
            "1",
            f"{demand['min_force_margin']:.2f} at {demand['min_force_margin_phase_pct']:.0f} %",
        ),
        ("maximum required pressure", "bar", required),
        ("muscle length / L0", "1", f"{demand['length_ratio_min']:.3f} to {demand['length_ratio_max']:.3f}"),
        ("fraction of the stride at the rest-length stop", "%", f"{demand['at_stop_pct']:.0f}"),
        ("maximum shortening velocity", "mm/s", f"{demand['max_shortening_velocity_mm_per_s']:.0f}"),
        ("maximum lengthening velocity", "mm/s", f"{demand['max_lengthening_velocity_mm_per_s']:.0f}"),
        ("air per stride, commanded pressure", "g", f"{demand['air_g']:.2f}"),
    ):
        result.add_row(label, unit, value)
    return result


def _build_sensitivity_table(summary: dict[str, Any]) -> Table:
    result = _create_table(
        "Sensitivity to the assumptions (with the selected actuators)",
        "assumption",
        "from",
        "to",
        "orifices\n[mm]",
        "cylinder\n[MPa]",
        "static /\npeak moment",
        "Hill con./\necc. [F0]",
        "air\n[g]",
        "rule\nselects",
    )
    nominal = summary["sensitivity"]["nominal"]
    result.add_row("as designed", "", "", *_format_metric_cells(nominal, None), style="bold")
    result.add_section()
    for row in summary["sensitivity"]["rows"]:
        unit = "" if row["unit"] == "1" else f" [{row['unit']}]"
        cells = ["not possible"] if row["metrics"] is None else _format_metric_cells(row["metrics"], nominal)
        result.add_row(f"{row['assumption']}{unit}", f"{row['nominal']:.4g}", f"{row['value']:.4g}", *cells)
    return result


def _format_metric_cells(metrics: dict[str, Any], nominal: dict[str, Any] | None) -> list[str]:
    """Return the cells of ``metrics``; a dot marks values that equal those of the ``nominal`` design."""

    def format_cell(format_spec: str, *keys: str) -> str:
        values = [metrics[key] for key in keys]
        if values[0] is None:
            return "-"
        text = " / ".join(format(value, format_spec) for value in values)
        is_same = nominal is not None and text == " / ".join(format(nominal[key], format_spec) for key in keys)
        return "·" if is_same else text

    return [
        format_cell(".3f", "orifice_concentric_mm", "orifice_eccentric_mm"),
        format_cell(".1f", "cylinder_pressure_mpa"),
        format_cell(".2f", "peak_moment_fraction"),
        format_cell(".3f", "rms_error_concentric_f0", "rms_error_eccentric_f0"),
        format_cell(".2f", "air_g"),
        format_cell("s", "recommended_actuators"),
    ]


def _describe_strength(summary: dict[str, Any]) -> str:
    """Return whether the actuators are strong enough statically, and in a stride with the damper."""
    demand, ratio = summary["demand"], f"{summary['force_ratio']:.2f} times the required force"
    required_pressure = summary["pressure_for_required_force_bar"]
    pressure = "more than 20 bar" if required_pressure is None else f"{required_pressure:.2f} bar"
    if demand and demand["min_force_margin"] < 1.0:
        condition = "" if summary["force_ratio"] < 1.0 else "statically "
        verdict = (
            f"The actuators are too weak: {condition}they have {ratio}, and at "
            f"{demand['min_force_margin_phase_pct']:.0f} % of the stride "
            f"{demand['min_force_margin']:.2f} times the force of tendon and damper at the supply pressure."
        )
    elif summary["force_ratio"] < 1.0:
        verdict = f"The actuators are too weak: they have {ratio}. The required force needs {pressure}."
    else:
        verdict = f"The actuators are strong enough: they have {ratio}. The required force needs {pressure}."
    return f"{verdict} The selection rule prefers few actuators, then a small gas volume (assumed)."


def _describe_excess_pressure(damper: dict[str, Any]) -> list[str]:
    """Return a warning if the cylinder pressure exceeds the allowed pressure."""
    pressure, allowed = damper["pressure_mpa"], damper["allowed_pressure_mpa"]
    if pressure <= PRESSURE_TOLERANCE_RATIO * allowed:
        return []
    oil_speed = max(damper[side]["jet_speed_m_per_s"] for side in ("concentric", "eccentric"))
    return [
        f"The damper cannot be built as sized: its cylinder pressure is {pressure:.4g} MPa, but {allowed:g} MPa are "
        f"allowed, and the oil flows at {oil_speed:.0f} m/s through its orifice. (4.2) requires a bore of "
        f"{damper['required_bore_mm']:.2f} mm; increase the bore, or change --cylinder-pressure."
    ]


def collect_remarks(summary: dict[str, Any]) -> list[str]:
    """Return remarks that limit or explain the design, one sentence each."""
    remarks, demand = [], summary["demand"]
    if summary["force_ratio"] is not None:
        remarks.append(_describe_strength(summary))
    remarks.extend(_describe_excess_pressure(summary["damper"]))
    if demand and demand["at_stop_pct"] > 0.0:
        remarks.append(
            f"In {demand['at_stop_pct']:.0f} % of the stride the muscle would exceed its resting length: the stop "
            "carries the load."
        )
    if summary["slenderness"] < MIN_TESTED_SLENDERNESS:
        remarks.append(
            f"The ratio of length to diameter is {summary['slenderness']:.1f}; the actuators of Table 3.1 were tested "
            f"at {MIN_TESTED_SLENDERNESS:g} or more."
        )
    missed = [row["name"] for row in summary["envelope"] if not row["is_met"]]
    if missed:
        remarks.append(
            f"The design envelope (2.5) is not met: {', '.join(missed)}. The isometric curve of an actuator is convex, "
            "and that of a muscle is concave. The damping of an orifice is quadratic in speed, and that of a muscle is "
            "hyperbolic."
        )
    remarks.append(
        "The cavitation number is the ratio of the pressure behind the orifice to the pressure drop; the reservoir is "
        "assumed to have atmospheric pressure. Far below 1, the jet cavitates unless a back pressure prevents it."
    )
    not_varied = summary["sensitivity"]["excluded_assumptions"]
    for reason in dict.fromkeys(not_varied.values()):
        fields = ", ".join(field.replace("_", " ") for field in not_varied if not_varied[field] == reason)
        remarks.append(f"Assumed, but not varied: {fields} ({reason}).")
    if summary["gait"]:
        remarks.append(f"Simulate the gait with its pressure profile: {summary['gait']}")
    else:
        remarks.append(
            "No pressure profile was written, because a muscle has no stride. By default, klute-sim gait uses the "
            "profile tuned for the default prosthesis and 75 kg."
        )
    remarks.append(f"{len(summary['assumptions'])} of the device's numbers are assumed (see device.toml).")
    return remarks
