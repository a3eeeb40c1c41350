"""Prediction of muscles of another diameter and length by what was found on one: known truth, and honest reports."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.api import diagnosis as datasets_api
from klute_sim.api.rendering import render_text
from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import Device, parse_device
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.result import Diagnosis, DiagnosisOptions
from klute_sim.diagnosis.transfer import predict_dataset
from klute_sim.diagnosis.transfer_prediction import ChannelPrediction, TransferPrediction
from klute_sim.diagnosis.workflow import diagnose
from klute_sim.errors import InputError
from klute_sim.report.diagnosis.prediction import (
    build_numbers_table,
    build_prediction_figure,
    build_prediction_table,
)
from tests.command_line import run
from tests.datasets.test_muscle_diameter import TEN_MM, scale

INTERVAL = 0.01
NOISE_N = 1.0


def write_muscles(folder: Path, device: Device, lengths: tuple[float, ...], head: str, seed: int = 0) -> Path:
    """Write slow fillings of clamped ``device``, each at four contractions of every resting length [m]."""
    rng = np.random.default_rng(seed)
    folder.mkdir()
    (folder / "muscle.toml").write_text(TEN_MM, "utf-8")
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', 'device = "muscle.toml"', head]
    time = np.arange(200) * INTERVAL
    pressure = np.interp(time, [0.0, 0.3, 1.7, 2.0], [0.0, 0.0, 6e5, 6e5])
    for resting in lengths:
        own = device.with_changes({"muscle.resting_length_mm": 1e3 * resting})
        for contraction in (0.0, 0.04, 0.08, 0.12):
            length = np.full(len(time), (1.0 - contraction) * resting)
            tension = simulate_rollouts(own.parameters, length, pressure, INTERVAL).tension
            for repeat in range(2):
                name = f"{1e3 * resting:.0f}_{1e3 * contraction:.0f}_{repeat}.csv"
                columns = {"time [s]": time, "length [mm]": 1e3 * length, "pressure_command [bar]": 1e-5 * pressure}
                write_trial(folder / name, columns | {"force [N]": tension + rng.normal(0.0, NOISE_N, len(time))})
                lines += ["[[trial]]", f'files = ["{name}"]', f'group = "{resting} {contraction}"']
                lines += ["[trial.device]", f'"muscle.resting_length_mm" = {1e3 * resting:g}']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


@pytest.fixture(scope="module")
def true_device() -> Device:
    """The bladder follows the braid, as in a fit of the turns."""
    changes = {"muscle.turns_per_m": 13.6, "muscle.bladder_radius_mm": 5.5 * 13.26 / 13.6}
    device = parse_device(TEN_MM.encode(), "10 mm muscle").with_changes(changes)
    return device.with_effect("passive_tension", form="power", rise_n=500.0, offset_n=30.0)


@pytest.fixture(scope="module")
def diagnosis(true_device: Device, tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    folder = tmp_path_factory.mktemp("transfer") / "ten"
    write_muscles(folder, true_device, (0.2,), '[uncertain]\n"muscle.turns_per_m" = "5 %"')
    return diagnose(load_dataset(folder), DiagnosisOptions(only=("passive_tension",)))


@pytest.mark.slow
def test_device_of_one_diameter_predicts_another(diagnosis: Diagnosis, true_device: Device, tmp_path: Path) -> None:
    head = '[diameter]\ndevice = "10 mm"\ntrials = "20 mm"'
    folder = write_muscles(tmp_path / "twenty", scale(true_device, "10 mm", "20 mm"), (0.3,), head, seed=1)
    prediction = predict_dataset(diagnosis, load_dataset(folder))
    force = prediction.channels["force"]
    assert force.with_effects < 0.005 * force.measured_range
    assert force.with_effects < 0.1 * force.refitted < 0.1 * force.nominal
    assert prediction.warnings == []
    numbers = {number.name: number for number in prediction.numbers}
    turns = numbers["muscle.turns_per_m"]
    assert turns.fitted == pytest.approx(13.6, rel=0.01)
    assert turns.used == pytest.approx(turns.fitted * 13.0 / 23.0, rel=1e-6)
    assert numbers["passive_tension.rise_n"].used == numbers["passive_tension.rise_n"].fitted
    assert "d/D" in numbers["passive_tension.rise_n"].rule
    assert prediction.to_dict()["channels"]["force"]["refitted_pct_of_range"] > 1.0
    text = render_text([build_prediction_table(prediction), build_numbers_table(prediction)])
    assert "turns_per_m" in text
    assert "%" in text
    (axis,) = build_prediction_figure(prediction).axes
    assert axis.get_xlabel() == "measured force [N]"
    assert f"with effects added: rms {force.with_effects:.3g} N" in axis.get_title()
    trial = prediction.trials[0]
    assert np.sqrt(np.mean((trial.measured - trial.with_effects) ** 2)) < 0.01 * force.measured_range


@pytest.mark.slow
@pytest.mark.parametrize(("found", "used"), [(40.0, 40.0 * (23.0 / 13.0) ** 2), (3200.0, 4000.0)])
def test_parameters_that_grow_with_the_diameter_are_scaled(
    found: float, used: float, diagnosis: Diagnosis, tmp_path: Path
) -> None:
    """The effect is replaced by one whose law does not contain the diameter; a value that is cut off says so."""
    base = diagnosis.base_fit
    assert base is not None
    hypothesis = base.hypothesis.with_term(EffectTerm("muscle_damping", "pressure"))
    fit = replace(base, hypothesis=hypothesis, x=np.append(base.x, found / 40.0))
    head = '[diameter]\ndevice = "10 mm"\ntrials = "20 mm"'
    device = parse_device(TEN_MM.encode(), "10 mm muscle")
    folder = write_muscles(tmp_path / "twenty", scale(device, "10 mm", "20 mm"), (0.3,), head)
    prediction = predict_dataset(replace(diagnosis, final_fit=fit), load_dataset(folder))
    damping = next(n for n in prediction.numbers if n.name == "muscle_damping.coefficient_n_s_per_m")
    assert (damping.fitted, damping.used) == pytest.approx((found, used))
    assert damping.rule.startswith("diameter to the power 2")
    assert ("cut off at a limit" in damping.rule) == (used == 4000.0)


@pytest.mark.slow
def test_effects_that_do_not_hold_elsewhere_are_said_not_to(
    diagnosis: Diagnosis, true_device: Device, tmp_path: Path
) -> None:
    """The other muscle has no passive tension, so the device without it, or its mark on a fit, is better."""
    bare = parse_device(TEN_MM.encode(), "10 mm muscle").with_changes(
        {"muscle.turns_per_m": true_device.spec.collect_values()["muscle.turns_per_m"]}
    )
    prediction = predict_dataset(diagnosis, load_dataset(write_muscles(tmp_path / "bare", bare, (0.25,), "")))
    assert prediction.recommended == "as-declared"
    (warning,) = prediction.warnings
    assert "the device as declared predicts force best" in warning
    assert "use the device as declared there" in warning
    assert prediction.to_dict()["warnings"] == [warning]


def rewrite_forces(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    for file in folder.glob("*.csv"):
        heading, *rows = file.read_text("utf-8").splitlines()
        values = np.array([[float(cell) for cell in row.split(",")] for row in rows])
        values[:, -1] = change(values[:, -1])
        write_trial(file, dict(zip(heading.split(","), values.T, strict=True)))


@pytest.mark.slow
def test_samples_at_the_end_of_a_sensor_refute_nothing(
    diagnosis: Diagnosis, true_device: Device, tmp_path: Path
) -> None:
    """A load cell that ends at 150 N reads far less than any device pulls."""
    folder = write_muscles(tmp_path / "clipped", true_device, (0.2,), "")
    rewrite_forces(folder, lambda force: np.minimum(force, 150.0))
    prediction = predict_dataset(diagnosis, load_dataset(folder, accept=["force-geometry"]))
    assert prediction.channels["force"].with_effects < 2.0 * NOISE_N
    assert prediction.recommended == "with-effects"
    (warning,) = prediction.warnings
    assert re.match(r"'clipped': 'force' equals 150 N in \d+ of \d+ samples: it may be saturated", warning)


def test_dataset_without_a_usable_channel_is_not_predicted(
    diagnosis: Diagnosis, true_device: Device, tmp_path: Path
) -> None:
    folder = write_muscles(tmp_path / "dead", true_device, (0.2,), "")
    rewrite_forces(folder, lambda force: np.full_like(force, 12.0))
    with pytest.raises(InputError, match="'dead' cannot be predicted: 'force' is constant at 12 N"):
        predict_dataset(diagnosis, load_dataset(folder))


def test_effect_that_the_other_device_has_is_not_added_again(
    diagnosis: Diagnosis, true_device: Device, tmp_path: Path
) -> None:
    folder = write_muscles(tmp_path / "with_effect", true_device, (0.2,), "")
    with pytest.raises(InputError, match="has effect 'passive_tension' already, which the prediction would add"):
        predict_dataset(diagnosis, load_dataset(folder, true_device))


def test_prediction_that_cannot_be_made_is_refused_before_the_diagnosis(true_device: Device, tmp_path: Path) -> None:
    write_muscles(tmp_path / "found", true_device, (0.2,), '[uncertain]\n"muscle.turns_per_m" = "5 %"')
    datasets_api.write_example_dataset(tmp_path / "tendon")
    done = run("diagnose", "tendon", "--predict", "found", "--out", "run", cwd=tmp_path)
    assert done.returncode == 2
    assert "device of dataset 'found' has no number 'tendon.stiffness_1_n_per_mm', which is fitted" in done.stderr
    assert not (tmp_path / "run").exists()


def test_data_that_are_insufficient_have_a_verdict_and_no_prediction(true_device: Device, tmp_path: Path) -> None:
    write_muscles(tmp_path / "other", true_device, (0.2,), "")
    folder = write_muscles(tmp_path / "short", true_device, (0.2,), "")
    head = (folder / "dataset.toml").read_text("utf-8").split("[[trial]]")[0]
    (folder / "dataset.toml").write_text(f'{head}[[trial]]\nfiles = ["200_0_0.csv"]\n', "utf-8")
    done = run("diagnose", "short", "--predict", "other", "--out", "run", "--no-report", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.search(r"no prediction of other: the diagnosis fitted nothing", done.stderr)
    verdict = json.loads((tmp_path / "run" / "verdict.json").read_text("utf-8"))
    assert (verdict["verdict"], verdict["predictions"]) == ("insufficient-data", [])


def test_channel_that_is_predicted_worse_does_not_contradict_the_advice() -> None:
    channels = {
        "force": ChannelPrediction(nominal=2.0, refitted=9.0, with_effects=3.0, measured_range=1000.0),
        "muscle_length": ChannelPrediction(nominal=9.0, refitted=5.0, with_effects=1.0, measured_range=100.0),
    }
    prediction = TransferPrediction("other", channels)
    assert prediction.recommended == "with-effects"
    (warning,) = prediction.warnings
    assert "the device as declared predicts force best" in warning
    assert warning.endswith("Over all channels, the device with the added effects is still the best.")


def test_diverging_prediction_is_a_warning() -> None:
    channels = {"force": ChannelPrediction(nominal=4.0, refitted=2.0, with_effects=np.inf, measured_range=100.0)}
    (warning,) = TransferPrediction("other", channels).warnings
    assert "misses by 2.0 % of the range, the refitted device with the added effects a simulation that div" in warning


@pytest.mark.parametrize(
    ("nominal", "refitted", "with_effects", "best"),
    [
        (9.0, 5.0, 4.0, "best: with-effects"),
        (9.0, 5.0, 5.0, "best: refitted"),
        (5.0, 5.01, 5.01, "none is better"),
        (2.0, 5.0, 5.0, "best: as-declared"),
        (9.0, 5.0, 6.0, "best: without-effects"),
    ],
)
def test_title_mentions_no_effects_that_change_nothing(
    nominal: float, refitted: float, with_effects: float, best: str
) -> None:
    channels = {"force": ChannelPrediction(nominal, refitted, with_effects, 100.0)}
    assert TransferPrediction("other", channels).best == best


@pytest.mark.parametrize(
    ("nominal", "refitted", "with_effects", "recommended", "match"),
    [
        (9.0, 5.0, 5.0001, "with-effects", None),
        (9.0, 5.0, 4.0, "with-effects", None),
        (9.0, 5.0, 6.0, "without-effects", "without effects predicts force best: .* 5.0 % .* effects 6.0 %"),
        (2.3, 5.3, 3.1, "as-declared", "as declared predicts .* 2.3 % .* effects 3.1 % .* 5.3 % .* as declared there"),
        (2.3, 5.3, 1.8, "with-effects", r"\(5.3 % of the range instead of 2.3 % of the range\); with them, .* 1.8 %"),
        (2.3, 5.3, 5.3, "as-declared", "misses by 2.3 % of the range, the refitted device without effects 5.3 %"),
        (9.0, np.inf, np.inf, "as-declared", "predicts nothing"),
    ],
)
def test_better_device_is_recommended_in_a_sentence(
    nominal: float, refitted: float, with_effects: float, recommended: str, match: str | None
) -> None:
    channels = {"force": ChannelPrediction(nominal, refitted, with_effects, 100.0)}
    assert TransferPrediction("other", channels).recommended == recommended
    warnings = TransferPrediction("other", channels).warnings
    assert len(warnings) == (match is not None)
    assert match is None or re.search(match, warnings[0])


@pytest.mark.slow
def test_page_of_the_command_shows_the_predictions(true_device: Device, tmp_path: Path) -> None:
    write_muscles(tmp_path / "found", true_device, (0.2,), '[uncertain]\n"muscle.turns_per_m" = "5 %"')
    write_muscles(tmp_path / "longer", true_device, (0.3,), "", seed=1)
    done = run(*("diagnose", "found", "--only", "passive_tension", "--predict", "longer", "--out", "run"), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Prediction of 'longer'" in done.stdout
    (row,) = json.loads((tmp_path / "run" / "predictions.json").read_text("utf-8"))
    force = row["channels"]["force"]
    html = (tmp_path / "run" / "index.html").read_text("utf-8")
    section = html.split('id="other-dataset-1-1"')[1].split('id="gap"')[0]
    assert "Prediction of &#39;longer&#39; (rms), best: with-effects" in section
    assert f"({force['with_effects_pct_of_range']:.1f} %)" in section
    assert "Carried over to &#39;longer&#39;" in section
    assert "passive_tension.rise_n" in section
    assert '<img src="data:image/png;base64,' in section
    for name in ("predictions.json", "prediction-1.png"):
        assert f'href="{name}"' in html
        assert (tmp_path / "run" / name).is_file()
