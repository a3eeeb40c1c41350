"""Difference of a metric from people: in standard deviations, in percent, or in percent of the cycle."""

import pytest

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
        (1.0, 0.0, "J/kg", None, ""),
        (None, 1.0, "J/kg", None, ""),
        (1.0, None, "J/kg", None, ""),
    ],
)
def test_difference_has_the_unit_that_is_known(
    value: float | None, human: float | None, unit: str, deviation: float | None, expected: str
) -> None:
    assert _format_difference(value, human, unit, deviation) == expected
