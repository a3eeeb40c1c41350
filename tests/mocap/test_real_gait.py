"""Gait that nobody measured for this program; it is no part of the project (``KLUTE_SIM_DATA``, docs/real-data.md)."""

import os
from pathlib import Path

import numpy as np
import pytest

from klute_sim.errors import InputError
from klute_sim.mocap import reference_import, trial
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import sources
from klute_sim.mocap.reference_import import ImportedReference
from klute_sim.mocap.strides.leg import LegChannels

DATA = Path(os.environ.get("KLUTE_SIM_DATA", "nowhere"))
MOORE, HORST, OPENSIM = (DATA / name for name in ("gait_moore2015", "gait_horst2019", "opensim_files"))

pytestmark = pytest.mark.skipif(
    not all(folder.exists() for folder in (MOORE, HORST, OPENSIM)), reason="KLUTE_SIM_DATA does not hold this gait"
)


def captured(number: int) -> list[Path]:
    pytest.importorskip("ezc3d", reason="the extra 'c3d' is not installed")
    return [HORST / f"S01_000{number}_Gait.c3d"]


def opensim(number: int) -> list[Path]:
    return [HORST / f"S01_000{number}_{name}" for name in ("IK.mot", "Gait_forces.sto", "ID.sto")]


def limbs(files: list[Path], mass: float) -> dict[str, LegChannels]:
    found = trial.extract_legs([sources.read(file) for file in files], ImportOptions(mass=mass), ImportLog())
    return {limb.side: limb for limb in found}


def said(found: ImportedReference, *parts: str) -> bool:
    return any(all(part in sentence for part in parts) for sentence in found.log.warnings)


@pytest.mark.parametrize("number", [2, 3])
def test_the_capture_and_opensims_files_of_one_trial_agree(number: int) -> None:
    """Markers alone, by functional joints and a rigid foot, against inverse kinematics and dynamics of a whole body.

    The angles' zeros differ by what the flat foot decides (up to 3.5 degrees). Hip and knee are not compared closely:
    the model's hip stands at its bound of -30 degrees, and its pelvis and knee make up for it.
    """
    by_markers, by_model = limbs(captured(number), 81.0), limbs(opensim(number), 81.0)
    for side in ("right", "left"):
        one, other = by_markers[side], by_model[side]
        stance = other.channels["grf_vertical"] > 20.0
        for name, bias, spread in (("shank_angle", 4.0, 2.2), ("ankle_angle", 3.5, 2.6), ("knee_angle", 3.5, 6.0)):
            off = np.interp(other.time, one.time, one.channels[name]) - other.channels[name]
            assert abs(np.nanmean(off)) < bias, (side, name)
            assert np.nanstd(off) < spread, (side, name)
        for name in ("grf_vertical", "grf_forward"):
            off = np.interp(other.time, one.time, one.channels[name]) - other.channels[name]
            assert np.nanmax(np.abs(off)) < 0.1, (side, name)
        moment = np.interp(other.time, one.time, one.channels["ankle_moment"])
        off = (moment - other.channels["ankle_moment"])[stance]
        assert np.sqrt(np.mean(off**2)) < 9.0, side
        assert moment.max() == pytest.approx(other.channels["ankle_moment"].max(), rel=0.07)


def test_the_mass_listed_contradicts_the_plates() -> None:
    found = reference_import.import_reference([*captured(2), *captured(3)], ImportOptions(mass=68.9))
    assert found.impulse_mass == pytest.approx(82.0, abs=0.7)
    assert said(found, "The mass given, 68.9 kg, contradicts the impulse of the ground reaction, which carries 8")
    assert said(found, "S01_0002_Gait.c3d: plate 1 reads -5.0 N with nobody on it")
    assert len(found.strides["right"]) == 2
    assert found.stride_time == pytest.approx(1.06, abs=0.01)
    assert found.walking_speed == pytest.approx(1.4, abs=0.05)
    by_model = reference_import.import_reference([*opensim(2), *opensim(3)], ImportOptions(mass=68.9))
    assert by_model.impulse_mass == pytest.approx(found.impulse_mass, rel=0.01)
    assert by_model.walking_speed == pytest.approx(found.walking_speed, rel=0.03)
    assert said(by_model, "'hip_flexion_r' stands at -29.7 degrees", "clipped by a model's bound")


def test_the_treadmills_traps_are_named() -> None:
    files = [MOORE / "UnpertPre_data.csv", MOORE / "UnpertPre__event.csv"]
    found = reference_import.import_reference(files, ImportOptions(mass=79.4, stature=1.832))
    assert said(found, "the belt ramps up")
    assert said(found, "'LeftCOP_x' and 'RightCOP_x' are the same for 36 % of the time")
    assert said(found, "is -1.5708 rad (-90 degrees) in standing")
    assert said(found, "The mass given, 79.4 kg, contradicts", "82.0 kg")
    assert {side: len(of) for side, of in found.strides.items()} == {"right": 42, "left": 42}
    assert found.walking_speed == pytest.approx(0.80, abs=0.01)
    assert found.stride_time == pytest.approx(1.340, abs=0.005)
    assert found.log.missing == []
    listed = [sentence for sentence in found.log.derived if sentence.startswith("Check of the events")]
    assert len(listed) == 4
    # one instant by hand: line 3000 of the file, 29.978614 s, in radians with the foot at right angles at -pi/2
    right = limbs(files, 79.4)["right"]
    at = {name: np.interp(29.978614, right.time, samples) for name, samples in right.channels.items()}
    assert at["knee_angle"] == pytest.approx(np.degrees(0.505289), abs=1.5)  # filtered
    assert at["ankle_angle"] == pytest.approx(np.degrees(1.769900 - np.pi / 2), abs=1.5)
    assert at["ankle_moment"] == pytest.approx(44.61, abs=8.0)
    assert at["grf_vertical"] == pytest.approx(274.3, abs=25.0)


def test_the_same_person_twice_walks_alike() -> None:
    options = ImportOptions(mass=79.4, side="right")
    one, two = (reference_import.import_reference([MOORE / f"Unpert{w}_data.csv"], options) for w in ("Pre", "Post"))
    for column, near in (("ankle_dorsiflexion_deg", 3.0), ("knee_flexion_deg", 3.0), ("grf_vertical_n_per_kg", 0.5)):
        assert np.sqrt(np.mean((one.table[column] - two.table[column]) ** 2)) < near, column


def test_opensims_example_by_markers_and_by_angles() -> None:
    """72.6 kg on a treadmill: the record of angles is shorter than a stride, the markers' is longer."""
    forces = OPENSIM / "subject01_walk1_grf.mot"
    by_markers = reference_import.import_reference([OPENSIM / "subject01_walk1.trc", forces], ImportOptions())
    assert by_markers.mass == pytest.approx(72.6, abs=0.5)
    assert by_markers.stride_time == pytest.approx(1.235, abs=0.005)
    files = [OPENSIM / "subject01_walk1_ik.mot", forces, OPENSIM / "inverse_dynamics.sto"]
    by_angles = reference_import.import_reference(files, ImportOptions())
    assert said(by_angles, "one was put together from the end of one and the beginning of the next")
    assert any(e["channel"] == "knee_angle" and e["sign"] == -1 for e in by_angles.log.channels)
    for column, near in (("hip_flexion_deg", 6.0), ("shank_forward_deg", 7.0), ("ankle_dorsiflexion_deg", 7.0)):
        off = by_markers.table[column] - by_angles.table[column]
        assert np.sqrt(np.mean(off**2)) < near, column
    with pytest.raises(InputError, match="no ground reaction"):
        reference_import.import_reference(files[::2], ImportOptions())
