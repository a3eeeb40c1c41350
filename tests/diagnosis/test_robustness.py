"""Misfit regions, cached fits, resumed diagnoses, proposed experiments, and equation residuals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets import dataset as datasets
from klute_sim.device.device import load_device, parse_device
from klute_sim.diagnosis import data_quality
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.fit_cache import FitCache
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.localization.equation_residuals import compute_equation_residuals, select_significant_equations
from klute_sim.diagnosis.localization.misfit_regions import locate_misfit
from klute_sim.diagnosis.planning import proposals
from klute_sim.diagnosis.planning.proposals import RIG_CHANGES, list_rig_changes, propose_experiment
from klute_sim.diagnosis.result import DiagnosisOptions
from klute_sim.diagnosis.workflow import diagnose, fit_base_device
from klute_sim.errors import SimulationError
from tests.diagnosis.synthetic_dataset import write_dataset

pytestmark = pytest.mark.slow
TENDON = b"[tendon]\nslack_length_mm = 90\nstiffness_1_n_per_mm = 60\nstiffness_2_n_per_mm = 0\nengagement_mm = 0\n"
CYLINDER = b"[cylinder]\nextended_length_mm = 200\nstroke_mm = 60\n"


@pytest.fixture(autouse=True)
def use_temporary_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KLUTE_SIM_CACHE", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def base_data(tmp_path_factory: pytest.TempPathFactory) -> tuple[datasets.Dataset, WeightedData]:
    """Return data with a pressure sensor that reads 5 % too much."""
    folder = tmp_path_factory.mktemp("data") / "d"
    dataset = datasets.load_dataset(write_dataset(folder, distort={"pressure": lambda time, value: 1.05 * value}))
    fit_experiments = [e for e in prepare_experiments(dataset, datasets.split_dataset(dataset)) if e.use == "fit"]
    return dataset, fit_base_device(dataset, fit_experiments, Simulator(2))[1]


def test_misfit_region_is_located(base_data: tuple[datasets.Dataset, WeightedData]) -> None:
    dataset, weighted_data = base_data
    base, _ = fit_base_device(dataset, weighted_data.experiments, weighted_data.simulator)
    first, *_ = locate_misfit(weighted_data, base)
    assert first.channel == "pressure"
    assert first.region.startswith("above ")
    assert first.region.endswith("bar")  # an error of 5 % grows with pressure
    assert first.concentration > 1.3
    assert 0.5 < first.fraction <= 1.0


def test_rig_change_is_proposed_where_no_command_separates_models(
    base_data: tuple[datasets.Dataset, WeightedData],
) -> None:
    dataset, all_data = base_data
    # Without a force, sensor gain and regulator gain are indistinguishable under any command.
    reduced = data_quality.remove_channels(
        all_data.experiments, data_quality.pair_trials_with_channels(all_data.experiments, ["force"])
    )
    base, weighted_data = fit_base_device(dataset, reduced, all_data.simulator)
    sensor = fit_hypothesis(weighted_data, base.hypothesis.with_term(EffectTerm("sensor_gain", "linear", "pressure")))
    assert sensor.values[-1] == pytest.approx(1.05, abs=0.002)
    regulator = fit_hypothesis(weighted_data, base.hypothesis.with_term(EffectTerm("regulator_error", "gain")))
    result = propose_experiment(weighted_data, dataset.device, sensor, regulator)
    assert result.separation_chi2 > 100.0
    assert result.rig_change == RIG_CHANGES[0]  # with this little noise, the rate of the reading separates them
    more_noise = {channel: noise._replace(std=30.0 * noise.std) for channel, noise in weighted_data.noise.items()}
    with_more_noise = propose_experiment(replace(weighted_data, noise=more_noise), dataset.device, sensor, regulator)
    # With more noise, the muscle length reveals the true pressure more clearly than a second sensor.
    assert with_more_noise.rig_change.added_channels == ("muscle_length",)
    assert with_more_noise.to_dict()["rig_change"] == "with a sensor for the muscle's own length"
    assert with_more_noise.rig_change.description in with_more_noise.to_dict()["sentence"]
    assert "channels: pressure, muscle_length)" in with_more_noise.to_dict()["sentence"]
    assert result.to_dict()["channels"] == ["pressure"]  # of the data; no force is asked for
    assert with_more_noise.separation_chi2 > 100.0 * result.separation_chi2 / 30.0**2
    content = result.to_dict()
    assert f"'{content['protocol']}' twice" in content["sentence"]
    same = propose_experiment(weighted_data, dataset.device, sensor, sensor)
    assert same.separation_chi2 < 1e-6
    assert "No known protocol or change of the rig separates these" in same.to_dict()["sentence"]
    assert same.to_dict()["protocol"] is None


def test_nothing_is_proposed_where_no_protocol_can_be_simulated(
    base_data: tuple[datasets.Dataset, WeightedData], monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset, data = base_data
    base, data = fit_base_device(dataset, data.experiments, data.simulator)

    def diverge(*_: object, **__: object) -> None:
        raise SimulationError("the simulation diverges")

    with monkeypatch.context() as patch:
        patch.setattr(proposals, "simulate_channels", diverge)
        assert propose_experiment(data, dataset.device, base, base) is None
    assert propose_experiment(data, parse_device(b'name = "part"\n' + CYLINDER + TENDON, "part"), base, base) is None


def test_changes_of_the_rig_are_those_of_the_parts() -> None:
    told = {
        name: [change.description for change in list_rig_changes(parse_device(b'name = "part"\n' + content, "part"))]
        for name, content in {"tendon": TENDON, "both": CYLINDER + TENDON}.items()
    }
    weight = "with the load cell checked by a dead weight before and after"
    assert told["tendon"] == ["with the rig as it is", weight]
    assert "with a sensor for the cylinder's own length" in told["both"]
    assert list_rig_changes(load_device("klute-3-4")) == list(RIG_CHANGES)


def test_finished_fits_are_cached(
    base_data: tuple[datasets.Dataset, WeightedData], monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset, weighted_data = base_data
    cached_data = WeightedData(
        weighted_data.simulator, weighted_data.experiments, weighted_data.noise, FitCache("these data")
    )
    hypothesis = fit_base_device(dataset, weighted_data.experiments, weighted_data.simulator)[0].hypothesis
    first, before = fit_hypothesis(cached_data, hypothesis), weighted_data.simulator.n_rollouts
    cached = fit_hypothesis(cached_data, hypothesis)
    assert weighted_data.simulator.n_rollouts - before <= 2 * len(
        weighted_data.experiments
    )  # at most one simulation at the solution
    assert np.array_equal(first.x, cached.x)
    assert np.array_equal(first.weighted_residuals, cached.weighted_residuals)
    assert np.array_equal(first.jacobian, cached.jacobian)
    assert fit_hypothesis(cached_data, hypothesis, np.array([0.5, 0.0])).x == pytest.approx(first.x, abs=0.02)
    assert weighted_data.simulator.n_rollouts - before > 3 * len(
        weighted_data.experiments
    )  # another starting point is another fit
    cache = FitCache("other data")
    assert cache.get("anything") is None

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as context:
        context.setattr(np, "savez", full)
        cache.put("anything", x=np.zeros(3))
    assert cache.get("anything") is None
    assert list(cache._folder.iterdir()) == []
    cache.put("anything", x=np.arange(3.0))
    assert cache.get("anything")["x"].tolist() == [0.0, 1.0, 2.0]
    cache._path_of("anything").write_bytes(b"half a file")
    assert cache.get("anything") is None
    cache.clear()
    assert not cache._folder.exists()


def test_interrupted_diagnosis_resumes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = datasets.load_dataset(
        write_dataset(tmp_path / "d", {("seal_friction", "coulomb"): {"force_n": 30.0}}, seconds=2.0)
    )
    options = DiagnosisOptions(only=("seal_friction", "muscle_damping"))
    uninterrupted = diagnose(dataset, options)

    def interrupt(fraction: float, stage: str) -> None:
        if stage == "searching for equivalent models":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        diagnose(dataset, options, interrupt)
    resumed = diagnose(dataset, options)
    assert resumed.verdict == uninterrupted.verdict == "identified"
    assert resumed.final_fit.values == uninterrupted.final_fit.values
    assert resumed.confidence_intervals == uninterrupted.confidence_intervals
    assert resumed.n_simulations < 0.5 * uninterrupted.n_simulations
    assert list((tmp_path / "cache" / "diagnose").iterdir()) == []  # deleted after use


def test_without_validation_trials_each_group_is_left_out_once(tmp_path: Path) -> None:
    dataset = datasets.load_dataset(
        write_dataset(
            tmp_path / "d", {("seal_friction", "coulomb"): {"force_n": 30.0}}, groups=("fit_1", "fit_2"), seconds=2.0
        )
    )
    result = diagnose(dataset, DiagnosisOptions(only=("seal_friction", "sensor_drift")))
    assert result.verdict == "identified"
    assert result.evaluated_on == "fit"
    assert set(result.selection_history[0].validation_gains) == {"fit_1", "fit_2"}
    assert min(result.selection_history[0].validation_gains.values()) > 0.3


@pytest.mark.parametrize(
    ("true_effects", "equations"),
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
def test_equation_with_a_missing_effect_is_found(
    true_effects: dict, equations: tuple[str, ...], length: bool, tmp_path: Path
) -> None:
    """The equations of the device without the effect are evaluated with measured pressure, force and length."""
    dataset, simulator = (
        datasets.load_dataset(write_dataset(tmp_path / "d", true_effects, muscle_length=length)),
        Simulator(2),
    )
    fit_experiments = [e for e in prepare_experiments(dataset, datasets.split_dataset(dataset)) if e.use == "fit"]
    _, weighted_data = fit_base_device(dataset, fit_experiments, simulator)
    terms = tuple(EffectTerm(*key) for key in true_effects)
    result = fit_hypothesis(weighted_data, Hypothesis(dataset.device, tuple(dataset.uncertainties.items()), (), terms))
    all_residuals = compute_equation_residuals(weighted_data, result)
    rows = {row.name: row for row in all_residuals}
    all_equations = {"supply", "muscle and damper", "tendon"} if length else {"supply", "muscle, damper or tendon"}
    assert set(rows) == all_equations
    expected = {name if length or name == "supply" else "muscle, damper or tendon" for name in equations}
    assert {row.name for row in select_significant_equations(all_residuals)} == expected, rows
    if expected:
        assert next(iter(rows)) in expected
