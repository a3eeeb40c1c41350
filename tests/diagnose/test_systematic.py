"""What repeats share is in the intervals of walks, as large as it would be at any time, less the noise's part."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.stats import norm

sys.path.insert(0, str(Path(__file__).parent))
import gait_made

from klute_sim.dataset import dataset as datasets
from klute_sim.dataset.trial import Series
from klute_sim.device.files import load
from klute_sim.diagnose import interval
from klute_sim.diagnose.experiment import Bench
from klute_sim.diagnose.fit import Evidence, Fit, fit
from klute_sim.diagnose.hypothesis import Hypothesis
from klute_sim.diagnose.noise import measure
from klute_sim.diagnose.on_bench import OnBench
from klute_sim.diagnose.on_gait import OnGait
from klute_sim.diagnose.prepare import prepare
from klute_sim.diagnose.systematic import Shared, otherwise, shared, unexplained
from klute_sim.rigs.replay.prescribed import CUTOFF, prescribed

SURE = norm.ppf(0.975)


def drawn(random: np.random.Generator, *shape: int) -> np.ndarray:
    return np.asarray(gaussian_filter1d(random.normal(size=shape), 2.0, axis=-1, mode="wrap"))


def test_what_is_shared_counts_as_it_would_on_average_at_any_time() -> None:
    random = np.random.default_rng(1)
    follow, mean = drawn(random, 2, 3, 60), drawn(random, 2, 60)
    silent = [np.zeros((2, 60))] * 2
    each = []
    for k in range(-15, 16):  # what meets the trial, as if it were all of it
        here, there = slice(max(0, k), 60 + min(0, k)), slice(max(0, -k), 60 - max(0, k))
        each.append(60 / (60 - abs(k)) * sum(f[:, here] @ m[there] for f, m in zip(follow, mean, strict=True)))
    alone = unexplained([Shared(follow, mean, silent)])
    assert alone == pytest.approx(SURE * np.sqrt(np.mean(np.square(each), axis=0)), rel=1e-6)
    # It is wrong in the same sense in every group, so groups add up: no square root of two.
    assert unexplained([Shared(follow, mean, silent)] * 2) == pytest.approx(2.0 * np.asarray(alone))


def test_noise_alone_shares_nothing_on_average() -> None:
    random = np.random.default_rng(2)
    follow = drawn(random, 1, 4, 400)
    squares, noises = [], []
    for _ in range(400):
        rows = drawn(random, 2, 400)
        mean = rows.mean(axis=0)
        apart = np.sqrt(2.0) * (rows - mean)
        squares.append(np.square(unexplained([Shared(follow, [mean], [apart])]) / SURE))
        noises.append(np.square(unexplained([Shared(follow, [mean], [np.zeros((2, 400))])]) / SURE))
    # Half of the time chance leaves a little more than the noise explains.
    assert (np.mean(squares, axis=0) < 0.4 * np.mean(noises, axis=0)).all()


def test_a_bench_has_nothing_prepared() -> None:
    """So intervals there are as they were without this."""
    device, rest, time = load("klute-3-4-pair"), np.zeros(3), 0.01 * np.arange(40)
    rows = {"force": Series(time, np.sin(time))}
    trials = [OnBench(f"{k}", "g", "fit", device, 0.0, 0.01, rest, rows, unit_length=rest) for k in range(2)]
    residuals = [{"force": np.sin(time) + k * np.cos(9.0 * time)} for k in range(2)]
    evidence = Evidence(Bench(1), trials, measure(trials, residuals))
    hypothesis = Hypothesis(device, (("tendon.stiffness_1_n_per_mm", 6.0),), ())
    vector = np.append(evidence.weighted(residuals), 0.0)
    found = Fit(hypothesis, np.zeros(1), vector, np.ones((len(vector), 1)), True, residuals)
    solver = np.linalg.pinv(found.jacobian)
    assert otherwise(evidence, found, solver) == []
    assert shared(evidence, found, solver) == []
    assert unexplained([]) == 0.0
    evidence.bench.close()


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> datasets.Dataset:
    return datasets.read(gait_made.dataset(tmp_path_factory.mktemp("gait") / "clean"))


def fitted(trials: Sequence[OnGait], bench: Bench) -> tuple[Evidence, Fit, np.ndarray]:
    """At the nominal device, with the Jacobian of one number, and its pseudoinverse."""
    hypothesis = Hypothesis(load(gait_made.DEVICE), (("tendon.stiffness_1_n_per_mm", 6.0),), ())
    here, aside = np.zeros(1), np.full(1, 1e-3)
    found, moved = Evidence(bench, trials, {}).residuals(hypothesis, [here, aside])
    evidence = Evidence(bench, trials, measure(trials, found))
    vector, other = (np.append(evidence.weighted(each), at[0]) for each, at in ((found, here), (moved, aside)))
    jacobian = ((other - vector) / 1e-3)[:, np.newaxis]
    return evidence, Fit(hypothesis, here, vector, jacobian, True, found), np.linalg.pinv(jacobian)


def test_a_walk_is_prepared_otherwise_by_half_the_cutoff(clean: datasets.Dataset) -> None:
    trial = clean.trials[0]
    ready = prescribed(trial.prescribed, "trial", cutoff=0.5 * CUTOFF)
    one = next(e for e in prepare(clean, datasets.split(clean)) if isinstance(e, OnGait) and e.name == trial.name)
    (other,) = one.otherwise
    assert isinstance(other, OnGait)
    since = one.begin + one.step * np.arange(float(len(one.command)))
    assert other.inputs.turning == pytest.approx(ready.inputs(since).turning)
    assert not np.allclose(other.inputs.turning, one.inputs.turning, rtol=0.01)
    assert other.measured is one.measured
    assert other.command is one.command


def half_width(walk: OnGait, later: float) -> float:
    """Of one number that follows the stride, from two repeats, the second of which begins ``later`` strides later."""
    bench, hypothesis = Bench(1), Hypothesis(walk.device, (("tendon.stiffness_1_n_per_mm", 6.0),), ())
    trials, residuals, follow = [], [], []
    for number, begin in enumerate((0.0, later)):
        time = walk.begin + walk.strikes[0] + walk.usual * np.arange(begin, begin + 20.0, 0.01)
        trials.append(replace(walk, name=str(number), group="g", measured={"force": Series(time, np.zeros(len(time)))}))
        phase = 2.0 * np.pi * trials[-1].stride(time - walk.begin)
        residuals.append({"force": np.cos(phase) + 0.1 * np.sin(20.0 * phase + 2.0 * number)})
        follow.append({"force": np.sin(phase)})
    evidence = Evidence(bench, trials, measure(trials, residuals))
    jacobian = np.append(evidence.weighted(follow), 1.0)[:, np.newaxis]
    found = Fit(hypothesis, np.zeros(1), np.zeros(len(jacobian)), jacobian, True, residuals)
    bench.close()
    return float(unexplained(shared(evidence, found, np.linalg.pinv(jacobian)))[0])


def test_repeats_share_as_much_wherever_they_begin(clean: datasets.Dataset) -> None:
    walk = next(e for e in prepare(clean, datasets.split(clean)) if isinstance(e, OnGait))
    together = half_width(walk, 0.0)
    assert together > 0.5
    for later in (0.25, 0.5):
        assert half_width(walk, later) == pytest.approx(together, rel=0.1)


def test_intervals_of_walks_hold_what_could_have_been_done_otherwise(clean: datasets.Dataset) -> None:
    trials = [e for e in prepare(clean, datasets.split(clean)) if isinstance(e, OnGait) and e.use == "fit"]
    bench = Bench(1)
    evidence, found, solver = fitted(trials, bench)
    steps, smoothed = otherwise(evidence, found, solver)
    assert (steps > 0.0).all()
    # What a second fit, to the smoother motion, has otherwise.
    smoother = evidence.on([e.otherwise[0] for e in trials])
    one, other = (fit(each, found.hypothesis, fine=True).steps for each in (evidence, smoother))
    assert smoothed == pytest.approx(np.abs(other - one), rel=0.1)
    bare = evidence.on([replace(e, smoother=e.inputs) for e in trials])
    assert otherwise(bare, found, solver)[1] == pytest.approx(np.zeros(1), abs=1e-12)
    common = unexplained(shared(evidence, found, solver))
    ((low, high),) = interval.intervals(evidence, found)
    unknown = found.hypothesis.unknowns[0]
    least = np.sqrt(steps**2 + smoothed**2 + common**2)[0]
    assert low < unknown.value(-least)
    assert high > unknown.value(least)
    bench.close()
