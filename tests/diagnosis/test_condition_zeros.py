"""A zero that differs between conditions on the bench is told, and nothing else is taken for one."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.diagnosis import condition_registration
from klute_sim.diagnosis.condition_registration import describe_condition_zeros
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.workflow import fit_base_device
from tests.diagnosis.synthetic_dataset import write_dataset

GROUPS = ("fit_1", "fit_2", "fit_3", "test_1")
ERRORS = {"fit_1": 1.0, "fit_2": -1.5, "fit_3": 0.4}


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    simulator = Simulator(1)
    yield simulator
    simulator.close()


def shift_reading(channel: str, size: float) -> Callable[[Experiment], Experiment]:
    def shift(e: Experiment) -> Experiment:
        series = e.measured[channel]
        shifted = series._replace(value=series.value + size * ERRORS[e.group])
        return replace(e, measured={**e.measured, channel: shifted})

    return shift


def shift_length(e: Experiment) -> Experiment:
    return replace(e, unit_length=e.unit_length + 3e-4 * ERRORS[e.group])


def describe(
    folder: Path, simulator: Simulator, change: Callable[[Experiment], Experiment], n_groups: int = 3, **options: object
) -> list[str]:
    dataset = load_dataset(write_dataset(folder, groups=(*GROUPS[:n_groups], "test_1"), **options))
    experiments = [e for e in prepare_experiments(dataset, split_dataset(dataset)) if e.use == "fit"]
    fit, data = fit_base_device(dataset, [change(e) for e in experiments], simulator)
    return describe_condition_zeros(data, fit)


@pytest.mark.parametrize(
    ("change", "channel", "unit", "size"),
    [
        (shift_reading("force", 6.0), "force", "N", 6.0),
        (shift_reading("pressure", 2e3), "pressure", "bar", 0.02),
        (shift_length, "length", "mm", 0.3),
    ],
)
def test_zeros_are_told(
    tmp_path: Path,
    simulator: Simulator,
    change: Callable[[Experiment], Experiment],
    channel: str,
    unit: str,
    size: float,
) -> None:
    (sentence,) = describe(tmp_path / "data", simulator, change)
    assert sentence.startswith(f"A zero of '{channel}' of its own")
    found = re.findall(rf"([-+][\d.]+) {unit} in '(\w+)'", sentence)
    assert [group for _, group in found] == list(ERRORS)
    values = np.array([float(value) for value, _ in found])
    assert np.diff(values) == pytest.approx(size * np.diff(list(ERRORS.values())), rel=0.15)


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({}, marks=pytest.mark.slow),
        {"distort": {"force": lambda time, force: 1.05 * force}},
        pytest.param(
            {"distort": {"force": lambda time, force: np.interp(time - 0.02, time, force)}}, marks=pytest.mark.slow
        ),
        {"effects": {("muscle_damping", "viscous"): {"damping_n_s_per_m": 400.0}}},
    ],
    ids=["nothing", "gain", "lag", "damping"],
)
def test_other_errors_are_no_zeros(tmp_path: Path, simulator: Simulator, options: dict[str, object]) -> None:
    assert describe(tmp_path / "data", simulator, lambda e: e, **options) == []


def test_zeros_larger_than_the_range_are_another_mistake(
    tmp_path: Path, simulator: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Forces in kgf that were declared in lbf would need zeros of the length beyond the stroke."""
    monkeypatch.setattr(condition_registration, "MAX_ZERO_FRACTION", 1e-3)
    assert describe(tmp_path / "data", simulator, shift_reading("force", 6.0)) == []


def test_two_conditions_are_too_few(tmp_path: Path, simulator: Simulator) -> None:
    assert describe(tmp_path / "data", simulator, shift_reading("force", 6.0), n_groups=2) == []
