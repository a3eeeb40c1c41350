"""Tests of the sizing rules: printed design points, limits of the rules, and the device file."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.controllers.pressure import load_default_profile, parse_profile, profile_to_csv
from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben
from klute_sim.laws import tendon as tendon_law
from klute_sim.laws.hill import HillCurve
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE
from klute_sim.sizing.choices import DesignAssumptions, DesignChoices
from klute_sim.sizing.parts import actuator, damper
from klute_sim.sizing.parts.profile import TUNED_PROFILE_MASS
from klute_sim.sizing.sizing import Design, design_device
from klute_sim.sizing.target import MuscleTarget, WalkerTarget, load_table_target

PAIR = DesignChoices(actuator="klute-3-4", count=2, resting_length=0.250, bore=0.020, eccentric_force=400.0)
MASSES = (20.0, 35.0, 50.0, 60.0, 75.0, 90.0, 100.0, 130.0, 180.0, 250.0)


def design_pair(**changes: object) -> Design:
    return design_device(MuscleTarget(), replace(PAIR, **changes))  # type: ignore[arg-type]


def test_3_4_in_pair_has_orifices_of_both_design_points() -> None:
    design = design_pair()
    assert design.isometric_force == pytest.approx(1472.0, rel=1e-3)
    assert design.damper.concentric.speed == 0.300
    assert design.damper.eccentric.speed == 0.150
    assert 1e3 * design.damper.concentric.orifice_diameter == pytest.approx(1.084, rel=0.005)
    assert 1e3 * design.damper.eccentric.orifice_diameter == pytest.approx(1.062, rel=0.005)


def test_bore_carries_design_force_at_allowed_pressure() -> None:
    design = design_pair(bore=None)
    assert 1e3 * design.damper.bore == pytest.approx(20.0, rel=0.005)
    assert damper_law.required_bore(design.damper.concentric.design_force, 4.7e6) <= design.damper.bore
    assert design.damper.concentric.pressure == pytest.approx(4.7e6, rel=0.005)  # the orifice is rounded to 1 um


def test_bore_follows_larger_force() -> None:
    design = design_pair(bore=None, eccentric_force=3000.0)
    assert design.damper.eccentric.pressure == design.damper.max_pressure == pytest.approx(4.7e6, rel=0.005)
    assert design.damper.concentric.pressure < 4.7e6


def test_default_eccentric_force_reaches_saturation() -> None:
    design = design_pair(eccentric_force=None)
    assert design.damper.eccentric.design_force == pytest.approx(0.3 * design.isometric_force)
    assert 1e3 * design.damper.eccentric.orifice_diameter == pytest.approx(1.036, rel=0.005)
    assert design.curves.fixed_orifices[0] == pytest.approx(1.3 * design.isometric_force, rel=0.002)


def test_residual_force_at_vmax_reduces_damping() -> None:
    # b > a: (2.4) leaves 1 - (1 + a) / (1 + b) of F0 at Vmax.
    design = design_device(MuscleTarget(hill=HillCurve(0.2, 0.3)), PAIR)
    assert design.damper.concentric.design_force == pytest.approx(design.isometric_force * 1.2 / 1.3)
    # a > b: a muscle has no negative force.
    assert design_device(MuscleTarget(hill=HillCurve(0.3, 0.2)), PAIR).damper.concentric.design_force == pytest.approx(
        design.isometric_force
    )


def test_75_kg_design_is_near_default_prosthesis() -> None:
    design, by_hand = design_device(WalkerTarget(mass=75.0)), load_device("klute-1-1-4-pair")
    assert design.required_force == pytest.approx(2234.0, rel=0.005)
    assert (design.selected.actuator, design.selected.count) == ("klute-1-1-4", 2)
    values, preset_values = design.device.spec.collect_values(), by_hand.spec.collect_values()
    assert set(values) == set(preset_values)
    for key, value in preset_values.items():
        assert values[key] == pytest.approx(value, rel=0.02), key


def test_every_candidate_reports_required_count() -> None:
    design = design_device(WalkerTarget(mass=75.0))
    assert {o.actuator: o.count for o in design.candidates} == {"klute-1-1-4": 2, "klute-3-4": 4, "klute-1-2": 10}
    for option in design.candidates:
        assert option.is_sufficient
        assert (
            (option.count - 1) * option.available_force < design.required_force <= option.count * option.available_force
        )  # type: ignore[operator]
        muscle = actuator.build_muscle(option.actuator, option.count, option.resting_length)
        assert option.count * option.available_force == pytest.approx(
            actuator.compute_isometric_force(muscle, 5e5, option.length_ratio)
        )
        assert option.total_force == pytest.approx(actuator.compute_isometric_force(muscle, 5e5, 0.96))
        assert option.gas_volume == pytest.approx(mckibben.gas_volume(muscle, 0.96 * option.resting_length))


def test_force_is_required_at_length_of_peak_moment() -> None:
    # At the design ratio two actuators reach 2707 of 2685 N, but the muscle is shorter at the peak.
    design = design_device(WalkerTarget(mass=90.0))
    assert design.selected.count == 3
    assert 2 * design.selected.isometric_force > design.required_force > 2 * design.selected.available_force  # type: ignore[operator]
    assert design.demand is not None
    index = int(design.demand.tendon_force.argmax())
    assert design.selected.length_ratio == pytest.approx(design.demand.length_ratio[index], abs=5e-4)


@pytest.mark.parametrize(
    ("force", "count", "selected"),
    [
        (300.0, None, ("klute-3-4", 1)),  # one unit of two presets is enough: the one with less gas
        (1200.0, 2, ("klute-3-4", 2)),  # two 1/2 in are too weak, two 1-1/4 in have more gas
        (9000.0, 2, ("klute-1-1-4", 2)),  # all pairs are too weak: the strongest
        (200.0, 2, ("klute-1-2", 2)),
        (200.0, None, ("klute-1-2", 1)),
    ],
)
def test_selection_prefers_sufficient_then_fewest_then_least_gas(
    force: float, count: int | None, selected: tuple[str, int]
) -> None:
    design = design_device(MuscleTarget(isometric_force=force), DesignChoices(count=count))
    assert (design.selected.actuator, design.selected.count) == selected
    assert design.selected.is_sufficient == (design.isometric_force >= force)


def test_short_actuator_is_lengthened_for_ankle_excursion() -> None:
    walker = WalkerTarget(mass=75.0)
    design = design_device(walker, DesignChoices(actuator="klute-3-4"))
    travel = walker.compute_ankle_range_of_motion() * 0.048
    assert travel / design.selected.resting_length <= 0.10
    assert travel / (design.selected.resting_length - 0.001) > 0.10
    longer = actuator.build_muscle("klute-3-4", 1, design.selected.resting_length)
    printed = load_device("klute-3-4").parameters.muscle
    for ratio in (0.8, 0.96, 1.0):
        value = actuator.compute_isometric_force(longer, 5e5, ratio)
        assert value == pytest.approx(actuator.compute_isometric_force(printed, 5e5, ratio))


def test_lengthened_actuator_is_marked_as_assumed() -> None:
    assert (
        "muscle.resting_length_mm"
        in design_device(WalkerTarget(mass=75.0), DesignChoices(actuator="klute-3-4")).device.spec.collect_assumptions()
    )
    assert "muscle.resting_length_mm" not in design_device(WalkerTarget(mass=75.0)).device.spec.collect_assumptions()


def test_strength_never_decreases_with_body_mass() -> None:
    design = [design_device(WalkerTarget(mass=mass)) for mass in MASSES]
    for lighter, heavier in pairwise(design):
        assert lighter.isometric_force <= heavier.isometric_force
        assert lighter.damper.bore <= heavier.damper.bore
    for value in design:
        assert value.required_force is not None
        assert value.demand is not None
        assert value.demand.peak_moment_fraction >= 1.0


@pytest.mark.parametrize("row", ["rat", "frog", "cat", "human", "bobbert_1986", "bobbert_van_ingen_schenau_1990"])
def test_table_2_4_muscle_gives_force_shape_and_speed(row: str) -> None:
    target = load_table_target(row)
    if target.resting_length is None:
        target = replace(target, resting_length=0.264)
    design = design_device(target)
    assert design.isometric_force >= design.required_force == target.isometric_force  # type: ignore[operator]
    assert design.selected.resting_length == target.resting_length
    assert design.damper.concentric.speed == target.peak_velocity
    assert design.muscle.hill == target.hill


@pytest.mark.slow
@given(st.floats(1e6, 20e6), st.floats(1.05, 2.0))
def test_higher_cylinder_pressure_gives_smaller_bore(pressure: float, factor: float) -> None:
    bores = [
        design_device(
            MuscleTarget(), replace(PAIR, bore=None, assumptions=DesignAssumptions(cylinder_pressure=p))
        ).damper.bore
        for p in (pressure, pressure * factor)
    ]
    assert bores[1] < bores[0]


@given(st.floats(1.0, 1e4), st.floats(1e5, 7e7))
def test_bore_equation_is_consistent(force: float, pressure: float) -> None:
    bore = damper_law.required_bore(force, pressure)
    assert pressure * math.pi * bore * bore / 4.0 == pytest.approx(force)


@given(st.floats(1.0, 1e4), st.floats(0.01, 2.0), st.floats(0.005, 0.1), st.floats(700.0, 1100.0), st.floats(0.6, 1.0))
def test_orifice_equation_is_consistent(
    force: float, speed: float, bore: float, density: float, discharge: float
) -> None:
    orifice = damper_law.required_orifice(force, speed, bore, density, discharge)
    assert orifice > 0.0
    assert damper_law.orifice_coefficient(bore, orifice, density, discharge) * speed * speed == pytest.approx(force)


@given(st.floats(1000.0, 5000.0), st.floats(0.2, 1.0))
def test_sized_damper_gives_design_forces(force: float, speed: float) -> None:
    sized = damper.size_damper(MuscleTarget(peak_velocity=speed), force, DesignChoices())
    law = sized.to_damper()
    assert damper_law.force(law, -speed) == pytest.approx(-force, rel=0.01)  # the orifice is rounded to 1 um
    assert damper_law.force(law, 0.5 * speed) == pytest.approx(0.3 * force, rel=0.01)
    assert sized.max_pressure == pytest.approx(4.7e6, rel=0.01)


def test_oil_satisfies_continuity_and_bernoulli() -> None:
    point = design_pair().damper.concentric
    area = math.pi * point.orifice_diameter**2 / 4.0
    flow = math.pi * point.bore**2 / 4.0 * point.speed
    assert point.jet_speed == pytest.approx(flow / area)
    pressure_drop = 0.5 * 900.0 * (point.jet_speed**2 - point.speed**2)
    assert point.pressure == pytest.approx(pressure_drop)
    assert point.cavitation_number == pytest.approx(ATMOSPHERIC_PRESSURE / pressure_drop)


def test_lower_discharge_coefficient_loads_cylinder() -> None:
    design = design_device(
        WalkerTarget(mass=75.0), DesignChoices(assumptions=DesignAssumptions(discharge_coefficient=0.61))
    )
    point, area = design.damper.concentric, math.pi * design.damper.bore**2 / 4.0
    assert point.design_force == pytest.approx(2707.0, abs=1.0)
    assert point.as_built_force == pytest.approx(-damper_law.force(design.damper.to_damper(), -0.3))
    assert point.as_built_force == pytest.approx(7275.0, rel=0.005)
    assert point.pressure == pytest.approx(point.as_built_force / area)
    assert point.pressure == pytest.approx(12.6e6, rel=0.01)
    assert point.cavitation_number == pytest.approx(0.0080, abs=1e-4)
    # Bernoulli, in the jet that is Cd times the orifice.
    assert point.pressure == pytest.approx(0.5 * 900.0 * (point.jet_speed**2 - point.speed**2))


def test_refill_passage_has_atmospheric_pressure_drop() -> None:
    point = design_pair().damper.concentric
    oil = point.speed * (point.bore / point.min_refill_diameter) ** 2
    assert 0.5 * 900.0 * (oil**2 - point.speed**2) == pytest.approx(ATMOSPHERIC_PRESSURE)
    assert point.orifice_diameter < point.min_refill_diameter < point.bore


@pytest.mark.slow
@given(st.floats(20.0, 250.0), st.floats(0.01, 0.10))
def test_tendon_reaches_design_strain_at_design_force(mass: float, strain: float) -> None:
    design = design_device(WalkerTarget(mass=mass), DesignChoices(assumptions=DesignAssumptions(tendon_strain=strain)))
    tendon, length = design.device.parameters.tendon, design.selected.resting_length
    assert design.required_force is not None
    stretch = tendon_law.stretch_at_tension(tendon, design.required_force)
    assert stretch / (tendon.slack_length + length) == pytest.approx(strain, rel=1e-3)


def test_design_matches_device_file() -> None:
    design = design_device(WalkerTarget(mass=82.0))
    spec = design.device.spec
    assert spec.damper is not None
    assert spec.damper.bore_mm == pytest.approx(1e3 * design.damper.bore, abs=1e-9)
    assert spec.damper.orifice_concentric_mm == pytest.approx(1e3 * design.damper.concentric.orifice_diameter, abs=1e-9)
    assert spec.muscle.count == design.selected.count
    assert spec.list_unsourced_keys() == []
    assert {k for k in spec.collect_assumptions() if k.startswith(("tendon.", "damper."))} == {
        *(k for k in spec.collect_values() if k.startswith(("tendon.", "damper.")) and k != "damper.oil_density_kg_m3")
    }


def test_specified_number_is_not_marked_assumed() -> None:
    sources = design_pair().device.spec.sources
    for key in ("muscle.count", "muscle.resting_length_mm", "damper.bore_mm"):
        assert sources[key] == "given to klute-sim design"
    assert sources["supply.pressure_bar"].startswith("dissertation")
    value = design_pair(eccentric_speed=0.15).device.spec.sources["damper.orifice_eccentric_mm"]
    assert value == "(4.6) with 400 N at 150 mm/s, Cd = 1; force and speed given to klute-sim design"
    assert "the force is given, the rest of the design point is ours" in sources["damper.orifice_eccentric_mm"]
    assert design_pair(supply_pressure=4e5).device.spec.sources["supply.pressure_bar"] == "given to klute-sim design"


@pytest.mark.parametrize(
    ("assumptions", "keys"),
    [
        ({"cylinder_pressure": 10e6}, {"damper.bore_mm"}),
        ({"slack_length": 0.09}, {"tendon.slack_length_mm"}),
        ({"engagement_fraction": 0.06}, {"tendon.engagement_mm"}),
        ({"pressure_rate": 60e5}, {"supply.rate_bar_per_s"}),
        ({"gas_temperature": 25.0}, {"supply.gas_temperature_c"}),
        ({"neutral_ratio": 0.97}, {"mounting.neutral_muscle_ratio"}),
        ({"excursion_fraction": 0.09}, {"muscle.resting_length_mm"}),
        (
            {"tendon_strain": 0.03, "second_spring_ratio": 2.0, "engagement_fraction": 0.06},
            {"tendon.stiffness_1_n_per_mm", "tendon.stiffness_2_n_per_mm", "tendon.engagement_mm"},
        ),
    ],
)
def test_specified_assumption_is_marked_in_device_file(assumptions: dict[str, float], keys: set[str]) -> None:
    by_rule = design_device(WalkerTarget(mass=75.0), DesignChoices(actuator="klute-3-4")).device.spec
    for choices in (
        DesignChoices(actuator="klute-3-4", assumptions=DesignAssumptions(**assumptions)),
        DesignChoices(actuator="klute-3-4", explicit_fields=frozenset(assumptions)),
    ):
        spec = design_device(WalkerTarget(mass=75.0), choices).device.spec
        assert set(by_rule.collect_assumptions()) - set(spec.collect_assumptions()) == keys
        assert all("given to klute-sim design" in spec.sources[key] for key in keys)


def test_specified_moment_arm_is_in_description() -> None:
    values = design_device(WalkerTarget(mass=75.0), DesignChoices(assumptions=DesignAssumptions(moment_arm=0.04)))
    assert "with the given moment arm of 40 mm" in values.device.spec.description
    assert "arm" not in design_device(WalkerTarget(mass=75.0)).device.spec.description


def test_profile_transferred_to_its_own_walker_is_unchanged() -> None:
    value = design_device(WalkerTarget(mass=TUNED_PROFILE_MASS)).profile
    assert value is not None
    assert value.pressure_bar == pytest.approx(load_default_profile().pressure_bar, abs=2e-3)
    assert parse_profile(profile_to_csv(value), "x").pressure_bar == value.pressure_bar


def test_lighter_walker_needs_less_pressure_within_supply() -> None:
    design = design_device(WalkerTarget(mass=50.0))
    assert design.demand is not None
    assert design.profile is not None
    value, given_bar = design.profile.pressure_bar, load_default_profile().pressure_bar
    assert all(lighter <= bar for lighter, bar in zip(value, given_bar, strict=True))
    index = 5  # 48 %: the muscles, the same in both, pull with two thirds of the force
    length = 0.264 * float(np.interp(0.48, design.demand.phase, design.demand.length_ratio))
    muscle = design.device.parameters.muscle
    pull = mckibben.force(muscle, 1e5 * value[index], length) / mckibben.force(muscle, 1e5 * given_bar[index], length)
    assert pull == pytest.approx(2.0 / 3.0, rel=1e-3)
    weak = design_device(WalkerTarget(mass=120.0), DesignChoices(actuator="klute-3-4", count=2))
    assert weak.profile is not None
    assert max(weak.profile.pressure_bar) == 5.0


def test_stride_is_evaluated_under_written_profile() -> None:
    design_75, design_60 = (design_device(WalkerTarget(mass=mass)) for mass in (75.0, 60.0))
    assert design_75.demand is not None
    assert design_60.demand is not None
    assert design_60.profile is not None
    index = int(design_60.demand.tendon_force.argmax())
    length = float(design_60.demand.length_ratio[index]) * design_60.selected.resting_length
    pressure = design_60.profile.pressure_at(float(design_60.demand.phase[index]))
    assert design_60.demand.commanded_isometric_force[index] == mckibben.force(
        design_60.device.parameters.muscle, pressure, length
    )
    assert design_60.demand.commanded_isometric_force[index] == pytest.approx(
        0.8 * design_75.demand.commanded_isometric_force[index], rel=0.02
    )
    assert design_60.demand.air_mass < 0.95 * design_75.demand.air_mass


def test_count_source_reports_required_and_reached_force() -> None:
    design = design_device(WalkerTarget(mass=60.0))
    source = design.device.spec.sources["muscle.count"]
    assert design.required_force is not None
    assert f"the {design.required_force:.0f} N required at L/L0 0.95" in source
    assert f"there they have {design.selected.count * design.selected.available_force:.0f} N at 5 bar" in source
    weak = design_device(MuscleTarget(isometric_force=9e4), DesignChoices(actuator="klute-1-2")).device.spec.sources[
        "muscle.count"
    ]
    assert "still too few for the 90000 N" in weak


@given(st.floats(0.0, 8e5), st.floats(0.85, 1.0))
def test_pressure_for_force_gives_that_force(pressure: float, ratio: float) -> None:
    muscle = actuator.build_muscle("klute-1-1-4", 2, 0.264)
    length = ratio * 0.264
    force = mckibben.force(muscle, pressure, length)
    design = actuator.compute_required_pressure(muscle, force, length)
    assert mckibben.force(muscle, design, length) >= force - 1e-6
    if force > mckibben.force(muscle, 0.0, length):
        assert mckibben.force(muscle, design, length) == pytest.approx(force, abs=0.05)


def test_unreachable_force_has_nan_pressure() -> None:
    assert math.isnan(actuator.compute_required_pressure(actuator.build_muscle("klute-1-2", 1, 0.126), 1e5, 0.12))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: design_device(MuscleTarget()), "both actuator and count"),
        (
            lambda: design_device(MuscleTarget(isometric_force=5e4), DesignChoices(actuator="klute-5")),
            "unknown actuator 'klute-5'",
        ),
        (
            lambda: design_device(MuscleTarget(isometric_force=1e5), DesignChoices(supply_pressure=2e5)),
            "no actuator of Table 3.1 reaches",
        ),
        (lambda: WalkerTarget(mass=10.0), "mass is 10; allowed: 20 to 250 kg"),
        (lambda: WalkerTarget(mass=math.nan), "mass is nan"),
        (lambda: MuscleTarget(hill=HillCurve(0.0, 0.28)), "a/F0 is 0; allowed: 0.01 to 10"),
        (lambda: MuscleTarget(hill=HillCurve(0.28, 0.28, 1.0)), "saturation over F0 is 1; allowed: 1.01 to 3"),
        (lambda: MuscleTarget(peak_velocity=9.0), "Vmax is 9000; allowed: 5 to 5000 mm/s"),
        (lambda: MuscleTarget(resting_length=0.001), "l0 is 1; allowed: 20 to 2000 mm"),
        (lambda: DesignChoices(supply_pressure=1e5), "supply pressure is 1; allowed: 2 to 8 bar"),
        (lambda: DesignChoices(count=101), "count of actuators is 101; allowed: 1 to 100"),
        (lambda: DesignAssumptions(cylinder_pressure=0.0), "cylinder pressure is 0; allowed: 0.1 to 70 MPa"),
        (lambda: DesignAssumptions(moment_arm=0.2), "moment arm is 200; allowed: 10 to 100 mm"),
        (lambda: load_table_target("dog"), "Table 2.4 has no muscle 'dog'; it has: rat,"),
        (lambda: design_pair(bore=0.001, eccentric_force=1e5, eccentric_speed=0.001), "allowed: bore / 1000 to bore"),
    ],
)
def test_impossible_design_raises_one_sentence(build: object, message: str) -> None:
    with pytest.raises(InputError) as refused:
        build()  # type: ignore[operator]
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_range_limits_are_inclusive() -> None:
    assert DesignChoices(resting_length=2.0, supply_pressure=8e5).count is None
    assert WalkerTarget(mass=20.0).mass == 20.0
