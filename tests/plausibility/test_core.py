"""Findings, guessed units, and faults of samples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.errors import InputError
from klute_sim.plausibility.finding import Finding, ImplausibleInputError, check_accepted_names, require_accepted
from klute_sim.plausibility.gait.markers import find_length_unit
from klute_sim.plausibility.samples import (
    Samples,
    are_exchanged,
    compute_correlation,
    compute_negative_share,
    find_missing_value_code,
    find_zero_blocks,
)
from klute_sim.plausibility.units import UNITS, Range, guess_units

WAVE = np.sin(np.linspace(0.0, 20.0, 400))
FORCE = Finding("force-unit", "trial 'a'", "force is 3 to 9 kN: is its unit N?")
TIME = Finding("time-unit", "trial 'a'", "time ends at 5000 s: is its unit ms?")


def test_unaccepted_findings_are_refused_with_the_way_to_accept_them() -> None:
    with pytest.raises(ImplausibleInputError) as error:
        require_accepted([FORCE, TIME])
    assert str(error.value) == (
        "trial 'a': force is 3 to 9 kN: is its unit N?; trial 'a': time ends at 5000 s: is its unit ms?. If this is "
        "no mistake, accept it with --accept force-unit --accept time-unit"
    )
    assert error.value.findings == (FORCE, TIME)


def test_accepted_findings_are_returned() -> None:
    assert require_accepted([FORCE, TIME], {"force-unit", "time-unit"}) == (FORCE, TIME)
    with pytest.raises(ImplausibleInputError) as error:
        require_accepted([FORCE, TIME], {"time-unit"})
    assert "--accept force-unit" in str(error.value)
    assert "time" not in str(error.value)


CHANNELS = ("force", "length", "pressure_command")


@pytest.mark.parametrize(
    "name",
    ["force-unit", "length-force-exchanged", "time-reversed", "marker-unit", "muscle.count", "pressure_command-sign"],
)
def test_names_that_a_finding_can_have_may_be_accepted(name: str) -> None:
    check_accepted_names([name], [TIME], CHANNELS, ["muscle.count"])


@pytest.mark.parametrize(
    ("name", "found", "message"),
    [
        ("bla", [], "there is no finding 'bla'; these data have none to accept"),
        ("x", [FORCE, TIME], "there is no finding 'x'; found in these data: force-unit, time-unit"),
        ("forse-unit", [FORCE], "'forse-unit'; did you mean 'force-unit'? Found in these data: force-unit"),
        ("force_unit", [FORCE], "did you mean 'force-unit'?"),
    ],
)
def test_other_names_to_accept_are_refused(name: str, found: list[Finding], message: str) -> None:
    with pytest.raises(InputError) as error:
        check_accepted_names([name], found, CHANNELS)
    assert message in str(error.value)


def test_equal_findings_are_reported_once() -> None:
    others = [FORCE._replace(place=f"trial '{name}'") for name in "bc"]
    with pytest.raises(ImplausibleInputError, match=r"is its unit N\? \(and in 2 more trials\)\. If"):
        require_accepted([FORCE, *others])


@pytest.mark.parametrize("si_unit", UNITS)
def test_every_unit_is_guessed_from_every_other(si_unit: str) -> None:
    plausible = Range(0.7, 1.4, 1.0)
    for written, factor in UNITS[si_unit].items():
        for true, true_factor in UNITS[si_unit].items():
            guesses = guess_units(factor / true_factor, factor, si_unit, plausible)
            if plausible.contains(factor / true_factor):
                assert guesses == ()
            else:
                assert 0.7 <= UNITS[si_unit][guesses[0]] / true_factor <= 1.4, (written, true, guesses)


def test_no_unit_is_guessed_where_none_is_plausible() -> None:
    assert guess_units(3e7, 1.0, "rad", Range(0.7, 1.4, 1.0)) == ()
    assert guess_units(-2.0, 1.0, "N", Range(0.7, 1.4, 1.0)) == ()


def test_units_that_the_size_does_not_tell_apart_are_named_in_order_of_closeness() -> None:
    tension = Range(0.4, 1.5, 0.8)
    assert guess_units(0.9 / 9.80665, 1.0, "N", tension) == ("kgf", "lbf")
    assert guess_units(0.6 / 4.44822, 1.0, "N", tension) == ("lbf", "kgf")
    assert guess_units(0.7 / 9.80665, 1.0, "N", tension) == ("kgf",)
    assert guess_units(0.9e-3, 1.0, "N", tension) == ("kN",)


@pytest.mark.parametrize("code", [-9999.0, 999.0, 1e30, -99.99])
def test_missing_value_codes_are_found(code: float) -> None:
    values = 200.0 + 100.0 * WAVE
    values[30:34] = code
    found = find_missing_value_code(Samples("force", values * 1e3, "kN", 1e3))
    assert found is not None
    assert found.code == pytest.approx(code)
    assert found.n_samples == 4


@pytest.mark.parametrize("values", [999.0 + 0.0 * WAVE, np.clip(1500.0 * WAVE, -999.0, 999.0), 1e3 * WAVE])
def test_ordinary_samples_are_no_codes(values: np.ndarray) -> None:
    assert find_missing_value_code(Samples("force", values, "N", 1.0)) is None


def test_zero_blocks() -> None:
    values = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0])
    assert np.flatnonzero(find_zero_blocks(values, 3)).tolist() == [2, 3, 4]
    assert find_zero_blocks(values, 2).sum() == 5


def test_negative_share() -> None:
    assert compute_negative_share(np.array([1.0, 1.0, -2.0, np.nan])) == 0.5
    assert compute_negative_share(np.zeros(3)) == 0.0


def test_exchanged_columns() -> None:
    force_range, length_range = Range(1.0, 5e3, 300.0), Range(0.1, 1.0, 0.3)
    force = Samples("force", 300.0 + 50.0 * WAVE, "N", 1.0)
    length = Samples("length", 0.3 + 0.01 * WAVE, "mm", 1e-3)
    assert not are_exchanged(force, length, force_range, length_range)
    swapped_force = force._replace(value=0.3e3 * np.ones(400) / 1.0 * 1e-3)  # 0.3 under [N]
    swapped_length = length._replace(value=400.0e3 * np.ones(400) * 1e-3)  # 400,000 under [mm]
    assert not are_exchanged(swapped_force, swapped_length, force_range, length_range)
    in_metres = Samples("length", 400.0 + 50.0 * WAVE, "m", 1.0)
    assert are_exchanged(swapped_force, in_metres, force_range, length_range)


def test_correlation() -> None:
    assert compute_correlation(WAVE, 3.0 - 2.0 * WAVE) == pytest.approx(-1.0)
    assert compute_correlation(WAVE, np.ones(400)) == 0.0


@given(st.one_of(st.just(0.0), st.floats(1e-150, 0.3), st.floats(2.0, 1e150)))
def test_markers_of_any_wrong_scale_are_named(scale: float) -> None:
    heights = {"hip": 0.92, "knee": 0.5, "ankle": 0.09}
    leg = {name: np.tile([0.0, 0.0, scale * height], (20, 1)) for name, height in heights.items()}
    (finding,) = find_length_unit([leg], "walk")
    assert finding.name == "marker-unit"
    assert ("are at one place" in finding.statement) == (scale == 0.0)
