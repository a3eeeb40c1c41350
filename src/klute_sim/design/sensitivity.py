"""How much each assumed number matters: one at a time, both ways, what becomes of the outcomes."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from klute_sim.design.choices import ROWS, Choices
from klute_sim.design.sizing import Design, design
from klute_sim.design.target import Target, Walker
from klute_sim.errors import InputError
from klute_sim.laws.hill_tables import GENERIC_HILL


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


@dataclass(frozen=True)
class Outcome:
    """What is looked at; None where it is not defined."""

    orifice_concentric: float
    """[m]"""
    orifice_eccentric: float
    """[m]"""
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
    """What was assumed in ``found`` and not given by its user."""
    target, choices, assumed = found.target, found.choices, found.choices.assumptions

    def number(field: str, name: str, unit: str, factor: float, values: tuple[float, ...], why: str) -> Variation:
        def changed(value: float) -> tuple[Target | Walker, Choices]:
            return target, replace(choices, assumptions=replace(assumed, **{field: value}))

        return Variation(name, unit, factor, getattr(assumed, field), values, why, changed)

    def around(field: str, share: float) -> tuple[float, ...]:
        base = getattr(assumed, field)
        return (1.0 - share) * base, (1.0 + share) * base

    ratio, neutral, strain = assumed.design_ratio, assumed.neutral_ratio, assumed.tendon_strain
    yield number(
        "design_ratio", "L/L0 at which F0 counts", "1", 1.0, (ratio - 0.02, min(1.0, ratio + 0.02)), "Fig. 3.9"
    )
    if choices.eccentric_speed is None:
        yield number(
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
        yield number("cylinder_pressure", "cylinder pressure", "MPa", 1e6, pressure, "Table 4.1 is missing; a fifth")
    yield number("discharge", "Cd as made", "1", 1.0, (0.8, 0.61), "chapter 4: as low as 0.61")
    yield from _of_the_muscle(found)
    if not isinstance(target, Walker):
        return
    yield number(
        "neutral_ratio", "L/L0 at neutral ankle", "1", 1.0, (neutral - 0.01, neutral + 0.01), "the stop is near"
    )
    yield number("moment_arm", "moment arm", "mm", 1e-3, (0.0434, 0.0524), "Wolfram 2018: 47.9 +- 4.5 mm")
    yield number("slack_length", "tendon slack length", "mm", 1e-3, around("slack_length", 0.2), "a fifth either way")
    yield number(
        "tendon_strain", "tendon strain", "%", 0.01, (strain - 0.01, strain + 0.01), "Kharazi 2021: 4.0 %; a point"
    )
    yield number(
        "second_spring", "second spring/first", "1", 1.0, around("second_spring", 0.5), "Figs 6.3, 6.4: no values"
    )
    yield number(
        "engagement_share",
        "engagement/slack length",
        "1",
        1.0,
        around("engagement_share", 0.5),
        "Figs 6.3, 6.4: no values",
    )
    yield number("temperature", "gas temperature", "degC", 1.0, (0.0, 40.0), "room temperature")
    if choices.resting_length is None:
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
    if muscle.hill == GENERIC_HILL:
        yield Variation(
            "a/F0 = b/Vmax",
            "1",
            1.0,
            muscle.hill.a,
            (0.12, 0.41),
            "Fig. 2.8; the ends of (2.5)",
            lambda value: with_muscle(replace(muscle, hill=muscle.hill._replace(a=value, b=value))),
        )


def sensitivity(found: Design, progress: Callable[[float], None] = lambda fraction: None) -> list[Effect]:
    """Every variation of ``found``, redesigned by rule; actuators, count and length are kept."""
    tried = [(variation, value) for variation in variations(found) for value in variation.values]
    effects = []
    for number, (variation, value) in enumerate(tried):
        progress(number / len(tried))
        effects.append(Effect(variation, value, _redesigned(found, *variation.changed(value))))
    progress(1.0)
    return effects


def _redesigned(found: Design, target: Target | Walker, choices: Choices) -> Outcome | None:
    kept = replace(choices, actuator=found.option.actuator, count=found.option.count)
    if choices.resting_length is None:
        kept = replace(kept, resting_length=found.option.resting_length)
    try:
        return replace(outcome(design(target, kept)), would_take=_by_rule(target, choices))
    except InputError:
        return None
