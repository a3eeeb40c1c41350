"""Span and foot strikes of a trial with a prosthesis in which some steps are on no plate."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.controllers.pressure import load_default_profile
from klute_sim.datasets import dataset as datasets
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.gait import prepare_gait_trial
from klute_sim.gait.contacts import Contact, find_contacts
from klute_sim.gait.rig import rig
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.mocap import dataset_import, export
from klute_sim.mocap.dataset_import import DatasetOptions, ImportedDataset
from klute_sim.mocap.formats import storage
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.prosthesis_trials import _find_loaded_span
from klute_sim.recording import csv
from klute_sim.recording.recording import Recording

DEVICE = "klute-1-1-4-pair"
FILES = ("markers.trc", "ground_reaction.mot", "log.csv")


@pytest.fixture(scope="module")
def recording() -> Recording:
    return rig.simulate_gait(load_device(DEVICE), load_default_profile(), GaitOptions(strides=5, dt=1e-3))


def export_steps(folder: Path, recording: Recording, first: float, last: float) -> list[Path]:
    """Export ``recording`` with plates that show the load from ``first`` to ``last`` [s] only."""
    folder.mkdir()
    export.write_files(recording, "right", ("mot", "trc", "log"), folder)
    force = storage.read(folder / "ground_reaction.mot")
    on_plate = (force.time > first) & (force.time < last)
    columns = {n: s if n == "time" else s * on_plate for n, s in force.columns.items()}
    storage.write(storage.Storage(columns, False), folder / "ground_reaction.mot")
    return [folder / name for name in FILES]


def find_foot_strikes(recording: Recording) -> list[float]:
    return [c.foot_strike for c in find_contacts(recording["time"], recording["grf_vertical"]) if c.has_foot_strike]


def import_trial(files: list[Path]) -> ImportedDataset:
    options = ImportOptions(motion_cutoff=0.0, load_cutoff=0.0, ankle_zero="file")
    return dataset_import.import_dataset(files, options, DatasetOptions(device=DEVICE, uncertainties={}))


@pytest.mark.parametrize(
    ("begin", "end", "expected"),
    [
        (0.65, 3.15, (0.65, 3.15)),
        (0.55, 3.25, (0.7, 3.1)),  # within a second of the plates, but longer than a swing
        (0.0, 9.0, (0.7, 3.1)),
    ],
)
def test_trial_extends_beyond_the_plates_by_a_swing(begin: float, end: float, expected: tuple[float, float]) -> None:
    contacts = [Contact(1.0, 1.7, True, True), Contact(2.1, 2.8, True, True)]
    assert _find_loaded_span(contacts, begin, end) == pytest.approx(expected)


def test_trial_with_a_short_swing_or_none_is_trimmed_within_the_swing() -> None:
    contacts = [Contact(1.0, 1.3, True, True), Contact(1.5, 1.8, True, True)]
    assert _find_loaded_span(contacts, 0.75, 2.1) == pytest.approx((0.8, 2.0))
    assert _find_loaded_span(contacts[:1], 0.75, 2.1) == pytest.approx((0.75, 1.6))
    assert _find_loaded_span([], 0.0, 2.0) == (0.0, 2.0)


def test_stance_beside_the_plates_is_left_out(recording: Recording, tmp_path: Path) -> None:
    strikes = find_foot_strikes(recording)
    files = export_steps(tmp_path / "lab", recording, strikes[0] - 0.1, strikes[3] - 0.1)
    (trial,) = import_trial(files).trials
    begin, end = (trial.channels["shank_angle"].time[k] for k in (0, -1))
    is_kept = (recording["time"] >= begin) & (recording["time"] <= end)
    measured = np.interp(recording["time"], *trial.channels["grf_vertical"])
    assert measured[is_kept] == pytest.approx(recording["grf_vertical"][is_kept], abs=40.0)


@pytest.mark.slow
@pytest.mark.parametrize("seconds_after_strike", [0.1, 0.16])
def test_foot_strike_counts_with_a_whole_contact(
    seconds_after_strike: float, recording: Recording, tmp_path: Path
) -> None:
    """What the import accepts, the diagnosis accepts as well."""
    files = export_steps(tmp_path / "lab", recording, -1.0, 99.0)
    strikes = find_foot_strikes(recording)
    log = export.to_prosthesis_log(recording)
    csv.write(log.select(log["time"] <= strikes[3] + seconds_after_strike), files[2])
    imported = import_trial(files)
    (tmp_path / "data").mkdir()
    dataset_import.write_dataset(imported, tmp_path / "data")
    (trial,) = datasets.load_dataset(tmp_path / "data").trials
    assert prepare_gait_trial(trial, "fit").foot_strikes + trial.prescribed["shank_angle"].time[0] == pytest.approx(
        imported.trials[0].foot_strikes, abs=2e-3
    )
