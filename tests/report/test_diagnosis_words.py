"""Numbers and sentences of a diagnosis, without one."""

import math

import pytest

from klute_sim.report import diagnosis_words as words


@pytest.mark.parametrize(
    ("numbers", "told"),
    [
        ((1.00034, 0.99991, 1.00112), ("1.0003", "0.9999", "1.0011")),  # 1, 0.9999 and 1.001 hid where between it is
        ((7.0, 6.912, 7.088), ("7.000", "6.912", "7.088")),
        ((41234.0, 41233.95, 41234.5), ("41234.00", "41233.95", "41234.50")),
        ((41234.0, 40000.0, 42000.0), ("41234", "40000", "42000")),
        ((0.0, 0.0, 0.02), ("0.00000", "0.00000", "0.02000")),
        ((1.0, 1.0, 1.0), ("1", "1", "1")),
        ((1.0, 0.5, math.inf), ("1", "0.5", "∞")),
        ((1.0, math.nan, math.nan), ("1", "unknown", "unknown")),
    ],
)
def test_a_value_and_its_interval_have_digits_enough(numbers: tuple[float, ...], told: tuple[str, ...]) -> None:
    assert words.told_apart(*numbers) == told
