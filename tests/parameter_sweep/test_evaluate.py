"""Evaluation of one case: its metrics, its distances to the reference, its failures and its key."""

import math
from dataclasses import replace
from typing import Any

import pytest

from klute_sim.controllers.pressure import create_off_controller, load_default_profile
from klute_sim.device.device import load_device
from klute_sim.errors import KluteSimError, SimulationError
from klute_sim.gait import reference
from klute_sim.gait.assumed_deviations import assume_standard_deviations
from klute_sim.gait.rig import rig
from klute_sim.gait.subject import Subject
from klute_sim.parameter_sweep.evaluate import METRIC_COLUMNS, REFERENCE_DISTANCES, evaluate_case
from klute_sim.parameter_sweep.plan import GaitCase

HUMAN = reference.load_default_reference()
DEFAULT = GaitCase(
    device_name="device",
    device=load_device("klute-1-1-4-pair"),
    controller_name="profile",
    controller=load_default_profile(),
    subject=Subject(),
    strides=1,
    dt=1e-3,
)


def test_evaluation_returns_every_metric_in_the_order_of_the_table() -> None:
    result = evaluate_case(DEFAULT)
    assert result.failure is None
    assert tuple(result.metrics) == METRIC_COLUMNS
    assert None not in result.metrics.values()


@pytest.mark.parametrize(
    ("change", "has_distances"),
    [
        ({"dt": 7e-4}, True),
        ({"subject": Subject(speed=1.2)}, False),
        ({"subject": Subject(slope_deg=-3.0)}, False),
        ({"subject": Subject(reference=assume_standard_deviations(HUMAN, everywhere=True), speed=1.2)}, True),
        ({"subject": Subject(reference=assume_standard_deviations(HUMAN, everywhere=True), slope_deg=-3.0)}, True),
    ],
    ids=["reference speed with odd time step", "another speed", "downhill", "assumed speed", "assumed slope"],
)
def test_distances_exist_only_where_standard_deviations_are_measured_or_assumed(
    change: dict[str, Any], has_distances: bool
) -> None:
    metrics = evaluate_case(replace(DEFAULT, **change)).metrics
    assert [metrics[column] is not None for column in REFERENCE_DISTANCES] == [has_distances] * 3
    assert metrics["ankle_power_peak [W/kg]"] is not None


def test_unsuitable_device_is_a_failure_with_the_reason() -> None:
    result = evaluate_case(replace(DEFAULT, device=load_device("klute-3-4")))
    assert not result.metrics
    assert result.failure is not None
    assert result.failure.endswith("its file has no [tendon] section; did you mean 'klute-3-4-pair'?")


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (SimulationError("the gait rig left its path"), "the gait rig left its path"),
        (ZeroDivisionError("by zero"), "unexpected ZeroDivisionError: by zero"),
    ],
)
def test_error_in_the_simulation_is_a_failure_with_the_reason(
    error: Exception, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raise_error(*_: object) -> None:
        raise error

    monkeypatch.setattr(rig, "simulate_gait", raise_error)
    assert evaluate_case(DEFAULT).failure == reason


def test_memory_error_is_raised_and_not_a_failure_of_the_case(monkeypatch: pytest.MonkeyPatch) -> None:
    def raise_error(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(rig, "simulate_gait", raise_error)
    with pytest.raises(MemoryError):
        evaluate_case(DEFAULT)


def test_other_software_than_that_of_the_plan_is_refused() -> None:
    with pytest.raises(KluteSimError, match=r"runs other software .*\(mujoco"):
        evaluate_case(replace(DEFAULT, software={**DEFAULT.software, "mujoco": "0.1"}))


def test_key_depends_on_every_input_and_on_no_name() -> None:
    subjects = [
        Subject(speed=1.0),
        Subject(slope_deg=1.0),
        Subject(mass=math.nextafter(75.0, 76.0)),
        Subject(stature=1.8),
        Subject(reference=replace(HUMAN, digest="other")),
        Subject(reference=replace(HUMAN, stride_time=1.2)),
        Subject(reference=assume_standard_deviations(HUMAN, everywhere=True)),
    ]
    changed = [
        replace(DEFAULT, device=load_device("klute-1-1-4-pair-valve")),
        replace(DEFAULT, controller=create_off_controller()),
        *(replace(DEFAULT, subject=subject) for subject in subjects),
        replace(DEFAULT, strides=2),
        replace(DEFAULT, foot_stiffness=6.0),
        replace(DEFAULT, dt=5e-4),
        replace(DEFAULT, software={**DEFAULT.software, "code": "other"}),
    ]
    assert len({DEFAULT.key, *(case.key for case in changed)}) == 14
    renamed_subject = Subject(reference=replace(HUMAN, name="other"))
    names = {"device_name": "other", "controller_name": "other", "reference_name": "other"}
    renamed = replace(DEFAULT, subject=renamed_subject, **names)
    assert renamed.key == DEFAULT.key
