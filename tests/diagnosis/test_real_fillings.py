"""Published fillings of a muscle with the pressure alone, not part of the project (see ``KLUTE_SIM_DATA``)."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.diagnosis.result import DiagnosisOptions
from klute_sim.diagnosis.workflow import diagnose
from tests.diagnosis.test_real_data import DEVICE

DATA = Path(os.environ.get("KLUTE_SIM_DATA", "nowhere")) / "pam_fill_tests"
SUPPLY_KPA = 635.0
N_REST = 50
"""Number of samples at rest, 0.01 s apart, that are written before the valve opens."""

pytestmark = [
    pytest.mark.extras,
    pytest.mark.skipif(not DATA.exists(), reason="KLUTE_SIM_DATA does not hold these measurements"),
]


def write_fillings(folder: Path, fillings: tuple[int, ...]) -> Path:
    """Write ``fillings`` as repeats: the valve opens at the first sample, and the muscle is clamped (assumed)."""
    (folder / "muscle.toml").write_text(DEVICE.replace("pressure_bar = 7.0", "pressure_bar = 6.35"), "utf-8")
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', 'device = "muscle.toml"']
    for filling in fillings:
        time, pressure = loadmat(DATA / f"Experiment{filling}Fill.mat")["data"].T
        time = np.concatenate([0.01 * np.arange(N_REST), time + 0.01 * N_REST])
        columns = {
            "time [s]": time,
            "length [mm]": np.full(len(time), 200.0),
            "pressure_command [kPa]": np.where(np.arange(len(time)) <= N_REST + 1, 0.0, SUPPLY_KPA),
            "pressure [kPa]": np.concatenate([np.full(N_REST, pressure[0]), pressure]),
        }
        write_trial(folder / f"fill_{filling}.csv", columns)
        lines += ["[[trial]]", f'files = ["fill_{filling}.csv"]', 'group = "fill"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


@pytest.mark.parametrize("fillings", [(2,), (4,), (1, 2)], ids=["2", "4", "1 and 2"])
def test_supply_is_named_from_the_pressure_alone(fillings: tuple[int, ...], tmp_path: Path) -> None:
    diagnosis = diagnose(load_dataset(write_fillings(tmp_path, fillings)), DiagnosisOptions())
    assert diagnosis.verdict in ("identified-in-part", "indistinguishable")
    assert {term.effect for term in diagnosis.added_terms} <= {"pressure_lag", "choked_valve", "hose"}
    gap = diagnosis.channel_rms["pressure"]
    assert gap.with_effects < 0.15 * gap.refitted
    if diagnosis.prediction is not None:
        assert 0.9 < diagnosis.prediction.share <= 1.0
    if diagnosis.verdict == "indistinguishable":
        fits = [diagnosis.final_fit, *(model.fit for model in diagnosis.equivalent_models)]
        assert "choked_valve" in {term.effect for fit in fits if fit for term in fit.hypothesis.terms}


def test_gauge_upstream_of_a_restriction_names_nothing(tmp_path: Path) -> None:
    """Filling 3: the gauge shows the supply within 50 ms, then falls, and follows the muscle later."""
    diagnosis = diagnose(load_dataset(write_fillings(tmp_path, (3,))), DiagnosisOptions())
    assert (diagnosis.verdict, diagnosis.added_terms) == ("insufficient-data", ())
