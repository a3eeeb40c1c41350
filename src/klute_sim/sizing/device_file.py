"""The design as a device file: every number with its source, assumed ones marked."""

from typing import Any

from klute_sim.device.changes import to_toml
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.laws.tendon import Tendon
from klute_sim.sizing.choices import ACTUATOR_LABELS, PA_PER_MPA, DesignChoices
from klute_sim.sizing.parts.actuator import ActuatorOption, load_muscle_section
from klute_sim.sizing.parts.damper import DESIGN_DISCHARGE_COEFFICIENT, DamperDesign, DamperDesignPoint
from klute_sim.sizing.target import MuscleTarget, WalkerTarget
from klute_sim.units import BAR

USER_SOURCE = "given to klute-sim design"
"""Source of a number that the user gave."""
MISSING_VALUES_NOTE = "the values of Figs 6.3-6.4 are missing from the source"
SPRING_ASSUMPTIONS = frozenset({"tendon_strain", "second_spring", "engagement_share"})
"""What the stiffnesses of the tendon follow from, beside its force and its length."""


def build_device(
    name: str,
    target: MuscleTarget | WalkerTarget,
    option: ActuatorOption,
    damper: DamperDesign,
    tendon: Tendon,
    tendon_force: float,
    required_force: float,
    choices: DesignChoices,
) -> Device:
    """The device file of a design whose tendon is sized for ``force`` [N], read back and checked as any other.

    ``needed`` [N] is what was asked of the actuators; 0: nothing.
    """
    assumed = choices.assumptions
    braid = load_muscle_section(option.actuator)
    muscle = {"count": option.count, "resting_length_mm": round(1e3 * option.resting_length, 1)}
    keys: dict[str, Any] = {
        "name": name,
        "description": _describe_design(target, option, choices),
        "muscle": {**braid.model_dump(exclude={"count", "resting_length_mm", "bladder", "friction"}), **muscle},
        "damper": {
            "bore_mm": round(1e3 * damper.bore, 2),
            "orifice_concentric_mm": round(1e3 * damper.concentric.orifice_diameter, 3),
            "orifice_eccentric_mm": round(1e3 * damper.eccentric.orifice_diameter, 3),
            "oil_density_kg_m3": choices.oil_density,
        },
        "tendon": {
            "slack_length_mm": round(1e3 * tendon.slack_length, 2),
            "stiffness_1_n_per_mm": float(f"{1e-3 * tendon.stiffness_1:.5g}"),
            "stiffness_2_n_per_mm": float(f"{1e-3 * tendon.stiffness_2:.5g}"),
            "engagement_mm": round(1e3 * tendon.engagement_stretch, 3),
        },
        "supply": {
            "pressure_bar": choices.supply_pressure / BAR,
            "rate_bar_per_s": assumed.pressure_rate / BAR,
            "gas_temperature_c": assumed.gas_temperature,
        },
        "mounting": {"neutral_muscle_ratio": assumed.neutral_ratio},
        "sources": _collect_sources(target, option, damper, tendon_force, required_force, choices),
    }
    return parse_device(to_toml(keys).encode(), f"of the design '{name}'")


def _describe_design(target: MuscleTarget | WalkerTarget, option: ActuatorOption, choices: DesignChoices) -> str:
    whom = f"the muscle '{target.name}'" if isinstance(target, MuscleTarget) else f"a walker of {target.mass:g} kg"
    if isinstance(target, WalkerTarget) and "moment_arm" in choices.fixed_fields:
        whom = f"{whom} with the given moment arm of {1e3 * choices.assumptions.moment_arm:g} mm"
    made = f"{option.count} x {ACTUATOR_LABELS[option.actuator]} actuator, damper and tendon"
    return f"{made}, sized by klute-sim design for {whom}."


def _collect_sources(
    target: MuscleTarget | WalkerTarget,
    option: ActuatorOption,
    damper: DamperDesign,
    tendon_force: float,
    required_force: float,
    choices: DesignChoices,
) -> dict[str, str]:
    assumed, preset = choices.assumptions, load_device(option.actuator)
    printed = {
        key: f"{source}, {ACTUATOR_LABELS[option.actuator]}" if "Table 3.1" in source else source
        for key, source in preset.spec.sources.items()
        if key.startswith("muscle.")
    }
    given, muscle = choices.fixed_fields, target.muscle if isinstance(target, WalkerTarget) else target
    # A given strain is the user's, but how the springs share the load stays assumed unless it is given, too.
    strain = f"stretched {100 * assumed.tendon_strain:g} % of tendon plus muscle at {tendon_force:.0f} N"
    if "tendon_strain" in given:
        strain = f"{strain} ({USER_SOURCE})"
    springs = strain if given >= SPRING_ASSUMPTIONS else f"assumed: {strain}; {MISSING_VALUES_NOTE}"

    def unless_given(field: str, otherwise: str) -> str:
        return USER_SOURCE if field in given else otherwise

    return {
        **printed,
        "muscle.count": _count_source(option, required_force, choices),
        "muscle.resting_length_mm": _length_source(target, option, choices),
        "damper.bore_mm": _bore_source(choices),
        "damper.orifice_concentric_mm": _orifice_source(damper.concentric, speed=muscle.peak_velocity, force=None),
        "damper.orifice_eccentric_mm": _orifice_source(
            damper.eccentric, speed=choices.eccentric_speed, force=choices.eccentric_force
        ),
        "damper.oil_density_kg_m3": "dissertation chapter 4, mineral oil"
        if choices.oil_density == DesignChoices.oil_density
        else USER_SOURCE,
        "tendon.slack_length_mm": unless_given(
            "slack_length", "assumed: that of the 3/4 in pair, whose unit lengths (Fig. 7.6) it fits"
        ),
        "tendon.stiffness_1_n_per_mm": springs,
        "tendon.stiffness_2_n_per_mm": springs,
        "tendon.engagement_mm": unless_given(
            "engagement_share",
            f"assumed: {100 * assumed.engagement_fraction:g} % of slack length; {MISSING_VALUES_NOTE}",
        ),
        "supply.pressure_bar": (
            "dissertation Fig. 3.3: at most 5 bar"
            if choices.supply_pressure == DesignChoices.supply_pressure
            else USER_SOURCE
        ),
        "supply.rate_bar_per_s": unless_given("pressure_rate", "assumed: a fast proportional regulator"),
        "supply.gas_temperature_c": unless_given("temperature", "assumed: room temperature"),
        "mounting.neutral_muscle_ratio": unless_given(
            "neutral_ratio", "assumed: strong at push-off, clear of the rest-length stop in walking"
        ),
    }


def _bore_source(choices: DesignChoices) -> str:
    if choices.bore is not None:
        return USER_SOURCE
    rule = f"(4.2) at {choices.assumptions.cylinder_pressure / PA_PER_MPA:g} MPa"
    if "cylinder_pressure" in choices.fixed_fields:
        return f"{rule}, {USER_SOURCE}"
    return f"assumed: {rule}; Table 4.1 is missing from the source"


def _orifice_source(point: DamperDesignPoint, *, speed: float | None, force: float | None) -> str:
    """``speed`` and ``force`` are what somebody gave of the design point."""
    rule = (
        f"(4.6) with {point.design_force:.0f} N at {1e3 * point.speed:.0f} mm/s, Cd = {DESIGN_DISCHARGE_COEFFICIENT:g}"
    )
    given = " and ".join(name for name, value in (("force", force), ("speed", speed)) if value is not None)
    if speed is not None and force is not None:
        return f"{rule}; {given} {USER_SOURCE}"
    rest = f"the {given} is given, the rest of the design point" if given else "the design point"
    return f"assumed: {rule}; {rest} is ours, Table 4.1 is missing"


def _count_source(option: ActuatorOption, required_force: float, choices: DesignChoices) -> str:
    if choices.count is not None:
        return USER_SOURCE
    rule = "fewest that reach" if option.is_sufficient else "as many as a device may have, and still too few for"
    return (
        f"assumed: {rule} the {required_force:.0f} N asked for at L/L0 {option.length_ratio:.3f}; there they have "
        f"{option.count * option.available_force:.0f} N at {choices.supply_pressure / BAR:g} bar"
    )


def _length_source(target: MuscleTarget | WalkerTarget, option: ActuatorOption, choices: DesignChoices) -> str:
    if choices.resting_length is not None:
        return USER_SOURCE
    if isinstance(target, MuscleTarget) and target.resting_length is not None:
        return f"l0 of the muscle '{target.name}'"
    if option.resting_length == load_muscle_section(option.actuator).get_si("resting_length_mm"):
        return f"dissertation Table 3.1, {ACTUATOR_LABELS[option.actuator]}"
    share = 100 * choices.assumptions.excursion_fraction
    rule = f"the same braid, longer, so that the ankle moves the tendon by at most {share:g} % of it"
    return f"{rule}, {USER_SOURCE}" if "excursion_share" in choices.fixed_fields else f"assumed: {rule}"
