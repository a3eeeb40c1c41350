"""The cut-off frequency of a filter is corrected where that alone explains the signals."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from klute_sim.datasets.dataset import Dataset, load_dataset, split_dataset
from klute_sim.diagnosis.command_interpolation import Outcome, Preparation
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.channel_filter import ChannelFilter
from klute_sim.diagnosis.experiments.low_pass import LowPassFilter
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.experiments.window_filter import WindowFilter
from klute_sim.diagnosis.filter_refinement import reconsider_filters, refine_filters
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.noise.filtered_noise import describe_low_pass_filters
from klute_sim.diagnosis.noise.misfit import has_misfit
from klute_sim.diagnosis.workflow import fit_base_device
from tests.diagnosis.synthetic_dataset import write_dataset

CUTOFF_HZ = 10.0
GROUPS = ("fit_1", "fit_2", "fit_3", "test_1")


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    simulator = Simulator(1)
    yield simulator
    simulator.close()


ZERO_LAG = LowPassFilter(CUTOFF_HZ, 2, 200.0)
AMPLIFIER = LowPassFilter(CUTOFF_HZ, 4, 200.0, "butterworth")


def filter_channels(e: Experiment, true_filter: ChannelFilter, assumed: ChannelFilter) -> Experiment:
    """Return ``e`` whose channels went through ``true_filter``, with another one assumed."""
    measured = {
        channel: true_filter.trim_ends(series._replace(value=true_filter.apply(series.time, series.value)))
        for channel, series in e.measured.items()
    }
    return replace(e, measured=measured, filters=dict.fromkeys(measured, assumed))


def refine(
    dataset: Dataset,
    simulator: Simulator,
    assumed: ChannelFilter,
    true_filter: ChannelFilter = ZERO_LAG,
    other: ChannelFilter | None = None,
) -> tuple[Preparation, Preparation]:
    experiments = [e for e in prepare_experiments(dataset, split_dataset(dataset)) if e.use == "fit"]

    def prepare(trials: list[Experiment]) -> Preparation:
        fit, data = fit_base_device(dataset, trials, simulator)
        return Preparation(trials, data, fit, [])

    before = prepare([filter_channels(e, true_filter, assumed) for e in experiments])
    channels = experiments[0].measured
    return before, refine_filters(before, prepare, [] if other is None else [dict.fromkeys(channels, other)])


def get_filter(preparation: Preparation) -> ChannelFilter:
    (found,) = {each for e in preparation.experiments for each in e.filters.values()}
    return found


@pytest.mark.parametrize("assumed_cutoff", [pytest.param(8.0, marks=pytest.mark.slow), 12.0])
def test_signals_correct_the_cutoff(tmp_path: Path, simulator: Simulator, assumed_cutoff: float) -> None:
    dataset = load_dataset(write_dataset(tmp_path / "data", groups=GROUPS))
    before, after = refine(dataset, simulator, replace(ZERO_LAG, cutoff=assumed_cutoff))
    assert after is not before
    assert get_filter(after).cutoff == pytest.approx(CUTOFF_HZ, rel=0.04)
    (sentence,) = describe_low_pass_filters(after.experiments, {})
    assert f"'force' ({get_filter(after).cutoff:.2g} Hz)" in sentence


@pytest.mark.parametrize("assumed_cutoff", [pytest.param(10.15, marks=pytest.mark.slow), 10.2])
def test_signals_correct_a_cutoff_that_leaves_no_misfit(
    tmp_path: Path, simulator: Simulator, assumed_cutoff: float
) -> None:
    """A cut-off frequency of 11 Hz for 10 Hz agreed with the fitted trials of a joint, and not with its test trials."""
    dataset = load_dataset(write_dataset(tmp_path / "data", groups=GROUPS))
    before, after = refine(dataset, simulator, replace(ZERO_LAG, cutoff=assumed_cutoff))
    assert not has_misfit(before.experiments, before.base_fit.residuals, before.data.noise)
    assert get_filter(after).cutoff == pytest.approx(CUTOFF_HZ, rel=0.005)


def test_right_cutoff_stays(tmp_path: Path, simulator: Simulator) -> None:
    before, after = refine(load_dataset(write_dataset(tmp_path / "data", groups=GROUPS)), simulator, ZERO_LAG)
    assert after is before


def test_missing_effect_does_not_move_the_cutoff(tmp_path: Path, simulator: Simulator) -> None:
    data = write_dataset(tmp_path / "data", groups=GROUPS, distort={"force": lambda time, force: 1.05 * force})
    before, after = refine(load_dataset(data), simulator, replace(ZERO_LAG, cutoff=8.0))
    assert after is before


@pytest.mark.slow
@pytest.mark.parametrize("force_gain", [1.0, 1.05])
@pytest.mark.parametrize(
    ("is_aligned", "sentence_end"),
    [(False, "has their delay, too."), (True, "were subtracted.")],
)
def test_signals_show_the_delay(
    tmp_path: Path, simulator: Simulator, force_gain: float, is_aligned: bool, sentence_end: str
) -> None:
    data = write_dataset(tmp_path / "data", groups=GROUPS, distort={"force": lambda time, force: force_gain * force})
    true_filter = replace(AMPLIFIER, is_aligned=is_aligned)
    before, after = refine(load_dataset(data), simulator, ZERO_LAG, true_filter, AMPLIFIER)
    assert not get_filter(before).has_delay
    found = get_filter(after)
    assert (found.kind, found.order, found.is_aligned) == ("butterworth", 4, is_aligned)
    assert found.cutoff == pytest.approx(CUTOFF_HZ, rel=0.03)
    (sentence,) = describe_low_pass_filters(after.experiments, {})
    assert f"Hz, delay {1e3 * found.delay:.3g} ms" in sentence
    assert sentence.endswith(sentence_end)


@pytest.mark.slow
@pytest.mark.parametrize("is_trailing", [False, True])
def test_signals_show_whether_a_window_is_trailing(tmp_path: Path, simulator: Simulator, is_trailing: bool) -> None:
    data = write_dataset(tmp_path / "data", groups=GROUPS)
    centred, trailing = (WindowFilter(20, 200.0, is_trailing=each) for each in (False, True))
    true, other = (trailing, centred) if is_trailing else (centred, trailing)
    _, after = refine(load_dataset(data), simulator, centred, true, trailing)
    assert get_filter(after) == true
    _, after = refine(load_dataset(data), simulator, other, true, true)
    assert get_filter(after) == true


def test_inputs_that_were_averaged_alike_leave_no_filter(tmp_path: Path, simulator: Simulator) -> None:
    """Averaged inputs move the simulation as averaged signals move, so a filter would act twice."""
    dataset = load_dataset(write_dataset(tmp_path / "data", groups=GROUPS))
    window = WindowFilter(40, 200.0)
    experiments = [e for e in prepare_experiments(dataset, split_dataset(dataset)) if e.use == "fit"]

    def prepare(trials: list[Experiment]) -> Preparation:
        fit, weighted = fit_base_device(dataset, trials, simulator)
        return Preparation(trials, weighted, fit, [])

    before = prepare([replace(e, filters=dict.fromkeys(e.measured, window)) for e in experiments])
    after = refine_filters(
        before, prepare, [dict.fromkeys(experiments[0].measured, replace(window, is_trailing=True)), {}]
    )
    assert all(e.filters == {} for e in after.experiments)
    (sentence,) = describe_low_pass_filters(after.experiments, {"force": window})
    assert "'force' (moving average of 40 samples)" in sentence
    assert "agree better with an unfiltered simulation" in sentence


@pytest.mark.slow
def test_filter_without_delay_keeps_none(tmp_path: Path, simulator: Simulator) -> None:
    data = write_dataset(tmp_path / "data", groups=GROUPS, distort={"force": lambda time, force: 1.05 * force})
    before, after = refine(load_dataset(data), simulator, ZERO_LAG, ZERO_LAG, AMPLIFIER)
    assert after is before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("verdict", "is_late", "verdict_after", "is_taken"),
    [
        pytest.param("identified", True, "identified", True, id="clock in place of a window"),
        pytest.param(
            "unexplained", True, "nothing-missing", True, id="nothing explains the window", marks=pytest.mark.slow
        ),
        pytest.param(
            "identified", True, "unexplained", False, id="no model with the other window", marks=pytest.mark.slow
        ),
        pytest.param("identified", False, "identified", False, id="no clock is named"),
    ],
)
def test_named_clock_of_a_filtered_channel_may_be_its_window(
    tmp_path: Path, simulator: Simulator, verdict: str, is_late: bool, verdict_after: str, is_taken: bool
) -> None:
    """Beside a missing lag, a centred window was taken for a trailing one, and a clock 24 ms early was named."""
    dataset = load_dataset(write_dataset(tmp_path / "data", groups=GROUPS))
    centred, trailing = (WindowFilter(20, 200.0, is_trailing=each) for each in (False, True))
    experiments = [e for e in prepare_experiments(dataset, split_dataset(dataset)) if e.use == "fit"]
    searched: list[Preparation] = []

    def prepare(trials: list[Experiment]) -> Preparation:
        fit, data = fit_base_device(dataset, trials, simulator)
        return Preparation(trials, data, fit, [])

    def make_outcome(prepared: Preparation, fit: Fit, verdict: str) -> Any:
        selected = SimpleNamespace(verdict=verdict, final_fit=fit, data=prepared.data)
        return Outcome(prepared.experiments, prepared.data, cast(Any, None), prepared.base_fit, cast(Any, selected), [])

    def search_model(prepared: Preparation) -> Outcome:
        searched.append(prepared)
        return make_outcome(prepared, prepared.base_fit, verdict_after)

    before = prepare([filter_channels(e, centred, trailing) for e in experiments])
    late = before.base_fit.hypothesis.with_term(EffectTerm("clock_skew", "linear", "force"))
    fit = fit_hypothesis(before.data, late) if is_late else before.base_fit
    outcome = make_outcome(before, fit, verdict)
    permitted = [dict.fromkeys(experiments[0].measured, each) for each in (trailing, centred)]
    after = reconsider_filters(outcome, prepare, search_model, permitted)
    assert (after is not outcome) == is_taken
    if is_late:
        assert get_filter(searched[0]) == centred
    else:
        assert searched == []


def test_channels_without_filter_stay(tmp_path: Path, simulator: Simulator) -> None:
    data = write_dataset(tmp_path / "data", groups=GROUPS, distort={"force": lambda time, force: 1.05 * force})
    dataset = load_dataset(data)
    experiments = [e for e in prepare_experiments(dataset, split_dataset(dataset)) if e.use == "fit"]
    fit, weighted = fit_base_device(dataset, experiments, simulator)
    preparation = Preparation(experiments, weighted, fit, [])
    assert refine_filters(preparation, lambda trials: pytest.fail("nothing to prepare"), []) is preparation
    assert describe_low_pass_filters(experiments, {}) == []
    assert np.isfinite(fit.chi2)
