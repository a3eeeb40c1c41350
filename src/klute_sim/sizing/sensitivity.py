"""Sensitivity of a design to each assumption: one assumption at a time, in both directions."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from klute_sim.errors import InputError
from klute_sim.laws.hill_tables import GENERIC_HILL_CURVE
from klute_sim.sizing.choices import ACTUATOR_LABELS, PA_PER_MPA, DesignChoices
from klute_sim.sizing.sizing import Design, design_device
from klute_sim.sizing.target import MuscleTarget, WalkerTarget
from klute_sim.types import ProgressCallback

HILL_SHAPE_LABELS = {"a": "a/F0", "b": "b/Vmax"}
"""Constants of Hill's equation (2.4) with their labels."""
SIMULATION_ONLY_ASSUMPTIONS = ("pressure_rate",)
"""Assumptions that only a simulation uses; ``klute-sim gait`` shows their influence."""
STRIDE_ASSUMPTIONS = (
    "neutral_ratio",
    "slack_length",
    "tendon_strain",
    "second_spring_ratio",
    "engagement_fraction",
    "gas_temperature",
    "dead_volume",
)
"""Assumptions of every device file that influence only the demand of a stride."""


@dataclass(frozen=True)
class Variation:
    """One assumption and its alternative values."""

    name: str
    """Label of the assumption."""
    unit: str
    """Unit of the table."""
    si_factor: float
    """SI value of one unit."""
    nominal: float
    """Nominal value [SI]."""
    values: tuple[float, ...]
    """Alternative values [SI]."""
    reason: str
    """Source of the assumption and of the size of its variation."""
    build_inputs: Callable[[float], tuple[MuscleTarget | WalkerTarget, DesignChoices]]
    """Function that returns target and choices of a design with the given value [SI]."""
    assumption: str | None = None
    """Field of :class:`~klute_sim.sizing.choices.DesignAssumptions`; None for another value."""
    affects_length: bool = False
    """Whether the resting length follows from this value and is sized again."""


@dataclass(frozen=True)
class DesignMetrics:
    """Metrics of a design that are compared; None where a metric is not defined."""

    orifice_concentric: float
    """Diameter of the concentric orifice [m]."""
    orifice_eccentric: float
    """Diameter of the eccentric orifice [m]."""
    cylinder_pressure: float
    """Larger actual gauge pressure of the two damper design points [Pa]."""
    peak_moment_fraction: float | None
    """Static ankle moment over the peak moment [1]; see :class:`~klute_sim.sizing.evaluation.demand.StrideDemand`."""
    rms_error_concentric: float
    """Deviation of the fixed orifices while shortening [F0]."""
    rms_error_eccentric: float
    """Deviation of the fixed orifices while lengthening [F0]."""
    air_mass: float | None
    """Air consumption per stride [kg]."""
    recommended_actuators: str | None
    """Actuators that the design rule selects for the force; None without a required force."""


@dataclass(frozen=True)
class SensitivityResult:
    """Metrics of a design in which one assumption has another value."""

    variation: Variation
    """Varied assumption."""
    value: float
    """Value of the assumption [SI]."""
    metrics: DesignMetrics | None
    """Metrics of the design; None where no device can be sized."""


def compute_design_metrics(design: Design) -> DesignMetrics:
    """Return the compared metrics of a design."""
    fixed, demand = design.compute_force_velocity_errors()["fixed_orifices"], design.demand
    return DesignMetrics(
        orifice_concentric=design.damper.concentric.orifice_diameter,
        orifice_eccentric=design.damper.eccentric.orifice_diameter,
        cylinder_pressure=design.damper.max_pressure,
        peak_moment_fraction=demand.peak_moment_fraction if demand else None,
        rms_error_concentric=fixed.concentric,
        rms_error_eccentric=fixed.eccentric,
        air_mass=demand.air_mass if demand else None,
        recommended_actuators=_recommend_actuators(design.target, design.choices),
    )


def _recommend_actuators(target: MuscleTarget | WalkerTarget, choices: DesignChoices) -> str | None:
    """Return the actuators that the design rule selects when the user fixes none."""
    if isinstance(target, MuscleTarget) and target.isometric_force is None:
        return None
    option = design_device(target, replace(choices, actuator=None, count=None)).selected
    return f"{option.count} x {ACTUATOR_LABELS[option.actuator]}"


def iter_variations(design: Design) -> Iterator[Variation]:
    """Yield the variations of everything that ``design`` assumes; :func:`list_excluded_assumptions` has the rest."""
    target, choices, assumptions = design.target, design.choices, design.choices.assumptions

    def vary_assumption(
        field: str,
        name: str,
        unit: str,
        factor: float,
        values: tuple[float, ...],
        reason: str,
        *,
        affects_length: bool = False,
    ) -> Iterator[Variation]:
        def build_inputs(value: float) -> tuple[MuscleTarget | WalkerTarget, DesignChoices]:
            return target, replace(choices, assumptions=replace(assumptions, **{field: value}))

        if field not in choices.fixed_fields:
            yield Variation(
                name, unit, factor, getattr(assumptions, field), values, reason, build_inputs, field, affects_length
            )

    def vary_relative(field: str, fraction: float) -> tuple[float, ...]:
        nominal = getattr(assumptions, field)
        return (1.0 - fraction) * nominal, (1.0 + fraction) * nominal

    ratio, neutral, strain = assumptions.design_ratio, assumptions.neutral_ratio, assumptions.tendon_strain
    yield from vary_assumption(
        "design_ratio", "L/L0 at which F0 counts", "1", 1.0, (ratio - 0.02, min(1.0, ratio + 0.02)), "Fig. 3.9"
    )
    if choices.eccentric_speed is None:
        yield from vary_assumption(
            "eccentric_speed_fraction",
            "fastest lengthening/Vmax",
            "1",
            1.0,
            vary_relative("eccentric_speed_fraction", 0.2),
            "the tests' 150 of 300 mm/s; varied by 20 %",
        )
    if choices.eccentric_force is None:
        nominal = design.damper.eccentric.design_force
        yield Variation(
            "eccentric damping",
            "N",
            1.0,
            nominal,
            (0.9 * nominal, 1.1 * nominal),
            "(s - 1) F0; 400 N instead of 441 N for the 3/4 in pair is -9 %",
            lambda value: (target, replace(choices, eccentric_force=value)),
        )
    if choices.bore is None:
        pressure = vary_relative("cylinder_pressure", 0.2)
        yield from vary_assumption(
            "cylinder_pressure",
            "cylinder pressure",
            "MPa",
            PA_PER_MPA,
            pressure,
            "Table 4.1 is missing; varied by 20 %",
        )
    yield from vary_assumption(
        "discharge_coefficient", "Cd as made", "1", 1.0, (0.8, 0.61), "chapter 4: as low as 0.61"
    )
    yield from _iter_muscle_variations(design)
    if not isinstance(target, WalkerTarget):
        return
    yield from vary_assumption(
        "neutral_ratio", "L/L0 at neutral ankle", "1", 1.0, (neutral - 0.01, neutral + 0.01), "the stop is near"
    )
    yield from vary_assumption("moment_arm", "moment arm", "mm", 1e-3, (0.0434, 0.0524), "Wolfram 2018: 47.9 +- 4.5 mm")
    slack = vary_relative("slack_length", 0.2)
    yield from vary_assumption("slack_length", "tendon slack length", "mm", 1e-3, slack, "varied by 20 %")
    yield from vary_assumption(
        "tendon_strain",
        "tendon strain",
        "%",
        0.01,
        (strain - 0.01, strain + 0.01),
        "Kharazi 2021: 4.0 %; varied by 1 percentage point",
    )
    for field, name in (
        ("second_spring_ratio", "second spring/first"),
        ("engagement_fraction", "engagement/slack length"),
    ):
        yield from vary_assumption(field, name, "1", 1.0, vary_relative(field, 0.5), "Figs 6.3, 6.4: no values")
    yield from vary_assumption("gas_temperature", "gas temperature", "degC", 1.0, (0.0, 40.0), "room temperature")
    yield from vary_assumption(
        "dead_volume", "dead volume", "cm³", 1e-6, (0.0, 2.0 * assumptions.dead_volume), "none or twice, per actuator"
    )
    if _is_length_free(design):
        fraction = vary_relative("excursion_fraction", 0.2)
        reason = "Fig. 3.8: 0.094; varied by 20 %, L0 by the design rule"
        yield from vary_assumption(
            "excursion_fraction", "ankle's travel/L0", "1", 1.0, fraction, reason, affects_length=True
        )
        nominal = design.selected.resting_length
        yield Variation(
            "resting length L0",
            "mm",
            1e-3,
            nominal,
            (0.9 * nominal, 1.1 * nominal),
            "the same braid; varied by 10 %",
            lambda value: (target, replace(choices, resting_length=value)),
        )
    yield Variation(
        "moment/reference",
        "1",
        1.0,
        target.moment_scale,
        (target.moment_scale * 1.72 / 1.43,),
        "other studies report 1.72 N·m/kg",
        lambda value: (replace(target, moment_scale=value), choices),
    )


def list_excluded_assumptions(design: Design) -> dict[str, str]:
    """Return the assumptions of ``design`` that are not varied, with the reason."""
    reasons = dict.fromkeys(SIMULATION_ONLY_ASSUMPTIONS, "no size and no outcome of a design depends on it")
    if not isinstance(design.target, WalkerTarget):
        reasons |= dict.fromkeys(STRIDE_ASSUMPTIONS, "without a subject no outcome depends on it")
    return {field: reason for field, reason in reasons.items() if field not in design.choices.fixed_fields}


def _is_length_free(design: Design) -> bool:
    return design.choices.resting_length is None and design.muscle.resting_length is None


def _iter_muscle_variations(design: Design) -> Iterator[Variation]:
    target, choices, muscle = design.target, design.choices, design.muscle

    def with_muscle(new_muscle: MuscleTarget) -> tuple[MuscleTarget | WalkerTarget, DesignChoices]:
        return (replace(target, muscle=new_muscle) if isinstance(target, WalkerTarget) else new_muscle), choices

    if muscle.peak_velocity is None:
        nominal = muscle.design_peak_velocity
        yield Variation(
            "Vmax",
            "mm/s",
            1e-3,
            nominal,
            (0.8 * nominal, 0.780),
            "fastest test; human triceps surae models: 756-780 mm/s",
            lambda value: with_muscle(replace(muscle, peak_velocity=value)),
        )
    free_keys = [
        key
        for key in HILL_SHAPE_LABELS
        if getattr(muscle.hill, key) == getattr(GENERIC_HILL_CURVE, key) and key not in choices.fixed_fields
    ]
    if free_keys:
        yield Variation(
            " = ".join(HILL_SHAPE_LABELS[key] for key in free_keys),
            "1",
            1.0,
            getattr(muscle.hill, free_keys[0]),
            (0.12, 0.41),
            "Fig. 2.8; the ends of (2.5)",
            lambda value: with_muscle(replace(muscle, hill=muscle.hill._replace(**dict.fromkeys(free_keys, value)))),
        )


def analyse_sensitivity(
    design: Design, progress: ProgressCallback = lambda fraction, stage: None
) -> list[SensitivityResult]:
    """Return the metrics of all variations of ``design``; each design keeps actuator, count and resting length.

    The resting length is sized again only where it follows from the varied value. ``progress`` receives the completed
    fraction.
    """
    cases = [(variation, value) for variation in iter_variations(design) for value in variation.values]
    results = []
    for index, (variation, value) in enumerate(cases):
        progress(index / len(cases), variation.name)
        results.append(SensitivityResult(variation, value, _redesign(design, variation, value)))
    progress(1.0, "sensitivity analysis")
    return results


def _redesign(design: Design, variation: Variation, value: float) -> DesignMetrics | None:
    target, choices = variation.build_inputs(value)
    fixed_choices = replace(choices, actuator=design.selected.actuator, count=design.selected.count)
    if choices.resting_length is None and not variation.affects_length:
        fixed_choices = replace(fixed_choices, resting_length=design.selected.resting_length)
    try:
        return replace(
            compute_design_metrics(design_device(target, fixed_choices)),
            recommended_actuators=_recommend_actuators(target, choices),
        )
    except InputError:
        return None
