"""Numbers and sentences of a diagnosis, without one."""

import math

import pytest

from klute_sim.report.diagnosis import text as words


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
    assert words.format_interval(*numbers) == told


def test_units_are_those_of_the_keys() -> None:
    assert words.split_key("stiffness_n_per_mm") == ("stiffness", "N/mm")
    assert words.split_key("damper.orifice_concentric_mm")[1] == "mm"


@pytest.mark.parametrize(
    ("value", "shown"),
    [(12.0956, "12.1"), (0.010694, "0.01069"), (118.4, "118.4"), (0.0, "0"), (829501.3, "829500"), (2e-7, "2.000e-07")],
)
def test_numbers_keep_four_digits(value: float, shown: str) -> None:
    assert words.format_number(value) == shown


def test_identifiers_in_sentences_are_spoken() -> None:
    assert words.format_sentence("braid_hysteresis (maxwell_slip) fits 'muscle_length'") == (
        "Braid hysteresis (Maxwell slip) fits 'muscle length'"
    )
    assert words.format_sentence("group 'my_sensor_gain_2' gets worse") == "Group 'my_sensor_gain_2' gets worse"
