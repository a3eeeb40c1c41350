"""Tests that no tolerance and no limit can be widened: each is derived again from its reason, apart from the data."""

import math

import pytest

from klute_sim.reproduction import printed
from klute_sim.reproduction.item import Outcome, PublishedItem, assess
from tests.reproduction import second_reading

ITEMS = {item.id: item for item in printed.list_items()}


def half_digit(text: str) -> float:
    """Return half of the last digit of a printed number."""
    return 0.5 * 10.0 ** -len(text.partition(".")[2])


def to_two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def radius_tolerance(resting_length: float, braid: float, turns: float) -> float:
    """Return the tolerance [mm] of R0 from lengths [mm] that are printed with one decimal."""
    leg, circumference = math.sqrt(braid**2 - resting_length**2), 2.0 * math.pi * turns
    return to_two_digits(half_digit("0.0") * (1.0 + (braid + resting_length) / leg / circumference))


def hill_tolerance(a: str, b: str) -> float:
    """Return how far F/F0 = (1 + a) b / (1 + b) - a at Vmax moves with half of the last digits of a and b."""
    by_b = (1.0 + float(a)) / (1.0 + float(b)) ** 2
    return to_two_digits(half_digit(a) / (1.0 + float(b)) + half_digit(b) * by_b)


PRINTED_HILL = {
    "rat": ("0.356", "0.38"),
    "frog": ("0.27", "0.28"),
    "cat": ("0.27", "0.30"),
    "human": ("0.81", "0.81"),
    "woittiez_1984": ("0.224", "0.224"),
    "bobbert_1986": ("0.41", "0.39"),
    second_reading.BOBBERT_1990: ("0.41", "0.41"),
    "hof_van_den_berg_1981": ("0.12", "0.12"),
}
TOLERANCES = {
    "table-2.2.max-elongation": half_digit("8"),
    "table-2.2.with-tendon": half_digit("0.8"),
    "fig-3.4.geometric": 0.5 * 50.0,
    "fig-3.4.bladder": 0.5 * 50.0,
    "fig-3.4.difference": 0.5 * 50.0,
    "fig-3.9.slow": 0.01 * 734.0,
    "fig-3.9.fast": 0.01 * 690.0,
    "fig-3.9.loss": half_digit("6"),
    "eq-4.real": 1e-5,
    **{
        f"table-3.1.{size}.radius": radius_tolerance(*row[1:3], row[0])
        for size, row in second_reading.TABLE_3_1.items()
    },
    **{f"table-2.3.{name}.at-rest": 3.0 * half_digit("0.00") for name in second_reading.TABLE_2_3},
    **{f"table-2.4.{name}.at-vmax": hill_tolerance(a, b) for name, (a, b) in PRINTED_HILL.items()},
}
"""Absolute tolerances, in the unit of the item."""
RELATIVE_TOLERANCES = {"input": 1e-9, "round-trip": 1e-6}
"""Tolerances of numbers that need no more than double precision."""
LIMITS = {
    "table-2.1.insignificant": ("at_most", 0.05),
    "table-3.1.slender": ("at_least", 14.0),
    "fig-3.4.everywhere": ("at_least", 0.5),
    "fig-3.4.proportional": ("at_most", 1.1),
    "fig-3.6.stop": ("at_most", 1.0),
    "fig-3.7.velocity": ("at_most", 6.0 / 6.0),
    "eq-4.round-trip": ("at_most", 1e-9),
    "fig-4.9.stop": ("at_most", 1.0),
    "figs-4.10-4.11.passive": ("at_most", 0.0),
    "fig-4.12.near": ("at_most", 0.5),
    "table-5.1.form": ("at_most", 1e-9),
    "figs-6.3-6.4.linear-a": ("at_most", 1e-6),
    "figs-6.3-6.4.linear-b": ("at_most", 1e-6),
    "figs-6.3-6.4.bilinear": ("at_least", 1.01),
    "figs-7.4-7.5.shortening": ("at_most", 0.95),
    "figs-7.4-7.5.lengthening": ("at_least", 1.05),
    "figs-8.1-8.4.square": ("at_most", 5.0),
    "table-8.1.velocity": ("at_least", 1.05),
    "table-8.2.velocity": ("at_least", 1.05),
}
UNCOMPARED_NUMBERS = (".r2", ".fit")
"""Ends of the identifiers of printed numbers that nothing can be compared with."""


def list_compared_numbers() -> list[PublishedItem]:
    return [i for i in ITEMS.values() if isinstance(i.published, float) and not i.id.endswith(UNCOMPARED_NUMBERS)]


def expected_tolerance(item: PublishedItem) -> float:
    assert isinstance(item.published, float)
    if item.id in TOLERANCES:
        return TOLERANCES[item.id]
    return RELATIVE_TOLERANCES[item.kind] * (abs(item.published) or 1.0)


@pytest.mark.parametrize("item", list_compared_numbers(), ids=lambda item: item.id)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_value_beyond_the_derived_tolerance_does_not_agree(item: PublishedItem, sign: float) -> None:
    tolerance = expected_tolerance(item)
    assert isinstance(item.published, float)
    assert assess(item, Outcome(item.published + sign * 0.99 * tolerance)).verdict == "agrees"
    assert assess(item, Outcome(item.published + sign * 1.01 * tolerance)).verdict != "agrees"


def test_every_tolerance_has_its_derivation() -> None:
    own = {i.id for table_id, table in printed.load_tables().items() for i in _with_tolerance(table_id, table)}
    assert own == TOLERANCES.keys()


def _with_tolerance(table_id: str, table: printed.PublishedTable) -> list[PublishedItem]:
    return [ITEMS[f"{table_id}.{entry.id}"] for entry in table.items if entry.tolerance is not None]


def test_limits_of_statements_equal_the_expected_ones() -> None:
    limits = {
        item.id: (name, value)
        for item in ITEMS.values()
        for name, value in (("at_most", item.at_most), ("at_least", item.at_least))
        if value is not None
    }
    assert limits == LIMITS


@pytest.mark.parametrize(("name", "limit"), LIMITS.items())
def test_value_beyond_the_limit_makes_the_statement_false(name: str, limit: tuple[str, float]) -> None:
    item, value = ITEMS[name], limit[1]
    beyond = math.nextafter(value, math.inf if limit[0] == "at_most" else -math.inf)
    assert assess(item, Outcome(value, True)).holds
    assert not assess(item, Outcome(beyond, True)).holds
    assert not assess(item, Outcome(math.nan, True)).holds
    assert not assess(item, Outcome(value, False)).holds


def test_every_compared_item_has_a_criterion() -> None:
    for item in list_compared_numbers():
        assert item.criterion, item.id
        assert item.tolerance is not None, item.id
    for name in LIMITS:
        assert ITEMS[name].criterion, name


def test_tolerances_without_support_in_the_source_are_marked_as_assumed() -> None:
    for name in (
        "fig-3.4.geometric",
        "fig-3.9.slow",
        "table-2.1.insignificant",
        "fig-3.4.proportional",
        "fig-4.12.near",
    ):
        assert "(assumed" in ITEMS[name].criterion, name


def test_supplied_number_is_compared_within_a_tenth() -> None:
    item = {i.id: i for i in printed.list_items({"table-4.1.bore": 20.0})}["table-4.1.bore"]
    assert assess(item, Outcome(21.98)).verdict == "agrees"
    assert assess(item, Outcome(22.02)).verdict == "contradicts-source"
    assert "10 %" in item.criterion
