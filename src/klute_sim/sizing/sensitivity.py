"""How much each assumed number matters: one at a time, both ways, what becomes of the outcomes."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from klute_sim.errors import InputError
from klute_sim.laws.hill_tables import GENERIC_HILL_CURVE
from klute_sim.sizing.choices import ACTUATOR_LABELS, PA_PER_MPA, DesignChoices
from klute_sim.sizing.sizing import Design, design_device
from klute_sim.sizing.target import MuscleTarget, WalkerTarget

HILL_SHAPE_LABELS = {"a": "a/F0", "b": "b/Vmax"}
"""Constants of Hill's equation (2.4), and what they are called."""
SIMULATION_ONLY_ASSUMPTIONS = ("pressure_rate",)
"""Assumptions that only a simulation of the device uses: klute-sim gait shows what they change."""
STRIDE_ASSUMPTIONS = (
    "neutral_ratio",
    "slack_length",
    "tendon_strain",
    "second_spring",
    "engagement_share",
    "temperature",
)
"""Assumptions that are in every device file, but count only in a stride."""


@dataclass(frozen=True)
class Variation:
    """One assumed number and the values it is changed to."""

    name: str
    unit: str
    si_factor: float
    """SI per unit."""
    nominal: float
    """[SI]"""
    values: tuple[float, ...]
    """Instead of ``base`` [SI]."""
    reason: str
    """Where the number, and how far it is changed, are from."""
    build_inputs: Callable[[float], tuple[MuscleTarget | WalkerTarget, DesignChoices]]
    """The inputs of a design with that value."""
    assumption: str | None = None
    """Of the assumptions; None: another number."""
    affects_length: bool = False
    """Whether the resting length follows from it, and is found anew."""


@dataclass(frozen=True)
class DesignMetrics:
    """What is looked at; None where it is not defined."""

    orifice_concentric: float
    """[m]"""
    orifice_eccentric: float
    """[m]"""
    cylinder_pressure: float
    """Gauge pressure in the damper as made, the larger of its two design points' [Pa]."""
    peak_moment_fraction: float | None
    """See :class:`klute_sim.sizing.evaluation.demand.Demand`."""
    rms_error_concentric: float
    """Of the fixed orifices [F0]."""
    rms_error_eccentric: float
    """Of the fixed orifices [F0]."""
    air_mass: float | None
    """Per stride [kg]."""
    recommended_actuators: str | None
    """Actuators that the rule would take for the force, or None: no force was asked for."""


@dataclass(frozen=True)
class SensitivityResult:
    """One row: an assumption at another value."""

    variation: Variation
    value: float
    """[SI]"""
    metrics: DesignMetrics | None
    """None: no device can be made so."""


def compute_design_metrics(design: Design) -> DesignMetrics:
    """The outcomes of a design."""
    fixed, demand = design.compute_force_velocity_errors()["fixed"], design.demand
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
    """The actuators that the rule takes where nobody chose."""
    if isinstance(target, MuscleTarget) and target.isometric_force is None:
        return None
    option = design_device(target, replace(choices, actuator=None, count=None)).selected
    return f"{option.count} x {ACTUATOR_LABELS[option.actuator]}"


def iter_variations(design: Design) -> Iterator[Variation]:
    """What was assumed in ``found`` and not given by its user; :func:`left_out` has the rest."""
    target, choices, assumed = design.target, design.choices, design.choices.assumptions

    def number(
        field: str, name: str, unit: str, factor: float, values: tuple[float, ...], why: str, *, length: bool = False
    ) -> Iterator[Variation]:
        def changed(value: float) -> tuple[MuscleTarget | WalkerTarget, DesignChoices]:
            return target, replace(choices, assumptions=replace(assumed, **{field: value}))

        if field not in choices.fixed_fields:
            yield Variation(name, unit, factor, getattr(assumed, field), values, why, changed, field, length)

    def around(field: str, share: float) -> tuple[float, ...]:
        base = getattr(assumed, field)
        return (1.0 - share) * base, (1.0 + share) * base

    ratio, neutral, strain = assumed.design_ratio, assumed.neutral_ratio, assumed.tendon_strain
    yield from number(
        "design_ratio", "L/L0 at which F0 counts", "1", 1.0, (ratio - 0.02, min(1.0, ratio + 0.02)), "Fig. 3.9"
    )
    if choices.eccentric_speed is None:
        yield from number(
            "eccentric_speed_share",
            "fastest lengthening/Vmax",
            "1",
            1.0,
            around("eccentric_speed_share", 0.2),
            "the tests' 150 of 300 mm/s; a fifth either way",
        )
    if choices.eccentric_force is None:
        base = design.damper.eccentric.design_force
        yield Variation(
            "eccentric damping",
            "N",
            1.0,
            base,
            (0.9 * base, 1.1 * base),
            "(s - 1) F0; 400 N instead of 441 N for the 3/4 in pair is -9 %",
            lambda value: (target, replace(choices, eccentric_force=value)),
        )
    if choices.bore is None:
        pressure = around("cylinder_pressure", 0.2)
        yield from number(
            "cylinder_pressure", "cylinder pressure", "MPa", PA_PER_MPA, pressure, "Table 4.1 is missing; a fifth"
        )
    yield from number("discharge", "Cd as made", "1", 1.0, (0.8, 0.61), "chapter 4: as low as 0.61")
    yield from _iter_muscle_variations(design)
    if not isinstance(target, WalkerTarget):
        return
    yield from number(
        "neutral_ratio", "L/L0 at neutral ankle", "1", 1.0, (neutral - 0.01, neutral + 0.01), "the stop is near"
    )
    yield from number("moment_arm", "moment arm", "mm", 1e-3, (0.0434, 0.0524), "Wolfram 2018: 47.9 +- 4.5 mm")
    slack = around("slack_length", 0.2)
    yield from number("slack_length", "tendon slack length", "mm", 1e-3, slack, "a fifth either way")
    yield from number(
        "tendon_strain", "tendon strain", "%", 0.01, (strain - 0.01, strain + 0.01), "Kharazi 2021: 4.0 %; a point"
    )
    for field, name in (("second_spring", "second spring/first"), ("engagement_share", "engagement/slack length")):
        yield from number(field, name, "1", 1.0, around(field, 0.5), "Figs 6.3, 6.4: no values")
    yield from number("temperature", "gas temperature", "degC", 1.0, (0.0, 40.0), "room temperature")
    if _is_length_free(design):
        share = around("excursion_share", 0.2)
        why = "Fig. 3.8: 0.094; a fifth either way, L0 by rule"
        yield from number("excursion_share", "ankle's travel/L0", "1", 1.0, share, why, length=True)
        base = design.selected.resting_length
        yield Variation(
            "resting length L0",
            "mm",
            1e-3,
            base,
            (0.9 * base, 1.1 * base),
            "the same braid, a tenth shorter or longer",
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
    """Fields of the assumptions that ``found`` uses, that nobody gave and that are not varied -> why."""
    why = dict.fromkeys(SIMULATION_ONLY_ASSUMPTIONS, "no size and no outcome of a design depends on it")
    if not isinstance(design.target, WalkerTarget):
        why |= dict.fromkeys(STRIDE_ASSUMPTIONS, "without a walker no outcome depends on it")
    return {field: reason for field, reason in why.items() if field not in design.choices.fixed_fields}


def _is_length_free(design: Design) -> bool:
    return design.choices.resting_length is None and design.muscle.resting_length is None


def _iter_muscle_variations(design: Design) -> Iterator[Variation]:
    target, choices, muscle = design.target, design.choices, design.muscle

    def with_muscle(changed: MuscleTarget) -> tuple[MuscleTarget | WalkerTarget, DesignChoices]:
        return (replace(target, muscle=changed) if isinstance(target, WalkerTarget) else changed), choices

    if muscle.peak_velocity is None:
        base = muscle.design_peak_velocity
        yield Variation(
            "Vmax",
            "mm/s",
            1e-3,
            base,
            (0.8 * base, 0.780),
            "fastest test; human triceps surae models: 756-780 mm/s",
            lambda value: with_muscle(replace(muscle, peak_velocity=value)),
        )
    free = [
        key
        for key in HILL_SHAPE_LABELS
        if getattr(muscle.hill, key) == getattr(GENERIC_HILL_CURVE, key) and key not in choices.fixed_fields
    ]
    if free:
        yield Variation(
            " = ".join(HILL_SHAPE_LABELS[key] for key in free),
            "1",
            1.0,
            getattr(muscle.hill, free[0]),
            (0.12, 0.41),
            "Fig. 2.8; the ends of (2.5)",
            lambda value: with_muscle(replace(muscle, hill=muscle.hill._replace(**dict.fromkeys(free, value)))),
        )


def analyse_sensitivity(
    design: Design, progress: Callable[[float], None] = lambda fraction: None
) -> list[SensitivityResult]:
    """Every variation of ``found``, redesigned by rule; actuators, count and length are kept.

    Only where the length itself follows from the number varied, it is found anew.
    """
    tried = [(variation, value) for variation in iter_variations(design) for value in variation.values]
    effects = []
    for number, (variation, value) in enumerate(tried):
        progress(number / len(tried))
        effects.append(SensitivityResult(variation, value, _redesign(design, variation, value)))
    progress(1.0)
    return effects


def _redesign(design: Design, variation: Variation, value: float) -> DesignMetrics | None:
    target, choices = variation.build_inputs(value)
    kept = replace(choices, actuator=design.selected.actuator, count=design.selected.count)
    if choices.resting_length is None and not variation.affects_length:
        kept = replace(kept, resting_length=design.selected.resting_length)
    try:
        return replace(
            compute_design_metrics(design_device(target, kept)),
            recommended_actuators=_recommend_actuators(target, choices),
        )
    except InputError:
        return None
