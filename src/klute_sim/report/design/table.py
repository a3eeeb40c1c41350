"""The tables of a design, for a terminal."""

from typing import Any

from rich import box
from rich.table import Table

from klute_sim.sizing.parts.actuator import MIN_TESTED_SLENDERNESS

PRESSURE_TOLERANCE_RATIO = 1.02
"""Pressure in the cylinder over the allowed one that the rounding of the orifices may make [1]."""
CURVE_LABELS = (("alone", "actuator alone"), ("ideal", "with ideal damper"), ("fixed", "with fixed orifices"))


def build_tables(summary: dict[str, Any]) -> list[Table]:
    """The tables of the summary ``shown``, in the order in which they are read."""
    found = [
        _build_target_table(summary["target"]),
        _build_actuator_table(summary),
        _build_sizing_table(summary),
        _build_envelope_table(summary),
        _build_misfit_table(summary),
    ]
    if summary["demand"]:
        found.append(_build_demand_table(summary["demand"]))
    return [*found, _build_sensitivity_table(summary)]


def _create_table(title: str, *headings: str) -> Table:
    result = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left")
    for number, heading in enumerate(headings):
        result.add_column(heading, justify="right" if number else "left", no_wrap=number > 0)
    return result


def _build_target_table(target: dict[str, Any]) -> Table:
    """What is emulated, as understood."""
    whom = f"muscle '{target['muscle']}'" if target["mass_kg"] is None else f"walker of {target['mass_kg']:g} kg"
    result = _create_table(f"Asked for: {whom}", "", "unit", "")
    rows: list[tuple[str, str, float | None, str]] = [
        ("F0", "N", target["f0_n"], "what the actuators have"),
        ("l0", "mm", target["l0_mm"], "the actuators' own"),
    ]
    if target["mass_kg"] is not None:
        rows = [("peak ankle moment", "N·m", target["peak_moment_nm"], "")]
    for label, unit, value, otherwise in rows:
        result.add_row(label, unit, otherwise if value is None else f"{value:.4g}")
    assumed = " (assumed)" if target["vmax_assumed"] else ""
    result.add_row("Vmax", "mm/s", f"{target['vmax_mm_per_s']:.4g}{assumed}")
    for label, key in (("a/F0", "a_over_f0"), ("b/Vmax", "b_over_vmax"), ("saturation/F0", "saturation")):
        result.add_row(label, "1", f"{target[key]:.4g}")
    return result


def _build_actuator_table(summary: dict[str, Any]) -> Table:
    asked = "" if summary["needed_force_n"] is None else f" for {summary['needed_force_n']:.0f} N"
    title = f"Actuators of Table 3.1{asked} at {summary['supply_pressure_bar']:g} bar"
    f0 = f"F0 of one\n(L/L0 {summary['design_ratio']:g})"
    headings = ("row", "L0\n[mm]", f"{f0} [N]", "L/L0 where\nneeded", "one there\n[N]", "count", "all there\n[N]")
    result = _create_table(title, *headings, "gas\n[mL]")
    for row in summary["rows"]:
        taken = row["actuator"] == summary["actuator"]
        weak = "" if row["sufficient"] else " (too weak)"
        result.add_row(
            f"{row['row']}{' (taken)' if taken else ''}{weak}",
            f"{row['resting_length_mm']:.0f}",
            f"{row['force_of_one_n']:.0f}",
            f"{row['ratio']:.3f}",
            f"{row['strength_of_one_n']:.0f}",
            f"{row['count']}",
            f"{row['strength_n']:.0f}",
            f"{row['gas_ml']:.0f}",
            style="bold" if taken else None,
        )
    return result


def _build_sizing_table(summary: dict[str, Any]) -> Table:
    damper, tendon = summary["damper"], summary["tendon"]
    result = _create_table("Damper and tendon", "", "unit", "concentric", "eccentric")
    for label, unit, key, form in (
        ("speed designed for", "mm/s", "speed_mm_per_s", ".0f"),
        ("damping there", "N", "damping_n", ".0f"),
        ("orifice (4.6)", "mm", "orifice_mm", ".3f"),
        ("damping there as made", "N", "damping_as_made_n", ".0f"),
        ("pressure in the cylinder", "MPa", "pressure_mpa", ".2f"),
        ("oil in the orifice", "m/s", "oil_speed_m_per_s", ".0f"),
        ("cavitation number", "1", "cavitation_number", ".3f"),
        ("refill passage, at least", "mm", "refill_passage_mm", ".2f"),
    ):
        result.add_row(label, unit, *(format(damper[side][key], form) for side in ("concentric", "eccentric")))
    if damper["bore_given"]:
        result.add_row("bore, given", "mm", f"{damper['bore_mm']:.2f}", "")
        result.add_row("bore that (4.2) asks for", "mm", f"{damper['needed_bore_mm']:.2f}", "")
    else:
        result.add_row("bore (4.2)", "mm", f"{damper['bore_mm']:.2f}", "")
    springs = f"{tendon['stiffness_1_n_per_mm']:.1f} + {tendon['stiffness_2_n_per_mm']:.1f}"
    result.add_row("tendon springs", "N/mm", springs, "")
    lengths = f"{tendon['engagement_mm']:.1f} of {tendon['slack_length_mm']:.0f}"
    result.add_row("second spring joins at", "mm", lengths, "")
    return result


def _build_envelope_table(summary: dict[str, Any]) -> Table:
    result = _create_table("Design envelope (2.5)", "", "allowed", "found", "")
    for row in summary["envelope"]:
        found = "no such constant" if row["found"] is None else f"{row['found']:.2f}"
        allowed = f"{row['low']:g}" if row["low"] == row["high"] else f"{row['low']:g} to {row['high']:g}"
        result.add_row(row["name"], allowed, found, "met" if row["met"] else "not met")
    return result


def _build_misfit_table(summary: dict[str, Any]) -> Table:
    result = _create_table("Distance to Hill, rms over velocity [F0]", "", "concentric", "eccentric")
    for key, label in CURVE_LABELS:
        own = summary["misfit_f0"][key]
        result.add_row(label, f"{own['concentric']:.3f}", f"{own['eccentric']:.3f}")
    return result


def _build_demand_table(demand: dict[str, Any]) -> Table:
    result = _create_table("The stride (the tendon alone carries the moment: assumed)", "", "unit", "")
    needed = "more than 20" if demand["needed_pressure_bar"] is None else f"{demand['needed_pressure_bar']:.2f}"
    for label, unit, value in (
        ("peak tendon force", "N", f"{demand['tendon_peak_n']:.0f} at {demand['tendon_peak_pct']:.0f} %"),
        ("isometric force there, supply's pressure", "N", f"{demand['strongest_at_peak_n']:.0f}"),
        ("isometric force there, its own profile", "N", f"{demand['commanded_at_peak_n']:.0f}"),
        ("moment held at rest / peak moment", "1", f"{demand['peak_share']:.2f}"),
        (
            "least strength / (tendon + damper)",
            "1",
            f"{demand['least_margin']:.2f} at {demand['least_margin_pct']:.0f} %",
        ),
        ("highest pressure needed", "bar", needed),
        ("muscle length / L0", "1", f"{demand['ratio_min']:.3f} to {demand['ratio_max']:.3f}"),
        ("of the stride against the rest-length stop", "%", f"{demand['at_stop_pct']:.0f}"),
        ("fastest shortening", "mm/s", f"{demand['fastest_shortening_mm_per_s']:.0f}"),
        ("fastest lengthening", "mm/s", f"{demand['fastest_lengthening_mm_per_s']:.0f}"),
        ("air, its own profile, no dead volume", "g", f"{demand['air_g']:.2f}"),
    ):
        result.add_row(label, unit, value)
    return result


def _build_sensitivity_table(summary: dict[str, Any]) -> Table:
    result = _create_table(
        "What the assumptions change (these actuators and their count kept)",
        "assumption",
        "from",
        "to",
        "orifices\n[mm]",
        "cylinder\n[MPa]",
        "moment\nshare",
        "Hill con./\necc. [F0]",
        "air\n[g]",
        "rule\ntakes",
    )
    base = summary["sensitivity"]["base"]
    result.add_row("as designed", "", "", *_format_outcome_cells(base, None), style="bold")
    result.add_section()
    for row in summary["sensitivity"]["rows"]:
        unit = "" if row["unit"] == "1" else f" [{row['unit']}]"
        cells = ["not possible"] if row["outcome"] is None else _format_outcome_cells(row["outcome"], base)
        result.add_row(f"{row['assumption']}{unit}", f"{row['base']:.4g}", f"{row['value']:.4g}", *cells)
    return result


def _format_outcome_cells(outcome: dict[str, Any], base: dict[str, Any] | None) -> list[str]:
    """Outcomes; a dot for what is as in ``base``."""

    def cell(form: str, *keys: str) -> str:
        values = [outcome[key] for key in keys]
        if values[0] is None:
            return "-"
        told = " / ".join(format(value, form) for value in values)
        same = base is not None and told == " / ".join(format(base[key], form) for key in keys)
        return "·" if same else told

    return [
        cell(".3f", "orifice_concentric_mm", "orifice_eccentric_mm"),
        cell(".1f", "cylinder_pressure_mpa"),
        cell(".2f", "peak_share"),
        cell(".3f", "misfit_concentric_f0", "misfit_eccentric_f0"),
        cell(".2f", "air_g"),
        cell("s", "would_take"),
    ]


def _describe_strength(summary: dict[str, Any]) -> str:
    """Whether the actuators are strong enough: at rest, and in a stride with the damper."""
    demand, share = summary["demand"], f"{summary['strength']:.2f} times the force that is asked for"
    needed = summary["pressure_for_needed_force_bar"]
    at = "more than 20 bar" if needed is None else f"{needed:.2f} bar"
    if demand and demand["least_margin"] < 1.0:
        held = "" if summary["strength"] < 1.0 else "at rest "
        verdict = (
            f"The actuators are too weak: {held}they have {share}, and at {demand['least_margin_pct']:.0f} % of the "
            f"stride {demand['least_margin']:.2f} of what tendon and damper ask for at the supply's pressure."
        )
    elif summary["strength"] < 1.0:
        verdict = f"The actuators are too weak: they have {share}; {at} would give just that."
    else:
        verdict = f"The actuators are strong enough: they have {share}; {at} would give just that."
    return f"{verdict} Preferred is the row that needs fewest actuators, then least gas (assumed)."


def _describe_excess_pressure(damper: dict[str, Any]) -> list[str]:
    """What to say of a cylinder that has more pressure than is allowed."""
    pressure, allowed = damper["pressure_mpa"], damper["allowed_pressure_mpa"]
    if pressure <= PRESSURE_TOLERANCE_RATIO * allowed:
        return []
    fastest = max(damper[side]["oil_speed_m_per_s"] for side in ("concentric", "eccentric"))
    return [
        f"The damper would have {pressure:.4g} MPa in its cylinder, more than the {allowed:g} MPa allowed, and oil at "
        f"{fastest:.0f} m/s in its orifice: no such damper can be built as sized. (4.2) asks for a bore of "
        f"{damper['needed_bore_mm']:.2f} mm; make the bore larger, or give another --cylinder-pressure."
    ]


def collect_remarks(summary: dict[str, Any]) -> list[str]:
    """What a reader has to know beside the tables, one sentence each."""
    said, demand = [], summary["demand"]
    if summary["strength"] is not None:
        said.append(_describe_strength(summary))
    said.extend(_describe_excess_pressure(summary["damper"]))
    if demand and demand["at_stop_pct"] > 0.0:
        said.append(
            f"In {demand['at_stop_pct']:.0f} % of the stride the muscle would be longer than at rest: the stop carries."
        )
    if summary["slenderness"] < MIN_TESTED_SLENDERNESS:
        said.append(
            f"Length over diameter is {summary['slenderness']:.1f}; the actuators of Table 3.1 were tested at "
            f"{MIN_TESTED_SLENDERNESS:g} and more."
        )
    missed = [row["name"] for row in summary["envelope"] if not row["met"]]
    if missed:
        said.append(
            f"(2.5) is not met: {', '.join(missed)}. The actuator's isometric curve bends upwards, a muscle's "
            "downwards; and one orifice gives a damping that grows with the square of speed, not a hyperbola."
        )
    said.append(
        "The cavitation number is the pressure behind the orifice over the drop across it, with the reservoir at "
        "atmosphere (assumed): far below 1, the jet is close to boiling, and only a back pressure would prevent it."
    )
    unvaried = summary["sensitivity"]["left_out"]
    for why in dict.fromkeys(unvaried.values()):
        fields = ", ".join(field.replace("_", " ") for field in unvaried if unvaried[field] == why)
        said.append(f"Assumed, but not varied: {fields} ({why}).")
    if summary["gait"]:
        said.append(f"To walk with it under its own profile: {summary['gait']}")
    else:
        said.append(
            "No pressure profile was written, because a muscle has no stride: klute-sim gait would walk with this "
            "device under the profile that is tuned for the default prosthesis and 75 kg, unless it is given another."
        )
    said.append(f"{len(summary['assumptions'])} of the device's numbers are assumed (device.toml says which and why).")
    return said
