"""Difference of a metric from people: in standard deviations, in percent, or in percent of the cycle."""

import pytest

from klute_sim.gait.reference import DEFAULT_NAME
from klute_sim.report.gait.reference_text import MAX_NAME_CHARS, describe_deviations, shorten_reference_name
from klute_sim.report.gait.table import _format_difference


@pytest.mark.parametrize(
    ("value", "human", "unit", "deviation", "expected"),
    [
        (1.6, 1.4, "N·m/kg", 0.1, "+2.0 sd"),
        (1.3, 1.4, "N·m/kg", 0.1, "-1.0 sd"),
        (1.6, 1.4, "N·m/kg", None, "+14 %"),
        (-0.16, -0.2, "body wt", None, "+20 %"),
        (0.999, 1.0, "body wt", None, "+0 %"),
        (51.0, 49.5, "% cycle", None, "+1.5"),
        (1.0, 0.0, "J/kg", None, "+1.000 J/kg"),
        (0.215, -0.088, "J/kg", None, "+0.303 J/kg"),
        (3.66, 0.5, "ratio", None, "+3.160"),
        (1.4, 0.5, "J/kg", None, "+180 %"),
        (None, 1.0, "J/kg", None, ""),
        (1.0, None, "J/kg", None, ""),
    ],
)
def test_difference_has_the_unit_that_is_known(
    value: float | None, human: float | None, unit: str, deviation: float | None, expected: str
) -> None:
    assert _format_difference(value, human, unit, deviation, "+.3f") == expected


def test_reference_of_one_subject_is_not_called_people() -> None:
    assert shorten_reference_name(DEFAULT_NAME) == "human"
    assert "from people" in describe_deviations(DEFAULT_NAME)
    assert shorten_reference_name("me") == "me"
    assert len(shorten_reference_name("a-very-long-folder-name")) == MAX_NAME_CHARS
    assert "between the strides of this subject from 'me'" in describe_deviations("me")
