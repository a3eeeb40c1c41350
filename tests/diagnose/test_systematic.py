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
from klute_sim.device.files import load
from klute_sim.diagnose import interval
from klute_sim.diagnose.experiment import Bench
from klute_sim.diagnose.fit import Evidence, Fit
from klute_sim.diagnose.hypothesis import Hypothesis
from klute_sim.diagnose.noise import measure
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
    each = [sum(f @ np.roll(m, k) for f, m in zip(follow, mean, strict=True)) for k in range(60)]
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
    assert unexplained([]) == 0.0


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


def test_intervals_of_walks_hold_what_could_have_been_done_otherwise(clean: datasets.Dataset) -> None:
    trials = [e for e in prepare(clean, datasets.split(clean)) if isinstance(e, OnGait) and e.use == "fit"]
    bench = Bench(1)
    evidence, found, solver = fitted(trials, bench)
    steps, smoothed = otherwise(evidence, found, solver)
    assert (steps > 0.0).all()
    # The whole of what refitting to the smoother motion would change, which a second fit there confirms.
    smoother = evidence.on([e.otherwise[0] for e in trials])
    (other,) = smoother.residuals(found.hypothesis, [found.steps])
    change = smoother.weighted(other) - evidence.weighted(found.residuals)
    assert smoothed == pytest.approx(np.abs(solver[:, : len(change)] @ change))
    bare = evidence.on([replace(e, smoother=e.inputs) for e in trials])
    assert otherwise(bare, found, solver)[1] == pytest.approx(np.zeros(1), abs=1e-12)
    common = unexplained(shared(evidence, found, solver))
    ((low, high),) = interval.intervals(evidence, found)
    unknown = found.hypothesis.unknowns[0]
    least = np.sqrt(steps**2 + smoothed**2 + common**2)[0]
    assert low < unknown.value(-least)
    assert high > unknown.value(least)
    bench.close()
