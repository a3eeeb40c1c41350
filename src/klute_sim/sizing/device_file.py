"""The design as a device file in which every number has a source and assumed numbers are marked."""

from typing import Any

from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.files.toml import format_toml
from klute_sim.laws.tendon import TendonParameters
from klute_sim.sizing.choices import ACTUATOR_LABELS, PA_PER_MPA, DesignChoices
from klute_sim.sizing.parts.actuator import ActuatorOption, load_muscle_section
from klute_sim.sizing.parts.damper import DESIGN_DISCHARGE_COEFFICIENT, DamperDesign, DamperDesignPoint
from klute_sim.sizing.target import MuscleTarget, WalkerTarget
from klute_sim.units import BAR

USER_SOURCE = "given to klute-sim design"
"""Source of a number that the user specified."""
MISSING_VALUES_NOTE = "the values of Figs 6.3-6.4 are missing from the source"
"""Reason why the springs of the tendon are assumed."""
SPRING_ASSUMPTIONS = frozenset({"tendon_strain", "second_spring_ratio", "engagement_fraction"})
"""Assumptions that determine the stiffnesses of the tendon besides its force and length."""


def build_device(
    name: str,
    target: MuscleTarget | WalkerTarget,
    option: ActuatorOption,
    damper: DamperDesign,
    tendon: TendonParameters,
    tendon_force: float,
    required_force: float,
    choices: DesignChoices,
) -> Device:
    """Return the device of a design, parsed and validated from its file.

    ``tendon_force`` [N] is the force for which the tendon was sized; ``required_force`` [N] is the force required of
    the actuators, 0 without a requirement.
    """
    assumptions = choices.assumptions
    muscle_section = load_muscle_section(option.actuator)
    muscle_keys = {"count": option.count, "resting_length_mm": round(1e3 * option.resting_length, 1)}
    keys: dict[str, Any] = {
        "name": name,
        "description": _describe_design(target, option, choices),
        "muscle": {
            **muscle_section.model_dump(exclude={"count", "resting_length_mm", "bladder", "friction"}),
            **muscle_keys,
        },
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
            "rate_bar_per_s": assumptions.pressure_rate / BAR,
            "gas_temperature_c": assumptions.gas_temperature,
            "dead_volume_cm3": round(1e6 * option.count * assumptions.dead_volume, 3),
        },
        "mounting": {"neutral_muscle_ratio": assumptions.neutral_ratio},
        "sources": _collect_sources(target, option, damper, tendon_force, required_force, choices),
    }
    return parse_device(format_toml(keys).encode(), f"of the design '{name}'")


def _describe_design(target: MuscleTarget | WalkerTarget, option: ActuatorOption, choices: DesignChoices) -> str:
    target_text = (
        f"the muscle '{target.name}'" if isinstance(target, MuscleTarget) else f"a subject of {target.mass:g} kg"
    )
    if isinstance(target, WalkerTarget) and "moment_arm" in choices.fixed_fields:
        target_text = f"{target_text} with the given moment arm of {1e3 * choices.assumptions.moment_arm:g} mm"
    parts = f"{option.count} x {ACTUATOR_LABELS[option.actuator]} actuator, damper and tendon"
    return f"{parts}, sized by klute-sim design for {target_text}."


def _collect_sources(
    target: MuscleTarget | WalkerTarget,
    option: ActuatorOption,
    damper: DamperDesign,
    tendon_force: float,
    required_force: float,
    choices: DesignChoices,
) -> dict[str, str]:
    assumptions, preset = choices.assumptions, load_device(option.actuator)
    printed_sources = {
        key: f"{source}, {ACTUATOR_LABELS[option.actuator]}" if "Table 3.1" in source else source
        for key, source in preset.spec.sources.items()
        if key.startswith("muscle.")
    }
    fixed_fields, muscle = choices.fixed_fields, target.muscle if isinstance(target, WalkerTarget) else target
    # A specified strain does not determine the load sharing of the springs, which stays assumed.
    strain_source = f"stretched {100 * assumptions.tendon_strain:g} % of tendon plus muscle at {tendon_force:.0f} N"
    if "tendon_strain" in fixed_fields:
        strain_source = f"{strain_source} ({USER_SOURCE})"
    spring_source = (
        strain_source if fixed_fields >= SPRING_ASSUMPTIONS else f"assumed: {strain_source}; {MISSING_VALUES_NOTE}"
    )

    def unless_given(name: str, source: str) -> str:
        return USER_SOURCE if name in fixed_fields else source

    return {
        **printed_sources,
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
        "tendon.stiffness_1_n_per_mm": spring_source,
        "tendon.stiffness_2_n_per_mm": spring_source,
        "tendon.engagement_mm": unless_given(
            "engagement_fraction",
            f"assumed: {100 * assumptions.engagement_fraction:g} % of slack length; {MISSING_VALUES_NOTE}",
        ),
        "supply.pressure_bar": (
            "dissertation Fig. 3.3: at most 5 bar"
            if choices.supply_pressure == DesignChoices.supply_pressure
            else USER_SOURCE
        ),
        "supply.rate_bar_per_s": unless_given("pressure_rate", "assumed: a fast proportional regulator"),
        "supply.gas_temperature_c": unless_given("gas_temperature", "assumed: room temperature"),
        "supply.dead_volume_cm3": unless_given(
            "dead_volume", "assumed: a fitting and 20 cm of hose of 4 mm per actuator"
        ),
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
    """Return the source of an orifice; ``speed`` and ``force`` are the values that the user specified."""
    rule = (
        f"(4.6) with {point.design_force:.0f} N at {1e3 * point.speed:.0f} mm/s, Cd = {DESIGN_DISCHARGE_COEFFICIENT:g}"
    )
    specified = " and ".join(name for name, value in (("force", force), ("speed", speed)) if value is not None)
    if speed is not None and force is not None:
        return f"{rule}; {specified} {USER_SOURCE}"
    remainder = f"the {specified} is given, the rest of the design point" if specified else "the design point"
    return f"assumed: {rule}; {remainder} is ours, Table 4.1 is missing"


def _count_source(option: ActuatorOption, required_force: float, choices: DesignChoices) -> str:
    if choices.count is not None:
        return USER_SOURCE
    rule = "fewest that reach" if option.is_sufficient else "as many as a device may have, and still too few for"
    return (
        f"assumed: {rule} the {required_force:.0f} N required at L/L0 {option.length_ratio:.3f}; there they have "
        f"{option.count * option.available_force:.0f} N at {choices.supply_pressure / BAR:g} bar"
    )


def _length_source(target: MuscleTarget | WalkerTarget, option: ActuatorOption, choices: DesignChoices) -> str:
    if choices.resting_length is not None:
        return USER_SOURCE
    if isinstance(target, MuscleTarget) and target.resting_length is not None:
        return f"l0 of the muscle '{target.name}'"
    if option.resting_length == load_muscle_section(option.actuator).get_si("resting_length_mm"):
        return f"dissertation Table 3.1, {ACTUATOR_LABELS[option.actuator]}"
    percent = 100 * choices.assumptions.excursion_fraction
    rule = f"the same braid, longer, so that the ankle moves the tendon by at most {percent:g} % of it"
    return f"{rule}, {USER_SOURCE}" if "excursion_fraction" in choices.fixed_fields else f"assumed: {rule}"
