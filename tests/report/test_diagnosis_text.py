"""Formatting of numbers, identifiers and sentences in reports of diagnoses."""

import math

import pytest

from klute_sim.report.diagnosis import text as words


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        (
            (1.00034, 0.99991, 1.00112),
            ("1.0003", "0.9999", "1.0011"),
        ),  # four digits do not suffice
        ((7.0, 6.912, 7.088), ("7.000", "6.912", "7.088")),
        ((41234.0, 41233.95, 41234.5), ("41234.00", "41233.95", "41234.50")),
        ((41234.0, 40000.0, 42000.0), ("41234", "40000", "42000")),
        ((0.0, 0.0, 0.02), ("0.00000", "0.00000", "0.02000")),
        ((1.0, 1.0, 1.0), ("1", "1", "1")),
        ((1.0, 0.5, math.inf), ("1", "0.5", "∞")),
        ((1.0, math.nan, math.nan), ("1", "unknown", "unknown")),
    ],
)
def test_interval_has_enough_decimals_to_distinguish_its_numbers(
    numbers: tuple[float, ...], expected: tuple[str, ...]
) -> None:
    assert words.format_interval(*numbers) == expected


def test_keys_split_into_name_and_unit() -> None:
    assert words.split_key("stiffness_n_per_mm") == ("stiffness", "N/mm")
    assert words.split_key("damper.orifice_concentric_mm")[1] == "mm"


@pytest.mark.parametrize(
    ("value", "expected"),
    [(12.0956, "12.1"), (0.010694, "0.01069"), (118.4, "118.4"), (0.0, "0"), (829501.3, "829500"), (2e-7, "2.000e-07")],
)
def test_numbers_have_four_significant_digits(value: float, expected: str) -> None:
    assert words.format_number(value) == expected


def test_identifiers_in_sentences_are_humanized() -> None:
    assert words.format_sentence("braid_hysteresis (maxwell_slip) fits 'muscle_length'") == (
        "Braid hysteresis (Maxwell slip) fits 'muscle length'"
    )
    assert words.format_sentence("group 'my_sensor_gain_2' gets worse") == "Group 'my_sensor_gain_2' gets worse"
