"""Biological muscle compared with the printed tables and statements, Hill's equation, limits, signs and continuity."""

import inspect
import itertools
import math
import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.device.backend.compiled import compile_module
from klute_sim.laws import hill, hill_tables
from klute_sim.laws.hill import (
    DESIGN_ENVELOPE,
    ClosedInterval,
    ContractileElement,
    DesignEnvelope,
    HillCurve,
    ParallelElement,
    SeriesElement,
)
from klute_sim.laws.hill_tables import (
    CONTRACTILE_ELEMENTS,
    GENERIC_CONTRACTILE_ELEMENT,
    GENERIC_HILL_CURVE,
    HILL_CURVES,
    MUSCLE_SCALES,
    PARALLEL_ELEMENTS,
    SERIES_ELEMENTS,
)
from tests.compiled_function import make_callable

BOBBERT_1990 = "bobbert_van_ingen_schenau_1990"

# The tables again, as printed (mm, N), typed apart from the package's.
PRINTED_SCALES = {
    "rat": (27.0, 0.29),
    "frog": (31.0, 0.67),
    "cat": (31.9, 0.18),
    "human": (215.9, 193.1),
    "woittiez_1984": (60, 3000),
    BOBBERT_1990: (61.0, 2430),
}
PRINTED_PARALLEL = {  # k1, k2, shortest, longest
    "frog": (0.0006, 20.63, 0.94, 1.39),
    "cat": (0.0301, 9.16, 1.00, 1.40),
    "human": (0.0037, 10.43, 1.05, 1.29),
    "woittiez_1984": (0.0787, 7.93, None, None),
    BOBBERT_1990: (0.00001, 24.59, None, None),
}
PRINTED_SERIES = {"rat": (0.027, 0.079), "frog": (0.014, 0.049), "cat": (0.028, 0.083)}
PRINTED_CONTRACTILE = {  # k5, k6, k7, shortest, longest
    "rat": (-4.50, 8.95, -3.45, 0.7, 1.2),
    "frog": (-6.79, 14.69, -6.88, 0.68, 1.34),
    "cat": (-5.71, 11.52, -4.81, 0.73, 1.35),
    "human": (-13.43, 28.23, -13.96, 0.82, 1.28),
    "woittiez_1984": (-6.25, 12.50, -5.25, None, None),
    "bobbert_1986": (-6.25, 12.50, -5.25, None, None),
}
PRINTED_HILL = {  # a/F0, F0, b/Vmax, Vmax
    "rat": (0.356, 4.30, 0.38, 144),
    "frog": (0.27, 0.67, 0.28, 42),
    "cat": (0.27, 0.18, 0.30, 191),
    "human": (0.81, 200, 0.81, 1115),
    "woittiez_1984": (0.224, None, 0.224, None),
    "bobbert_1986": (0.41, 3000, 0.39, 756),
    BOBBERT_1990: (0.41, 2430, 0.41, 780),
    "hof_van_den_berg_1981": (0.12, None, 0.12, None),
}

hills = st.builds(HillCurve, st.floats(0.05, 1.0), st.floats(0.05, 1.0), st.floats(1.0, 2.0))
rising = st.builds(HillCurve, st.floats(0.05, 1.0), st.floats(0.05, 1.0), st.floats(1.05, 2.0))
isometrics = st.floats(0.0, 1.1)
velocities = st.floats(-2.0, 2.0)
shortening = st.floats(0.0, 2.0)
lengthening = st.floats(-2.0, 0.0)


def span(valid: ClosedInterval | None) -> tuple[float | None, float | None]:
    return (None, None) if valid is None else (valid.lower, valid.upper)


def top(law: ContractileElement) -> tuple[float, float]:
    """Return length and force of the parabola's maximum."""
    length = -law.k6 / (2.0 * law.k5)
    return length, hill.isometric_force(law, length)


def width(law: ContractileElement) -> float:
    """Return the length between the parabola's roots."""
    return math.sqrt(law.k6 * law.k6 - 4.0 * law.k5 * law.k7) / abs(law.k5)


# Tables --------------------------------------------------------------------------------------------------------------


def test_scales_are_printed() -> None:
    result = {name: (row.resting_length * 1e3, row.isometric_force) for name, row in MUSCLE_SCALES.items()}
    assert result.keys() == PRINTED_SCALES.keys()
    for name, row in result.items():
        assert row == pytest.approx(PRINTED_SCALES[name], rel=1e-12), name


def test_parallel_table_is_printed_and_has_no_rat() -> None:
    assert {
        name: (*row.constants, *span(row.valid_range)) for name, row in PARALLEL_ELEMENTS.items()
    } == PRINTED_PARALLEL
    assert hill_tables.RAT_PARALLEL_ONSET_LENGTH == 1.20


def test_series_table_is_printed() -> None:
    assert SERIES_ELEMENTS == PRINTED_SERIES


def test_contractile_table_is_printed() -> None:
    assert {
        name: (*row.constants, *span(row.valid_range)) for name, row in CONTRACTILE_ELEMENTS.items()
    } == PRINTED_CONTRACTILE


def test_hill_table_is_printed() -> None:
    assert HILL_CURVES.keys() == PRINTED_HILL.keys()
    for name, (a, force, b, speed) in PRINTED_HILL.items():
        row = HILL_CURVES[name]
        assert (row.constants.a, row.constants.b, row.isometric_force) == (a, b, force), name
        assert row.constants.saturation == 1.3
        assert row.max_velocity == (None if speed is None else pytest.approx(speed * 1e-3, rel=1e-12)), name


def test_figures_constants_are_printed() -> None:
    assert GENERIC_CONTRACTILE_ELEMENT == (-6.9, 13.8, -5.9)
    assert GENERIC_HILL_CURVE == (0.28, 0.28, 1.3)
    assert sorted(hill_tables.ECCENTRIC_SATURATIONS.values()) == [1.2, 1.3, 1.8]
    assert hill_tables.ECCENTRIC_SATURATIONS["hatze"] == hill.ECCENTRIC_SATURATION
    assert tuple(DESIGN_ENVELOPE) == (
        (-13.5, -4.5),
        (9.0, 28.2),
        (-14.0, -3.45),
        (0.12, 0.41),
        (0.12, 0.41),
        (1.3, 1.3),
    )


# What the source says about its curves, and where its constants do not say so ----------------------------------------


@pytest.mark.parametrize("name", ["frog", "human", BOBBERT_1990])
def test_parallel_force_is_insignificant_until_1_2_resting_lengths(name: str) -> None:
    assert hill.parallel_force(PARALLEL_ELEMENTS[name].constants, 1.2) < 0.03
    assert hill.parallel_force(PARALLEL_ELEMENTS[name].constants, 1.4) > 1.2 * hill.parallel_force(
        PARALLEL_ELEMENTS[name].constants, 1.3
    )


@pytest.mark.parametrize(("name", "force"), [("cat", 0.160), ("woittiez_1984", 0.334)])
def test_parallel_force_that_contradicts_the_claim(name: str, force: float) -> None:
    assert hill.parallel_force(PARALLEL_ELEMENTS[name].constants, 1.2) == pytest.approx(force, abs=5e-4)


def test_series_element_stretches_up_to_8_percent() -> None:
    full = {name: hill.series_elongation(law, 1.0) for name, law in SERIES_ELEMENTS.items()}
    assert full == {"rat": 0.079, "frog": 0.049, "cat": 0.083}
    assert max(full.values()) == pytest.approx(0.08, abs=0.005)


@pytest.mark.parametrize(("name", "force"), [("rat", 0.0536), ("frog", 0.0302), ("cat", 0.0516)])
def test_series_element_is_slack_below(name: str, force: float) -> None:
    law = SERIES_ELEMENTS[name]
    slack = hill.series_slack_force(law)
    assert slack == pytest.approx(force, abs=5e-5)
    assert hill.series_elongation(law, 0.999 * slack) == 0.0
    assert hill.series_elongation(law, 1.001 * slack) == pytest.approx(1e-3 * law.k3, rel=1e-2)


@pytest.mark.parametrize(
    ("name", "at_rest", "highest", "where"),
    [
        ("rat", 1.00, 1.0001, 0.994),
        ("frog", 1.02, 1.0655, 1.082),
        ("cat", 1.00, 1.0004, 1.009),
        ("human", 0.84, 0.8749, 1.051),
        ("woittiez_1984", 1.00, 1.00, 1.00),
        ("bobbert_1986", 1.00, 1.00, 1.00),
    ],
)
def test_isometric_force_at_rest_and_at_its_maximum(name: str, at_rest: float, highest: float, where: float) -> None:
    law = CONTRACTILE_ELEMENTS[name].constants
    assert hill.isometric_force(law, 1.0) == pytest.approx(at_rest, abs=1e-9)
    assert top(law) == pytest.approx((where, highest), abs=6e-4)


def test_human_parabola_is_the_steepest_and_narrowest() -> None:
    widths = {name: width(row.constants) for name, row in CONTRACTILE_ELEMENTS.items()}
    assert min(widths, key=widths.__getitem__) == "human"
    assert widths["human"] == pytest.approx(0.51, abs=0.005)
    assert min(CONTRACTILE_ELEMENTS, key=lambda name: CONTRACTILE_ELEMENTS[name].constants.k5) == "human"


def test_isometric_force_is_positive_in_its_range_except_for_the_short_frog_muscle() -> None:
    ends = {
        (name, end): hill.isometric_force(row.constants, end)
        for name, row in CONTRACTILE_ELEMENTS.items()
        if row.valid_range is not None
        for end in row.valid_range
    }
    assert {key for key, force in ends.items() if force < 0.0} == {("frog", 0.68)}
    assert ends["frog", 0.68] == pytest.approx(-0.03, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "percent"),
    [("rat", 1.74), ("frog", 0.78), ("cat", 2.31), ("bobbert_1986", -1.44)],
)
def test_residual_force_at_the_printed_peak_velocity(name: str, percent: float) -> None:
    law = HILL_CURVES[name].constants
    assert 100.0 * hill.concentric_force(law, 1.0, 1.0) == pytest.approx(percent, abs=5e-3)
    assert hill.force_velocity(law, 1.0, 1.0) == hill.concentric_force(law, 1.0, 1.0)


def test_force_vanishes_at_peak_velocity_where_a_equals_b() -> None:
    equal = [row.constants for row in HILL_CURVES.values() if row.constants.a == row.constants.b]
    assert len(equal) == 4
    for law in [*equal, GENERIC_HILL_CURVE]:
        assert hill.concentric_force(law, 1.0, 1.0) == pytest.approx(0.0, abs=1e-15)
        assert hill.unloaded_velocity(law, 1.0) == 1.0


@given(st.floats(0.01, 1.0))
def test_concentric_curves_are_ordered(velocity: float) -> None:
    force = {
        name: hill.concentric_force(HILL_CURVES[name].constants, 1.0, velocity)
        for name in ("human", "rat", "frog", "cat")
    }
    if velocity < 0.88:  # beyond, what is left at Vmax where a is not b turns the order over
        assert force["human"] > force["rat"] > max(force["frog"], force["cat"])
    # The text puts the frog above the cat. With the same a and the larger b the cat is above at any speed.
    assert force["cat"] > force["frog"]


def test_concentric_order_reverses_near_the_peak_velocity() -> None:
    def lead(first: str, second: str, velocity: float) -> float:
        forces = [hill.concentric_force(HILL_CURVES[name].constants, 1.0, velocity) for name in (first, second)]
        return forces[0] - forces[1]

    assert lead("rat", "cat", 0.88) > 0.0 > lead("rat", "cat", 0.89)
    assert lead("human", "rat", 0.90) > 0.0 > lead("human", "rat", 0.91)


# Laws ----------------------------------------------------------------------------------------------------------------


@given(st.sampled_from(sorted(PARALLEL_ELEMENTS)), st.floats(0.1, 1.6), st.floats(0.1, 1.6))
def test_parallel_force_is_positive_and_increasing(name: str, value_a: float, value_b: float) -> None:
    law = PARALLEL_ELEMENTS[name].constants
    low, high = sorted((value_a, value_b))
    assert 0.0 <= hill.parallel_force(law, low) <= hill.parallel_force(law, high)
    assert hill.parallel_force(law, 1.0) == law.k1
    assert hill.parallel_force(law, 2.0 * low) == pytest.approx(hill.parallel_force(law, low) * 2.0**law.k2, rel=1e-12)


@pytest.mark.parametrize("nothing", [0.0, -0.5])
def test_zero_length_and_zero_force_give_zero(nothing: float) -> None:
    assert hill.parallel_force(ParallelElement(0.1, 9.5), nothing) == 0.0
    assert hill.series_elongation(SeriesElement(0.027, 0.079), nothing) == 0.0


@given(st.sampled_from(sorted(SERIES_ELEMENTS)), st.floats(0.0, 1.5), st.floats(0.0, 1.5))
def test_series_elongation_is_nonnegative_and_increasing(name: str, value_a: float, value_b: float) -> None:
    law = SERIES_ELEMENTS[name]
    low, high = sorted((value_a, value_b))
    assert 0.0 <= hill.series_elongation(law, low) <= hill.series_elongation(law, high)


@given(st.sampled_from(sorted(SERIES_ELEMENTS)), st.floats(0.06, 1.0), st.floats(0.06, 1.0))
def test_series_elongation_is_logarithmic(name: str, value_a: float, value_b: float) -> None:
    law = SERIES_ELEMENTS[name]
    difference = hill.series_elongation(law, value_a) - hill.series_elongation(law, value_b)
    assert difference == pytest.approx(law.k3 * math.log(value_a / value_b), abs=1e-14)


@given(hills, isometrics, shortening)
def test_concentric_force_solves_hills_equation(law: HillCurve, isometric: float, velocity: float) -> None:
    force = hill.concentric_force(law, isometric, velocity)
    assert (force + law.a) * (velocity + law.b) == pytest.approx((isometric + law.a) * law.b, rel=1e-9)


@given(rising, st.floats(0.01, 1.1), lengthening)
def test_eccentric_force_solves_the_inverted_equation(law: HillCurve, isometric: float, velocity: float) -> None:
    force = hill.eccentric_force(law, isometric, velocity)
    rise = (law.saturation - 1.0) * isometric
    c = rise * law.b / (isometric + law.a)
    assert (law.saturation * isometric - force) * (c - velocity) == pytest.approx(rise * c, rel=1e-9)


@given(hills, isometrics)
def test_branches_are_continuous_at_rest(law: HillCurve, isometric: float) -> None:
    at_rest = {branch(law, isometric, 0.0) for branch in (hill.concentric_force, hill.eccentric_force)}
    assert at_rest == {isometric} == {hill.force_velocity(law, isometric, 0.0)}
    tiny = hill.force_velocity(law, isometric, -1e-12)
    assert tiny == pytest.approx(isometric, abs=1e-10)


@given(rising, st.floats(0.1, 1.1))
def test_branches_have_the_same_slope_at_rest(law: HillCurve, isometric: float) -> None:
    slope = -(isometric + law.a) / law.b  # of (2.4) at rest
    d = 1e-7
    force = [hill.force_velocity(law, isometric, velocity) for velocity in (-d, 0.0, d)]
    assert (force[1] - force[0]) / d == pytest.approx(slope, rel=5e-3)
    assert (force[2] - force[1]) / d == pytest.approx(slope, rel=5e-3)


@given(hills, isometrics, velocities, velocities)
def test_force_falls_with_velocity(law: HillCurve, isometric: float, value_a: float, value_b: float) -> None:
    low, high = sorted((value_a, value_b))
    assert hill.force_velocity(law, isometric, low) >= hill.force_velocity(law, isometric, high) - 1e-15


@given(hills, isometrics, st.floats(1e-6, 2.0))
def test_shortening_weakens_and_lengthening_strengthens(law: HillCurve, isometric: float, speed: float) -> None:
    assert hill.force_velocity(law, isometric, speed) < isometric
    stretched = hill.force_velocity(law, isometric, -speed)
    if law.saturation > 1.0001 and isometric > 1e-3:
        assert stretched > isometric
    assert isometric <= stretched <= law.saturation * isometric * (1 + 1e-15)


@pytest.mark.parametrize("saturation", sorted({1.0, *hill_tables.ECCENTRIC_SATURATIONS.values()}))
@pytest.mark.parametrize("name", sorted(HILL_CURVES))
def test_lengthening_saturates(name: str, saturation: float) -> None:
    law = HILL_CURVES[name].constants._replace(saturation=saturation)
    assert hill.force_velocity(law, 1.0, -1e9) == pytest.approx(saturation, rel=1e-8)
    assert hill.force_velocity(law, 0.5, -1e9) == pytest.approx(0.5 * saturation, rel=1e-8)
    # At a finite speed saturation is incomplete: Fig. 2.6 ends at half of Vmax.
    if saturation > 1.0:
        assert 1.0 + 0.5 * (saturation - 1.0) < hill.force_velocity(law, 1.0, -0.5) < saturation


def test_default_saturation_is_1_3() -> None:
    assert HillCurve(0.28, 0.28).saturation == 1.3
    assert hill.force_velocity(GENERIC_HILL_CURVE, 1.0, -1e9) == pytest.approx(1.3)


@given(rising, st.floats(0.01, 1.0))
def test_length_scales_the_unloaded_velocity(law: HillCurve, isometric: float) -> None:
    speed = hill.unloaded_velocity(law, isometric)
    assert hill.concentric_force(law, isometric, speed) == pytest.approx(0.0, abs=1e-12)
    assert speed == pytest.approx(isometric * hill.unloaded_velocity(law, 1.0))
    assert speed > 0.0


# The contractile element -----------------------------------------------------------------------------------------


def test_generic_muscle_of_the_surface() -> None:
    def force(length: float, velocity: float) -> float:
        return hill.contractile_force(GENERIC_CONTRACTILE_ELEMENT, GENERIC_HILL_CURVE, length, velocity)

    assert force(1.0, 0.0) == pytest.approx(1.0, abs=1e-12)
    assert force(1.0, 1.0) == pytest.approx(0.0, abs=1e-12)
    assert force(1.0, 0.5) == pytest.approx(0.1795, abs=5e-5)
    assert force(1.0, -0.5) == pytest.approx(1.2652, abs=5e-5)
    assert force(0.8, 0.0) == pytest.approx(0.724, abs=1e-12)
    assert force(0.5, 0.0) == force(1.5, 0.0) == 0.0  # roots at 0.619 and 1.381


@given(st.floats(0.3, 1.7), velocities)
def test_contractile_force_is_the_printed_formula_clipped_at_zero(length: float, velocity: float) -> None:
    isometric = hill.isometric_force(GENERIC_CONTRACTILE_ELEMENT, length)
    force = hill.contractile_force(GENERIC_CONTRACTILE_ELEMENT, GENERIC_HILL_CURVE, length, velocity)
    if isometric <= 0.0:
        assert force == 0.0
    else:
        assert force == max(0.0, hill.force_velocity(GENERIC_HILL_CURVE, isometric, velocity))


# Design envelope -----------------------------------------------------------------------------------------------------


def test_envelope_contains_its_muscles_except_for_rounding() -> None:
    inside = {
        name
        for name, row in CONTRACTILE_ELEMENTS.items()
        if hill.is_in_envelope(DESIGN_ENVELOPE, row.constants, GENERIC_HILL_CURVE)
    }
    assert set(CONTRACTILE_ELEMENTS) - inside == {"rat", "human"}  # k6 8.95 and 28.23, bounds printed 9.0 and 28.2
    assert not hill.is_in_interval(DESIGN_ENVELOPE.k6, CONTRACTILE_ELEMENTS["rat"].constants.k6)
    assert not hill.is_in_interval(DESIGN_ENVELOPE.k6, CONTRACTILE_ELEMENTS["human"].constants.k6)
    for name in ("rat", "human"):
        rounded = CONTRACTILE_ELEMENTS[name].constants._replace(k6=9.0 if name == "rat" else 28.2)
        assert hill.is_in_envelope(DESIGN_ENVELOPE, rounded, GENERIC_HILL_CURVE)
    speeds = {
        name
        for name, row in HILL_CURVES.items()
        if hill.is_in_envelope(DESIGN_ENVELOPE, GENERIC_CONTRACTILE_ELEMENT, row.constants)
    }
    assert set(HILL_CURVES) - speeds == {"human"}  # Ralston's 0.81


def test_envelope_checks_every_constant() -> None:
    spans = list(DESIGN_ENVELOPE)
    middle = [(s.lower + s.upper) / 2.0 for s in spans]
    assert hill.is_in_envelope(DESIGN_ENVELOPE, ContractileElement(*middle[:3]), HillCurve(*middle[3:]))
    for i, end in itertools.product(range(6), (0, 1)):
        for sign, inside in ((0.0, True), (-1.0 if end == 0 else 1.0, False)):
            moved = list(middle)
            moved[i] = spans[i][end] + sign * 1e-6
            assert (
                hill.is_in_envelope(DESIGN_ENVELOPE, ContractileElement(*moved[:3]), HillCurve(*moved[3:])) is inside
            ), (i, end)
    assert not hill.is_in_interval(ClosedInterval(0.0, 1.0), math.nan)


# Compiled ------------------------------------------------------------------------------------------------------------


def samples(seed: int, count: int) -> dict[type, list[Any]]:
    """Return arguments of all types, inside and outside the valid range of the laws."""
    pick = random.Random(seed)

    def number() -> float:
        return pick.choice([0.0, -0.0, 1.0, -1.0, pick.uniform(-2, 2), pick.uniform(0, 1.6), pick.uniform(-1e-9, 1e-9)])

    def hill_law() -> HillCurve:
        return HillCurve(pick.uniform(0.05, 1.0), pick.uniform(0.05, 1.0), pick.choice([1.0, 1.2, 1.3, 1.8]))

    return {
        ParallelElement: [ParallelElement(pick.uniform(1e-5, 0.1), pick.uniform(5, 25)) for _ in range(count)],
        SeriesElement: [SeriesElement(pick.uniform(0.01, 0.03), pick.uniform(0.04, 0.09)) for _ in range(count)],
        ContractileElement: [pick.choice(list(CONTRACTILE_ELEMENTS.values())).constants for _ in range(count)],
        HillCurve: [hill_law() for _ in range(count)],
        DesignEnvelope: [DESIGN_ENVELOPE] * count,
        ClosedInterval: [ClosedInterval(*sorted((number(), number()))) for _ in range(count)],
        float: [number() for _ in range(count)],
    }


@pytest.mark.parametrize("seed", [1, 2])
def test_compiled_laws_are_bit_identical(seed: int) -> None:
    count = 400
    compiled_hill = compile_module(hill)
    names = [name for name, f in vars(hill).items() if inspect.isfunction(f) and f.__module__ == hill.__name__]
    assert len(names) == 11
    for name in names:
        python, compiled = getattr(hill, name), make_callable(getattr(compiled_hill, name))
        kinds = [parameter.annotation for parameter in inspect.signature(python).parameters.values()]
        # Separate seeds, because isometric force and velocity would otherwise be equal.
        columns = [samples(seed + 10 * i, count)[kind] for i, kind in enumerate(kinds)]
        for arguments in zip(*columns, strict=True):
            expected, result = python(*arguments), compiled(*arguments)
            assert type(result) is type(expected)
            assert float(result).hex() == float(expected).hex(), (name, arguments)
