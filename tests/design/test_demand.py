"""What a stride asks of a device, and what the assumptions change."""

from dataclasses import fields, replace

import numpy as np
import pytest

from klute_sim.control.pressure import Constant, PressureController, off, tuned
from klute_sim.design.choices import Assumptions, Choices
from klute_sim.design.demand import Demand, over_stride, posture
from klute_sim.design.sensitivity import Effect, left_out, outcome, sensitivity, variations
from klute_sim.design.sizing import design
from klute_sim.design.target import Target, Walker
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben
from klute_sim.laws import tendon as tendon_law
from klute_sim.laws.hill import Hill

WALKER = Walker(mass=75.0)
FOUND = design(WALKER)
PARAMETERS = FOUND.device.parameters
MUSCLE, TENDON = PARAMETERS.muscle, PARAMETERS.tendon
FIELDS = {field.name for field in fields(Assumptions)}


def asked(**changes: float) -> Demand:
    return under(replace(WALKER, **changes))


def under(walker: Walker, profile: PressureController | None = None, neutral_ratio: float = 0.975) -> Demand:
    lies = posture(PARAMETERS, neutral_ratio, 0.048, walker)
    return over_stride(PARAMETERS, walker, lies, tuned() if profile is None else profile)


def test_the_tendon_carries_the_references_plantarflexor_moment() -> None:
    own = asked()
    moment = 75.0 * WALKER.reference("ankle_plantarflexor_moment_nm_per_kg", own.phase)
    assert own.tendon * 0.048 == pytest.approx(np.maximum(moment, 0.0))
    assert own.tendon.max() == pytest.approx(WALKER.peak()[0] / 0.048, rel=1e-3)
    assert asked(mass=150.0).tendon == pytest.approx(2.0 * own.tendon)
    assert asked(moment_scale=1.2).tendon == pytest.approx(1.2 * own.tendon)


def test_muscle_and_tendon_fill_the_unit_that_the_ankle_moves() -> None:
    own = asked()
    assert not own.at_stop.any()
    stretch = np.array([tendon_law.stretch_under(TENDON, float(force)) for force in own.tendon])
    unit = own.ratio * MUSCLE.resting_length + stretch + TENDON.slack_length
    neutral = 0.975 * MUSCLE.resting_length + TENDON.slack_length
    angle = np.radians(WALKER.reference("ankle_dorsiflexion_deg", own.phase))
    assert unit - neutral == pytest.approx(0.048 * angle, abs=1e-12)


def test_the_needed_pressure_carries_tendon_and_damper() -> None:
    own = asked()
    for at in np.flatnonzero(own.loaded)[::5]:
        length = float(own.ratio[at]) * MUSCLE.resting_length
        pull = mckibben.force(MUSCLE, float(own.needed_pressure[at]), length)
        braked = damper_law.force(PARAMETERS.damper, float(own.rate[at]))
        assert pull + braked == pytest.approx(own.tendon[at], abs=0.1)
    assert (own.needed_pressure[own.tendon == 0.0] == 0.0).all()


def test_rates_are_those_of_the_lengths_and_of_the_strides_time() -> None:
    own = asked()
    length = own.ratio * MUSCLE.resting_length
    step = WALKER.reference.stride_time / len(own.phase)
    travelled = length[0] + np.cumsum(own.rate) * step
    assert travelled == pytest.approx(length, abs=1e-3)
    hurried = replace(WALKER.reference, stride_time=0.55)
    twice = under(replace(WALKER, reference=hurried))
    assert twice.rate == pytest.approx(2.0 * own.rate)


def test_the_peak_share_is_the_moment_held_at_rest() -> None:
    own = asked()
    at = int(own.tendon.argmax())
    unit = (
        0.975 * MUSCLE.resting_length
        + TENDON.slack_length
        + 0.048 * float(np.radians(WALKER.reference("ankle_dorsiflexion_deg", own.phase[at : at + 1]))[0])
    )
    # The muscle at which gas and bladder balance the tendon, by looking everywhere.
    lengths = np.linspace(0.8, 1.0, 40_001) * MUSCLE.resting_length
    pull = np.array([mckibben.force(MUSCLE, 5e5, float(x)) for x in lengths])
    tendon = np.array([tendon_law.force(TENDON, unit - float(x) - TENDON.slack_length) for x in lengths])
    held = float(tendon[np.argmin(np.abs(pull - tendon))])
    assert own.peak_share == pytest.approx(held / own.tendon[at], rel=1e-3)


def test_a_pair_of_3_4_in_is_too_weak_and_says_so() -> None:
    weak = design(WALKER, Choices(actuator="klute-3-4", count=2)).demand
    assert weak is not None
    assert weak.peak_share < 0.9
    assert np.nanmin(weak.margin) < 1.0
    assert FOUND.demand is not None
    assert np.nanmin(FOUND.demand.margin) > 1.0


def test_strength_is_compared_where_there_is_load() -> None:
    own = asked()
    assert np.isnan(own.margin[~own.loaded]).all()
    at = int(own.tendon.argmax())
    assert own.margin[at] == pytest.approx(own.strongest[at] / (own.tendon[at] - own.damping[at]))


def test_a_muscle_mounted_long_meets_its_stop() -> None:
    long = under(WALKER, neutral_ratio=1.0)
    assert long.at_stop.any()
    assert long.ratio.max() == 1.0


def test_constant_pressure_takes_the_air_of_the_volume_alone() -> None:
    own = under(WALKER, Constant(4e5))
    volumes = np.array([mckibben.volume(MUSCLE, float(r) * MUSCLE.resting_length) for r in own.ratio])
    grown = np.maximum(np.diff(np.append(volumes, volumes[0])), 0.0).sum()
    assert own.air == pytest.approx((4e5 + 101_325.0) * grown / (287.05 * 293.15))
    assert under(WALKER, off()).air < own.air
    assert under(WALKER, Constant(9e5)).commanded == pytest.approx(own.strongest)


@pytest.fixture(scope="module")
def effects() -> list[Effect]:
    return sensitivity(FOUND)


def by_name(effects: list[Effect], name: str) -> list[Effect]:
    return [e for e in effects if e.variation.name == name]


def test_every_assumption_of_the_file_is_varied(effects: list[Effect]) -> None:
    names = {e.variation.name for e in effects}
    assert len(effects) >= 2 * len(names) - 1
    assert {"cylinder pressure", "tendon strain", "second spring/first", "engagement/slack length"} <= names
    assert {"tendon slack length", "L/L0 at neutral ankle", "eccentric damping", "Vmax", "moment arm"} <= names
    assert {e.variation.field for e in effects if e.variation.field} | set(left_out(FOUND)) == FIELDS
    base = outcome(FOUND)
    idle = [(e.variation.name, e.value) for e in effects if e.outcome is None or e.outcome == base]
    # A travel of up to 12 % would not make this row longer than it is.
    assert idle == [("ankle's travel/L0", pytest.approx(0.12))]


def test_a_muscle_says_what_of_its_file_no_outcome_depends_on() -> None:
    found = design(Target(), Choices(actuator="klute-3-4", count=2))
    varied = {v.field for v in variations(found)}
    assert varied.isdisjoint(left_out(found))
    # Neither is used: no ankle moves the tendon.
    assert FIELDS - varied - set(left_out(found)) == {"moment_arm", "excursion_share"}


def test_a_travel_that_is_allowed_less_makes_the_actuators_longer(effects: list[Effect]) -> None:
    shorter_travel = by_name(effects, "ankle's travel/L0")[0]
    made = design(WALKER, Choices(assumptions=Assumptions(excursion_share=shorter_travel.value)))
    assert made.option.resting_length > FOUND.option.resting_length
    assert shorter_travel.outcome == outcome(made)


def test_the_real_orifice_loads_the_cylinder(effects: list[Effect]) -> None:
    _, real = by_name(effects, "Cd as made")
    assert real.outcome is not None
    assert outcome(FOUND).cylinder_pressure == pytest.approx(4.7e6, rel=0.005)
    assert real.outcome.cylinder_pressure == pytest.approx(4.7e6 / 0.61**2, rel=0.005)


def test_effects_go_the_way_they_must(effects: list[Effect]) -> None:
    def outcomes(name: str) -> list[tuple[float, float]]:
        return [
            (e.outcome.orifice_concentric, e.outcome.peak_share or 0.0) for e in by_name(effects, name) if e.outcome
        ]

    low, high = outcomes("cylinder pressure")
    assert low[0] > outcome(FOUND).orifice_concentric > high[0]
    low, high = outcomes("moment arm")
    assert low[1] < FOUND.demand.peak_share < high[1]  # type: ignore[union-attr]
    (scaled,) = outcomes("moment/reference")
    assert scaled[1] < 1.0
    mild, real = by_name(effects, "Cd as made")
    assert mild.outcome is not None
    assert real.outcome is not None
    # The real orifice brakes 1/0.61^2 as much: too much, and that is worse than the square law alone.
    assert real.outcome.misfit_concentric > outcome(FOUND).misfit_concentric
    assert real.outcome.orifice_concentric == outcome(FOUND).orifice_concentric


def test_a_variation_is_the_design_with_that_value(effects: list[Effect]) -> None:
    effect = by_name(effects, "tendon strain")[1]
    made = design(WALKER, Choices(assumptions=Assumptions(tendon_strain=effect.value)))
    assert effect.outcome == outcome(made)


def test_a_variation_keeps_the_length_that_the_rule_gave() -> None:
    found = design(WALKER, Choices(actuator="klute-3-4"))
    longer_arm = next(e for e in sensitivity(found) if e.variation.name == "moment arm" and e.value > 0.048)
    own = found.option
    fixed = Choices(actuator="klute-3-4", count=own.count, resting_length=own.resting_length)
    made = design(WALKER, replace(fixed, assumptions=Assumptions(moment_arm=longer_arm.value)))
    assert longer_arm.outcome is not None
    assert longer_arm.outcome.air == outcome(made).air


def test_the_rule_is_asked_again_but_the_actuators_stay() -> None:
    near = design(Walker(mass=85.0))
    stronger = next(e for e in sensitivity(near) if e.variation.name == "moment/reference")
    assert outcome(near).would_take == "2 x 1-1/4 in"
    assert stronger.outcome is not None
    assert stronger.outcome.would_take == "3 x 1-1/4 in"
    assert stronger.outcome.orifice_concentric == near.damper.concentric.orifice


def test_what_was_given_is_not_varied() -> None:
    choices = Choices(actuator="klute-3-4", count=2, bore=0.02, eccentric_force=400.0, eccentric_speed=0.15)
    names = {v.name for v in variations(design(Target(peak_velocity=0.3), choices))}
    assert names == {"L/L0 at which F0 counts", "Cd as made", "a/F0 = b/Vmax"}


def test_a_given_assumption_is_not_varied_even_at_its_default() -> None:
    def fields_of(choices: Choices) -> set[str | None]:
        return {v.field for v in variations(design(WALKER, choices))}

    by_rule = fields_of(Choices())
    other = Assumptions(moment_arm=0.040, cylinder_pressure=10e6)
    assert by_rule - fields_of(Choices(assumptions=other)) == {"moment_arm", "cylinder_pressure"}
    assert by_rule - fields_of(Choices(named=frozenset({"moment_arm"}))) == {"moment_arm"}
    assert "pressure_rate" not in left_out(design(WALKER, Choices(named=frozenset({"pressure_rate"}))))


def test_the_half_of_hills_shape_that_was_not_given_is_varied() -> None:
    def shapes(hill: Hill, *named: str) -> list[tuple[str, Hill]]:
        found = design(Target(hill=hill), Choices(actuator="klute-3-4", count=2, named=frozenset(named)))
        return [
            (v.name, target.hill)
            for v in variations(found)
            if ("F0" in v.name and "at which" not in v.name) or "b/Vmax" in v.name
            for target in [v.changed(v.values[0])[0]]
            if isinstance(target, Target)
        ]

    assert shapes(Hill(0.28, 0.28, 1.4)) == [("a/F0 = b/Vmax", Hill(0.12, 0.12, 1.4))]
    assert shapes(Hill(0.28, 0.28), "a") == [("b/Vmax", Hill(0.28, 0.12))]
    assert shapes(Hill(0.3, 0.28)) == [("b/Vmax", Hill(0.3, 0.12))]
    assert shapes(Hill(0.28, 0.28), "a", "b") == []
