"""Tests of the counts and sentences that summarize the assessments."""

from klute_sim.reproduction.item import Dependence, ItemAssessment, ItemKind, Outcome, PublishedItem, assess
from klute_sim.reproduction.summary import (
    count_kinds,
    format_dependence,
    format_headline,
    format_other_kinds,
    summarize,
)


def make(kind: ItemKind, value: float | None, dependence: Dependence | None = None) -> ItemAssessment:
    """Return the assessment of the printed number 1 and the computed ``value``."""
    item = PublishedItem("row.name", "Row", "quantity", "N", 1.0, kind, dependence=dependence, tolerance=0.1)
    return assess(item, Outcome(value))


ASSESSMENTS = (
    make("independent", 1.0),
    make("independent", 2.0),
    make("independent", None),
    make("independent", 1.0, "calibrated"),
    make("independent", 1.0, "derived"),
    make("round-trip", 1.0),
    make("round-trip", 1.0),
    make("input", 1.0),
    make("claim", 2.0),
)


def test_headline_counts_compared_independent_numbers_only() -> None:
    assert format_headline(ASSESSMENTS) == "3 of 4 independent numbers agree."
    assert format_headline(ASSESSMENTS[5:]) == "0 of 0 independent numbers agree."


def test_dependent_numbers_are_left_out_of_the_second_count() -> None:
    assert "without them 1 of 2 agree" in format_dependence(ASSESSMENTS)
    assert "1 was used to fit constants of the model and 1 follow" in format_dependence(ASSESSMENTS)


def test_other_kinds_are_counted_apart() -> None:
    sentence = format_other_kinds(ASSESSMENTS)
    assert sentence.startswith("Beside them 0 of 1 claims and definitions, 2 of 2 round trips and 1 of 1 inputs agree.")
    assert sentence.endswith("1 items are not compared.")


def test_counts_cover_every_assessment() -> None:
    counts = count_kinds(ASSESSMENTS)
    assert list(counts) == ["independent", "claim", "round-trip", "input"]
    assert sum(sum(by_verdict.values()) for by_verdict in counts.values()) == len(ASSESSMENTS)
    assert counts["independent"] == {
        "agrees": 3,
        "contradicts-source": 1,
        "source-contradicts-itself": 0,
        "not-printed": 1,
    }
    assert summarize(ASSESSMENTS)["headline"] == format_headline(ASSESSMENTS)
