"""The design as a device file: every number with its source, assumed ones marked."""

from typing import Any

from klute_sim.dataset.override import to_toml
from klute_sim.design.actuator import Option, row
from klute_sim.design.choices import ROWS, Choices
from klute_sim.design.damper import DamperDesign
from klute_sim.design.target import Target, Walker
from klute_sim.device.files import Device, load, read
from klute_sim.laws.tendon import Tendon
from klute_sim.units import BAR

ASKED = "given to klute-sim design"


def device(
    name: str,
    target: Target | Walker,
    option: Option,
    damper: DamperDesign,
    tendon: Tendon,
    force: float,
    choices: Choices,
) -> Device:
    """The device file of a design whose tendon is sized for ``force`` [N], read back and checked as any other."""
    assumed = choices.assumptions
    braid = row(option.actuator)
    muscle = {"count": option.count, "resting_length_mm": _round(1e3 * option.resting_length, 1)}
    keys: dict[str, Any] = {
        "name": name,
        "description": _description(target, option),
        "muscle": {**braid.model_dump(exclude={"count", "resting_length_mm", "bladder", "friction"}), **muscle},
        "damper": {
            "bore_mm": _round(1e3 * damper.bore, 2),
            "orifice_concentric_mm": _round(1e3 * damper.concentric.orifice, 3),
            "orifice_eccentric_mm": _round(1e3 * damper.eccentric.orifice, 3),
            "oil_density_kg_m3": choices.oil_density,
        },
        "tendon": {
            "slack_length_mm": _round(1e3 * tendon.slack_length, 2),
            "stiffness_1_n_per_mm": float(f"{1e-3 * tendon.stiffness_1:.5g}"),
            "stiffness_2_n_per_mm": float(f"{1e-3 * tendon.stiffness_2:.5g}"),
            "engagement_mm": _round(1e3 * tendon.engagement, 3),
        },
        "supply": {
            "pressure_bar": choices.supply_pressure / BAR,
            "rate_bar_per_s": assumed.pressure_rate / BAR,
            "gas_temperature_c": assumed.temperature,
        },
        "mounting": {"neutral_muscle_ratio": assumed.neutral_ratio},
        "sources": _sources(target, option, damper, force, choices),
    }
    return read(to_toml(keys).encode(), f"of the design '{name}'")


def _round(value: float, digits: int) -> float:
    return round(value, digits)


def _description(target: Target | Walker, option: Option) -> str:
    whom = f"a walker of {target.mass:g} kg" if isinstance(target, Walker) else f"the muscle '{target.name}'"
    made = f"{option.count} x {ROWS[option.actuator]} actuator, damper and tendon"
    return f"{made}, sized by klute-sim design for {whom}."


def _sources(
    target: Target | Walker, option: Option, damper: DamperDesign, force: float, choices: Choices
) -> dict[str, str]:
    assumed, preset = choices.assumptions, load(option.actuator)
    printed = {
        key: f"{source}, {ROWS[option.actuator]}" if "Table 3.1" in source else source
        for key, source in preset.spec.sources.items()
        if key.startswith("muscle.")
    }
    missing = "the values of Figs 6.3-6.4 are missing from the source"
    bore = f"assumed: (4.2) at {assumed.cylinder_pressure / 1e6:g} MPa; Table 4.1 is missing from the source"
    strain = f"stretched {100 * assumed.tendon_strain:g} % of tendon plus muscle at {force:.0f} N"
    point = "assumed: (4.6) with {:.0f} N at {:.0f} mm/s, Cd = 1; the design point is ours, Table 4.1 is missing"
    return {
        **printed,
        "muscle.count": _why_count(target, option, choices),
        "muscle.resting_length_mm": _why_length(target, option, choices),
        "damper.bore_mm": bore if choices.bore is None else ASKED,
        "damper.orifice_concentric_mm": point.format(damper.concentric.damping, 1e3 * damper.concentric.speed),
        "damper.orifice_eccentric_mm": point.format(damper.eccentric.damping, 1e3 * damper.eccentric.speed),
        "damper.oil_density_kg_m3": "dissertation chapter 4, mineral oil" if choices.oil_density == 900.0 else ASKED,
        "tendon.slack_length_mm": "assumed: that of the 3/4 in pair, whose unit lengths (Fig. 7.6) it fits",
        "tendon.stiffness_1_n_per_mm": f"assumed: {strain}; {missing}",
        "tendon.stiffness_2_n_per_mm": f"assumed: {strain}; {missing}",
        "tendon.engagement_mm": f"assumed: {100 * assumed.engagement_share:g} % of slack length; {missing}",
        "supply.pressure_bar": "dissertation Fig. 3.3: at most 5 bar" if choices.supply_pressure == 5 * BAR else ASKED,
        "supply.rate_bar_per_s": "assumed: a fast proportional regulator",
        "supply.gas_temperature_c": "assumed: room temperature",
        "mounting.neutral_muscle_ratio": "assumed: strong at push-off, clear of the rest-length stop in walking",
    }


def _why_count(target: Target | Walker, option: Option, choices: Choices) -> str:
    if choices.count is not None:
        return ASKED
    reached = (
        f"{option.total:.0f} N at {choices.supply_pressure / BAR:g} bar, L/L0 {choices.assumptions.design_ratio:g}"
    )
    return f"assumed: fewest that reach the force asked for ({reached})"


def _why_length(target: Target | Walker, option: Option, choices: Choices) -> str:
    if choices.resting_length is not None:
        return ASKED
    if isinstance(target, Target) and target.resting_length is not None:
        return f"l0 of the muscle '{target.name}'"
    if option.resting_length == row(option.actuator).si("resting_length_mm"):
        return f"dissertation Table 3.1, {ROWS[option.actuator]}"
    share = 100 * choices.assumptions.excursion_share
    return f"assumed: the same braid, longer, so that the ankle moves the tendon by at most {share:g} % of it"
