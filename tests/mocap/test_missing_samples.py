"""Files that leave samples out, instead of leaving their cells empty."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.mocap import dataset_import
from klute_sim.mocap.dataset_import import DatasetOptions
from klute_sim.mocap.formats import storage, trc
from klute_sim.mocap.kinematics import from_markers
from klute_sim.mocap.kinematics.leg import Leg
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing.markers import WalkingFrame
from klute_sim.mocap.prosthesis_trials import ProsthesisTrial
from tests import synthetic_gait
from tests.mocap.motion_files import RAW, extract_legs, write_markers, write_opensim
from tests.synthetic_gait import Walker

GAP = (1.5, 2.1)
"""Beginning and end of the samples that are left out [s]."""
IDENTITY = WalkingFrame(np.eye(3), "laboratory")


def remove_rows(path: Path, begin: float, end: float) -> None:
    """Remove the rows between ``begin`` and ``end`` [s] from the file at ``path``."""
    if path.suffix == ".trc":
        markers = trc.read(path)
        is_present = (markers.time < begin) | (markers.time > end)
        positions = {name: position[is_present] for name, position in markers.positions.items()}
        trc.write(trc.Markers(markers.time[is_present], positions), path)
        return
    old = storage.read(path)
    is_present = (old.time < begin) | (old.time > end)
    storage.write(storage.Storage({n: s[is_present] for n, s in old.columns.items()}, old.in_degrees), path)


def check_gap(leg: Leg, expected: Leg, channels: tuple[str, ...], begin: float, end: float) -> None:
    """Check that ``channels`` are unknown in the gap and are those of ``expected`` in all other samples."""
    inside = (leg.time > begin) & (leg.time < end)
    for name in channels:
        values = leg.channels[name]
        assert np.isnan(values[inside]).all(), name
        outside = ~inside & np.isfinite(values)
        assert outside.sum() >= (~inside).sum() - 4
        known = np.interp(leg.time, expected.time, expected.channels[name])
        assert values[outside] == pytest.approx(known[outside], abs=0.01), name


def test_markers_are_unknown_in_a_long_gap(tmp_path: Path) -> None:
    files = write_markers(tmp_path)
    expected = extract_legs(files, RAW)
    remove_rows(files[0], *GAP)
    for side, leg in extract_legs(files, RAW).items():
        check_gap(leg, expected[side], ("knee_angle", "shank_angle"), *GAP)


def test_angles_are_unknown_in_a_long_gap(tmp_path: Path) -> None:
    files = write_opensim(tmp_path)
    expected = extract_legs(files, RAW)
    remove_rows(files[0], *GAP)
    for side, leg in extract_legs(files, RAW).items():
        check_gap(leg, expected[side], ("knee_angle", "hip_angle"), *GAP)


def test_loads_are_unknown_in_a_gap_with_a_heel_strike(tmp_path: Path) -> None:
    files = write_opensim(tmp_path)
    expected = extract_legs(files, RAW)["right"]
    strike = expected.contacts[1].foot_strike
    remove_rows(files[1], strike - 0.05, strike + 0.05)
    leg = extract_legs(files, RAW)["right"]
    check_gap(leg, expected, ("grf_vertical",), strike - 0.045, strike + 0.045)
    assert not leg.contacts[1].has_foot_strike


def test_short_gaps_of_markers_are_interpolated() -> None:
    markers = synthetic_gait.markers(Walker())
    is_present = (markers.time < 1.5) | (markers.time > 1.6)
    shorter = trc.Markers(markers.time[is_present], {n: p[is_present] for n, p in markers.positions.items()})
    filled = from_markers.preprocess_markers(shorter, IDENTITY, 0.0, "a.trc")
    assert filled.time == pytest.approx(markers.time)
    for name, position in filled.positions.items():
        assert position[is_present] == pytest.approx(markers.positions[name][is_present])
        assert np.isfinite(position).all()


def import_walk(files: list[Path]) -> ProsthesisTrial:
    options = DatasetOptions(device="klute-1-1-4-pair", uncertainties={})
    return dataset_import.import_dataset(files, ImportOptions(side="right"), options).trials[0]


def write_walk(folder: Path, motion: str) -> list[Path]:
    """Write the motion of a walk, as markers or columns, its loads, and the log of a prosthesis."""
    walker = Walker()
    trc.write(synthetic_gait.markers(walker), folder / "markers.trc")
    shank, ankle = walker.of("shank_forward_deg", "right"), walker.points("right")["ANKLE"]
    tables = {
        "motion.csv": ("shank_angle [deg],ankle_x [m],ankle_z [m]", [shank, ankle]),
        "log.csv": (
            "pressure_command [bar],ankle_angle [deg]",
            [0.0 * shank, walker.of("ankle_dorsiflexion_deg", "right")],
        ),
    }
    for name, (heading, columns) in tables.items():
        rows = [",".join(map(repr, row)) for row in np.column_stack([walker.time, *columns]).tolist()]
        (folder / name).write_text("\n".join([f"time [s],{heading}", *rows]) + "\n")
    return [folder / motion, synthetic_gait.opensim(folder, walker)[1], folder / "log.csv"]


@pytest.mark.parametrize(("motion", "file"), [("markers.trc", 0), ("motion.csv", 0), ("markers.trc", 1)])
def test_trial_of_a_prosthesis_is_cut_at_a_long_gap(motion: str, file: int, tmp_path: Path) -> None:
    files = write_walk(tmp_path, motion)
    begin, end = (0.6, 1.0) if file else (0.7, 1.1)
    if files[file].suffix == ".csv":
        rows = files[file].read_text().splitlines()
        is_present = [not begin < float(row.split(",")[0]) < end for row in rows[1:]]
        kept = [row for row, is_kept in zip(rows[1:], is_present, strict=True) if is_kept]
        files[file].write_text("\n".join([rows[0], *kept]) + "\n")
    else:
        remove_rows(files[file], begin, end)
    trial = import_walk(files)
    name = "grf_vertical" if file else "shank_angle"
    assert trial.channels[name].time[0] > end - 0.02
