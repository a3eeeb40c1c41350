"""Import of measured gait data that are not part of the project (``KLUTE_SIM_DATA``, docs/real-data.md)."""

import os
from pathlib import Path

import numpy as np
import pytest

from klute_sim.errors import InputError
from klute_sim.mocap import reference_import, trial
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics.leg import Leg
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import sources
from klute_sim.mocap.reference_import import ImportedReference

DATA = Path(os.environ.get("KLUTE_SIM_DATA", "nowhere"))
MOORE, HORST, OPENSIM = (DATA / name for name in ("gait_moore2015", "gait_horst2019", "opensim_files"))

pytestmark = [
    pytest.mark.extras,
    pytest.mark.skipif(
        not all(folder.exists() for folder in (MOORE, HORST, OPENSIM)), reason="KLUTE_SIM_DATA does not hold these data"
    ),
]


def get_c3d(number: int) -> list[Path]:
    pytest.importorskip("ezc3d", reason="the extra 'c3d' is not installed")
    return [HORST / f"S01_000{number}_Gait.c3d"]


def get_opensim(number: int) -> list[Path]:
    return [HORST / f"S01_000{number}_{name}" for name in ("IK.mot", "Gait_forces.sto", "ID.sto")]


def extract_legs(files: list[Path], mass: float) -> dict[str, Leg]:
    group = [source for file in files for source in sources.read(file)]
    legs = trial.extract_legs(group, ImportOptions(mass=mass), ImportLog())
    return {leg.side: leg for leg in legs}


def has_warning(imported: ImportedReference, *parts: str) -> bool:
    return any(all(part in sentence for part in parts) for sentence in imported.log.warnings)


@pytest.mark.parametrize("number", [2, 3])
def test_c3d_and_opensim_files_of_one_trial_agree(number: int) -> None:
    """Compare markers with functional joints and a rigid foot with inverse kinematics and dynamics of a whole body.

    The zeros of the angles differ by up to 3.5 degrees because of the flat foot. The tolerances of hip and knee are
    wide: the hip of the model reaches its bound of -30 degrees, and pelvis and knee compensate.
    """
    by_markers, by_model = extract_legs(get_c3d(number), 81.0), extract_legs(get_opensim(number), 81.0)
    for side in ("right", "left"):
        measured, modelled = by_markers[side], by_model[side]
        stance = modelled.channels["grf_vertical"] > 20.0
        for name, bias, spread in (("shank_angle", 4.0, 2.2), ("ankle_angle", 3.5, 2.6), ("knee_angle", 3.5, 6.0)):
            difference = np.interp(modelled.time, measured.time, measured.channels[name]) - modelled.channels[name]
            assert abs(np.nanmean(difference)) < bias, (side, name)
            assert np.nanstd(difference) < spread, (side, name)
        for name in ("grf_vertical", "grf_forward"):
            difference = np.interp(modelled.time, measured.time, measured.channels[name]) - modelled.channels[name]
            assert np.nanmax(np.abs(difference)) < 0.1, (side, name)
        moment = np.interp(modelled.time, measured.time, measured.channels["ankle_moment"])
        difference = (moment - modelled.channels["ankle_moment"])[stance]
        assert np.sqrt(np.mean(difference**2)) < 9.0, side
        assert moment.max() == pytest.approx(modelled.channels["ankle_moment"].max(), rel=0.07)


def test_listed_mass_contradicts_plates() -> None:
    imported = reference_import.import_reference([*get_c3d(2), *get_c3d(3)], ImportOptions(mass=68.9))
    assert imported.impulse_mass == pytest.approx(82.0, abs=0.7)
    assert has_warning(
        imported, "The given mass, 68.9 kg, contradicts the impulse of the ground reaction, which supports 8"
    )
    assert has_warning(imported, "S01_0002_Gait.c3d: without load, plate 1 reads -5.0 N vertically")
    assert len(imported.strides["right"]) == 2
    assert imported.stride_time == pytest.approx(1.06, abs=0.01)
    assert imported.walking_speed == pytest.approx(1.4, abs=0.05)
    by_model = reference_import.import_reference([*get_opensim(2), *get_opensim(3)], ImportOptions(mass=68.9))
    assert by_model.impulse_mass == pytest.approx(imported.impulse_mass, rel=0.01)
    assert by_model.walking_speed == pytest.approx(imported.walking_speed, rel=0.03)
    assert has_warning(by_model, "'hip_flexion_r' stays at -29.7 degrees", "a bound of the model may clip it")


def test_treadmill_pitfalls_are_reported() -> None:
    files = [MOORE / "UnpertPre_data.csv", MOORE / "UnpertPre__event.csv"]
    imported = reference_import.import_reference(files, ImportOptions(mass=79.4, stature=1.832))
    assert has_warning(imported, "the belt accelerates")
    assert has_warning(imported, "'LeftCOP_x' and 'RightCOP_x' are equal for 36 % of the time")
    assert has_warning(imported, "is -1.5708 rad (-90 degrees) in standing")
    assert has_warning(imported, "The given mass, 79.4 kg, contradicts", "82.0 kg")
    assert {side: len(strides) for side, strides in imported.strides.items()} == {"right": 42, "left": 42}
    assert imported.walking_speed == pytest.approx(0.80, abs=0.01)
    assert imported.stride_time == pytest.approx(1.340, abs=0.005)
    assert imported.log.missing == []
    listed = [sentence for sentence in imported.log.derived if sentence.startswith("Event check")]
    assert len(listed) == 4
    # line 3000 of the file: 29.978614 s, in radians, with the ankle angle of a right angle at -pi/2
    right = extract_legs(files, 79.4)["right"]
    at = {name: np.interp(29.978614, right.time, samples) for name, samples in right.channels.items()}
    assert at["knee_angle"] == pytest.approx(np.degrees(0.505289), abs=1.5)  # filtered
    assert at["ankle_angle"] == pytest.approx(np.degrees(1.769900 - np.pi / 2), abs=1.5)
    assert at["ankle_moment"] == pytest.approx(44.61, abs=8.0)
    assert at["grf_vertical"] == pytest.approx(274.3, abs=25.0)


def test_repeated_trials_of_one_person_agree() -> None:
    options = ImportOptions(mass=79.4, side="right")
    before, after = (
        reference_import.import_reference([MOORE / f"Unpert{w}_data.csv"], options) for w in ("Pre", "Post")
    )
    for column, tolerance in (
        ("ankle_dorsiflexion_deg", 3.0),
        ("knee_flexion_deg", 3.0),
        ("grf_vertical_n_per_kg", 0.5),
    ):
        assert np.sqrt(np.mean((before.table[column] - after.table[column]) ** 2)) < tolerance, column


def test_opensim_example_by_markers_and_by_angles_agree() -> None:
    """The angles (72.6 kg on a treadmill) are shorter than one stride, the markers are longer."""
    forces = OPENSIM / "subject01_walk1_grf.mot"
    by_markers = reference_import.import_reference([OPENSIM / "subject01_walk1.trc", forces], ImportOptions())
    assert by_markers.mass == pytest.approx(72.6, abs=0.5)
    assert by_markers.stride_time == pytest.approx(1.235, abs=0.005)
    files = [OPENSIM / "subject01_walk1_ik.mot", forces, OPENSIM / "inverse_dynamics.sto"]
    by_angles = reference_import.import_reference(files, ImportOptions())
    assert has_warning(by_angles, "one was assembled from the end of one stride and the beginning of the next")
    assert any(e["channel"] == "knee_angle" and e["sign"] == -1 for e in by_angles.log.channels)
    for column, tolerance in (("hip_flexion_deg", 6.0), ("shank_forward_deg", 7.0), ("ankle_dorsiflexion_deg", 7.0)):
        difference = by_markers.table[column] - by_angles.table[column]
        assert np.sqrt(np.mean(difference**2)) < tolerance, column
    with pytest.raises(InputError, match="no ground reaction"):
        reference_import.import_reference(files[::2], ImportOptions())
