"""One combination: its outcomes, when there is a human to compare with, and what is a row instead of an end."""

import math
from dataclasses import replace

import pytest

from klute_sim.controllers.pressure import create_off_controller, load_default_profile
from klute_sim.device.device import load_device
from klute_sim.errors import KluteSimError, SimulationError
from klute_sim.gait import reference
from klute_sim.gait.rig import rig
from klute_sim.parameter_sweep.evaluate import METRIC_COLUMNS, REFERENCE_DISTANCES, evaluate_case
from klute_sim.parameter_sweep.plan import GaitCase

DEFAULT = GaitCase(
    device_name="mine",
    device=load_device("klute-1-1-4-pair"),
    controller_name="profile",
    controller=load_default_profile(),
    speed=None,
    slope_deg=0.0,
    mass=75.0,
    strides=1,
    dt=1e-3,
)


def test_a_walk_has_every_outcome_in_the_order_of_the_table() -> None:
    walked = evaluate_case(DEFAULT)
    assert walked.failure is None
    assert tuple(walked.metrics) == METRIC_COLUMNS
    assert None not in walked.metrics.values()


@pytest.mark.parametrize(
    ("change", "compared"),
    [({"step": 7e-4}, True), ({"speed": 1.2}, False), ({"slope_deg": -3.0}, False)],
    ids=["own speed in odd steps", "another speed", "downhill"],
)
def test_humans_are_there_to_compare_with_on_the_level_at_their_own_speed(
    change: dict[str, float], compared: bool
) -> None:
    found = evaluate_case(replace(DEFAULT, **change)).metrics
    assert [found[heading] is not None for heading in REFERENCE_DISTANCES] == [compared] * 3
    assert found["ankle_power_peak [W/kg]"] is not None


def test_a_device_that_does_not_fit_is_a_reason() -> None:
    walked = evaluate_case(replace(DEFAULT, device=load_device("klute-3-4")))
    assert not walked.metrics
    assert walked.failure.endswith("its file has no [tendon] section; did you mean 'klute-3-4-pair'?")


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (SimulationError("the gait rig left its path"), "the gait rig left its path"),
        (ZeroDivisionError("by zero"), "unexpected ZeroDivisionError: by zero"),
    ],
)
def test_what_goes_wrong_in_a_walk_is_a_reason(error: Exception, reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr(rig, "simulate_gait", fails)
    assert evaluate_case(DEFAULT).failure == reason


def test_too_little_memory_says_nothing_about_the_combination(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(rig, "simulate_gait", fails)
    with pytest.raises(MemoryError):
        evaluate_case(DEFAULT)


def test_other_software_than_planned_is_refused() -> None:
    with pytest.raises(KluteSimError, match="other mujoco"):
        evaluate_case(replace(DEFAULT, software={**DEFAULT.software, "mujoco": "0.1"}))


def test_the_key_is_of_all_that_the_outcomes_depend_on_and_of_no_name() -> None:
    changed = [
        replace(DEFAULT, device=load_device("klute-1-1-4-pair-valve")),
        replace(DEFAULT, controller=create_off_controller()),
        replace(DEFAULT, speed=1.0),
        replace(DEFAULT, slope_deg=1.0),
        replace(DEFAULT, mass=math.nextafter(75.0, 76.0)),
        replace(DEFAULT, strides=2),
        replace(DEFAULT, stature=1.8),
        replace(DEFAULT, reference=replace(reference.load_default_reference(), digest="other")),
        replace(DEFAULT, reference=replace(reference.load_default_reference(), stride_time=1.2)),
        replace(DEFAULT, foot_stiffness=6.0),
        replace(DEFAULT, dt=5e-4),
        replace(DEFAULT, software={**DEFAULT.software, "code": "other"}),
    ]
    assert len({DEFAULT.key, *(each.key for each in changed)}) == 13
    renamed = replace(DEFAULT, device_name="other", controller_name="other", reference_name="other")
    assert renamed.key == DEFAULT.key
