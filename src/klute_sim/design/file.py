"""The design as a device file: every number with its source, assumed ones marked."""

from typing import Any

from klute_sim.dataset.override import to_toml
from klute_sim.design.actuator import Option, row
from klute_sim.design.choices import MPA, ROWS, Choices
from klute_sim.design.damper import DESIGN_DISCHARGE, DamperDesign, DesignPoint
from klute_sim.design.target import Target, Walker
from klute_sim.device.files import Device, load, read
from klute_sim.laws.tendon import Tendon
from klute_sim.units import BAR

ASKED = "given to klute-sim design"
"""Source of a number that the user gave."""
MISSING = "the values of Figs 6.3-6.4 are missing from the source"
SPRINGS = frozenset({"tendon_strain", "second_spring", "engagement_share"})
"""What the stiffnesses of the tendon follow from, beside its force and its length."""


def device(
    name: str,
    target: Target | Walker,
    option: Option,
    damper: DamperDesign,
    tendon: Tendon,
    force: float,
    needed: float,
    choices: Choices,
) -> Device:
    """The device file of a design whose tendon is sized for ``force`` [N], read back and checked as any other.

    ``needed`` [N] is what was asked of the actuators; 0: nothing.
    """
    assumed = choices.assumptions
    braid = row(option.actuator)
    muscle = {"count": option.count, "resting_length_mm": round(1e3 * option.resting_length, 1)}
    keys: dict[str, Any] = {
        "name": name,
        "description": _description(target, option, choices),
        "muscle": {**braid.model_dump(exclude={"count", "resting_length_mm", "bladder", "friction"}), **muscle},
        "damper": {
            "bore_mm": round(1e3 * damper.bore, 2),
            "orifice_concentric_mm": round(1e3 * damper.concentric.orifice, 3),
            "orifice_eccentric_mm": round(1e3 * damper.eccentric.orifice, 3),
            "oil_density_kg_m3": choices.oil_density,
        },
        "tendon": {
            "slack_length_mm": round(1e3 * tendon.slack_length, 2),
            "stiffness_1_n_per_mm": float(f"{1e-3 * tendon.stiffness_1:.5g}"),
            "stiffness_2_n_per_mm": float(f"{1e-3 * tendon.stiffness_2:.5g}"),
            "engagement_mm": round(1e3 * tendon.engagement, 3),
        },
        "supply": {
            "pressure_bar": choices.supply_pressure / BAR,
            "rate_bar_per_s": assumed.pressure_rate / BAR,
            "gas_temperature_c": assumed.temperature,
        },
        "mounting": {"neutral_muscle_ratio": assumed.neutral_ratio},
        "sources": _sources(target, option, damper, force, needed, choices),
    }
    return read(to_toml(keys).encode(), f"of the design '{name}'")


def _description(target: Target | Walker, option: Option, choices: Choices) -> str:
    whom = f"the muscle '{target.name}'" if isinstance(target, Target) else f"a walker of {target.mass:g} kg"
    if isinstance(target, Walker) and "moment_arm" in choices.given:
        whom = f"{whom} with the given moment arm of {1e3 * choices.assumptions.moment_arm:g} mm"
    made = f"{option.count} x {ROWS[option.actuator]} actuator, damper and tendon"
    return f"{made}, sized by klute-sim design for {whom}."


def _sources(
    target: Target | Walker, option: Option, damper: DamperDesign, force: float, needed: float, choices: Choices
) -> dict[str, str]:
    assumed, preset = choices.assumptions, load(option.actuator)
    printed = {
        key: f"{source}, {ROWS[option.actuator]}" if "Table 3.1" in source else source
        for key, source in preset.spec.sources.items()
        if key.startswith("muscle.")
    }
    given, muscle = choices.given, target.muscle if isinstance(target, Walker) else target
    # A given strain is the user's, but how the springs share the load stays assumed unless it is given, too.
    strain = f"stretched {100 * assumed.tendon_strain:g} % of tendon plus muscle at {force:.0f} N"
    if "tendon_strain" in given:
        strain = f"{strain} ({ASKED})"
    springs = strain if given >= SPRINGS else f"assumed: {strain}; {MISSING}"

    def unless_given(field: str, otherwise: str) -> str:
        return ASKED if field in given else otherwise

    return {
        **printed,
        "muscle.count": _why_count(option, needed, choices),
        "muscle.resting_length_mm": _why_length(target, option, choices),
        "damper.bore_mm": _why_bore(choices),
        "damper.orifice_concentric_mm": _why_orifice(damper.concentric, speed=muscle.peak_velocity, force=None),
        "damper.orifice_eccentric_mm": _why_orifice(
            damper.eccentric, speed=choices.eccentric_speed, force=choices.eccentric_force
        ),
        "damper.oil_density_kg_m3": "dissertation chapter 4, mineral oil"
        if choices.oil_density == Choices.oil_density
        else ASKED,
        "tendon.slack_length_mm": unless_given(
            "slack_length", "assumed: that of the 3/4 in pair, whose unit lengths (Fig. 7.6) it fits"
        ),
        "tendon.stiffness_1_n_per_mm": springs,
        "tendon.stiffness_2_n_per_mm": springs,
        "tendon.engagement_mm": unless_given(
            "engagement_share", f"assumed: {100 * assumed.engagement_share:g} % of slack length; {MISSING}"
        ),
        "supply.pressure_bar": (
            "dissertation Fig. 3.3: at most 5 bar" if choices.supply_pressure == Choices.supply_pressure else ASKED
        ),
        "supply.rate_bar_per_s": unless_given("pressure_rate", "assumed: a fast proportional regulator"),
        "supply.gas_temperature_c": unless_given("temperature", "assumed: room temperature"),
        "mounting.neutral_muscle_ratio": unless_given(
            "neutral_ratio", "assumed: strong at push-off, clear of the rest-length stop in walking"
        ),
    }


def _why_bore(choices: Choices) -> str:
    if choices.bore is not None:
        return ASKED
    rule = f"(4.2) at {choices.assumptions.cylinder_pressure / MPA:g} MPa"
    if "cylinder_pressure" in choices.given:
        return f"{rule}, {ASKED}"
    return f"assumed: {rule}; Table 4.1 is missing from the source"


def _why_orifice(point: DesignPoint, *, speed: float | None, force: float | None) -> str:
    """``speed`` and ``force`` are what somebody gave of the design point."""
    rule = f"(4.6) with {point.damping:.0f} N at {1e3 * point.speed:.0f} mm/s, Cd = {DESIGN_DISCHARGE:g}"
    given = " and ".join(name for name, value in (("force", force), ("speed", speed)) if value is not None)
    if speed is not None and force is not None:
        return f"{rule}; {given} {ASKED}"
    rest = f"the {given} is given, the rest of the design point" if given else "the design point"
    return f"assumed: {rule}; {rest} is ours, Table 4.1 is missing"


def _why_count(option: Option, needed: float, choices: Choices) -> str:
    if choices.count is not None:
        return ASKED
    rule = "fewest that reach" if option.sufficient else "as many as a device may have, and still too few for"
    return (
        f"assumed: {rule} the {needed:.0f} N asked for at L/L0 {option.ratio:.3f}; there they have "
        f"{option.count * option.strength:.0f} N at {choices.supply_pressure / BAR:g} bar"
    )


def _why_length(target: Target | Walker, option: Option, choices: Choices) -> str:
    if choices.resting_length is not None:
        return ASKED
    if isinstance(target, Target) and target.resting_length is not None:
        return f"l0 of the muscle '{target.name}'"
    if option.resting_length == row(option.actuator).si("resting_length_mm"):
        return f"dissertation Table 3.1, {ROWS[option.actuator]}"
    share = 100 * choices.assumptions.excursion_share
    rule = f"the same braid, longer, so that the ankle moves the tendon by at most {share:g} % of it"
    return f"{rule}, {ASKED}" if "excursion_share" in choices.given else f"assumed: {rule}"
