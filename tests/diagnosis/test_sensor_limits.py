"""Sensors that saturate: samples at a declared limit are censored, so they neither make a gap nor hide an effect."""

from pathlib import Path

import numpy as np
import pyarrow.csv
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.datasets.dataset import Dataset, load_dataset, split_dataset
from klute_sim.datasets.trial import SensorLimits
from klute_sim.datasets.write import write_trial
from klute_sim.diagnosis.experiments.base import censor_reading
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.result import Diagnosis, DiagnosisOptions
from klute_sim.diagnosis.workflow import diagnose
from tests.diagnosis.synthetic_dataset import write_dataset

LIMITS = SensorLimits(-9.0, 300.0)
FORCES = st.floats(-1e3, 1e3)
FULL_SCALE = 800.0
"""Force [N] that a third of the samples exceed."""


@given(simulated=FORCES, actual=FORCES)
def test_residual_is_that_of_censored_data(simulated: float, actual: float) -> None:
    measured = np.clip(np.array([actual]), *LIMITS)
    residual = float((measured - censor_reading(np.array([simulated]), measured, LIMITS))[0])
    if LIMITS.low < actual < LIMITS.high:
        assert residual == actual - simulated
    elif actual >= LIMITS.high:
        assert residual == max(0.0, LIMITS.high - simulated)
    else:
        assert residual == min(0.0, LIMITS.low - simulated)


@given(simulated=FORCES, actual=st.floats(-1e3, 1e3))
def test_one_limit_leaves_the_other_side_alone(simulated: float, actual: float) -> None:
    measured, reading = np.array([min(actual, 300.0)]), np.array([simulated])
    result = censor_reading(reading, measured, SensorLimits(-np.inf, 300.0))
    assert result[0] == (simulated if actual < 300.0 else min(simulated, 300.0))


def clip_force(folder: Path) -> Dataset:
    """Clip the load cell of all trials at its full scale, where its converter still trembles; return the dataset."""
    rng = np.random.default_rng(5)
    n_clipped = n_samples = 0
    for path in sorted(folder.glob("*.csv")):
        table = pyarrow.csv.read_csv(path)
        columns = {name: table.column(name).to_numpy().copy() for name in table.column_names}
        force = columns["force [N]"]
        is_clipped = force > FULL_SCALE
        n_clipped, n_samples = n_clipped + int(is_clipped.sum()), n_samples + len(force)
        columns["force [N]"] = np.where(is_clipped, FULL_SCALE + rng.normal(0.0, 0.3, len(force)), force)
        write_trial(path, columns)
    assert 0.2 < n_clipped / n_samples < 0.6
    return load_dataset(folder)


def declare_limits(folder: Path) -> None:
    file = folder / "dataset.toml"
    file.write_text(
        file.read_text().replace("[uncertain]", f'[limits]\nforce = "to {FULL_SCALE - 2.0} N"\n[uncertain]')
    )


def test_limits_reach_the_experiments(tmp_path: Path) -> None:
    write_dataset(tmp_path, groups=("fit_1",), repeats=1, seconds=1.0)
    declare_limits(tmp_path)
    data = clip_force(tmp_path)
    assert data.trials[0].limits == {"force": SensorLimits(-np.inf, 798.0)}
    (experiment,) = prepare_experiments(data, split_dataset(data))
    assert experiment.limits == data.trials[0].limits
    assert experiment.measured["force"].value.max() == 798.0
    assert data.trials[0].measured["force"].value.max() > 799.0


@pytest.fixture(scope="module")
def diagnoses(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Diagnosis]:
    """Return the diagnoses of a clipped load cell: without an effect and limits, without an effect, with an effect."""
    results = {}
    folder = tmp_path_factory.mktemp("limits")
    friction = {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}}
    options = DiagnosisOptions(only=("braid_hysteresis", "muscle_damping", "sensor_gain"))
    for name, effects in {"undeclared": {}, "declared": {}, "friction": friction}.items():
        write_dataset(folder / name, effects)
        if name != "undeclared":
            declare_limits(folder / name)
        results[name] = diagnose(clip_force(folder / name), options)
    return results


@pytest.mark.slow
def test_clipped_load_cell_makes_a_gap_only_without_limits(diagnoses: dict[str, Diagnosis]) -> None:
    assert diagnoses["undeclared"].verdict != "nothing-missing"
    assert diagnoses["declared"].verdict == "nothing-missing", diagnoses["declared"].reasons


@pytest.mark.slow
def test_effect_is_identified_with_a_clipped_load_cell(diagnoses: dict[str, Diagnosis]) -> None:
    diagnosis = diagnoses["friction"]
    assert diagnosis.verdict == "identified", diagnosis.reasons
    assert diagnosis.final_fit is not None
    (term,) = diagnosis.final_fit.hypothesis.terms
    assert term.effect == "braid_hysteresis"
