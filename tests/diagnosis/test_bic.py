"""Change of BIC in words."""

import pytest

from klute_sim.diagnosis.fitting.bic import format_bic_drop


@pytest.mark.parametrize(
    ("drop", "text"),
    [
        (12.3, "falls by 12"),
        (0.6, "falls by 1"),
        (0.2, "does not change"),
        (-0.3, "does not change"),
        (-4.8, "rises by 5"),
    ],
)
def test_change_of_bic_has_no_signed_zero(drop: float, text: str) -> None:
    assert format_bic_drop(drop) == text


def test_decimals_are_those_asked_for() -> None:
    assert format_bic_drop(-3.24, 1) == "rises by 3.2"
    assert format_bic_drop(0.2, 1) == "falls by 0.2"
