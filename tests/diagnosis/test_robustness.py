"""What is around the search: checks of the data, places, kept fits, proposed experiments, the score."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import Series
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments import data_quality
from klute_sim.diagnosis.experiments.base import Simulator
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.fitting.fit_cache import FitCache
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import WeightedData, fit_hypothesis
from klute_sim.diagnosis.planning.proposals import RIG_CHANGES, propose_experiment
from klute_sim.diagnosis.selection.equation_residuals import compute_equation_residuals
from klute_sim.diagnosis.selection.equation_residuals import select_significant_equations as lacks
from klute_sim.diagnosis.selection.localization import locate_misfit
from klute_sim.diagnosis.workflow import DiagnosisOptions, diagnose, fit_base_device
from tests.diagnosis.synthetic_dataset import dataset


@pytest.fixture(autouse=True)
def kept_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KLUTE_SIM_CACHE", str(tmp_path / "cache"))


def experiment(name: str, force: np.ndarray, group: str = "g", moving: bool = True) -> BenchExperiment:
    count = 2000
    wave = np.sin(np.arange(count) / 100) if moving else np.zeros(count)
    time = np.arange(len(force)) * (0.5 / len(force)) + 1e-3
    length, command, measured = 0.34 + 0.005 * wave, 2.5e5 + 2e5 * wave, {"force": Series(time, force)}
    return BenchExperiment(
        name, group, "fit", load_device("klute-3-4-pair"), 0.0, 2.5e-4, command, measured, unit_length=length
    )


def test_what_cannot_answer_is_told_with_the_mend() -> None:
    random = np.random.default_rng(0)
    good = [experiment(n, random.normal(size=200)) for n in "ab"] * 4
    assert data_quality.find_blocking_problems(good) == []
    (alone,) = data_quality.find_limitations([replace(e, group=str(k)) for k, e in enumerate(good)])
    assert "Record every input at least twice" in alone
    (short,) = data_quality.find_blocking_problems(good[:2])
    assert "last 1.0 s together" in short
    (still,) = data_quality.find_blocking_problems(
        [experiment(n, random.normal(size=200), moving=False) for n in "ab"] * 4
    )
    assert still.startswith("Nothing moves")
    (nothing,) = data_quality.find_blocking_problems(
        [replace(e, measured={"pressure": e.measured["force"]}) for e in good]
    )
    assert nothing.startswith("Neither force nor muscle length")
    assert data_quality.find_limitations(good) == []
    assert (
        len(data_quality.find_limitations([experiment("a", np.zeros(20), moving=False)])) == 3
    )  # neither moves, nor is it repeated


def test_dead_and_saturated_channels_are_seen() -> None:
    random = np.random.default_rng(0)
    dead = [experiment(n, np.full(200, 7.0)) for n in "ab"]
    unusable, _ = data_quality.find_faulty_channels(dead)
    assert unusable == {"force": "'force' always shows 7 N: the channel is dead"}
    assert data_quality.remove_channels(dead, {("a", "force")})[0].measured == {}
    assert data_quality.remove_channels(dead, {("a", "force")})[1].measured
    clipped = [experiment(n, np.minimum(random.normal(0.0, 3.0, 200), 2.0)) for n in "ab"]
    unusable, remarks = data_quality.find_faulty_channels(clipped)
    assert unusable == {}
    assert "shows exactly 2 N in" in remarks[0]
    kept = data_quality.remove_saturated_samples(clipped, clipped)[0].measured["force"]
    assert kept.value.max() < 2.0
    assert len(kept.time) == len(kept.value)
    assert data_quality.find_faulty_channels([experiment("a", random.normal(size=200))]) == ({}, [])
    # Coarse digits stand still everywhere, and a vented gauge at zero: neither is saturated.
    coarse = np.round(8.0 * np.sin(np.arange(400) / 40.0))
    assert data_quality.find_faulty_channels([experiment("a", coarse)]) == ({}, [])
    assert data_quality.find_faulty_channels(
        [experiment("a", np.abs(random.normal(size=200)) * (np.arange(200) > 80))]
    ) == (
        {},
        [],
    )
    few = random.normal(0.0, 3.0, 5000)  # 12 of 5000: less than one in a hundred
    ceiling = np.sort(few)[-12]
    assert "12 of 5000 samples" in data_quality.find_faulty_channels([experiment("a", np.minimum(few, ceiling))])[1][0]


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> tuple[datasets.Dataset, WeightedData]:
    """Data whose pressure sensor shows 5 % too much."""
    folder = tmp_path_factory.mktemp("data") / "d"
    data = datasets.load_dataset(dataset(folder, distort={"pressure": lambda time, value: 1.05 * value}))
    fitted = [e for e in prepare_experiments(data, datasets.split_dataset(data)) if e.use == "fit"]
    return data, fit_base_device(data, fitted, Simulator(2))[1]


def test_the_place_of_a_misfit_is_found(material: tuple[datasets.Dataset, WeightedData]) -> None:
    data, evidence = material
    base, _ = fit_base_device(data, evidence.experiments, evidence.simulator)
    first, *_ = locate_misfit(evidence, base)
    assert first.channel == "pressure"
    assert first.region.startswith("above ")
    assert first.region.endswith("bar")  # 5 % of more is more
    assert first.concentration > 1.3
    assert 0.5 < first.fraction <= 1.0


def test_another_rig_is_proposed_where_no_command_helps(material: tuple[datasets.Dataset, WeightedData]) -> None:
    data, both = material
    # The gauge alone: without a force, a regulator that is off by as much looks the same whatever is commanded.
    alone = data_quality.remove_channels(
        both.experiments, data_quality.pair_trials_with_channels(both.experiments, ["force"])
    )
    base, evidence = fit_base_device(data, alone, both.simulator)
    sensor = fit_hypothesis(evidence, base.hypothesis.with_term(EffectTerm("sensor_gain", "linear", "pressure")))
    assert sensor.values[-1] == pytest.approx(1.05, abs=0.002)
    regulator = fit_hypothesis(evidence, base.hypothesis.with_term(EffectTerm("regulator_error", "gain")))
    found = propose_experiment(evidence, data.device, sensor, regulator)
    assert found.separation_chi2 > 100.0
    assert found.rig_change == RIG_CHANGES[0]  # how fast the gauge rises tells them apart, with noise as little as this
    noisy = {channel: own._replace(std=30.0 * own.std) for channel, own in evidence.noise.items()}
    loud = propose_experiment(replace(evidence, noise=noisy), data.device, sensor, regulator)
    # Then the muscle's own length shows what pressure there really is; a second gauge would, too, if less clearly.
    assert loud.rig_change.added_channels == ("muscle_length",)
    assert loud.to_dict()["rig_change"] == "with a sensor for the muscle's own length"
    assert loud.rig_change.description in loud.to_dict()["sentence"]
    assert loud.separation_chi2 > 100.0 * found.separation_chi2 / 30.0**2
    told = found.to_dict()
    assert f"'{told['protocol']}' twice" in told["sentence"]
    same = propose_experiment(evidence, data.device, sensor, sensor)
    assert same.separation_chi2 < 1e-6
    assert "No protocol or change of the rig that is known separates these" in same.to_dict()["sentence"]


def test_finished_fits_are_kept_until_they_are_used(
    material: tuple[datasets.Dataset, WeightedData], monkeypatch: pytest.MonkeyPatch
) -> None:
    data, evidence = material
    on = WeightedData(evidence.simulator, evidence.experiments, evidence.noise, FitCache("these data"))
    hypothesis = fit_base_device(data, evidence.experiments, evidence.simulator)[0].hypothesis
    first, before = fit_hypothesis(on, hypothesis), evidence.simulator.n_rollouts
    again = fit_hypothesis(on, hypothesis)
    assert evidence.simulator.n_rollouts - before <= 2 * len(evidence.experiments)  # one look at the solution, at most
    assert np.array_equal(first.x, again.x)
    assert np.array_equal(first.weighted_residuals, again.weighted_residuals)
    assert np.array_equal(first.jacobian, again.jacobian)
    assert fit_hypothesis(on, hypothesis, np.array([0.5, 0.0])).x == pytest.approx(first.x, abs=0.02)
    assert evidence.simulator.n_rollouts - before > 3 * len(evidence.experiments)  # another start is another question
    store = FitCache("other data")
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
    store._path_of("anything").write_bytes(b"half a file")
    assert store.get("anything") is None
    store.clear()
    assert not store._folder.exists()


def test_an_interrupted_diagnosis_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = datasets.load_dataset(
        dataset(tmp_path / "d", {("seal_friction", "coulomb"): {"force_n": 30.0}}, seconds=2.0)
    )
    options = DiagnosisOptions(only=("seal_friction", "muscle_damping"))
    whole = diagnose(data, options)

    def interrupt(sentence: str) -> None:
        if sentence == "looking for rivals":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        diagnose(data, options, interrupt)
    resumed = diagnose(data, options)
    assert resumed.verdict == whole.verdict == "named"
    assert resumed.final_fit.values == whole.final_fit.values
    assert resumed.confidence_intervals == whole.confidence_intervals
    assert resumed.n_simulations < 0.5 * whole.n_simulations
    assert list((tmp_path / "cache" / "diagnose").iterdir()) == []  # used, and gone


def test_without_selection_trials_every_group_is_left_out_once(tmp_path: Path) -> None:
    data = datasets.load_dataset(
        dataset(
            tmp_path / "d", {("seal_friction", "coulomb"): {"force_n": 30.0}}, groups=("fit_1", "fit_2"), seconds=2.0
        )
    )
    found = diagnose(data, DiagnosisOptions(only=("seal_friction", "sensor_drift")))
    assert found.verdict == "named"
    assert found.evaluated_on == "fit"
    assert set(found.selection_history[0].validation_gains) == {"fit_1", "fit_2"}
    assert min(found.selection_history[0].validation_gains.values()) > 0.3


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
    data, bench = datasets.load_dataset(dataset(tmp_path / "d", hidden, muscle_length=length)), Simulator(2)
    fitted = [e for e in prepare_experiments(data, datasets.split_dataset(data)) if e.use == "fit"]
    _, evidence = fit_base_device(data, fitted, bench)
    terms = tuple(EffectTerm(*key) for key in hidden)
    found = fit_hypothesis(evidence, Hypothesis(data.device, tuple(data.uncertainties.items()), (), terms))
    every = compute_equation_residuals(evidence, found)
    rows = {each.name: each for each in every}
    wholes = {"supply", "muscle and damper", "tendon"} if length else {"supply", "muscle, damper or tendon"}
    assert set(rows) == wholes
    wanted = {name if length or name == "supply" else "muscle, damper or tendon" for name in lacking}
    assert {each.name for each in lacks(every)} == wanted, rows
    if wanted:
        assert next(iter(rows)) in wanted
