"""Diagnosis of walks: the contact model's, in other steps and seen by noisy instruments, replayed and explained."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.controllers.pressure import load_default_profile
from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import Series
from klute_sim.device.device import load_device
from klute_sim.diagnosis.device_file import augment_device
from klute_sim.diagnosis.experiments.base import SimulationSetup, Simulator, observe, simulate_extrapolated
from klute_sim.diagnosis.experiments.gait import (
    MARGIN_AFTER_CONTACT_CHANGE,
    MARGIN_BEFORE_CONTACT_CHANGE,
    GaitExperiment,
)
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.noise import repeats as noises
from klute_sim.diagnosis.selection.localization import _find_region, _list_splits
from klute_sim.diagnosis.workflow import Diagnosis, DiagnosisOptions, diagnose
from klute_sim.errors import InputError
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.recording import parquet
from tests.diagnosis import synthetic_gait_dataset as gait_made


@pytest.fixture(autouse=True)
def kept_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KLUTE_SIM_CACHE", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> datasets.Dataset:
    return datasets.load_dataset(gait_made.dataset(tmp_path_factory.mktemp("gait") / "clean"))


def trials(dataset: datasets.Dataset) -> list[GaitExperiment]:
    return [e for e in prepare_experiments(dataset, datasets.split_dataset(dataset)) if isinstance(e, GaitExperiment)]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values * values)))


def named(found: Diagnosis) -> list[str]:
    return [str(term) for term in found.added_terms]


def test_what_is_not_simulated_is_less_than_the_instruments_noise(clean: datasets.Dataset) -> None:
    """Of a walk in steps of 0.25 ms that is replayed from samples of 5 ms: all that is left is noise."""
    one = trials(clean)[0]
    setting = SimulationSetup(one.device.parameters)
    found = observe(setting, one, simulate_extrapolated(setting, one))
    for channel, noise in (
        ("ankle_angle", np.radians(0.1)),
        ("force", 5.0),
        ("pressure", 1e3),
        ("muscle_length", 5e-5),
    ):
        assert rms(one.measured[channel].value - found[channel]) < 1.25 * noise  # what is prescribed is noisy, too


def test_two_steps_tell_what_shorter_ones_tend_to(clean: datasets.Dataset) -> None:
    one = trials(clean)[0]
    assert one.coarse_variant.dt == 2.0 * one.dt
    assert one.coarse_variant.coarse_variant is one.coarse_variant
    setting = SimulationSetup(one.device.parameters)
    fine = replace(one, dt=one.dt / 10.0, **_finer(one, 10)).simulate(setting)
    late = one.start_time + np.arange(0.5, one.duration - 0.1, 0.002)
    there = np.interp(late, fine.time, fine.angle)
    off = [
        rms(np.interp(late, each.time, each.angle) - there)
        for each in (one.simulate(setting), simulate_extrapolated(setting, one))
    ]
    assert off[1] < 0.3 * off[0]
    assert off[1] < np.radians(0.01)


def _finer(one: GaitExperiment, parts: int) -> dict:
    fine = np.arange(len(one.command) * parts) / parts
    whole = np.arange(len(one.command))
    inputs = type(one.inputs)(*(np.interp(fine, whole, series) for series in one.inputs))
    return {"inputs": inputs, "command": np.interp(fine, whole, one.command)}


def test_nothing_is_compared_around_where_the_load_comes_and_goes(clean: datasets.Dataset) -> None:
    one = trials(clean)[0]
    loaded = one.vertical_load > 20.0
    changes = one.start_time + one.dt * np.flatnonzero(np.diff(loaded.astype(int)))
    for series in one.measured.values():
        for event in changes:
            near = (series.time > event - MARGIN_BEFORE_CONTACT_CHANGE + 0.004) & (
                series.time < event + MARGIN_AFTER_CONTACT_CHANGE - 0.004
            )
            assert not near.any()
        assert len(series.time) * series.sampling_interval > 0.6 * one.duration


def test_strides_of_repeats_are_matched_by_their_phase(clean: datasets.Dataset) -> None:
    """One that walks 5 % slower shows the same misfit at the same time of the common clock."""
    one = trials(clean)[0]
    slow = replace(
        one, foot_strikes=1.05 * one.foot_strikes, mean_stride_time=1.05 * one.mean_stride_time, dt=1.05 * one.dt
    )
    one, slow = (e.with_repeats([one, slow]) for e in (one, slow))
    assert isinstance(one, GaitExperiment)
    assert isinstance(slow, GaitExperiment)
    assert one.mean_stride_time == slow.mean_stride_time
    since = np.linspace(-0.2, one.duration + 0.2, 50)
    assert one.align_time(since) == pytest.approx(slow.align_time(1.05 * since), abs=1e-12)
    assert one.align_time(one.foot_strikes) == pytest.approx(
        one.mean_stride_time * np.arange(len(one.foot_strikes)), abs=1e-12
    )
    swing = np.sin(2.0 * np.pi * one.compute_stride_phase(np.arange(0.6, 3.0, 0.005)))
    experiments = [
        replace(e, measured={"force": Series(e.start_time + scale * np.arange(0.6, 3.0, 0.005), swing)})
        for e, scale in ((one, 1.0), (slow, 1.05))
    ]
    residuals = [{"force": swing}, {"force": swing}]
    (stack,) = noises.align_repeats(experiments, residuals, "force")
    assert np.abs(stack.residuals[0] - stack.residuals[1]).max() < 0.002
    assert stack.residuals.std() > 0.5


def test_a_part_of_the_stride_is_found() -> None:
    """Also one that goes on beyond the foot strike."""
    phase = np.linspace(0.0, 5.0, 4000) % 1.0
    for begin, words in ((0.48, "at 48-60 % of the stride"), (0.94, "at 94-6 % of the stride")):
        square = 1.0 + 50.0 * ((phase - begin) % 1.0 < 0.12)
        region, share, concentration = _find_region(square, {"phase": phase})
        assert region == words
        assert share == pytest.approx(51.0 * 0.12 / (51.0 * 0.12 + 0.88), rel=0.02)
        assert concentration > 6.0
    assert _list_splits(np.zeros(4000), np.ones(4000, dtype=bool), {"phase": phase}) == []


def test_a_trial_without_strides_is_refused(clean: datasets.Dataset) -> None:
    trial = clean.trials[0]
    load = trial.prescribed["grf_vertical"]
    short = {**trial.prescribed, "grf_vertical": Series(load.time, np.maximum(load.value, 100.0))}
    one = replace(clean, trials=(replace(trial, prescribed=short), *clean.trials[1:]))
    with pytest.raises(InputError, match="its load shows 0 foot strikes; a gait trial needs 2 or more"):
        prepare_experiments(one, datasets.split_dataset(one))


def test_uncertain_numbers_of_the_body_move_the_foot(clean: datasets.Dataset) -> None:
    """As much as those that a device file has; and a bench, which shows nothing of them, refuses them."""
    text = gait_made.load_device(gait_made.DEVICE).content.decode() + "[effects.ankle_friction]\nmoment_n_m = {}\n"
    rubs, rubs_more = (gait_made.parse_device(text.format(moment).encode(), "one") for moment in (2.0, 3.0))
    key = "effects.ankle_friction.moment_n_m"
    having = [
        replace(clean, device=device, trials=(replace(clean.trials[0], device=device),), uncertainties={key: 0.5})
        for device in (rubs, rubs_more)
    ]
    (one,), (other,) = (prepare_experiments(each, datasets.split_dataset(clean)) for each in having)
    hypothesis = Hypothesis(rubs, ((key, 0.5),), ())
    (setting,) = hypothesis.build_setups(np.array([2.0]), [one])
    found, wanted = one.simulate(setting), other.simulate(SimulationSetup(rubs_more.parameters))
    assert found.angle is not None
    assert wanted.angle is not None
    assert np.array_equal(found.angle, wanted.angle)
    assert rms(found.angle - one.simulate(SimulationSetup(rubs.parameters)).angle) > np.radians(0.05)
    with pytest.raises(InputError, match=r"'effects\.ankle_friction\.moment_n_m' is of the body, and a bench shows"):
        prepare_experiments(replace(having[0], rig="bench"), datasets.split_dataset(clean))


def test_a_recording_of_ours_is_a_trial_and_lacks_nothing(tmp_path: Path) -> None:
    """Without noise or a repeat: nothing can be said for sure, and nothing goes wrong."""
    walked = simulate_gait(load_device(gait_made.DEVICE), load_default_profile(), GaitOptions(strides=3))
    parquet.write(walked, tmp_path / "a.parquet")
    head = f'format = "klute-sim-dataset/1"\nrig = "gait"\ndevice = "{gait_made.DEVICE}"\n'
    (tmp_path / "dataset.toml").write_text(f'{head}[[trial]]\nfiles = ["a.parquet"]\n', "utf-8")
    found = diagnose(datasets.load_dataset(tmp_path), DiagnosisOptions(only=("ankle_friction", "seal_friction")))
    assert found.verdict == "insufficient-data"
    assert "pressure" not in found.noise
    assert found.channel_rms["ankle_angle"].nominal < np.radians(0.05)
    assert found.channel_rms["force"].nominal < 3.0


def test_noise_is_loudest_where_the_load_is_far_from_the_ankle(clean: datasets.Dataset) -> None:
    """A centre of pressure that is 1 mm off turns the ankle at push-off, and nothing in swing."""
    one = trials(clean)[0]
    bench, setting = Simulator(1), SimulationSetup(one.device.parameters)
    try:
        moved_, here = ([e] for e in (one.perturb_inputs(lambda command: command)[1], one))
        found = [bench.simulate([[setting]], each)[0][0]["ankle_angle"] for each in (moved_, here)]
    finally:
        bench.close()
    change, time = np.abs(found[0] - found[1]), one.measured["ankle_angle"].time
    loaded = np.interp(time, one.start_time + one.dt * np.arange(len(one.vertical_load)), one.vertical_load)
    assert change[loaded > 600.0].mean() > np.radians(0.05)
    assert change[loaded < 1.0].mean() < 0.1 * change[loaded > 600.0].mean()


def test_clean_walks_lack_nothing(clean: datasets.Dataset) -> None:
    """With the whole catalogue to choose from."""
    found = diagnose(clean)
    assert found.verdict == "nothing-missing"
    for channel, gap in found.channel_rms.items():
        assert gap.noise_floor is not None
        assert gap.with_effects < 1.05 * gap.noise_floor, channel


def test_a_hidden_friction_of_the_damper_is_named(tmp_path: Path) -> None:
    effects = '\n[effects.seal_friction]\nform = "coulomb"\nforce_n = 40.0\n'
    data = datasets.load_dataset(gait_made.dataset(tmp_path / "data", effects=effects, groups=("fit_1", "select_1")))
    found = diagnose(data, DiagnosisOptions(only=("seal_friction", "pressure_lag", "sensor_gain")))
    assert found.verdict == "named"
    assert named(found) == ["seal_friction (coulomb)"]
    assert found.final_fit is not None
    assert found.final_fit.values[-1] == pytest.approx(40.0, rel=0.03)
    assert "of the stride" in " ".join(place.region for place in found.misfit_regions)


def test_an_encoder_that_is_zeroed_wrongly_is_the_encoder(tmp_path: Path) -> None:
    offset = {"ankle_angle [deg]": 1.0}
    data = datasets.load_dataset(gait_made.dataset(tmp_path / "data", offset=offset, groups=("fit_1", "select_1")))
    found = diagnose(data, DiagnosisOptions(only=("sensor_offset", "sensor_gain", "tendon_slack")))
    assert named(found) == ["sensor_offset of ankle_angle"]
    assert found.final_fit is not None
    assert found.final_fit.values[-1] == pytest.approx(1.0, rel=0.03)


def test_a_hidden_friction_of_the_ankle_is_named_and_walks_again(tmp_path: Path) -> None:
    """Friction in the MJCF, as MuJoCo has it; found in the replay's equation, and put back into a device file."""
    effects = '\n[effects.ankle_friction]\nform = "coulomb"\nmoment_n_m = 2.0\n'
    data = datasets.load_dataset(gait_made.dataset(tmp_path / "data", effects=effects, groups=("fit_1", "select_1")))
    found = diagnose(data, DiagnosisOptions(only=("ankle_friction", "return_spring_error", "seal_friction")))
    assert found.verdict == "named"
    assert named(found) == ["ankle_friction (coulomb)"]
    assert found.final_fit is not None
    assert found.final_fit.values[-1] == pytest.approx(2.0, rel=0.05)
    assert found.confidence_intervals[-1][0] < 2.0 < found.confidence_intervals[-1][1]
    device = augment_device(found.final_fit, "data")
    assert build_device_foot(device).ankle_friction == pytest.approx(found.final_fit.values[-1], rel=1e-12)
    for gap in found.channel_rms.values():
        assert gap.noise_floor is not None
        assert gap.with_effects < 1.1 * gap.noise_floor


def test_a_foot_that_bends_is_named_where_markers_are_on_it(tmp_path: Path) -> None:
    """Two bodies in MuJoCo, one number in the replay."""
    effects = "\n[effects.foot_stiffness]\ncompliance_deg_per_n_m = 0.01\n"
    data = datasets.load_dataset(gait_made.dataset(tmp_path / "data", effects=effects, groups=("fit_1", "select_1")))
    found = diagnose(data, DiagnosisOptions(only=("foot_stiffness", "return_spring_error", "sensor_gain")))
    assert found.verdict == "named"
    assert named(found) == ["foot_stiffness"]
    assert found.final_fit is not None
    assert found.final_fit.values[-1] == pytest.approx(0.01, rel=0.03)
    assert found.confidence_intervals[-1][0] < 0.01 < found.confidence_intervals[-1][1]


@pytest.mark.long
@pytest.mark.parametrize("limb", [True, False])
def test_a_limb_that_sinks_into_its_socket_shows_above_the_socket_alone(tmp_path: Path, limb: bool) -> None:
    """With the whole catalogue to choose from; with markers on the prosthesis nothing is missing."""
    effects = "\n[effects.socket_pistoning]\ncompliance_mm_per_kn = 10.0\n"
    data = datasets.load_dataset(gait_made.dataset(tmp_path / "data", effects=effects, limb=limb))
    found = diagnose(data)
    assert found.verdict == ("named" if limb else "nothing-missing")
    assert named(found) == (["socket_pistoning"] if limb else [])
    if limb:
        assert found.final_fit is not None
        assert found.final_fit.values[-1] == pytest.approx(10.0, rel=0.05)
