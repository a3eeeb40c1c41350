"""Foot of each contact on force plates where the angles of both knees are unknown."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from klute_sim.mocap import dataset_import, reference_import
from klute_sim.mocap.dataset_import import DatasetOptions, ImportedDataset
from klute_sim.mocap.formats import trc
from klute_sim.mocap.options import ImportOptions
from tests import synthetic_gait
from tests.synthetic_gait import MASS, Walker


def write_walk(folder: Path, has_marker: Callable[[str], bool] = lambda name: True) -> list[Path]:
    """Write a walk on a plate for each foot, and the log of a prosthesis."""
    folder.mkdir()
    walker = Walker()
    markers = synthetic_gait.markers(walker)
    kept = {name: position for name, position in markers.positions.items() if has_marker(name)}
    trc.write(trc.Markers(markers.time, kept), folder / "markers.trc")
    angle = walker.of("ankle_dorsiflexion_deg", "right")
    rows = [f"{time!r},1.5,{value!r}" for time, value in zip(walker.time.tolist(), angle.tolist(), strict=True)]
    (folder / "log.csv").write_text("\n".join(["time [s],pressure_command [bar],ankle_angle [deg]", *rows]) + "\n")
    return [folder / "markers.trc", synthetic_gait.opensim(folder, walker)[1], folder / "log.csv"]


def import_walk(files: list[Path]) -> ImportedDataset:
    options = DatasetOptions(device="klute-1-1-4-pair", uncertainties={})
    return dataset_import.import_dataset(files, ImportOptions(side="right"), options)


@pytest.mark.parametrize(
    ("has_marker", "reason"),
    [
        (lambda name: name.startswith("R_"), "contacts whose centre of pressure the right ankle passes"),
        (lambda name: name.startswith("R_") and name != "R_HIP", "contacts whose centre of pressure the right ankle"),
        (lambda name: not name.endswith("HIP"), "that whose ankle stands"),
        (lambda name: name != "R_HIP", "that whose ankle stands"),
    ],
)
def test_steps_of_the_other_foot_are_left_out(has_marker: Callable[[str], bool], reason: str, tmp_path: Path) -> None:
    expected = import_walk(write_walk(tmp_path / "both")).trials[0]
    imported = import_walk(write_walk(tmp_path / "fewer", has_marker))
    (trial,) = imported.trials
    assert trial.foot_strikes == pytest.approx(expected.foot_strikes)
    for name in ("grf_vertical", "grf_forward", "cop_x", "shank_angle", "ankle_x", "ankle_z"):
        value = np.interp(expected.channels[name].time, *trial.channels[name])
        assert value == pytest.approx(expected.channels[name].value, nan_ok=True), name
    assert any(sentence.startswith("Foot on a plate: ") and reason in sentence for sentence in imported.log.derived)


def test_steps_of_the_other_foot_are_left_out_where_motion_comes_from_columns(tmp_path: Path) -> None:
    expected = import_walk(write_walk(tmp_path / "both")).trials[0]
    files = write_walk(tmp_path / "columns")
    walker = Walker()
    shank, ankle = walker.of("shank_forward_deg", "right"), walker.points("right")["ANKLE"]
    rows = [",".join(map(repr, row)) for row in np.column_stack([walker.time, shank, ankle]).tolist()]
    heading = "time [s],shank_angle [deg],ankle_x [m],ankle_z [m]"
    (tmp_path / "columns" / "motion.csv").write_text("\n".join([heading, *rows]) + "\n")
    imported = import_walk([tmp_path / "columns" / "motion.csv", *files[1:]])
    (trial,) = imported.trials
    assert trial.foot_strikes == pytest.approx(expected.foot_strikes)
    vertical = np.interp(expected.channels["grf_vertical"].time, *trial.channels["grf_vertical"])
    assert vertical == pytest.approx(expected.channels["grf_vertical"].value, nan_ok=True)
    assert any("contacts whose centre of pressure the right ankle passes" in text for text in imported.log.derived)


def test_reference_of_one_leg_has_its_load_only(tmp_path: Path) -> None:
    files = write_walk(tmp_path / "one", lambda name: name.startswith("R_"))[:2]
    imported = reference_import.import_reference(files, ImportOptions(mass=MASS))
    both = reference_import.import_reference(write_walk(tmp_path / "both")[:2], ImportOptions(mass=MASS, side="right"))
    assert imported.table["grf_vertical_n_per_kg"] == pytest.approx(both.table["grf_vertical_n_per_kg"], abs=1e-6)
