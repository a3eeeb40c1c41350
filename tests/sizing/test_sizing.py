"""Sizing: the printed design points, the rule's limits, and what is written is what was meant."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given as for_all
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


def of_pair(**changes: object) -> Design:
    return design_device(MuscleTarget(), replace(PAIR, **changes))  # type: ignore[arg-type]


def test_the_3_4_in_pair_has_the_orifices_of_its_two_design_points() -> None:
    found = of_pair()
    assert found.isometric_force == pytest.approx(1472.0, rel=1e-3)
    assert found.damper.concentric.speed == 0.300
    assert found.damper.eccentric.speed == 0.150
    assert 1e3 * found.damper.concentric.orifice_diameter == pytest.approx(1.084, rel=0.005)
    assert 1e3 * found.damper.eccentric.orifice_diameter == pytest.approx(1.062, rel=0.005)


def test_the_bore_by_rule_carries_the_design_force_at_the_allowed_pressure() -> None:
    found = of_pair(bore=None)
    assert 1e3 * found.damper.bore == pytest.approx(20.0, rel=0.005)
    assert damper_law.required_bore(found.damper.concentric.design_force, 4.7e6) <= found.damper.bore
    assert found.damper.concentric.pressure == pytest.approx(4.7e6, rel=0.005)  # the orifice is rounded to 1 um


def test_the_bore_is_that_of_the_larger_force() -> None:
    found = of_pair(bore=None, eccentric_force=3000.0)
    assert found.damper.eccentric.pressure == found.damper.max_pressure == pytest.approx(4.7e6, rel=0.005)
    assert found.damper.concentric.pressure < 4.7e6


def test_without_a_given_force_the_eccentric_one_lifts_the_muscle_to_its_saturation() -> None:
    found = of_pair(eccentric_force=None)
    assert found.damper.eccentric.design_force == pytest.approx(0.3 * found.isometric_force)
    assert 1e3 * found.damper.eccentric.orifice_diameter == pytest.approx(1.036, rel=0.005)
    assert found.curves.fixed_orifices[0] == pytest.approx(1.3 * found.isometric_force, rel=0.002)


def test_a_muscle_that_still_pulls_at_vmax_needs_less_damping() -> None:
    # b > a: (2.4) leaves 1 - (1 + a) / (1 + b) of F0 at Vmax.
    found = design_device(MuscleTarget(hill=HillCurve(0.2, 0.3)), PAIR)
    assert found.damper.concentric.design_force == pytest.approx(found.isometric_force * 1.2 / 1.3)
    # a > b: what is below zero is no force of a muscle.
    assert design_device(MuscleTarget(hill=HillCurve(0.3, 0.2)), PAIR).damper.concentric.design_force == pytest.approx(
        found.isometric_force
    )


def test_75_kg_by_rule_is_near_the_hand_made_prosthesis() -> None:
    found, by_hand = design_device(WalkerTarget(mass=75.0)), load_device("klute-1-1-4-pair")
    assert found.required_force == pytest.approx(2234.0, rel=0.005)
    assert (found.selected.actuator, found.selected.count) == ("klute-1-1-4", 2)
    made, known = found.device.spec.collect_values(), by_hand.spec.collect_values()
    assert set(made) == set(known)
    for key, value in known.items():
        assert made[key] == pytest.approx(value, rel=0.02), key


def test_every_row_says_what_it_would_take() -> None:
    found = design_device(WalkerTarget(mass=75.0))
    assert {o.actuator: o.count for o in found.candidates} == {"klute-1-1-4": 2, "klute-3-4": 4, "klute-1-2": 10}
    for option in found.candidates:
        assert option.is_sufficient
        assert (
            (option.count - 1) * option.available_force < found.required_force <= option.count * option.available_force
        )  # type: ignore[operator]
        muscle = actuator.build_muscle(option.actuator, option.count, option.resting_length)
        assert option.count * option.available_force == pytest.approx(
            actuator.isometric_force(muscle, 5e5, option.length_ratio)
        )
        assert option.total_force == pytest.approx(actuator.isometric_force(muscle, 5e5, 0.96))
        assert option.gas_volume == pytest.approx(mckibben.volume(muscle, 0.96 * option.resting_length))


def test_strength_counts_at_the_length_that_the_stride_has_at_its_peak() -> None:
    # At the design ratio 90 kg would just do with two: 2707 of 2685 N. But there the muscle is shorter.
    found = design_device(WalkerTarget(mass=90.0))
    assert found.selected.count == 3
    assert 2 * found.selected.isometric_force > found.required_force > 2 * found.selected.available_force  # type: ignore[operator]
    assert found.demand is not None
    at = int(found.demand.tendon_force.argmax())
    assert found.selected.length_ratio == pytest.approx(found.demand.length_ratio[at], abs=5e-4)


@pytest.mark.parametrize(
    ("force", "count", "taken"),
    [
        (300.0, None, ("klute-3-4", 1)),  # one is enough of two rows: the one with less gas
        (1200.0, 2, ("klute-3-4", 2)),  # two 1/2 in are too weak, two 1-1/4 in have more gas
        (9000.0, 2, ("klute-1-1-4", 2)),  # all are: the strongest
        (200.0, 2, ("klute-1-2", 2)),
        (200.0, None, ("klute-1-2", 1)),
    ],
)
def test_enough_force_comes_first_then_fewest_then_least_gas(
    force: float, count: int | None, taken: tuple[str, int]
) -> None:
    found = design_device(MuscleTarget(isometric_force=force), DesignChoices(count=count))
    assert (found.selected.actuator, found.selected.count) == taken
    assert found.selected.is_sufficient == (found.isometric_force >= force)


def test_a_short_row_is_cut_longer_for_the_ankles_travel() -> None:
    walker = WalkerTarget(mass=75.0)
    found = design_device(walker, DesignChoices(actuator="klute-3-4"))
    travel = walker.ankle_range_of_motion() * 0.048
    assert travel / found.selected.resting_length <= 0.10
    assert travel / (found.selected.resting_length - 0.001) > 0.10
    longer = actuator.build_muscle("klute-3-4", 1, found.selected.resting_length)
    printed = load_device("klute-3-4").parameters.muscle
    for ratio in (0.8, 0.96, 1.0):
        own = actuator.isometric_force(longer, 5e5, ratio)
        assert own == pytest.approx(actuator.isometric_force(printed, 5e5, ratio))


def test_the_source_of_a_lengthened_row_says_so() -> None:
    assert (
        "muscle.resting_length_mm"
        in design_device(WalkerTarget(mass=75.0), DesignChoices(actuator="klute-3-4")).device.spec.collect_assumptions()
    )
    assert "muscle.resting_length_mm" not in design_device(WalkerTarget(mass=75.0)).device.spec.collect_assumptions()


def test_heavier_is_never_weaker_and_always_enough() -> None:
    found = [design_device(WalkerTarget(mass=mass)) for mass in MASSES]
    for lighter, heavier in pairwise(found):
        assert lighter.isometric_force <= heavier.isometric_force
        assert lighter.damper.bore <= heavier.damper.bore
    for own in found:
        assert own.required_force is not None
        assert own.demand is not None
        assert own.demand.peak_moment_fraction >= 1.0


@pytest.mark.parametrize("row", ["rat", "frog", "cat", "human", "bobbert_1986", "bobbert_van_ingen_schenau_1990"])
def test_a_muscle_of_table_2_4_gives_its_force_shape_and_speed(row: str) -> None:
    target = load_table_target(row)
    if target.resting_length is None:
        target = replace(target, resting_length=0.264)
    found = design_device(target)
    assert found.isometric_force >= found.required_force == target.isometric_force  # type: ignore[operator]
    assert found.selected.resting_length == target.resting_length
    assert found.damper.concentric.speed == target.peak_velocity
    assert found.muscle.hill == target.hill


@for_all(st.floats(1e6, 20e6), st.floats(1.05, 2.0))
def test_higher_cylinder_pressure_makes_a_smaller_bore(pressure: float, more: float) -> None:
    bores = [
        design_device(
            MuscleTarget(), replace(PAIR, bore=None, assumptions=DesignAssumptions(cylinder_pressure=p))
        ).damper.bore
        for p in (pressure, pressure * more)
    ]
    assert bores[1] < bores[0]


@for_all(st.floats(1.0, 1e4), st.floats(1e5, 7e7))
def test_the_bore_of_4_2_carries_its_force_at_its_pressure(force: float, pressure: float) -> None:
    bore = damper_law.required_bore(force, pressure)
    assert pressure * math.pi * bore * bore / 4.0 == pytest.approx(force)


@for_all(
    st.floats(1.0, 1e4), st.floats(0.01, 2.0), st.floats(0.005, 0.1), st.floats(700.0, 1100.0), st.floats(0.6, 1.0)
)
def test_the_orifice_of_4_6_gives_back_its_force(
    force: float, speed: float, bore: float, density: float, discharge: float
) -> None:
    orifice = damper_law.required_orifice(force, speed, bore, density, discharge)
    assert orifice > 0.0
    assert damper_law.orifice_coefficient(bore, orifice, density, discharge) * speed * speed == pytest.approx(force)


@for_all(st.floats(1000.0, 5000.0), st.floats(0.2, 1.0))
def test_the_sized_damper_gives_the_forces_it_was_sized_for(force: float, speed: float) -> None:
    sized = damper.size_damper(MuscleTarget(peak_velocity=speed), force, DesignChoices())
    law = sized.to_damper()
    assert damper_law.force(law, -speed) == pytest.approx(-force, rel=0.01)  # the orifice is rounded to 1 um
    assert damper_law.force(law, 0.5 * speed) == pytest.approx(0.3 * force, rel=0.01)
    assert sized.max_pressure == pytest.approx(4.7e6, rel=0.01)


def test_the_oil_obeys_continuity_and_bernoulli() -> None:
    point = of_pair().damper.concentric
    area = math.pi * point.orifice_diameter**2 / 4.0
    flow = math.pi * point.bore**2 / 4.0 * point.speed
    assert point.jet_speed == pytest.approx(flow / area)
    gained = 0.5 * 900.0 * (point.jet_speed**2 - point.speed**2)
    assert point.pressure == pytest.approx(gained)
    assert point.cavitation_number == pytest.approx(ATMOSPHERIC_PRESSURE / gained)


def test_an_orifice_that_flows_worse_loads_the_cylinder_as_built() -> None:
    found = design_device(
        WalkerTarget(mass=75.0), DesignChoices(assumptions=DesignAssumptions(discharge_coefficient=0.61))
    )
    point, area = found.damper.concentric, math.pi * found.damper.bore**2 / 4.0
    assert point.design_force == pytest.approx(2707.0, abs=1.0)
    assert point.as_built_force == pytest.approx(-damper_law.force(found.damper.to_damper(), -0.3))
    assert point.as_built_force == pytest.approx(7275.0, rel=0.005)
    assert point.pressure == pytest.approx(point.as_built_force / area)
    assert point.pressure == pytest.approx(12.6e6, rel=0.01)
    assert point.cavitation_number == pytest.approx(0.0080, abs=1e-4)
    # Bernoulli, in the jet that is Cd times the orifice.
    assert point.pressure == pytest.approx(0.5 * 900.0 * (point.jet_speed**2 - point.speed**2))


def test_the_refill_passage_just_takes_the_atmosphere() -> None:
    point = of_pair().damper.concentric
    oil = point.speed * (point.bore / point.min_refill_diameter) ** 2
    assert 0.5 * 900.0 * (oil**2 - point.speed**2) == pytest.approx(ATMOSPHERIC_PRESSURE)
    assert point.orifice_diameter < point.min_refill_diameter < point.bore


@for_all(st.floats(20.0, 250.0), st.floats(0.01, 0.10))
def test_the_tendon_stretches_by_its_strain_at_the_design_force(mass: float, strain: float) -> None:
    found = design_device(WalkerTarget(mass=mass), DesignChoices(assumptions=DesignAssumptions(tendon_strain=strain)))
    tendon, length = found.device.parameters.tendon, found.selected.resting_length
    assert found.required_force is not None
    stretch = tendon_law.stretch_at_tension(tendon, found.required_force)
    assert stretch / (tendon.slack_length + length) == pytest.approx(strain, rel=1e-3)


def test_what_is_reported_is_what_the_file_says() -> None:
    found = design_device(WalkerTarget(mass=82.0))
    spec = found.device.spec
    assert spec.damper is not None
    assert spec.damper.bore_mm == pytest.approx(1e3 * found.damper.bore, abs=1e-9)
    assert spec.damper.orifice_concentric_mm == pytest.approx(1e3 * found.damper.concentric.orifice_diameter, abs=1e-9)
    assert spec.muscle.count == found.selected.count
    assert spec.list_unsourced_keys() == []
    assert {k for k in spec.collect_assumptions() if k.startswith(("tendon.", "damper."))} == {
        *(k for k in spec.collect_values() if k.startswith(("tendon.", "damper.")) and k != "damper.oil_density_kg_m3")
    }


def test_a_given_number_is_not_called_assumed() -> None:
    sources = of_pair().device.spec.sources
    for key in ("muscle.count", "muscle.resting_length_mm", "damper.bore_mm"):
        assert sources[key] == "given to klute-sim design"
    assert sources["supply.pressure_bar"].startswith("dissertation")
    own = of_pair(eccentric_speed=0.15).device.spec.sources["damper.orifice_eccentric_mm"]
    assert own == "(4.6) with 400 N at 150 mm/s, Cd = 1; force and speed given to klute-sim design"
    assert "the force is given, the rest of the design point is ours" in sources["damper.orifice_eccentric_mm"]
    assert of_pair(supply_pressure=4e5).device.spec.sources["supply.pressure_bar"] == "given to klute-sim design"


@pytest.mark.parametrize(
    ("given", "keys"),
    [
        ({"cylinder_pressure": 10e6}, {"damper.bore_mm"}),
        ({"slack_length": 0.09}, {"tendon.slack_length_mm"}),
        ({"engagement_share": 0.06}, {"tendon.engagement_mm"}),
        ({"pressure_rate": 60e5}, {"supply.rate_bar_per_s"}),
        ({"temperature": 25.0}, {"supply.gas_temperature_c"}),
        ({"neutral_ratio": 0.97}, {"mounting.neutral_muscle_ratio"}),
        ({"excursion_share": 0.09}, {"muscle.resting_length_mm"}),
        (
            {"tendon_strain": 0.03, "second_spring": 2.0, "engagement_share": 0.06},
            {"tendon.stiffness_1_n_per_mm", "tendon.stiffness_2_n_per_mm", "tendon.engagement_mm"},
        ),
    ],
)
def test_a_given_assumption_is_marked_as_given_in_the_file(given: dict[str, float], keys: set[str]) -> None:
    by_rule = design_device(WalkerTarget(mass=75.0), DesignChoices(actuator="klute-3-4")).device.spec
    for choices in (
        DesignChoices(actuator="klute-3-4", assumptions=DesignAssumptions(**given)),
        DesignChoices(actuator="klute-3-4", explicit_fields=frozenset(given)),
    ):
        spec = design_device(WalkerTarget(mass=75.0), choices).device.spec
        assert set(by_rule.collect_assumptions()) - set(spec.collect_assumptions()) == keys
        assert all("given to klute-sim design" in spec.sources[key] for key in keys)


def test_a_given_moment_arm_is_in_the_files_description() -> None:
    made = design_device(WalkerTarget(mass=75.0), DesignChoices(assumptions=DesignAssumptions(moment_arm=0.04)))
    assert "with the given moment arm of 40 mm" in made.device.spec.description
    assert "arm" not in design_device(WalkerTarget(mass=75.0)).device.spec.description


def test_the_profile_carried_over_to_its_own_walker_is_the_tuned_one() -> None:
    own = design_device(WalkerTarget(mass=TUNED_PROFILE_MASS)).profile
    assert own is not None
    assert own.pressure_bar == pytest.approx(load_default_profile().pressure_bar, abs=2e-3)
    assert parse_profile(profile_to_csv(own), "x").pressure_bar == own.pressure_bar


def test_a_lighter_walker_needs_less_pressure_and_nobody_more_than_the_supply() -> None:
    found = design_device(WalkerTarget(mass=50.0))
    assert found.demand is not None
    assert found.profile is not None
    own, given_bar = found.profile.pressure_bar, load_default_profile().pressure_bar
    assert all(lighter <= bar for lighter, bar in zip(own, given_bar, strict=True))
    at = 5  # 48 %: the muscles, the same in both, pull with two thirds of the force
    length = 0.264 * float(np.interp(0.48, found.demand.phase, found.demand.length_ratio))
    muscle = found.device.parameters.muscle
    pull = mckibben.force(muscle, 1e5 * own[at], length) / mckibben.force(muscle, 1e5 * given_bar[at], length)
    assert pull == pytest.approx(2.0 / 3.0, rel=1e-3)
    weak = design_device(WalkerTarget(mass=120.0), DesignChoices(actuator="klute-3-4", count=2))
    assert weak.profile is not None
    assert max(weak.profile.pressure_bar) == 5.0


def test_the_stride_is_evaluated_under_the_profile_that_is_written() -> None:
    of_75, of_60 = (design_device(WalkerTarget(mass=mass)) for mass in (75.0, 60.0))
    assert of_75.demand is not None
    assert of_60.demand is not None
    assert of_60.profile is not None
    at = int(of_60.demand.tendon_force.argmax())
    length = float(of_60.demand.length_ratio[at]) * of_60.selected.resting_length
    pressure = of_60.profile.pressure_at(float(of_60.demand.phase[at]))
    assert of_60.demand.commanded_isometric_force[at] == mckibben.force(
        of_60.device.parameters.muscle, pressure, length
    )
    assert of_60.demand.commanded_isometric_force[at] == pytest.approx(
        0.8 * of_75.demand.commanded_isometric_force[at], rel=0.02
    )
    assert of_60.demand.air_mass < 0.95 * of_75.demand.air_mass


def test_the_count_says_what_was_asked_for_and_what_is_reached() -> None:
    found = design_device(WalkerTarget(mass=60.0))
    source = found.device.spec.sources["muscle.count"]
    assert found.required_force is not None
    assert f"the {found.required_force:.0f} N asked for at L/L0 0.95" in source
    assert f"there they have {found.selected.count * found.selected.available_force:.0f} N at 5 bar" in source
    weak = design_device(MuscleTarget(isometric_force=9e4), DesignChoices(actuator="klute-1-2")).device.spec.sources[
        "muscle.count"
    ]
    assert "still too few for the 90000 N" in weak


@for_all(st.floats(0.0, 8e5), st.floats(0.85, 1.0))
def test_the_pressure_for_a_force_gives_that_force(pressure: float, ratio: float) -> None:
    muscle = actuator.build_muscle("klute-1-1-4", 2, 0.264)
    length = ratio * 0.264
    force = mckibben.force(muscle, pressure, length)
    found = actuator.pressure_for_force(muscle, force, length)
    assert mckibben.force(muscle, found, length) >= force - 1e-6
    if force > mckibben.force(muscle, 0.0, length):
        assert mckibben.force(muscle, found, length) == pytest.approx(force, abs=0.05)


def test_the_pressure_for_a_force_that_no_pressure_gives_is_none() -> None:
    assert math.isnan(actuator.pressure_for_force(actuator.build_muscle("klute-1-2", 1, 0.126), 1e5, 0.12))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: design_device(MuscleTarget()), "both actuator and count"),
        (
            lambda: design_device(MuscleTarget(isometric_force=5e4), DesignChoices(actuator="klute-5")),
            "there is no actuator 'klute-5'",
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
        (lambda: of_pair(bore=0.001, eccentric_force=1e5, eccentric_speed=0.001), "allowed: bore / 1000 to bore"),
    ],
)
def test_what_cannot_be_sized_is_refused_in_one_sentence(make: object, says: str) -> None:
    with pytest.raises(InputError) as refused:
        make()  # type: ignore[operator]
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_limits_themselves_are_allowed() -> None:
    assert DesignChoices(resting_length=2.0, supply_pressure=8e5).count is None
    assert WalkerTarget(mass=20.0).mass == 20.0
