"""How much each assumed number matters: one at a time, both ways, what becomes of the outcomes."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from klute_sim.design.choices import MPA, ROWS, Choices
from klute_sim.design.sizing import Design, design
from klute_sim.design.target import Target, Walker
from klute_sim.errors import InputError
from klute_sim.laws.hill_tables import GENERIC_HILL

SHAPE = {"a": "a/F0", "b": "b/Vmax"}
"""Constants of Hill's equation (2.4), and what they are called."""
NOT_IN_A_DESIGN = ("pressure_rate",)
"""Assumptions that only a simulation of the device uses: klute-sim gait shows what they change."""
OF_THE_STRIDE = ("neutral_ratio", "slack_length", "tendon_strain", "second_spring", "engagement_share", "temperature")
"""Assumptions that are in every device file, but count only in a stride."""


@dataclass(frozen=True)
class Variation:
    """One assumed number and the values it is changed to."""

    name: str
    unit: str
    factor: float
    """SI per unit."""
    base: float
    """[SI]"""
    values: tuple[float, ...]
    """Instead of ``base`` [SI]."""
    why: str
    """Where the number, and how far it is changed, are from."""
    changed: Callable[[float], tuple[Target | Walker, Choices]]
    """The inputs of a design with that value."""
    field: str | None = None
    """Of the assumptions; None: another number."""
    changes_length: bool = False
    """Whether the resting length follows from it, and is found anew."""


@dataclass(frozen=True)
class Outcome:
    """What is looked at; None where it is not defined."""

    orifice_concentric: float
    """[m]"""
    orifice_eccentric: float
    """[m]"""
    cylinder_pressure: float
    """Gauge pressure in the damper as made, the larger of its two design points' [Pa]."""
    peak_share: float | None
    """See :class:`klute_sim.design.demand.Demand`."""
    misfit_concentric: float
    """Of the fixed orifices [F0]."""
    misfit_eccentric: float
    """Of the fixed orifices [F0]."""
    air: float | None
    """Per stride [kg]."""
    would_take: str | None
    """Actuators that the rule would take for the force, or None: no force was asked for."""


@dataclass(frozen=True)
class Effect:
    """One row: an assumption at another value."""

    variation: Variation
    value: float
    """[SI]"""
    outcome: Outcome | None
    """None: no device can be made so."""


def outcome(found: Design) -> Outcome:
    """The outcomes of a design."""
    fixed, demand = found.misfit()["fixed"], found.demand
    return Outcome(
        orifice_concentric=found.damper.concentric.orifice,
        orifice_eccentric=found.damper.eccentric.orifice,
        cylinder_pressure=found.damper.pressure,
        peak_share=demand.peak_share if demand else None,
        misfit_concentric=fixed.concentric,
        misfit_eccentric=fixed.eccentric,
        air=demand.air if demand else None,
        would_take=_by_rule(found.target, found.choices),
    )


def _by_rule(target: Target | Walker, choices: Choices) -> str | None:
    """The actuators that the rule takes where nobody chose."""
    if isinstance(target, Target) and target.isometric_force is None:
        return None
    option = design(target, replace(choices, actuator=None, count=None)).option
    return f"{option.count} x {ROWS[option.actuator]}"


def variations(found: Design) -> Iterator[Variation]:
    """What was assumed in ``found`` and not given by its user; :func:`left_out` has the rest."""
    target, choices, assumed = found.target, found.choices, found.choices.assumptions

    def number(
        field: str, name: str, unit: str, factor: float, values: tuple[float, ...], why: str, *, length: bool = False
    ) -> Iterator[Variation]:
        def changed(value: float) -> tuple[Target | Walker, Choices]:
            return target, replace(choices, assumptions=replace(assumed, **{field: value}))

        if field not in choices.given:
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
        base = found.damper.eccentric.damping
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
            "cylinder_pressure", "cylinder pressure", "MPa", MPA, pressure, "Table 4.1 is missing; a fifth"
        )
    yield from number("discharge", "Cd as made", "1", 1.0, (0.8, 0.61), "chapter 4: as low as 0.61")
    yield from _of_the_muscle(found)
    if not isinstance(target, Walker):
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
    if _length_is_free(found):
        share = around("excursion_share", 0.2)
        why = "Fig. 3.8: 0.094; a fifth either way, L0 by rule"
        yield from number("excursion_share", "ankle's travel/L0", "1", 1.0, share, why, length=True)
        base = found.option.resting_length
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


def left_out(found: Design) -> dict[str, str]:
    """Fields of the assumptions that ``found`` uses, that nobody gave and that are not varied -> why."""
    why = dict.fromkeys(NOT_IN_A_DESIGN, "no size and no outcome of a design depends on it")
    if not isinstance(found.target, Walker):
        why |= dict.fromkeys(OF_THE_STRIDE, "without a walker no outcome depends on it")
    return {field: reason for field, reason in why.items() if field not in found.choices.given}


def _length_is_free(found: Design) -> bool:
    return found.choices.resting_length is None and found.muscle.resting_length is None


def _of_the_muscle(found: Design) -> Iterator[Variation]:
    target, choices, muscle = found.target, found.choices, found.muscle

    def with_muscle(changed: Target) -> tuple[Target | Walker, Choices]:
        return (replace(target, muscle=changed) if isinstance(target, Walker) else changed), choices

    if muscle.peak_velocity is None:
        base = muscle.velocity
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
        key for key in SHAPE if getattr(muscle.hill, key) == getattr(GENERIC_HILL, key) and key not in choices.given
    ]
    if free:
        yield Variation(
            " = ".join(SHAPE[key] for key in free),
            "1",
            1.0,
            getattr(muscle.hill, free[0]),
            (0.12, 0.41),
            "Fig. 2.8; the ends of (2.5)",
            lambda value: with_muscle(replace(muscle, hill=muscle.hill._replace(**dict.fromkeys(free, value)))),
        )


def sensitivity(found: Design, progress: Callable[[float], None] = lambda fraction: None) -> list[Effect]:
    """Every variation of ``found``, redesigned by rule; actuators, count and length are kept.

    Only where the length itself follows from the number varied, it is found anew.
    """
    tried = [(variation, value) for variation in variations(found) for value in variation.values]
    effects = []
    for number, (variation, value) in enumerate(tried):
        progress(number / len(tried))
        effects.append(Effect(variation, value, _redesigned(found, variation, value)))
    progress(1.0)
    return effects


def _redesigned(found: Design, variation: Variation, value: float) -> Outcome | None:
    target, choices = variation.changed(value)
    kept = replace(choices, actuator=found.option.actuator, count=found.option.count)
    if choices.resting_length is None and not variation.changes_length:
        kept = replace(kept, resting_length=found.option.resting_length)
    try:
        return replace(outcome(design(target, kept)), would_take=_by_rule(target, choices))
    except InputError:
        return None
