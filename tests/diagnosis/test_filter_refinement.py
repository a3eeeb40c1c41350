"""The cut-off frequency of a filter is corrected where that alone explains the signals."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import Dataset, load_dataset, split_dataset
from klute_sim.diagnosis.command_interpolation import Preparation
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.low_pass import LowPassFilter
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.filter_refinement import refine_filters
from klute_sim.diagnosis.noise.filtered_noise import describe_low_pass_filters
from klute_sim.diagnosis.workflow import fit_base_device
from tests.diagnosis.synthetic_dataset import write_dataset

CUTOFF_HZ = 10.0
GROUPS = ("fit_1", "fit_2", "fit_3", "test_1")


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    simulator = Simulator(1)
    yield simulator
    simulator.close()


def filter_channels(e: Experiment, assumed_cutoff: float) -> Experiment:
    """Return ``e`` whose channels went through a filter, with another cut-off frequency [Hz] assumed."""
    true_filter = LowPassFilter(CUTOFF_HZ, 2, 200.0)
    measured = {
        channel: true_filter.trim_ends(series._replace(value=true_filter.apply(series.time, series.value)))
        for channel, series in e.measured.items()
    }
    return replace(e, measured=measured, filters=dict.fromkeys(measured, LowPassFilter(assumed_cutoff, 2, 200.0)))


def refine(dataset: Dataset, simulator: Simulator, assumed_cutoff: float) -> tuple[Preparation, Preparation]:
    experiments = [e for e in prepare_experiments(dataset, split_dataset(dataset)) if e.use == "fit"]

    def prepare(trials: list[Experiment]) -> Preparation:
        fit, data = fit_base_device(dataset, trials, simulator)
        return Preparation(trials, data, fit, [])

    before = prepare([filter_channels(e, assumed_cutoff) for e in experiments])
    return before, refine_filters(before, prepare)


@pytest.mark.parametrize("assumed_cutoff", [8.0, 12.0])
def test_signals_correct_the_cutoff(tmp_path: Path, simulator: Simulator, assumed_cutoff: float) -> None:
    dataset = load_dataset(write_dataset(tmp_path / "data", groups=GROUPS))
    before, after = refine(dataset, simulator, assumed_cutoff)
    assert after is not before
    cutoffs = {each.cutoff for e in after.experiments for each in e.filters.values()}
    assert len(cutoffs) == 1
    assert min(cutoffs) == pytest.approx(CUTOFF_HZ, rel=0.04)
    (sentence,) = describe_low_pass_filters(after.experiments)
    assert f"'force' ({min(cutoffs):.2g} Hz)" in sentence


def test_right_cutoff_stays(tmp_path: Path, simulator: Simulator) -> None:
    before, after = refine(load_dataset(write_dataset(tmp_path / "data", groups=GROUPS)), simulator, CUTOFF_HZ)
    assert after is before


def test_missing_effect_does_not_move_the_cutoff(tmp_path: Path, simulator: Simulator) -> None:
    data = write_dataset(tmp_path / "data", groups=GROUPS, distort={"force": lambda time, force: 1.05 * force})
    before, after = refine(load_dataset(data), simulator, 8.0)
    assert after is before


def test_channels_without_filter_stay(tmp_path: Path, simulator: Simulator) -> None:
    data = write_dataset(tmp_path / "data", groups=GROUPS, distort={"force": lambda time, force: 1.05 * force})
    dataset = load_dataset(data)
    experiments = [e for e in prepare_experiments(dataset, split_dataset(dataset)) if e.use == "fit"]
    fit, weighted = fit_base_device(dataset, experiments, simulator)
    preparation = Preparation(experiments, weighted, fit, [])
    assert refine_filters(preparation, lambda trials: pytest.fail("nothing to prepare")) is preparation
    assert describe_low_pass_filters(experiments) == []
    assert np.isfinite(fit.chi2)
