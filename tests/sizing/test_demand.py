"""Tests of the stride demand on a device and of its sensitivity to the assumptions."""

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
DESIGN = design_device(WALKER)
PARAMETERS = DESIGN.device.parameters
MUSCLE, TENDON = PARAMETERS.muscle, PARAMETERS.tendon
FIELDS = {field.name for field in fields(DesignAssumptions)}


def compute_demand(**changes: float) -> StrideDemand:
    return demand_under_profile(replace(WALKER, **changes))


def demand_under_profile(
    walker: WalkerTarget, profile: PressureController | None = None, neutral_ratio: float = 0.975
) -> StrideDemand:
    geometry = compute_stride_geometry(PARAMETERS, neutral_ratio, 0.048, walker)
    return compute_stride_demand(PARAMETERS, walker, geometry, load_default_profile() if profile is None else profile)


def test_tendon_carries_plantarflexor_moment_of_reference() -> None:
    demand = compute_demand()
    moment = 75.0 * WALKER.reference("ankle_plantarflexor_moment_nm_per_kg", demand.phase)
    assert demand.tendon_force * 0.048 == pytest.approx(np.maximum(moment, 0.0))
    assert demand.tendon_force.max() == pytest.approx(WALKER.compute_peak_moment()[0] / 0.048, rel=1e-3)
    assert compute_demand(mass=150.0).tendon_force == pytest.approx(2.0 * demand.tendon_force)
    assert compute_demand(moment_scale=1.2).tendon_force == pytest.approx(1.2 * demand.tendon_force)


def test_muscle_and_tendon_lengths_add_up_to_unit_length() -> None:
    demand = compute_demand()
    assert not demand.at_stop.any()
    stretch = np.array([tendon_law.stretch_at_tension(TENDON, float(force)) for force in demand.tendon_force])
    unit = demand.length_ratio * MUSCLE.resting_length + stretch + TENDON.slack_length
    neutral = 0.975 * MUSCLE.resting_length + TENDON.slack_length
    angle = np.radians(WALKER.reference("ankle_dorsiflexion_deg", demand.phase))
    assert unit - neutral == pytest.approx(0.048 * angle, abs=1e-12)


def test_required_pressure_balances_tendon_and_damper() -> None:
    demand = compute_demand()
    for index in np.flatnonzero(demand.is_loaded)[::5]:
        length = float(demand.length_ratio[index]) * MUSCLE.resting_length
        pull = mckibben.force(MUSCLE, float(demand.required_pressure[index]), length)
        damper_force = damper_law.force(PARAMETERS.damper, float(demand.muscle_velocity[index]))
        assert pull + damper_force == pytest.approx(demand.tendon_force[index], abs=0.1)
    assert (demand.required_pressure[demand.tendon_force == 0.0] == 0.0).all()


def test_muscle_velocity_is_derivative_of_length() -> None:
    demand = compute_demand()
    length = demand.length_ratio * MUSCLE.resting_length
    dt = WALKER.reference.stride_time / len(demand.phase)
    travelled = length[0] + np.cumsum(demand.muscle_velocity) * dt
    assert travelled == pytest.approx(length, abs=1e-3)
    fast_reference = replace(WALKER.reference, stride_time=0.55)
    fast_demand = demand_under_profile(replace(WALKER, reference=fast_reference))
    assert fast_demand.muscle_velocity == pytest.approx(2.0 * demand.muscle_velocity)


def test_peak_moment_fraction_is_static_moment() -> None:
    demand = compute_demand()
    index = int(demand.tendon_force.argmax())
    unit = (
        0.975 * MUSCLE.resting_length
        + TENDON.slack_length
        + 0.048 * float(np.radians(WALKER.reference("ankle_dorsiflexion_deg", demand.phase[index : index + 1]))[0])
    )
    # Find the muscle length at which gas and bladder balance the tendon by exhaustive search.
    lengths = np.linspace(0.8, 1.0, 40_001) * MUSCLE.resting_length
    pull = np.array([mckibben.force(MUSCLE, 5e5, float(x)) for x in lengths])
    tendon = np.array([tendon_law.force(TENDON, unit - float(x) - TENDON.slack_length) for x in lengths])
    static_force = float(tendon[np.argmin(np.abs(pull - tendon))])
    assert demand.peak_moment_fraction == pytest.approx(static_force / demand.tendon_force[index], rel=1e-3)


def test_pair_of_3_4_in_is_too_weak() -> None:
    weak = design_device(WALKER, DesignChoices(actuator="klute-3-4", count=2)).demand
    assert weak is not None
    assert weak.peak_moment_fraction < 0.9
    assert np.nanmin(weak.force_margin) < 1.0
    assert DESIGN.demand is not None
    assert np.nanmin(DESIGN.demand.force_margin) > 1.0


def test_force_margin_is_nan_without_load() -> None:
    demand = compute_demand()
    assert np.isnan(demand.force_margin[~demand.is_loaded]).all()
    index = int(demand.tendon_force.argmax())
    assert demand.force_margin[index] == pytest.approx(
        demand.max_isometric_force[index] / (demand.tendon_force[index] - demand.damping_force[index])
    )


def test_long_mounting_reaches_stop() -> None:
    long = demand_under_profile(WALKER, neutral_ratio=1.0)
    assert long.at_stop.any()
    assert long.length_ratio.max() == 1.0


def test_air_at_constant_pressure_follows_volume() -> None:
    demand = demand_under_profile(WALKER, ConstantPressure(4e5))
    volumes = np.array([mckibben.gas_volume(MUSCLE, float(r) * MUSCLE.resting_length) for r in demand.length_ratio])
    volume_increase = np.maximum(np.diff(np.append(volumes, volumes[0])), 0.0).sum()
    assert demand.air_mass == pytest.approx((4e5 + 101_325.0) * volume_increase / (287.05 * 293.15))
    assert demand_under_profile(WALKER, create_off_controller()).air_mass < demand.air_mass
    assert demand_under_profile(WALKER, ConstantPressure(9e5)).commanded_isometric_force == pytest.approx(
        demand.max_isometric_force
    )


@pytest.fixture(scope="module")
def results() -> list[SensitivityResult]:
    return analyse_sensitivity(DESIGN)


def select_by_name(results: list[SensitivityResult], name: str) -> list[SensitivityResult]:
    return [e for e in results if e.variation.name == name]


@pytest.mark.slow
def test_every_assumption_is_varied_or_excluded(results: list[SensitivityResult]) -> None:
    names = {e.variation.name for e in results}
    assert len(results) >= 2 * len(names) - 1
    assert {"cylinder pressure", "tendon strain", "second spring/first", "engagement/slack length"} <= names
    assert {"tendon slack length", "L/L0 at neutral ankle", "eccentric damping", "Vmax", "moment arm"} <= names
    assert {e.variation.assumption for e in results if e.variation.assumption} | set(
        list_excluded_assumptions(DESIGN)
    ) == FIELDS
    base = compute_design_metrics(DESIGN)
    unchanged = [(e.variation.name, e.value) for e in results if e.metrics is None or e.metrics == base]
    # An excursion of 12 % does not require a longer actuator.
    assert unchanged == [("ankle's travel/L0", pytest.approx(0.12))]


def test_muscle_target_excludes_stride_assumptions() -> None:
    design = design_device(MuscleTarget(), DesignChoices(actuator="klute-3-4", count=2))
    varied = {v.assumption for v in iter_variations(design)}
    assert varied.isdisjoint(list_excluded_assumptions(design))
    # Both are unused because no ankle moves the tendon.
    assert FIELDS - varied - set(list_excluded_assumptions(design)) == {"moment_arm", "excursion_fraction"}


def test_smaller_excursion_fraction_lengthens_actuators(results: list[SensitivityResult]) -> None:
    shorter_travel = select_by_name(results, "ankle's travel/L0")[0]
    changed_design = design_device(
        WALKER, DesignChoices(assumptions=DesignAssumptions(excursion_fraction=shorter_travel.value))
    )
    assert changed_design.selected.resting_length > DESIGN.selected.resting_length
    assert shorter_travel.metrics == compute_design_metrics(changed_design)


def test_lower_discharge_coefficient_raises_cylinder_pressure(results: list[SensitivityResult]) -> None:
    _, real = select_by_name(results, "Cd as made")
    assert real.metrics is not None
    assert compute_design_metrics(DESIGN).cylinder_pressure == pytest.approx(4.7e6, rel=0.005)
    assert real.metrics.cylinder_pressure == pytest.approx(4.7e6 / 0.61**2, rel=0.005)


def test_sensitivities_have_expected_signs(results: list[SensitivityResult]) -> None:
    def outcomes(name: str) -> list[tuple[float, float]]:
        return [
            (e.metrics.orifice_concentric, e.metrics.peak_moment_fraction or 0.0)
            for e in select_by_name(results, name)
            if e.metrics
        ]

    low, high = outcomes("cylinder pressure")
    assert low[0] > compute_design_metrics(DESIGN).orifice_concentric > high[0]
    low, high = outcomes("moment arm")
    assert low[1] < DESIGN.demand.peak_moment_fraction < high[1]  # type: ignore[union-attr]
    (scaled,) = outcomes("moment/reference")
    assert scaled[1] < 1.0
    mild, real = select_by_name(results, "Cd as made")
    assert mild.metrics is not None
    assert real.metrics is not None
    # An orifice with Cd = 0.61 brakes 1/0.61^2 times as much, which increases the error.
    assert real.metrics.rms_error_concentric > compute_design_metrics(DESIGN).rms_error_concentric
    assert real.metrics.orifice_concentric == compute_design_metrics(DESIGN).orifice_concentric


def test_variation_equals_design_with_that_value(results: list[SensitivityResult]) -> None:
    effect = select_by_name(results, "tendon strain")[1]
    changed_design = design_device(WALKER, DesignChoices(assumptions=DesignAssumptions(tendon_strain=effect.value)))
    assert effect.metrics == compute_design_metrics(changed_design)


@pytest.mark.slow
def test_variation_keeps_resting_length() -> None:
    design = design_device(WALKER, DesignChoices(actuator="klute-3-4"))
    longer_arm = next(e for e in analyse_sensitivity(design) if e.variation.name == "moment arm" and e.value > 0.048)
    demand = design.selected
    fixed = DesignChoices(actuator="klute-3-4", count=demand.count, resting_length=demand.resting_length)
    changed_design = design_device(WALKER, replace(fixed, assumptions=DesignAssumptions(moment_arm=longer_arm.value)))
    assert longer_arm.metrics is not None
    assert longer_arm.metrics.air_mass == compute_design_metrics(changed_design).air_mass


@pytest.mark.slow
def test_variation_updates_recommendation_and_keeps_actuators() -> None:
    near = design_device(WalkerTarget(mass=85.0))
    stronger = next(e for e in analyse_sensitivity(near) if e.variation.name == "moment/reference")
    assert compute_design_metrics(near).recommended_actuators == "2 x 1-1/4 in"
    assert stronger.metrics is not None
    assert stronger.metrics.recommended_actuators == "3 x 1-1/4 in"
    assert stronger.metrics.orifice_concentric == near.damper.concentric.orifice_diameter


def test_specified_choices_are_not_varied() -> None:
    choices = DesignChoices(actuator="klute-3-4", count=2, bore=0.02, eccentric_force=400.0, eccentric_speed=0.15)
    names = {v.name for v in iter_variations(design_device(MuscleTarget(peak_velocity=0.3), choices))}
    assert names == {"L/L0 at which F0 counts", "Cd as made", "a/F0 = b/Vmax"}


def test_specified_assumption_is_not_varied_at_default_value() -> None:
    def list_varied_fields(choices: DesignChoices) -> set[str | None]:
        return {v.assumption for v in iter_variations(design_device(WALKER, choices))}

    by_rule = list_varied_fields(DesignChoices())
    other_assumptions = DesignAssumptions(moment_arm=0.040, cylinder_pressure=10e6)
    assert by_rule - list_varied_fields(DesignChoices(assumptions=other_assumptions)) == {
        "moment_arm",
        "cylinder_pressure",
    }
    assert by_rule - list_varied_fields(DesignChoices(explicit_fields=frozenset({"moment_arm"}))) == {"moment_arm"}
    assert "pressure_rate" not in list_excluded_assumptions(
        design_device(WALKER, DesignChoices(explicit_fields=frozenset({"pressure_rate"})))
    )


def test_unspecified_hill_constant_is_varied() -> None:
    def shapes(hill: HillCurve, *explicit_fields: str) -> list[tuple[str, HillCurve]]:
        design = design_device(
            MuscleTarget(hill=hill),
            DesignChoices(actuator="klute-3-4", count=2, explicit_fields=frozenset(explicit_fields)),
        )
        return [
            (v.name, target.hill)
            for v in iter_variations(design)
            if ("F0" in v.name and "at which" not in v.name) or "b/Vmax" in v.name
            for target in [v.build_inputs(v.values[0])[0]]
            if isinstance(target, MuscleTarget)
        ]

    assert shapes(HillCurve(0.28, 0.28, 1.4)) == [("a/F0 = b/Vmax", HillCurve(0.12, 0.12, 1.4))]
    assert shapes(HillCurve(0.28, 0.28), "a") == [("b/Vmax", HillCurve(0.28, 0.12))]
    assert shapes(HillCurve(0.3, 0.28)) == [("b/Vmax", HillCurve(0.3, 0.12))]
    assert shapes(HillCurve(0.28, 0.28), "a", "b") == []
