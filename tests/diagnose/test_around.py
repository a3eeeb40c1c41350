"""What is around the search: checks of the data, places, kept fits, proposed experiments, the score."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made import dataset

from klute_sim.dataset import dataset as datasets
from klute_sim.dataset.trial import Series
from klute_sim.device.files import load
from klute_sim.diagnose import check
from klute_sim.diagnose.diagnosis import Options, base_fit, diagnose
from klute_sim.diagnose.equations import equations
from klute_sim.diagnose.equations import lacking as lacks
from klute_sim.diagnose.experiment import Bench
from klute_sim.diagnose.fit import Evidence, fit
from klute_sim.diagnose.hypothesis import Hypothesis, Term
from klute_sim.diagnose.locate import locate
from klute_sim.diagnose.on_bench import OnBench
from klute_sim.diagnose.prepare import prepare
from klute_sim.diagnose.propose import CHANGES, propose
from klute_sim.diagnose.store import Store

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks" / "hidden_effects"))


@pytest.fixture(autouse=True)
def kept_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KLUTE_SIM_CACHE", str(tmp_path / "cache"))


def experiment(name: str, force: np.ndarray, group: str = "g", moving: bool = True) -> OnBench:
    count = 2000
    wave = np.sin(np.arange(count) / 100) if moving else np.zeros(count)
    time = np.arange(len(force)) * (0.5 / len(force)) + 1e-3
    length, command, measured = 0.34 + 0.005 * wave, 2.5e5 + 2e5 * wave, {"force": Series(time, force)}
    return OnBench(name, group, "fit", load("klute-3-4-pair"), 0.0, 2.5e-4, command, measured, unit_length=length)


def test_what_cannot_answer_is_told_with_the_mend() -> None:
    random = np.random.default_rng(0)
    good = [experiment(n, random.normal(size=200)) for n in "ab"] * 4
    assert check.obstacles(good) == []
    (alone,) = check.blind([replace(e, group=str(k)) for k, e in enumerate(good)])
    assert "Record every input at least twice" in alone
    (short,) = check.obstacles(good[:2])
    assert "last 1.0 s together" in short
    (still,) = check.obstacles([experiment(n, random.normal(size=200), moving=False) for n in "ab"] * 4)
    assert still.startswith("Nothing moves")
    (nothing,) = check.obstacles([replace(e, measured={"pressure": e.measured["force"]}) for e in good])
    assert nothing.startswith("Neither force nor muscle length")
    assert check.blind(good) == []
    assert len(check.blind([experiment("a", np.zeros(20), moving=False)])) == 3  # neither moves, nor is it repeated


def test_dead_and_saturated_channels_are_seen() -> None:
    random = np.random.default_rng(0)
    dead = [experiment(n, np.full(200, 7.0)) for n in "ab"]
    unusable, _ = check.faults(dead)
    assert unusable == {"force": "'force' always shows 7 N: the channel is dead"}
    assert check.without(dead, {("a", "force")})[0].measured == {}
    assert check.without(dead, {("a", "force")})[1].measured
    clipped = [experiment(n, np.minimum(random.normal(0.0, 3.0, 200), 2.0)) for n in "ab"]
    unusable, remarks = check.faults(clipped)
    assert unusable == {}
    assert "shows exactly 2 N in" in remarks[0]
    kept = check.unsaturated(clipped, clipped)[0].measured["force"]
    assert kept.value.max() < 2.0
    assert len(kept.time) == len(kept.value)
    assert check.faults([experiment("a", random.normal(size=200))]) == ({}, [])
    # Coarse digits stand still everywhere, and a vented gauge at zero: neither is saturated.
    coarse = np.round(8.0 * np.sin(np.arange(400) / 40.0))
    assert check.faults([experiment("a", coarse)]) == ({}, [])
    assert check.faults([experiment("a", np.abs(random.normal(size=200)) * (np.arange(200) > 80))]) == ({}, [])
    few = random.normal(0.0, 3.0, 5000)  # 12 of 5000: less than one in a hundred
    ceiling = np.sort(few)[-12]
    assert "12 of 5000 samples" in check.faults([experiment("a", np.minimum(few, ceiling))])[1][0]


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> tuple[datasets.Dataset, Evidence]:
    """Data whose pressure sensor shows 5 % too much."""
    folder = tmp_path_factory.mktemp("data") / "d"
    data = datasets.read(dataset(folder, distort={"pressure": lambda time, value: 1.05 * value}))
    fitted = [e for e in prepare(data, datasets.split(data)) if e.use == "fit"]
    return data, base_fit(data, fitted, Bench(2))[1]


def test_the_place_of_a_misfit_is_found(material: tuple[datasets.Dataset, Evidence]) -> None:
    data, evidence = material
    base, _ = base_fit(data, evidence.experiments, evidence.bench)
    first, *_ = locate(evidence, base)
    assert first.channel == "pressure"
    assert first.region.startswith("above ")
    assert first.region.endswith("bar")  # 5 % of more is more
    assert first.concentration > 1.3
    assert 0.5 < first.share <= 1.0


def test_another_rig_is_proposed_where_no_command_helps(material: tuple[datasets.Dataset, Evidence]) -> None:
    data, both = material
    # The gauge alone: without a force, a regulator that is off by as much looks the same whatever is commanded.
    alone = check.without(both.experiments, check.everywhere(both.experiments, ["force"]))
    base, evidence = base_fit(data, alone, both.bench)
    sensor = fit(evidence, base.hypothesis.plus(Term("sensor_gain", "linear", "pressure")))
    assert sensor.values[-1] == pytest.approx(1.05, abs=0.002)
    regulator = fit(evidence, base.hypothesis.plus(Term("regulator_error", "gain")))
    found = propose(evidence, data.device, sensor, regulator)
    assert found.separation > 100.0
    assert found.change == CHANGES[0]  # how fast the gauge rises tells them apart, with noise as little as this
    noisy = {channel: own._replace(deviation=30.0 * own.deviation) for channel, own in evidence.noise.items()}
    loud = propose(replace(evidence, noise=noisy), data.device, sensor, regulator)
    # Then the muscle's own length shows what pressure there really is; a second gauge would, too, if less clearly.
    assert loud.change.added == ("muscle_length",)
    assert loud.as_json()["rig_change"] == "with a sensor for the muscle's own length"
    assert loud.change.words in loud.as_json()["sentence"]
    assert loud.separation > 100.0 * found.separation / 30.0**2
    told = found.as_json()
    assert f"'{told['protocol']}' twice" in told["sentence"]
    same = propose(evidence, data.device, sensor, sensor)
    assert same.separation < 1e-6
    assert "No protocol or change of the rig that is known separates these" in same.as_json()["sentence"]


def test_finished_fits_are_kept_until_they_are_used(
    material: tuple[datasets.Dataset, Evidence], monkeypatch: pytest.MonkeyPatch
) -> None:
    data, evidence = material
    on = Evidence(evidence.bench, evidence.experiments, evidence.noise, Store("these data"))
    hypothesis = base_fit(data, evidence.experiments, evidence.bench)[0].hypothesis
    first, before = fit(on, hypothesis), evidence.bench.rollouts
    again = fit(on, hypothesis)
    assert evidence.bench.rollouts - before <= 2 * len(evidence.experiments)  # one look at the solution, at most
    assert np.array_equal(first.steps, again.steps)
    assert np.array_equal(first.vector, again.vector)
    assert np.array_equal(first.jacobian, again.jacobian)
    assert fit(on, hypothesis, np.array([0.5, 0.0])).steps == pytest.approx(first.steps, abs=0.02)
    assert evidence.bench.rollouts - before > 3 * len(evidence.experiments)  # another start is another question
    store = Store("other data")
    assert store.get("anything") is None

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as context:
        context.setattr(np, "savez", full)
        store.put("anything", x=np.zeros(3))
    assert store.get("anything") is None
    assert list(store._folder.iterdir()) == []
    store.put("anything", x=np.arange(3.0))
    assert store.get("anything")["x"].tolist() == [0.0, 1.0, 2.0]
    store._file("anything").write_bytes(b"half a file")
    assert store.get("anything") is None
    store.forget()
    assert not store._folder.exists()


def test_an_interrupted_diagnosis_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = datasets.read(dataset(tmp_path / "d", {("seal_friction", "coulomb"): {"force_n": 30.0}}, seconds=2.0))
    options = Options(only=("seal_friction", "muscle_damping"))
    whole = diagnose(data, options)

    def interrupt(sentence: str) -> None:
        if sentence == "looking for rivals":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        diagnose(data, options, interrupt)
    resumed = diagnose(data, options)
    assert resumed.verdict == whole.verdict == "named"
    assert resumed.final.values == whole.final.values
    assert resumed.intervals == whole.intervals
    assert resumed.rollouts < 0.5 * whole.rollouts
    assert list((tmp_path / "cache" / "diagnose").iterdir()) == []  # used, and gone


def test_without_selection_trials_every_group_is_left_out_once(tmp_path: Path) -> None:
    data = datasets.read(
        dataset(
            tmp_path / "d", {("seal_friction", "coulomb"): {"force_n": 30.0}}, groups=("fit_1", "fit_2"), seconds=2.0
        )
    )
    found = diagnose(data, Options(only=("seal_friction", "sensor_drift")))
    assert found.verdict == "named"
    assert found.shown_on == "fit"
    assert set(found.steps[0].gains) == {"fit_1", "fit_2"}
    assert min(found.steps[0].gains.values()) > 0.3


@pytest.mark.parametrize(
    ("hidden", "lacking"),
    [
        ({}, ()),
        ({("pressure_delay", "dead_time"): {"delay_s": 0.03}}, ("supply",)),
        ({("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}}, ("muscle and damper",)),
        ({("threshold_pressure", "constant"): {"pressure_bar": 0.5}}, ("muscle and damper",)),
        ({("tendon_slack", "dead_length"): {"slack_mm": 2.0}}, ("tendon",)),
    ],
    ids=["nothing", "delay", "braid", "threshold", "slack"],
)
@pytest.mark.parametrize("length", [True, False], ids=["length", "no-length"])
def test_the_equation_that_lacks_something_is_found(
    hidden: dict, lacking: tuple[str, ...], length: bool, tmp_path: Path
) -> None:
    """Measured pressure, force and length are put into each equation of the true device without its effect."""
    data, bench = datasets.read(dataset(tmp_path / "d", hidden, muscle_length=length)), Bench(2)
    fitted = [e for e in prepare(data, datasets.split(data)) if e.use == "fit"]
    _, evidence = base_fit(data, fitted, bench)
    terms = tuple(Term(*key) for key in hidden)
    found = fit(evidence, Hypothesis(data.device, tuple(data.uncertain.items()), (), terms))
    every = equations(evidence, found)
    rows = {each.name: each for each in every}
    wholes = {"supply", "muscle and damper", "tendon"} if length else {"supply", "muscle, damper or tendon"}
    assert set(rows) == wholes
    wanted = {name if length or name == "supply" else "muscle, damper or tendon" for name in lacking}
    assert {each.name for each in lacks(every)} == wanted, rows
    if wanted:
        assert next(iter(rows)) in wanted
