"""Datasets whose trials measure different channels at different sampling rates."""

from pathlib import Path

import pyarrow.csv
import pytest

from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.diagnosis.result import DiagnosisOptions
from klute_sim.diagnosis.workflow import diagnose
from tests.diagnosis.synthetic_dataset import write_dataset

GROUPS = ("fit_force", "fit_pressure", "fit_both", "validation_both", "test_force", "test_pressure")


@pytest.mark.slow
def test_effect_is_identified_from_trials_with_different_channels(tmp_path: Path) -> None:
    friction = {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}}
    write_dataset(tmp_path, friction, groups=GROUPS, seconds=2.0)
    for path in tmp_path.glob("*.csv"):
        table = pyarrow.csv.read_csv(path)
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
        if "force" in path.stem:
            del columns["pressure [bar]"]
        if "pressure" in path.stem:  # a slow logger
            del columns["force [N]"]
            columns = {name: samples[::4] for name, samples in columns.items()}
        write_trial(path, columns)
    diagnosis = diagnose(load_dataset(tmp_path), DiagnosisOptions(only=("braid_hysteresis", "sensor_gain")))
    assert diagnosis.verdict == "identified", diagnosis.reasons
    assert diagnosis.final_fit is not None
    assert [term.effect for term in diagnosis.final_fit.hypothesis.terms] == ["braid_hysteresis"]
