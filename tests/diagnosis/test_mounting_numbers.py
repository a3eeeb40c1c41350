"""Numbers of the mounting in an ankle: what stays where the lengths of the device are corrected."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.device.device import load_device
from klute_sim.diagnosis.device_file import augment_device
from klute_sim.diagnosis.fitting.dependent_numbers import (
    NEUTRAL_RATIO,
    RESTING_LENGTH,
    SLACK_LENGTH,
    compute_mounting_error,
    hold_mounting,
    move_mounting,
    replace_values,
)
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.number_error import NUMBER_ERROR_NAME
from klute_sim.diagnosis.remarks import describe_mounting_error

NOMINAL = load_device("klute-1-1-4-pair")
VALUES = NOMINAL.spec.collect_values()


def measure_mounting(values: dict[str, float]) -> float:
    return values[NEUTRAL_RATIO] * values[RESTING_LENGTH] + values[SLACK_LENGTH]


@given(st.floats(-3.0, 6.0), st.floats(-3.0, 3.0))
def test_device_file_holds_the_mounting(slack_error: float, length_error: float) -> None:
    corrected = {
        SLACK_LENGTH: VALUES[SLACK_LENGTH] + slack_error,
        RESTING_LENGTH: VALUES[RESTING_LENGTH] + length_error,
    }
    held = {**VALUES, **hold_mounting(VALUES, corrected)}
    assert measure_mounting(held) == pytest.approx(measure_mounting(VALUES))


def test_mounting_follows_lengths_only() -> None:
    assert hold_mounting(VALUES, {"muscle.c10_kpa": 100.0}) == {"muscle.c10_kpa": 100.0}
    own = {NEUTRAL_RATIO: 0.95}
    assert hold_mounting(VALUES, own) == own
    bench = {key: value for key, value in VALUES.items() if key != NEUTRAL_RATIO}
    assert hold_mounting(bench, {SLACK_LENGTH: 103.0}) == {SLACK_LENGTH: 103.0}
    assert hold_mounting(VALUES, {SLACK_LENGTH: 80.0})[NEUTRAL_RATIO] == 1.0  # the largest that a file may have


@given(st.floats(-5.0, 5.0), st.floats(-3.0, 3.0), st.floats(-0.01, 0.01))
def test_device_file_has_the_muscle_of_the_fit_at_a_neutral_ankle(slack: float, length: float, ratio: float) -> None:
    corrected = {
        SLACK_LENGTH: VALUES[SLACK_LENGTH] + slack,
        RESTING_LENGTH: VALUES[RESTING_LENGTH] + length,
        NEUTRAL_RATIO: VALUES[NEUTRAL_RATIO] + ratio,
    }
    fitted = replace_values(NOMINAL.spec, corrected)
    moved = move_mounting(fitted.to_parameters(), NOMINAL.spec, fitted)
    in_fit = measure_mounting(VALUES) - 1e3 * moved.tendon.slack_length
    in_file = {**VALUES, **hold_mounting(VALUES, corrected)}
    error = compute_mounting_error(VALUES, corrected)
    assert in_file[NEUTRAL_RATIO] * in_file[RESTING_LENGTH] == pytest.approx(in_fit + error, abs=1e-6)
    assert (error == 0.0) == (in_file[NEUTRAL_RATIO] < 1.0)


def test_mounting_that_no_file_can_state_is_reported() -> None:
    term = EffectTerm(NUMBER_ERROR_NAME, "value", number=SLACK_LENGTH)
    hypothesis = Hypothesis(NOMINAL, (), ()).with_term(term)

    def describe(x: float) -> list[str]:
        return describe_mounting_error(Fit(hypothesis, np.array([x]), np.zeros(1), np.eye(1), True, []))

    assert describe(1.5) == []
    (sentence,) = describe(-4.0)  # 8 mm
    assert "1.4 mm shorter at a neutral ankle" in sentence


def test_longer_mounting_is_a_shorter_tendon() -> None:
    parameters = NOMINAL.parameters
    assert move_mounting(parameters, NOMINAL.spec, NOMINAL.spec) == parameters  # to the last bit
    wider = replace_values(NOMINAL.spec, {NEUTRAL_RATIO: VALUES[NEUTRAL_RATIO] + 0.01})
    moved = move_mounting(parameters, NOMINAL.spec, wider)
    change = 0.01e-3 * VALUES[RESTING_LENGTH]
    assert moved.tendon.slack_length == pytest.approx(parameters.tendon.slack_length - change)
    assert moved._replace(tendon=parameters.tendon) == parameters


def test_written_device_has_the_corrected_slack_where_it_was_mounted() -> None:
    term = EffectTerm(NUMBER_ERROR_NAME, "value", number=SLACK_LENGTH)
    hypothesis = Hypothesis(NOMINAL, (), ()).with_term(term)
    fit = Fit(hypothesis, np.array([1.5]), np.zeros(1), np.eye(1), True, [])
    device = augment_device(fit, "a walk")
    values = device.spec.collect_values()
    assert values[SLACK_LENGTH] == pytest.approx(VALUES[SLACK_LENGTH] + 3.0)
    assert measure_mounting(values) == pytest.approx(measure_mounting(VALUES))
    assert "follows from the numbers" in device.spec.sources[NEUTRAL_RATIO]
