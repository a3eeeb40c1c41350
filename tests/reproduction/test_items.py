"""Tests of the published items, their assessment and the numbers that a user supplies."""

import re
import tomllib
from pathlib import Path

import pytest

from klute_sim.errors import InputError
from klute_sim.reproduction import printed
from klute_sim.reproduction.item import Outcome, PublishedItem, assess
from tests.reproduction import second_reading

TABLES = ("2.1", "2.2", "2.3", "2.4", "3.1", "4.1", "5.1", "5.2", "8.1", "8.2")
FIGURES = (
    *(f"2.{k}" for k in range(2, 9)),
    *(f"3.{k}" for k in range(2, 10)),
    *(f"4.{k}" for k in range(1, 13)),
    *(f"5.{k}" for k in range(1, 4)),
    *(f"6.{k}" for k in range(1, 5)),
    *("7.1", "7.4", "7.5", "7.6"),
    *(f"8.{k}" for k in range(1, 9)),
)
"""Figures of the source except Figs. 7.2 and 7.3, which this copy of it does not list."""


def numbers(title: str, word: str) -> set[str]:
    """Return the numbers of the tables or figures that ``title`` names, with ranges expanded."""
    numbers_found = set()
    for part in re.findall(rf"{word}s?\.? ((?:\d\.\d+(?:-\d\.\d+)?(?:, )?)+)", title):
        for item_range in part.strip(", ").split(", "):
            first, _, last = item_range.partition("-")
            chapter, low = first.split(".")
            high = last.split(".")[1] if last else low
            numbers_found |= {f"{chapter}.{k}" for k in range(int(low), int(high) + 1)}
    return numbers_found


def item(published: float | str | None, tolerance: float = 0.01, contradiction: str = "") -> PublishedItem:
    absolute = tolerance * (abs(published) or 1.0) if isinstance(published, float) else None
    return PublishedItem(
        *("row.name", "Row", "quantity", "N"),
        published,
        "independent",
        tolerance=absolute,
        contradiction=contradiction,
    )


def test_published_items_cover_all_tables_and_figures() -> None:
    titles = [row.title for row in printed.load_tables().values()]
    assert set().union(*(numbers(title, "Table") for title in titles)) >= set(TABLES)
    assert set().union(*(numbers(title, "Fig") for title in titles)) >= set(FIGURES)
    assert all(row.items for row in printed.load_tables().values())
    names = [published_item.id for published_item in printed.list_items()]
    assert len(names) == len(set(names)) >= 60
    assert all(published_item.quantity for published_item in printed.list_items())


@pytest.mark.parametrize(
    ("published", "finding", "contradiction", "verdict"),
    [
        (100.0, Outcome(100.9), "", "agrees"),
        (100.0, Outcome(101.1), "", "contradicts-source"),
        (-100.0, Outcome(-98.9), "", "contradicts-source"),
        (100.0, Outcome(101.1), "it says so elsewhere", "source-contradicts-itself"),
        (100.0, Outcome(100.9), "it says so elsewhere", "agrees"),
        (0.0, Outcome(0.009), "", "agrees"),
        (0.0, Outcome(0.011), "", "contradicts-source"),
        (100.0, Outcome(float("nan")), "", "contradicts-source"),
        (100.0, Outcome(), "", "not-printed"),
        (None, Outcome(100.0), "", "not-printed"),
        ("rises", Outcome(1.0, True), "", "agrees"),
        ("rises", Outcome(1.0, False), "", "contradicts-source"),
        ("rises", Outcome(None, False), "it falls there", "source-contradicts-itself"),
        ("rises", Outcome(), "", "not-printed"),
    ],
)
def test_verdict_follows_from_published_and_computed(
    published: float | str | None, finding: Outcome, contradiction: str, verdict: str
) -> None:
    assessment = assess(item(published, contradiction=contradiction), finding)
    assert assessment.verdict == verdict
    assert (contradiction in assessment.note) == (verdict == "source-contradicts-itself" or not contradiction)


@pytest.mark.parametrize(
    ("published", "finding", "implied", "verdict"),
    [
        (1.0, Outcome(0.84), 0.84, "source-contradicts-itself"),
        (1.0, Outcome(1.30), 0.84, "contradicts-source"),
        (1.0, Outcome(1.001), 0.84, "agrees"),
        ("holds", Outcome(None, False), False, "source-contradicts-itself"),
        ("holds", Outcome(None, False), True, "contradicts-source"),
        ("holds", Outcome(None, True), False, "source-contradicts-itself"),
        ("holds", Outcome(None, True), True, "agrees"),
    ],
)
def test_source_contradicts_itself_only_by_implied_values(
    published: float | str, finding: Outcome, implied: float | bool, verdict: str
) -> None:
    assert assess(item(published, contradiction="elsewhere"), finding, implied).verdict == verdict


def test_difference_is_relative_to_published() -> None:
    assert assess(item(-200.0), Outcome(-190.0)).difference == pytest.approx(0.05)
    assert assess(item(0.0), Outcome(0.02)).difference == pytest.approx(0.02)
    assert assess(item("rises"), Outcome(1.0, True)).difference is None
    assert assess(item(None), Outcome(1.0)).difference is None


def test_template_can_be_completed_and_loaded(tmp_path: Path) -> None:
    template = printed.render_template()
    assert tomllib.loads(template) == {}
    names = [published_item.id for published_item in printed.list_missing_items()]
    completed = re.sub(r'^# ("[^"]+" =)', r"\1 1.5", template, flags=re.MULTILINE)
    file = tmp_path / "numbers.toml"
    file.write_text(completed, "utf-8")
    supplied = printed.load_supplied_values(file)
    assert supplied == dict.fromkeys(names, 1.5)
    items = {published_item.id: published_item for published_item in printed.list_items(supplied)}
    supplied_item = items["table-8.1.p5-v100"]
    assert supplied_item.published == 1.5
    assert "supplied by the user" in supplied_item.note
    assert assess(supplied_item, Outcome(1.6)).verdict == "agrees"
    assert assess(supplied_item, Outcome(1.7)).verdict == "contradicts-source"
    assert printed.list_items()[0] == printed.list_items(supplied)[0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('"table-8.1.p5-v10" = 1.0', r"no missing number is called 'table-8.1.p5-v10'.*did you mean 'table-8.1.p5-v1"),
        ('"fig-3.9.slow" = 1.0', "no missing number is called 'fig-3.9.slow'"),
        ('"table-4.1.bore" = "20 mm"', "'table-4.1.bore' is '20 mm'; allowed: a number"),
        ('"table-4.1.bore" = true', "allowed: a number"),
        ('"table-4.1.bore" = inf', "allowed: finite numbers"),
        ("table-4.1.bore = 20.0", "no missing number is called 'table-4'"),
        ("= 3", "is not valid TOML"),
    ],
)
def test_invalid_supplied_file_raises_one_sentence(tmp_path: Path, content: str, message: str) -> None:
    file = tmp_path / "numbers.toml"
    file.write_text(content, "utf-8")
    with pytest.raises(InputError, match=message):
        printed.load_supplied_values(file)
    with pytest.raises(InputError, match="cannot be read"):
        printed.load_supplied_values(tmp_path / "none.toml")


def test_printed_numbers_equal_a_second_reading() -> None:
    assert printed.get_published_numbers() == second_reading.collect_numbers()


def test_values_without_a_second_reading_are_marked() -> None:
    marked = {published_item.id for published_item in printed.list_items() if not published_item.is_checked}
    assert marked == {
        *(f"table-2.3.{name}.fit" for name in ("rat", "frog", "cat", "human")),
        "eq-2.5.around",
        "fig-2.8.inside",
    }


def test_only_compared_independent_numbers_have_a_dependence() -> None:
    dependences = {i.id: i.dependence for i in printed.list_items() if i.dependence is not None}
    assert dependences == {
        "fig-3.9.slow": "calibrated",
        "fig-3.9.loss": "derived",
        "fig-3.4.difference": "derived",
        "table-2.2.with-tendon": "derived",
    }
    assert all(i.kind == "independent" and i.kind_reason for i in printed.list_items() if i.dependence is not None)


def test_number_without_tolerance_is_refused() -> None:
    with pytest.raises(ValueError, match=r"item row\.name has no tolerance"):
        assess(item(1.0)._replace(tolerance=None), Outcome(1.0))


def test_implied_number_of_a_statement_is_judged_by_its_limit() -> None:
    statement = item("holds", contradiction="elsewhere")._replace(at_most=1.0)
    assert assess(statement, Outcome(0.5, True), 0.9).verdict == "agrees"
    assert assess(statement, Outcome(0.5, True), 1.1).verdict == "source-contradicts-itself"
    assert assess(statement, Outcome(1.5, True), 0.9).verdict == "contradicts-source"
    assert assess(statement, Outcome(1.5, True), 1.1).verdict == "source-contradicts-itself"
