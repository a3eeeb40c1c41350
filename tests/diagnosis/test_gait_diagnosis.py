"""Diagnosis of gait trials simulated with the contact model, another time step and noisy instruments."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.device_file import augment_device
from klute_sim.diagnosis.experiments.base import SimulationSetup
from klute_sim.diagnosis.experiments.gait import (
    MARGIN_AFTER_CONTACT_CHANGE,
    MARGIN_BEFORE_CONTACT_CHANGE,
    GaitExperiment,
)
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator, observe, simulate_extrapolated
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.localization.misfit_regions import _find_region, _list_splits
from klute_sim.diagnosis.noise import repeats as noises
from klute_sim.diagnosis.result import Diagnosis, DiagnosisOptions
from klute_sim.diagnosis.workflow import diagnose
from klute_sim.errors import InputError
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.report.diagnosis.text import describe_verdict
from tests.diagnosis import synthetic_gait_dataset as synthetic_gait_dataset

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def use_temporary_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KLUTE_SIM_CACHE", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def clean_dataset(tmp_path_factory: pytest.TempPathFactory) -> datasets.Dataset:
    return datasets.load_dataset(synthetic_gait_dataset.write_dataset(tmp_path_factory.mktemp("gait") / "clean"))


def prepare_trials(dataset: datasets.Dataset) -> list[GaitExperiment]:
    return [e for e in prepare_experiments(dataset, datasets.split_dataset(dataset)) if isinstance(e, GaitExperiment)]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values * values)))


def list_terms(result: Diagnosis) -> list[str]:
    return [str(term) for term in result.added_terms]


def test_replay_error_is_below_the_instrument_noise(clean_dataset: datasets.Dataset) -> None:
    """Gait simulated with a time step of 0.25 ms is replayed from samples at 5 ms: only noise remains."""
    trial_experiment = prepare_trials(clean_dataset)[0]
    setup = SimulationSetup(trial_experiment.device.parameters)
    result = observe(setup, trial_experiment, simulate_extrapolated(setup, trial_experiment))
    for channel, noise in (
        ("ankle_angle", np.radians(0.1)),
        ("force", 5.0),
        ("pressure", 1e3),
        ("muscle_length", 5e-5),
    ):
        assert (
            rms(trial_experiment.measured[channel].value - result[channel]) < 1.25 * noise
        )  # the prescribed channels are noisy, too


def test_extrapolation_removes_most_of_the_integration_error(clean_dataset: datasets.Dataset) -> None:
    trial_experiment = prepare_trials(clean_dataset)[0]
    assert trial_experiment.coarse_variant.dt == 2.0 * trial_experiment.dt
    assert trial_experiment.coarse_variant.coarse_variant is trial_experiment.coarse_variant
    setup = SimulationSetup(trial_experiment.device.parameters)
    refined = replace(trial_experiment, dt=trial_experiment.dt / 10.0, **_refine_inputs(trial_experiment, 10)).simulate(
        setup
    )
    times = trial_experiment.start_time + np.arange(0.5, trial_experiment.duration - 0.1, 0.002)
    reference = np.interp(times, refined.time, refined.ankle_angle)
    errors = [
        rms(np.interp(times, response.time, response.ankle_angle) - reference)
        for response in (trial_experiment.simulate(setup), simulate_extrapolated(setup, trial_experiment))
    ]
    assert errors[1] < 0.3 * errors[0]
    assert errors[1] < np.radians(0.01)


def _refine_inputs(trial_experiment: GaitExperiment, factor: int) -> dict:
    refined = np.arange(len(trial_experiment.command) * factor) / factor
    coarse_index = np.arange(len(trial_experiment.command))
    inputs = type(trial_experiment.inputs)(
        *(np.interp(refined, coarse_index, series) for series in trial_experiment.inputs)
    )
    return {"inputs": inputs, "command": np.interp(refined, coarse_index, trial_experiment.command)}


def test_samples_near_contact_changes_are_not_compared(clean_dataset: datasets.Dataset) -> None:
    trial_experiment = prepare_trials(clean_dataset)[0]
    loaded = trial_experiment.load.vertical > 20.0
    changes = trial_experiment.start_time + trial_experiment.dt * np.flatnonzero(np.diff(loaded.astype(int)))
    for series in trial_experiment.measured.values():
        for event in changes:
            is_near = (series.time > event - MARGIN_BEFORE_CONTACT_CHANGE + 0.004) & (
                series.time < event + MARGIN_AFTER_CONTACT_CHANGE - 0.004
            )
            assert not is_near.any()
        assert len(series.time) * series.sampling_interval > 0.6 * trial_experiment.duration


def test_strides_of_repeats_are_aligned_by_phase(clean_dataset: datasets.Dataset) -> None:
    """A repeat that is 5 % slower has the same misfit at the same aligned time."""
    trial_experiment = prepare_trials(clean_dataset)[0]
    slower = replace(
        trial_experiment,
        foot_strikes=1.05 * trial_experiment.foot_strikes,
        mean_stride_time=1.05 * trial_experiment.mean_stride_time,
        dt=1.05 * trial_experiment.dt,
    )
    trial_experiment, slower = (e.with_repeats([trial_experiment, slower]) for e in (trial_experiment, slower))
    assert isinstance(trial_experiment, GaitExperiment)
    assert isinstance(slower, GaitExperiment)
    assert trial_experiment.mean_stride_time == slower.mean_stride_time
    elapsed = np.linspace(-0.2, trial_experiment.duration + 0.2, 50)
    assert trial_experiment.align_time(elapsed) == pytest.approx(slower.align_time(1.05 * elapsed), abs=1e-12)
    assert trial_experiment.align_time(trial_experiment.foot_strikes) == pytest.approx(
        trial_experiment.mean_stride_time * np.arange(len(trial_experiment.foot_strikes)), abs=1e-12
    )
    misfit = np.sin(2.0 * np.pi * trial_experiment.compute_stride_phase(np.arange(0.6, 3.0, 0.005)))
    experiments = [
        replace(e, measured={"force": TimeSeries(e.start_time + scale * np.arange(0.6, 3.0, 0.005), misfit)})
        for e, scale in ((trial_experiment, 1.0), (slower, 1.05))
    ]
    residuals = [{"force": misfit}, {"force": misfit}]
    (aligned,) = noises.align_repeats(experiments, residuals, "force")
    assert np.abs(aligned.residuals[0] - aligned.residuals[1]).max() < 0.002
    assert aligned.residuals.std() > 0.5


def test_misfit_region_is_a_part_of_the_stride() -> None:
    """The part may extend beyond foot strike."""
    phase = np.linspace(0.0, 5.0, 4000) % 1.0
    for start, description in ((0.48, "at 48-60 % of the stride"), (0.94, "at 94-6 % of the stride")):
        squared_misfit = 1.0 + 50.0 * ((phase - start) % 1.0 < 0.12)
        region, share, concentration = _find_region(squared_misfit, {"phase": phase})
        assert region == description
        assert share == pytest.approx(51.0 * 0.12 / (51.0 * 0.12 + 0.88), rel=0.02)
        assert concentration > 6.0
    assert _list_splits(np.zeros(4000), np.ones(4000, dtype=bool), {"phase": phase}) == []


def test_trial_without_strides_is_refused(clean_dataset: datasets.Dataset) -> None:
    trial = clean_dataset.trials[0]
    load = trial.prescribed["grf_vertical"]
    loaded_channels = {**trial.prescribed, "grf_vertical": TimeSeries(load.time, np.maximum(load.value, 300.0))}
    trial_experiment = replace(
        clean_dataset, trials=(replace(trial, prescribed=loaded_channels), *clean_dataset.trials[1:])
    )
    with pytest.raises(
        InputError, match="the vertical load shows 0 foot strikes after a swing; a gait trial needs at least 2"
    ):
        prepare_experiments(trial_experiment, datasets.split_dataset(trial_experiment))


def test_uncertain_body_parameters_change_the_foot(clean_dataset: datasets.Dataset) -> None:
    """They act like values in the device file; a bench refuses them."""
    text = (
        synthetic_gait_dataset.load_device(synthetic_gait_dataset.DEVICE).content.decode()
        + "[effects.ankle_friction]\nmoment_n_m = {}\n"
    )
    with_friction, with_more_friction = (
        synthetic_gait_dataset.parse_device(text.format(moment).encode(), "one") for moment in (2.0, 3.0)
    )
    key = "effects.ankle_friction.moment_n_m"
    changed_datasets = [
        replace(
            clean_dataset,
            device=device,
            trials=(replace(clean_dataset.trials[0], device=device),),
            uncertainties={key: 0.5},
        )
        for device in (with_friction, with_more_friction)
    ]
    (trial_experiment,), (other_experiment,) = (
        prepare_experiments(response, datasets.split_dataset(clean_dataset)) for response in changed_datasets
    )
    hypothesis = Hypothesis(with_friction, ((key, 0.5),), ())
    (setup,) = hypothesis.build_setups(np.array([2.0]), [trial_experiment])
    result, expected = (
        trial_experiment.simulate(setup),
        other_experiment.simulate(SimulationSetup(with_more_friction.parameters)),
    )
    assert result.ankle_angle is not None
    assert expected.ankle_angle is not None
    assert np.array_equal(result.ankle_angle, expected.ankle_angle)
    assert rms(
        result.ankle_angle - trial_experiment.simulate(SimulationSetup(with_friction.parameters)).ankle_angle
    ) > np.radians(0.05)
    with pytest.raises(
        InputError, match=r"'effects\.ankle_friction\.moment_n_m' describes the body, which a bench does not test"
    ):
        prepare_experiments(replace(changed_datasets[0], rig="bench"), datasets.split_dataset(clean_dataset))


def test_simulated_recording_is_a_trial_without_misfit(tmp_path: Path) -> None:
    """Without noise and repeats the verdict is insufficient data. The device file of the run states the alignment."""
    ks.simulate_gait(device=synthetic_gait_dataset.DEVICE, strides=3).save(tmp_path)
    header = 'format = "klute-sim-dataset/2"\nrig = "gait"\ndevice = "device.toml"\n'
    (tmp_path / "dataset.toml").write_text(f'{header}[[trial]]\nfiles = ["recording.parquet"]\n', "utf-8")
    result = diagnose(datasets.load_dataset(tmp_path), DiagnosisOptions(only=("ankle_friction", "seal_friction")))
    assert result.verdict == "insufficient-data"
    assert "pressure" not in result.noise
    assert result.channel_rms["ankle_angle"].nominal < np.radians(0.05)
    assert result.channel_rms["force"].nominal < 3.0


def test_sensitivity_is_largest_where_the_load_is_far_from_the_ankle(clean_dataset: datasets.Dataset) -> None:
    """An error of 1 mm in the centre of pressure moves the ankle at push-off but not in swing."""
    trial_experiment = prepare_trials(clean_dataset)[0]
    simulator, setup = Simulator(1), SimulationSetup(trial_experiment.device.parameters)
    try:
        shifted, nominal = (
            [e] for e in (trial_experiment.perturb_inputs(lambda command: command)[1], trial_experiment)
        )
        result = [simulator.simulate([[setup]], response)[0][0]["ankle_angle"] for response in (shifted, nominal)]
    finally:
        simulator.close()
    change, time = np.abs(result[0] - result[1]), trial_experiment.measured["ankle_angle"].time
    loaded = np.interp(
        time,
        trial_experiment.start_time + trial_experiment.dt * np.arange(len(trial_experiment.load.vertical)),
        trial_experiment.load.vertical,
    )
    assert change[loaded > 600.0].mean() > np.radians(0.05)
    assert change[loaded < 1.0].mean() < 0.1 * change[loaded > 600.0].mean()


def test_clean_gait_has_no_missing_effect(clean_dataset: datasets.Dataset) -> None:
    """The whole catalogue is searched."""
    result = diagnose(clean_dataset)
    assert result.verdict == "nothing-missing"
    for channel, rms_values in result.channel_rms.items():
        assert rms_values.noise_floor is not None
        assert rms_values.with_effects < 1.15 * rms_values.noise_floor, channel


def test_command_that_acts_between_its_samples_misses_nothing(tmp_path: Path) -> None:
    """A state machine's commands, held for 10 ms, on a log of 5 ms that is 2 ms late."""
    folder = synthetic_gait_dataset.write_dataset(
        tmp_path / "gait", has_state_machine=True, command_interval=5e-3, command_delay=2e-3
    )
    result = ks.diagnose(folder)
    assert result.verdict == "nothing-missing"
    (sentence,) = [reason for reason in result.reasons if "registration" in reason]
    assert "the pressure command acted 2" in sentence
    assert "ms earlier" in sentence


def test_hidden_damper_friction_is_identified(tmp_path: Path) -> None:
    effects = '\n[effects.seal_friction]\nform = "coulomb"\nforce_n = 40.0\n'
    data = datasets.load_dataset(
        synthetic_gait_dataset.write_dataset(tmp_path / "data", effects=effects, groups=("fit_1", "validation_1"))
    )
    result = diagnose(data, DiagnosisOptions(only=("seal_friction", "pressure_lag", "sensor_gain")))
    assert result.verdict == "identified"
    assert list_terms(result) == ["seal_friction (coulomb)"]
    assert result.final_fit is not None
    assert result.final_fit.values[-1] == pytest.approx(40.0, rel=0.03)
    assert "of the stride" in " ".join(place.region for place in result.misfit_regions)


def test_small_encoder_offset_belongs_to_the_registration(tmp_path: Path) -> None:
    """An angle's zero is known to one degree only, so nothing is missing."""
    offset = {"ankle_angle [deg]": 1.0}
    data = datasets.load_dataset(
        synthetic_gait_dataset.write_dataset(tmp_path / "data", offset=offset, groups=("fit_1", "validation_1"))
    )
    result = diagnose(data, DiagnosisOptions(only=("sensor_offset", "sensor_gain", "tendon_slack")))
    assert result.verdict == "nothing-missing"
    assert list_terms(result) == []
    assert any("the ankle angle is" in reason and "smaller" in reason for reason in result.reasons)
    assert describe_verdict(result).startswith("Nothing is missing once the registration is corrected: ")
    assert result.final_fit is not None
    names = [parameter.name for parameter in result.final_fit.hypothesis.parameters]
    zero = result.final_fit.values[names.index("registration.ankle_zero_deg")]
    assert abs(zero) == pytest.approx(1.0, rel=0.1)


def test_hidden_ankle_friction_is_identified_and_written_to_a_device_file(tmp_path: Path) -> None:
    """Friction in the MJCF is identified with the replay's equation and written to a device file.

    The form with a small viscous part describes a walk as well as the Coulomb friction alone.
    """
    effects = '\n[effects.ankle_friction]\nform = "coulomb"\nmoment_n_m = 2.0\n'
    data = datasets.load_dataset(
        synthetic_gait_dataset.write_dataset(tmp_path / "data", effects=effects, groups=("fit_1", "validation_1"))
    )
    result = diagnose(data, DiagnosisOptions(only=("ankle_friction", "return_spring_error", "seal_friction")))
    assert result.verdict == "identified"
    assert list_terms(result) in (["ankle_friction (coulomb)"], ["ankle_friction (both)"])
    assert result.final_fit is not None
    index = [parameter.term_index for parameter in result.final_fit.hypothesis.parameters].index(0)
    moment, (low, high) = result.final_fit.values[index], result.confidence_intervals[index]
    assert moment == pytest.approx(2.0, rel=0.05)
    assert low < 2.0 < high
    device = augment_device(result.final_fit, "data")
    assert build_device_foot(device).ankle_friction == pytest.approx(moment, rel=1e-12)
    for rms_values in result.channel_rms.values():
        assert rms_values.noise_floor is not None
        assert rms_values.with_effects < 1.1 * rms_values.noise_floor


def test_foot_compliance_is_identified_with_markers_on_the_foot(tmp_path: Path) -> None:
    """MuJoCo has two bodies, the replay one parameter."""
    effects = "\n[effects.foot_stiffness]\ncompliance_deg_per_n_m = 0.01\n"
    data = datasets.load_dataset(
        synthetic_gait_dataset.write_dataset(tmp_path / "data", effects=effects, groups=("fit_1", "validation_1"))
    )
    result = diagnose(data, DiagnosisOptions(only=("foot_stiffness", "return_spring_error", "sensor_gain")))
    assert result.verdict == "identified"
    assert list_terms(result) == ["foot_stiffness"]
    assert result.final_fit is not None
    assert result.final_fit.values[-1] == pytest.approx(0.01, rel=0.05)
    assert result.confidence_intervals[-1][0] < 0.01 < result.confidence_intervals[-1][1]


@pytest.mark.long
@pytest.mark.parametrize("limb", [True, False])
def test_socket_pistoning_is_visible_with_markers_on_the_limb_only(tmp_path: Path, limb: bool) -> None:
    """The whole catalogue is searched; with markers on the prosthesis nothing is missing.

    The liner of the rig, 20 mm/kN, is in series with the effect.
    """
    effects = "\n[effects.socket_pistoning]\ncompliance_mm_per_kn = 10.0\n"
    data = datasets.load_dataset(synthetic_gait_dataset.write_dataset(tmp_path / "data", effects=effects, limb=limb))
    result = diagnose(data)
    assert result.verdict == ("identified" if limb else "nothing-missing")
    assert list_terms(result) == (["socket_pistoning (axial)"] if limb else [])
    if limb:
        assert result.final_fit is not None
        assert result.final_fit.values[-1] == pytest.approx(20.0 + 10.0, rel=0.05)
