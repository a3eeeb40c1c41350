"""Tests of the reflexes: neutral gains, signs, limits, and the files of walkers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.errors import InputError
from klute_sim.walker.person.body import load_body
from klute_sim.walker.person.build import build_walker_model, get_contact
from klute_sim.walker.reflexes import laws
from klute_sim.walker.reflexes.gain_table import GAINS, INITIAL_STATE, Reflexes
from klute_sim.walker.reflexes.walker_file import (
    Walker,
    describe_condition,
    list_walkers,
    load_walker,
    parse_walker,
    select_walker,
)

START = laws.ReflexGains(*(gain.start for gain in GAINS))
LEG = laws.LegSenses(0.3, 0.8, 0.2, 0.3, 0.3, 0.0, 0.9, 0.1, 0.1, 0.9, 0.9, 0.1)
TRUNK = laws.TrunkSenses(0.15, 0.0, 1.25)


def stimulate(gains: laws.ReflexGains = START, leg: laws.LegSenses = LEG, **trunk: float) -> laws.Stimulations:
    return laws.stimulate_stance(gains, leg, TRUNK._replace(**trunk), 0.0, False)


def swing(gains: laws.ReflexGains = START, leg: laws.LegSenses = LEG, stance_leg_angle: float = -0.2, **trunk: float):  # type: ignore[no-untyped-def]
    return laws.stimulate_swing(gains, leg, TRUNK._replace(**trunk), stance_leg_angle, 0.1, 1.25)


def test_load_raises_calf_and_vasti() -> None:
    low, high = stimulate(), stimulate(leg=LEG._replace(soleus_force=0.6, vasti_force=0.6, gastrocnemius_force=0.5))
    assert high.soleus > low.soleus
    assert high.vasti > low.vasti
    assert high.gastrocnemius > low.gastrocnemius
    assert high.tibialis_anterior < low.tibialis_anterior


def test_hip_keeps_the_trunk_upright_in_proportion_to_the_load() -> None:
    forward, backward = stimulate(lean=0.4), stimulate(lean=-0.2)
    assert forward.glutei > backward.glutei
    assert forward.hamstrings > backward.hamstrings
    assert forward.hip_flexors < backward.hip_flexors
    unloaded = stimulate(leg=LEG._replace(load=0.0), lean=0.4)
    assert unloaded.glutei == pytest.approx(START.stance_tone)


def test_extending_knee_inhibits_the_vasti_near_extension_only() -> None:
    straight = LEG._replace(knee_angle=0.05, knee_rate=-1.0)
    assert stimulate(leg=straight).vasti < stimulate().vasti
    assert stimulate(leg=straight._replace(knee_rate=1.0)).vasti == stimulate().vasti


def test_trailing_leg_prepares_its_swing() -> None:
    free = laws.stimulate_stance(START, LEG, TRUNK, 0.5, False)
    trailing = laws.stimulate_stance(START, LEG, TRUNK, 0.5, True)
    assert trailing.hip_flexors > free.hip_flexors
    assert trailing.vasti < free.vasti
    assert trailing.glutei <= free.glutei


def test_placement_moves_the_leg_to_its_target() -> None:
    gains = START._replace(placement=2.0)
    behind, ahead = swing(gains, LEG._replace(leg_angle=-0.2)), swing(gains, LEG._replace(leg_angle=0.9))
    assert behind.hip_flexors > swing(START).hip_flexors
    assert ahead.glutei > swing(START).glutei
    assert swing(gains, speed=1.8).hip_flexors > swing(gains).hip_flexors
    assert swing(gains, stance_leg_angle=-0.4).hip_flexors > swing(gains).hip_flexors


def test_placement_of_zero_changes_no_bit() -> None:
    """A neutral gain leaves the reflexes of Geyer and Herr as they are, whatever its companions."""
    other = START._replace(placement_angle=0.0, placement_distance=1.7, placement_speed=-0.3)
    assert swing(START) == swing(other)


@given(st.lists(st.floats(-5, 5), min_size=12, max_size=12), st.floats(-1, 1), st.floats(-5, 5), st.booleans())
def test_stimulations_stay_in_their_range(senses: list[float], lean: float, rate: float, is_trailing: bool) -> None:
    leg, trunk = laws.LegSenses(*senses), laws.TrunkSenses(lean, rate, 1.0)
    for stimulations in (
        laws.stimulate_stance(START, leg, trunk, abs(senses[0]), is_trailing),
        laws.stimulate_swing(START, leg, trunk, senses[1], lean, rate),
    ):
        assert all(laws.MIN_STIMULATION <= value <= 1.0 for value in stimulations)


def make_walker(**changes: object) -> Walker:
    body = load_body()
    gains = np.array([gain.start for gain in GAINS])
    initial = np.array([number.start for number in INITIAL_STATE])
    values = {
        "name": "w",
        "reflexes": Reflexes(gains, gains, initial),
        "body_digest": body.digest,
        "contact": get_contact(build_walker_model(body, None)),
        "condition": describe_condition("none"),
        "search": {"seed": 1, "evaluations": 16, "cost": 8.0, "speed_m_per_s": 1.25},
    }
    return Walker(**{**values, **changes})  # type: ignore[arg-type]


def test_file_reads_back_to_the_bit() -> None:
    walker = make_walker()
    again = parse_walker(walker.to_toml().encode(), "w")
    assert again.digest == walker.digest
    assert (again.contact, again.condition, again.search) == (walker.contact, walker.condition, walker.search)


def test_walker_of_another_body_or_contact_is_refused() -> None:
    body, contact = load_body(), get_contact(build_walker_model(load_body(), None))
    make_walker().check_fits(body, contact)
    with pytest.raises(InputError, match="adapted in another body"):
        make_walker(body_digest="0" * 64).check_fits(body, contact)
    with pytest.raises(InputError, match=r"contact with solref = \[0.03, 1.0\], this one has \[0.02, 1.0\]"):
        make_walker(contact={**contact, "solref": [0.03, 1.0]}).check_fits(body, contact)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (("soleus_force = 1.2", "soleus_force = 9.0"), r"'left.soleus_force' is 9.0; allowed: 0 to 3"),
        (("soleus_force = 1.2", "soleus_gain = 1.2"), r"unknown key 'left.soleus_gain'"),
        (("klute-sim-walker/1", "klute-sim-walker/0"), r"'format' is 'klute-sim-walker/0'; allowed"),
        (("[initial]", "[begin]"), r"table \[initial\] is missing"),
        (("sha256", "sha"), r"'body.sha256' is missing"),
    ],
)
def test_damaged_file_is_refused_with_one_sentence(change: tuple[str, str], sentence: str) -> None:
    text = make_walker().to_toml()
    assert change[0] in text
    with pytest.raises(InputError, match=sentence):
        parse_walker(text.replace(*change, 1).encode(), "w")


def test_shipped_walkers_belong_to_this_body_and_are_found_by_condition() -> None:
    body, contact = load_body(), get_contact(build_walker_model(load_body(), None))
    for name in list_walkers():
        load_walker(name).check_fits(body, contact)
    assert select_walker(describe_condition("none")).is_intact
    with pytest.raises(InputError, match="there is no walker 'intact-0'; did you mean 'intact-"):
        load_walker("intact-0")
