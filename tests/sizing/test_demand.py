"""What a stride asks of a device, and what the assumptions change."""

from dataclasses import fields, replace

import numpy as np
import pytest

from klute_sim.controllers.pressure import (
    ConstantPressure,
    PressureController,
    create_off_controller,
    load_default_profile,
)
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben
from klute_sim.laws import tendon as tendon_law
from klute_sim.laws.hill import HillCurve
from klute_sim.sizing.choices import DesignAssumptions, DesignChoices
from klute_sim.sizing.evaluation.demand import StrideDemand, compute_stride_demand, compute_stride_geometry
from klute_sim.sizing.sensitivity import (
    SensitivityResult,
    analyse_sensitivity,
    compute_design_metrics,
    iter_variations,
    list_excluded_assumptions,
)
from klute_sim.sizing.sizing import design_device
from klute_sim.sizing.target import MuscleTarget, WalkerTarget

WALKER = WalkerTarget(mass=75.0)
FOUND = design_device(WALKER)
PARAMETERS = FOUND.device.parameters
MUSCLE, TENDON = PARAMETERS.muscle, PARAMETERS.tendon
FIELDS = {field.name for field in fields(DesignAssumptions)}


def asked(**changes: float) -> StrideDemand:
    return under(replace(WALKER, **changes))


def under(
    walker: WalkerTarget, profile: PressureController | None = None, neutral_ratio: float = 0.975
) -> StrideDemand:
    lies = compute_stride_geometry(PARAMETERS, neutral_ratio, 0.048, walker)
    return compute_stride_demand(PARAMETERS, walker, lies, load_default_profile() if profile is None else profile)


def test_the_tendon_carries_the_references_plantarflexor_moment() -> None:
    own = asked()
    moment = 75.0 * WALKER.reference("ankle_plantarflexor_moment_nm_per_kg", own.phase)
    assert own.tendon_force * 0.048 == pytest.approx(np.maximum(moment, 0.0))
    assert own.tendon_force.max() == pytest.approx(WALKER.compute_peak_moment()[0] / 0.048, rel=1e-3)
    assert asked(mass=150.0).tendon_force == pytest.approx(2.0 * own.tendon_force)
    assert asked(moment_scale=1.2).tendon_force == pytest.approx(1.2 * own.tendon_force)


def test_muscle_and_tendon_fill_the_unit_that_the_ankle_moves() -> None:
    own = asked()
    assert not own.at_stop.any()
    stretch = np.array([tendon_law.stretch_at_tension(TENDON, float(force)) for force in own.tendon_force])
    unit = own.length_ratio * MUSCLE.resting_length + stretch + TENDON.slack_length
    neutral = 0.975 * MUSCLE.resting_length + TENDON.slack_length
    angle = np.radians(WALKER.reference("ankle_dorsiflexion_deg", own.phase))
    assert unit - neutral == pytest.approx(0.048 * angle, abs=1e-12)


def test_the_needed_pressure_carries_tendon_and_damper() -> None:
    own = asked()
    for at in np.flatnonzero(own.is_loaded)[::5]:
        length = float(own.length_ratio[at]) * MUSCLE.resting_length
        pull = mckibben.force(MUSCLE, float(own.required_pressure[at]), length)
        braked = damper_law.force(PARAMETERS.damper, float(own.muscle_velocity[at]))
        assert pull + braked == pytest.approx(own.tendon_force[at], abs=0.1)
    assert (own.required_pressure[own.tendon_force == 0.0] == 0.0).all()


def test_rates_are_those_of_the_lengths_and_of_the_strides_time() -> None:
    own = asked()
    length = own.length_ratio * MUSCLE.resting_length
    step = WALKER.reference.stride_time / len(own.phase)
    travelled = length[0] + np.cumsum(own.muscle_velocity) * step
    assert travelled == pytest.approx(length, abs=1e-3)
    hurried = replace(WALKER.reference, stride_time=0.55)
    twice = under(replace(WALKER, reference=hurried))
    assert twice.muscle_velocity == pytest.approx(2.0 * own.muscle_velocity)


def test_the_peak_share_is_the_moment_held_at_rest() -> None:
    own = asked()
    at = int(own.tendon_force.argmax())
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
    assert own.peak_moment_fraction == pytest.approx(held / own.tendon_force[at], rel=1e-3)


def test_a_pair_of_3_4_in_is_too_weak_and_says_so() -> None:
    weak = design_device(WALKER, DesignChoices(actuator="klute-3-4", count=2)).demand
    assert weak is not None
    assert weak.peak_moment_fraction < 0.9
    assert np.nanmin(weak.force_margin) < 1.0
    assert FOUND.demand is not None
    assert np.nanmin(FOUND.demand.force_margin) > 1.0


def test_strength_is_compared_where_there_is_load() -> None:
    own = asked()
    assert np.isnan(own.force_margin[~own.is_loaded]).all()
    at = int(own.tendon_force.argmax())
    assert own.force_margin[at] == pytest.approx(
        own.max_isometric_force[at] / (own.tendon_force[at] - own.damping_force[at])
    )


def test_a_muscle_mounted_long_meets_its_stop() -> None:
    long = under(WALKER, neutral_ratio=1.0)
    assert long.at_stop.any()
    assert long.length_ratio.max() == 1.0


def test_constant_pressure_takes_the_air_of_the_volume_alone() -> None:
    own = under(WALKER, ConstantPressure(4e5))
    volumes = np.array([mckibben.volume(MUSCLE, float(r) * MUSCLE.resting_length) for r in own.length_ratio])
    grown = np.maximum(np.diff(np.append(volumes, volumes[0])), 0.0).sum()
    assert own.air_mass == pytest.approx((4e5 + 101_325.0) * grown / (287.05 * 293.15))
    assert under(WALKER, create_off_controller()).air_mass < own.air_mass
    assert under(WALKER, ConstantPressure(9e5)).commanded_isometric_force == pytest.approx(own.max_isometric_force)


@pytest.fixture(scope="module")
def effects() -> list[SensitivityResult]:
    return analyse_sensitivity(FOUND)


def by_name(effects: list[SensitivityResult], name: str) -> list[SensitivityResult]:
    return [e for e in effects if e.variation.name == name]


def test_every_assumption_of_the_file_is_varied(effects: list[SensitivityResult]) -> None:
    names = {e.variation.name for e in effects}
    assert len(effects) >= 2 * len(names) - 1
    assert {"cylinder pressure", "tendon strain", "second spring/first", "engagement/slack length"} <= names
    assert {"tendon slack length", "L/L0 at neutral ankle", "eccentric damping", "Vmax", "moment arm"} <= names
    assert {e.variation.assumption for e in effects if e.variation.assumption} | set(
        list_excluded_assumptions(FOUND)
    ) == FIELDS
    base = compute_design_metrics(FOUND)
    idle = [(e.variation.name, e.value) for e in effects if e.metrics is None or e.metrics == base]
    # A travel of up to 12 % would not make this row longer than it is.
    assert idle == [("ankle's travel/L0", pytest.approx(0.12))]


def test_a_muscle_says_what_of_its_file_no_outcome_depends_on() -> None:
    found = design_device(MuscleTarget(), DesignChoices(actuator="klute-3-4", count=2))
    varied = {v.assumption for v in iter_variations(found)}
    assert varied.isdisjoint(list_excluded_assumptions(found))
    # Neither is used: no ankle moves the tendon.
    assert FIELDS - varied - set(list_excluded_assumptions(found)) == {"moment_arm", "excursion_share"}


def test_a_travel_that_is_allowed_less_makes_the_actuators_longer(effects: list[SensitivityResult]) -> None:
    shorter_travel = by_name(effects, "ankle's travel/L0")[0]
    made = design_device(WALKER, DesignChoices(assumptions=DesignAssumptions(excursion_fraction=shorter_travel.value)))
    assert made.selected.resting_length > FOUND.selected.resting_length
    assert shorter_travel.metrics == compute_design_metrics(made)


def test_the_real_orifice_loads_the_cylinder(effects: list[SensitivityResult]) -> None:
    _, real = by_name(effects, "Cd as made")
    assert real.metrics is not None
    assert compute_design_metrics(FOUND).cylinder_pressure == pytest.approx(4.7e6, rel=0.005)
    assert real.metrics.cylinder_pressure == pytest.approx(4.7e6 / 0.61**2, rel=0.005)


def test_effects_go_the_way_they_must(effects: list[SensitivityResult]) -> None:
    def outcomes(name: str) -> list[tuple[float, float]]:
        return [
            (e.metrics.orifice_concentric, e.metrics.peak_moment_fraction or 0.0)
            for e in by_name(effects, name)
            if e.metrics
        ]

    low, high = outcomes("cylinder pressure")
    assert low[0] > compute_design_metrics(FOUND).orifice_concentric > high[0]
    low, high = outcomes("moment arm")
    assert low[1] < FOUND.demand.peak_moment_fraction < high[1]  # type: ignore[union-attr]
    (scaled,) = outcomes("moment/reference")
    assert scaled[1] < 1.0
    mild, real = by_name(effects, "Cd as made")
    assert mild.metrics is not None
    assert real.metrics is not None
    # The real orifice brakes 1/0.61^2 as much: too much, and that is worse than the square law alone.
    assert real.metrics.rms_error_concentric > compute_design_metrics(FOUND).rms_error_concentric
    assert real.metrics.orifice_concentric == compute_design_metrics(FOUND).orifice_concentric


def test_a_variation_is_the_design_with_that_value(effects: list[SensitivityResult]) -> None:
    effect = by_name(effects, "tendon strain")[1]
    made = design_device(WALKER, DesignChoices(assumptions=DesignAssumptions(tendon_strain=effect.value)))
    assert effect.metrics == compute_design_metrics(made)


def test_a_variation_keeps_the_length_that_the_rule_gave() -> None:
    found = design_device(WALKER, DesignChoices(actuator="klute-3-4"))
    longer_arm = next(e for e in analyse_sensitivity(found) if e.variation.name == "moment arm" and e.value > 0.048)
    own = found.selected
    fixed = DesignChoices(actuator="klute-3-4", count=own.count, resting_length=own.resting_length)
    made = design_device(WALKER, replace(fixed, assumptions=DesignAssumptions(moment_arm=longer_arm.value)))
    assert longer_arm.metrics is not None
    assert longer_arm.metrics.air_mass == compute_design_metrics(made).air_mass


def test_the_rule_is_asked_again_but_the_actuators_stay() -> None:
    near = design_device(WalkerTarget(mass=85.0))
    stronger = next(e for e in analyse_sensitivity(near) if e.variation.name == "moment/reference")
    assert compute_design_metrics(near).recommended_actuators == "2 x 1-1/4 in"
    assert stronger.metrics is not None
    assert stronger.metrics.recommended_actuators == "3 x 1-1/4 in"
    assert stronger.metrics.orifice_concentric == near.damper.concentric.orifice_diameter


def test_what_was_given_is_not_varied() -> None:
    choices = DesignChoices(actuator="klute-3-4", count=2, bore=0.02, eccentric_force=400.0, eccentric_speed=0.15)
    names = {v.name for v in iter_variations(design_device(MuscleTarget(peak_velocity=0.3), choices))}
    assert names == {"L/L0 at which F0 counts", "Cd as made", "a/F0 = b/Vmax"}


def test_a_given_assumption_is_not_varied_even_at_its_default() -> None:
    def fields_of(choices: DesignChoices) -> set[str | None]:
        return {v.assumption for v in iter_variations(design_device(WALKER, choices))}

    by_rule = fields_of(DesignChoices())
    other = DesignAssumptions(moment_arm=0.040, cylinder_pressure=10e6)
    assert by_rule - fields_of(DesignChoices(assumptions=other)) == {"moment_arm", "cylinder_pressure"}
    assert by_rule - fields_of(DesignChoices(explicit_fields=frozenset({"moment_arm"}))) == {"moment_arm"}
    assert "pressure_rate" not in list_excluded_assumptions(
        design_device(WALKER, DesignChoices(explicit_fields=frozenset({"pressure_rate"})))
    )


def test_the_half_of_hills_shape_that_was_not_given_is_varied() -> None:
    def shapes(hill: HillCurve, *named: str) -> list[tuple[str, HillCurve]]:
        found = design_device(
            MuscleTarget(hill=hill), DesignChoices(actuator="klute-3-4", count=2, explicit_fields=frozenset(named))
        )
        return [
            (v.name, target.hill)
            for v in iter_variations(found)
            if ("F0" in v.name and "at which" not in v.name) or "b/Vmax" in v.name
            for target in [v.build_inputs(v.values[0])[0]]
            if isinstance(target, MuscleTarget)
        ]

    assert shapes(HillCurve(0.28, 0.28, 1.4)) == [("a/F0 = b/Vmax", HillCurve(0.12, 0.12, 1.4))]
    assert shapes(HillCurve(0.28, 0.28), "a") == [("b/Vmax", HillCurve(0.28, 0.12))]
    assert shapes(HillCurve(0.3, 0.28)) == [("b/Vmax", HillCurve(0.3, 0.12))]
    assert shapes(HillCurve(0.28, 0.28), "a", "b") == []
