"""Import of a synthetic gait with known values: the reference of the package."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.errors import InputError
from klute_sim.gait import reference
from klute_sim.mocap import reference_import
from klute_sim.mocap.formats import storage, trc
from klute_sim.mocap.formats.storage import Storage
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import mapping
from tests import synthetic_gait
from tests.mocap.motion_files import (
    RAW,
    ROW_30,
    edit_columns,
    extract_legs,
    flip,
    get_paths,
    has_sentence,
    write_c3d,
    write_markers,
    write_older_knee,
    write_opensim,
    write_parquet,
    write_treadmill,
)
from tests.synthetic_gait import HUMAN, LATER, MASS, PERIOD, Walker

"""Options without filters and zero shifts, so that values are exact."""

"""Reference at 30 % of the gait cycle for 70 kg; angles minus 30 % of the difference between 100 % and 0 %."""


@pytest.mark.parametrize(
    "files", [write_opensim, write_older_knee, write_treadmill, write_parquet, write_markers, write_c3d]
)
def test_one_instant_matches_reference_row(files: Callable[[Path], list[Path]], tmp_path: Path) -> None:
    for side, leg in extract_legs(files(tmp_path), RAW).items():
        time = LATER[side] + 0.3 * PERIOD
        expected = dict(ROW_30)
        if files in (write_opensim, write_older_knee):
            expected["hip_angle"] = ROW_30["knee_angle"] - ROW_30["shank_angle"] + 4.03  # pelvis tilt in the file
        if files in (write_markers, write_c3d):
            expected["hip_angle"] = ROW_30["knee_angle"] - ROW_30["shank_angle"]  # angle to the vertical
            # minus the moment of the foot's weight: 0.0145 of 70 kg, half-way from ankle to toe
            expected["ankle_moment"] -= 0.0145 * 70 * 9.81 * 0.5 * 0.15
        if files in (write_treadmill, write_parquet):
            # without pelvis tilt the shank angle is knee minus hip plus the offset of the flat foot
            expected["shank_angle"] = leg.channels["shank_angle"][np.searchsorted(leg.time, time - 1e-9)]
            assert expected["shank_angle"] == pytest.approx(8.26, abs=0.7)
        for name, value in expected.items():
            imported = np.interp(time, leg.time, leg.channels[name])
            # the moment from markers includes the inertia of the foot, which is small in mid-stance
            tolerance = 0.5 if name == "ankle_moment" and files in (write_markers, write_c3d) else 0.01
            assert imported == pytest.approx(value, abs=tolerance), (side, name)


@pytest.mark.parametrize("files", [write_opensim, write_older_knee, write_treadmill, write_markers, write_c3d])
def test_import_recovers_synthetic_reference(files: Callable[[Path], list[Path]], tmp_path: Path) -> None:
    imported = reference_import.import_reference(files(tmp_path), ImportOptions(mass=MASS))
    phase = imported.table[reference.PHASE_COLUMN] / 100.0
    # heel strike at 20 N is 0.3 % later than in the reference; filters cause the remaining difference
    tolerances = {"deg": 1.2, "kg": 0.3}
    for column in reference.REQUIRED_COLUMNS:
        if column == "hip_flexion_deg" and files in (write_markers, write_c3d):
            continue
        difference = np.abs(imported.table[column] - HUMAN(column, phase)).max()
        assert difference < tolerances[column.split("_")[-1]], column
    assert imported.stride_time == pytest.approx(PERIOD, abs=1e-3)
    assert imported.toe_off == pytest.approx(63.0, abs=0.6)
    assert imported.impulse_mass == pytest.approx(
        69.5, abs=0.3
    )  # the loads of the reference support 0.993 body weights


def convert_to_radians(paths: list[Path]) -> None:
    edit_columns(paths[0], lambda label, s: s if label in ("time", "pelvis_tx") else np.radians(s), degrees=False)


def convert_to_radians_labelled_degrees(paths: list[Path]) -> None:
    edit_columns(paths[0], lambda label, s: s if label in ("time", "pelvis_tx") else np.radians(s), degrees=True)


def label_degrees_as_radians(paths: list[Path]) -> None:
    edit_columns(paths[0], lambda label, s: s, degrees=False)


def convert_to_foot_shank_angle(paths: list[Path]) -> None:
    edit_columns(paths[0], lambda label, s: 90.0 - s if "ankle" in label else s)


@pytest.mark.parametrize(
    ("modify", "reason"),
    [
        (flip(0, "knee"), "flexion; the label suggests the opposite"),
        (flip(0, "hip"), "the hip is more flexed at heel strike"),
        (flip(0, "ankle"), "plantarflexes from late stance"),
        (flip(1, "vx"), "brakes first"),
        (flip(1, "v"), "brakes first"),
        (flip(2, "ankle"), "mean moment in stance"),
        (convert_to_radians, "unit stated"),
        (convert_to_radians_labelled_degrees, "although the header states deg"),
        (label_degrees_as_radians, "although the header states rad"),
        (convert_to_foot_shank_angle, "zero is the nearest right angle"),
    ],
)
def test_signs_units_and_zeros_are_detected_and_logged(
    modify: Callable[[list[Path]], None], reason: str, tmp_path: Path
) -> None:
    paths = write_opensim(tmp_path)
    plain = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    modify(paths)
    imported = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    for column in reference.REQUIRED_COLUMNS:
        assert imported.table[column] == pytest.approx(plain.table[column], abs=1e-6), column
    assert any(reason in entry["reason"] for entry in imported.log.channels)


def test_neutral_ankle_is_shifted_to_flat_foot_unless_file_zero(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    plain = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    edit_columns(paths[0], lambda label, s: s - 12.0 if "ankle" in label else s)
    moved = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    column = "ankle_dorsiflexion_deg"
    assert moved.table[column] == pytest.approx(plain.table[column])
    assert has_sentence(moved, "warnings", "the right foot is pitched by 11.") or has_sentence(
        moved, "warnings", "pitched by 12."
    )
    left = reference_import.import_reference(paths, ImportOptions(mass=MASS, ankle_zero="file"))
    assert left.table[column].mean() == pytest.approx(plain.table[column].mean() - 12.0, abs=0.6)


def test_mapping_overrides_detection(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    (tmp_path / "map.toml").write_text('[right]\nknee_angle = { column = "knee_angle_r", sign = -1 }\n')
    options = replace(RAW, mapping=mapping.read(tmp_path / "map.toml"))
    log = ImportLog()
    right = extract_legs(paths, options, log)["right"]
    assert np.interp(0.43, right.time, right.channels["knee_angle"]) == pytest.approx(-ROW_30["knee_angle"], abs=0.01)
    assert any(e["channel"] == "knee_angle" and "as specified" in e["reason"] for e in log.channels)


def test_pelvis_tilt_sign_follows_mapping_only(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    plain = extract_legs(paths, RAW)["right"].channels["shank_angle"]
    edit_columns(paths[0], lambda label, s: -s if "tilt" in label else s)
    (tmp_path / "map.toml").write_text('[body]\npelvis_tilt = { column = "pelvis_tilt", sign = -1 }\n')
    log = ImportLog()
    corrected = extract_legs(paths, replace(RAW, mapping=mapping.read(tmp_path / "map.toml")), log)["right"]
    assert corrected.channels["shank_angle"] == pytest.approx(plain)
    assert any(e["channel"] == "pelvis_tilt" and e["sign"] == -1 for e in log.channels)


@pytest.mark.parametrize(("sign", "zero"), [(1, 0.0), (-1, 0.0), (-1, 6.0)])
def test_tables_may_state_the_forward_tilt_of_the_pelvis(sign: int, zero: float, tmp_path: Path) -> None:
    angles, *others = synthetic_gait.opensim(tmp_path, Walker(), tilt=10.0)
    expected = extract_legs([angles, *others], RAW)["right"].channels
    columns = dict(storage.read(angles).columns)
    columns["pelvis_tilt"] = sign * columns["pelvis_tilt"] + zero
    units = {"time": "s", "pelvis_tx": "m"}
    rows = [",".join(f"{name} [{units.get(name, 'deg')}]" for name in columns)]
    rows += [",".join(map(repr, map(float, row))) for row in zip(*columns.values(), strict=True)]
    table, map_file = tmp_path / "angles.csv", tmp_path / "map.toml"
    table.write_text("\n".join(rows) + "\n")
    map_file.write_text(
        f'[body]\npelvis_tilt = {{ column = "pelvis_tilt [deg]", sign = {sign}, zero = {sign * zero} }}\n'
    )
    given = replace(RAW, mapping=mapping.read(map_file))
    log = ImportLog()
    imported = extract_legs([table, *others], given if zero else RAW, log)["right"].channels
    for name in ("shank_angle", "ankle_angle"):
        assert imported[name] == pytest.approx(expected[name]), name
    (entry,) = [e for e in log.channels if e["channel"] == "pelvis_tilt"]
    assert (entry["sign"], entry["zero"]) == (sign, sign * zero)
    assert ("as specified" if zero else "people walk with the pelvis tilted forward") in entry["reason"]


def test_mass_is_estimated_and_contradiction_is_reported(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    assert reference_import.import_reference(paths, ImportOptions()).mass == pytest.approx(69.5, abs=0.3)
    assert not has_sentence(
        reference_import.import_reference(paths, ImportOptions(mass=70.0)), "warnings", "contradicts"
    )
    wrong = reference_import.import_reference(paths, ImportOptions(mass=60.0))
    assert has_sentence(wrong, "warnings", "60 kg, contradicts the impulse of the ground reaction, which supports 69.")
    assert wrong.mass == 60.0
    assert wrong.table["grf_vertical_n_per_kg"].max() == pytest.approx(70 / 60 * 11.1, abs=0.3)


def test_accelerating_belt_is_excluded(tmp_path: Path) -> None:
    imported = reference_import.import_reference(write_treadmill(tmp_path), ImportOptions(mass=MASS))
    assert has_sentence(imported, "warnings", "the belt accelerates: 1 stride of the right leg excluded")
    assert min(stride.start for stride in imported.strides["right"]) > 1.1
    assert imported.walking_speed == pytest.approx(1.2, rel=0.02)
    assert has_sentence(imported, "warnings", "is -1.5708 rad (-90 degrees) in standing")
    assert has_sentence(imported, "warnings", "are equal for 100 % of the time: one centre of pressure for both feet")


def test_clipped_hip_is_reported(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    assert not has_sentence(reference_import.import_reference(paths, RAW), "warnings", "may clip it")
    edit_columns(paths[0], lambda label, s: np.maximum(s, 0.0) if "hip" in label else s)
    assert has_sentence(reference_import.import_reference(paths, RAW), "warnings", "stays at 0.0 degrees for")


def test_plate_offset_is_removed_and_reported(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    clean = reference_import.import_reference(paths, RAW)
    edit_columns(paths[1], lambda label, s: s + 12.0 * label.endswith("1_vy") - 8.0 * label.endswith("1_vx"))
    imported = reference_import.import_reference(paths, RAW)
    assert has_sentence(
        imported, "warnings", "grf.mot: without load, plate 1 reads 12.0 N vertically and -8.0 N fore-aft"
    )
    assert imported.impulse_mass == pytest.approx(69.5, abs=0.3)
    forward, expected = (each.strides["right"][0].channels["grf_forward"] for each in (imported, clean))
    assert forward == pytest.approx(expected, abs=0.1)


def test_sentences_name_the_file_of_the_plates_not_the_first_of_the_trial(tmp_path: Path) -> None:
    trc_path, grf = write_markers(tmp_path)
    edit_columns(grf, lambda label, s: s + 12.0 if label.endswith("1_vy") else s)
    imported = reference_import.import_reference([trc_path, grf], RAW)
    assert has_sentence(imported, "warnings", f"{grf.name}: without load, plate 1 reads 12.0 N vertically")
    files = {entry["channel"]: entry["file"] for entry in imported.log.channels}
    assert files["grf_forward"] == grf.name
    assert {e["column"] for e in imported.log.channels if e["channel"] == "grf_forward"} == {"force plates"}
    assert files["knee centre"] == trc_path.name


def test_listed_events_are_compared_with_detected_ones(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    for delay, section, part in (
        (0.0, "derived", "Event check"),
        (0.1, "warnings", "ms after the detected ones; the detected"),
    ):
        strikes = LATER["right"] + PERIOD * np.arange(3) + delay + 0.003
        (tmp_path / "events.csv").write_text("rhs\n" + "\n".join(map(str, strikes)) + "\n")
        imported = reference_import.import_reference([*paths, tmp_path / "events.csv"], RAW)
        assert has_sentence(imported, section, part)
        assert not has_sentence(imported, "warnings" if section == "derived" else "derived", "events.csv")


def test_moment_does_not_depend_on_the_origin_of_the_laboratory(tmp_path: Path) -> None:
    trc_path, _ = write_markers(tmp_path)
    grf = synthetic_gait.opensim(tmp_path, Walker(rate=1000.0))[1]
    column = "ankle_plantarflexor_moment_nm_per_kg"
    near = reference_import.import_reference([trc_path, grf], ImportOptions(mass=MASS)).table
    lab, shift = trc.read(trc_path), np.array([20.0, 0.0, 0.0])
    trc.write(trc.Markers(lab.time, {name: p + shift for name, p in lab.positions.items()}), trc_path)
    edit_columns(grf, lambda label, s: np.where(s != 0.0, s + 20.0, 0.0) if label.endswith("_px") else s)
    far = reference_import.import_reference([trc_path, grf], ImportOptions(mass=MASS)).table
    assert far[column] == pytest.approx(near[column], abs=1e-3)
    # only the weight of the foot, 0.0145 of the body's 75 mm in front of the ankle, is not in the reference
    assert near[column] == pytest.approx(HUMAN(column, near[reference.PHASE_COLUMN] / 100.0), abs=0.06)


def test_stride_without_second_heel_strike_ends_by_posture(tmp_path: Path) -> None:
    paths = synthetic_gait.opensim(tmp_path, Walker(seconds=1.75))
    edit_columns(paths[1], lambda label, s: np.where(np.arange(len(s)) < 95, s, 0.0) if "force" in label else s)
    imported = reference_import.import_reference(paths, ImportOptions(mass=MASS, side="right"))
    (stride,) = imported.strides["right"]
    assert stride.duration == pytest.approx(PERIOD, abs=0.011)
    assert has_sentence(imported, "derived", "recurrence of the posture of the first heel strike")


def test_stride_is_assembled_from_two_parts(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    complete = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    old = storage.read(paths[0])
    part = slice(50, 50 + round(100 * PERIOD) - 2)
    storage.write(Storage({label: s[part] for label, s in old.columns.items()}, True), paths[0])
    imported = reference_import.import_reference(paths, ImportOptions(mass=MASS, side="right"))
    assert has_sentence(imported, "warnings", "assembled from the end of one stride and the beginning of the next")
    assert imported.table["knee_flexion_deg"] == pytest.approx(complete.table["knee_flexion_deg"], abs=2.5)


def test_strides_of_two_trials_are_pooled_with_standard_deviations(tmp_path: Path) -> None:
    first, second = tmp_path / "one", tmp_path / "two"
    first.mkdir()
    second.mkdir()
    copied_files = write_opensim(second)
    with pytest.raises(InputError, match="its strides would count twice"):
        reference_import.import_reference(write_opensim(first) + copied_files, ImportOptions(mass=MASS))
    edit_columns(get_paths(first)[2], lambda label, s: 0.9 * s if "moment" in label else s)
    edit_columns(copied_files[2], lambda label, s: 1.1 * s if "moment" in label else s)
    for path in copied_files:
        edit_columns(path, lambda label, s: s + (0.02 if label == "time" else 0.001))
    imported = reference_import.import_reference(get_paths(first) + copied_files, ImportOptions(mass=MASS))
    assert len(imported.strides["right"]) == 6
    # three strides 10 % below the mean and three above
    peak = imported.table["ankle_plantarflexor_moment_nm_per_kg"][48]
    assert imported.table["ankle_moment_sd_nm_per_kg"][48] == pytest.approx(0.1 * peak * np.sqrt(6 / 5), rel=2e-3)
    assert set(reference.DEVIATION_COLUMNS) <= set(imported.table)
    short = reference_import.import_reference(
        synthetic_gait.opensim(tmp_path, Walker(seconds=2.6)), ImportOptions(mass=MASS, side="right")
    )
    assert len(short.strides["right"]) == 2
    assert not set(reference.DEVIATION_COLUMNS) & set(short.table)
    assert has_sentence(short, "missing", "3 or more are needed")


def test_plates_are_assigned_to_leg_with_straighter_knee(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    swapped = storage.read(paths[1])
    columns = {
        label.replace("_1_", "_x_").replace("_2_", "_1_").replace("_x_", "_2_"): s
        for label, s in swapped.columns.items()
    }
    storage.write(Storage(columns, False), paths[1])
    right = extract_legs(paths, RAW)["right"]
    assert np.interp(0.43, right.time, right.channels["grf_vertical"]) == pytest.approx(70 * 7.7176, abs=1.0)


def test_laboratory_axes_are_detected(tmp_path: Path) -> None:
    turn = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turn[0] *= np.linalg.det(turn)
    paths = write_markers(tmp_path)
    force = storage.read(paths[1])
    for plate in "12":
        for kind in "vp":
            old = np.stack([force.columns[f"ground_force_{plate}_{kind}{a}"] for a in "xyz"], axis=1) @ turn.T
            for number, axis in enumerate("xyz"):
                force.columns[f"ground_force_{plate}_{kind}{axis}"] = old[:, number]  # type: ignore[index]
    storage.write(force, paths[1])
    trc.write(synthetic_gait.markers(Walker(), turn), paths[0])
    imported = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    assert any("forward is -y" in e["reason"] and "up is +z" in e["reason"] for e in imported.log.channels)
    for column in ("shank_forward_deg", "ankle_plantarflexor_moment_nm_per_kg", "grf_forward_n_per_kg"):
        assert (
            np.abs(imported.table[column] - HUMAN(column, imported.table[reference.PHASE_COLUMN] / 100)).max() < 1.0
        ), column


@pytest.mark.parametrize(("delay", "n_strides"), [(0.0, 3), (0.02, 6)])
def test_same_trial_in_two_forms_counts_once(delay: float, n_strides: int, tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    (tmp_path / "again").mkdir()
    copied_files = write_opensim(tmp_path / "again")
    for path in copied_files:
        edit_columns(path, lambda label, s: s + delay if label == "time" else s + 1e-6)
    imported = reference_import.import_reference([*paths, *copied_files], RAW)
    assert len(imported.strides["right"]) == n_strides
    assert bool(has_sentence(imported, "warnings", "the same trial in another form")) == (delay == 0.0)


def test_c3d_plates_use_walking_frame_with_angles_of_other_file(tmp_path: Path) -> None:
    (c3d,) = write_c3d(tmp_path)
    angles, _, moments = write_opensim(tmp_path)
    imported = reference_import.import_reference([c3d, angles, moments], ImportOptions(mass=MASS))
    assert any(e["file"] == "ik.mot" and e["channel"] == "knee_angle" for e in imported.log.channels)
    difference = imported.table["grf_forward_n_per_kg"] - HUMAN(
        "grf_forward_n_per_kg", imported.table[reference.PHASE_COLUMN] / 100
    )
    assert np.abs(difference).max() < 0.3
    alone = reference_import.import_reference(
        [c3d, angles], ImportOptions(mass=MASS)
    )  # without an ankle moment from a file
    assert has_sentence(alone, "derived", "the angles in ik.mot have no moment and were ignored")
    by_markers = reference_import.import_reference([c3d], ImportOptions(mass=MASS))
    assert alone.table["ankle_dorsiflexion_deg"] == pytest.approx(by_markers.table["ankle_dorsiflexion_deg"])


def test_missing_strides_of_one_leg_are_explained(tmp_path: Path) -> None:
    paths = synthetic_gait.opensim(tmp_path, Walker(seconds=1.75))
    edit_columns(paths[1], lambda label, s: s + 9.0 if label.endswith("1_vy") else s)
    with pytest.raises(InputError) as caught:
        reference_import.import_reference(paths, ImportOptions(mass=MASS, side="left"))
    assert (
        "1 stride of the left leg incomplete and excluded: the heel strike after the one at 0.65 s is on no plate"
        in str(caught.value)
    )
    assert "without load" not in str(caught.value)  # which concerns the right foot
    assert str(caught.value).endswith("; the right leg has 1 stride: pass --side right")
