"""Force plates of other laboratories: units, corners, clocks, readings of the unloaded plate, and missing samples."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.foot_load import find_unloaded_samples
from klute_sim.gait import reference
from klute_sim.mocap import reference_import
from klute_sim.mocap.formats import storage
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.reference_import import ImportedReference
from klute_sim.plausibility.finding import ImplausibleInputError
from tests import synthetic_gait
from tests.mocap.motion_files import edit_columns, has_sentence, write_c3d, write_markers, write_opensim
from tests.synthetic_gait import HUMAN, MASS, Walker

MOMENT = "ankle_plantarflexor_moment_nm_per_kg"
READINGS = (9.0, -15.0, 60.0, 12_000.0, -8_000.0, 3_000.0)
"""Readings of the channels of a plate that was not zeroed [N, N.mm]."""


def run_import(*paths: Path) -> ImportedReference:
    return reference_import.import_reference(paths, ImportOptions(mass=MASS))


def compare(imported: ImportedReference, plain: ImportedReference, tolerance: float = 1e-3) -> None:
    for column in reference.REQUIRED_COLUMNS:
        assert imported.table[column] == pytest.approx(plain.table[column], abs=tolerance), column


def test_moments_of_a_plate_may_be_in_newton_metres(tmp_path: Path) -> None:
    plain = run_import(*write_c3d(tmp_path))
    assert plain.table[MOMENT] == pytest.approx(HUMAN(MOMENT, plain.table[reference.PHASE_COLUMN] / 100.0), abs=0.06)
    compare(run_import(synthetic_gait.c3d(tmp_path, Walker(), moment_unit="Nm")), plain)


def test_plates_that_were_not_zeroed_give_the_same_stride(tmp_path: Path) -> None:
    plain = run_import(*write_c3d(tmp_path))
    imported = run_import(synthetic_gait.c3d(tmp_path, Walker(), readings=READINGS))
    compare(imported, plain)
    assert imported.impulse_mass == pytest.approx(plain.impulse_mass, rel=1e-4)
    assert has_sentence(imported, "warnings", "plate 1 reads 60.0 N vertically and -15.0 N fore-aft")
    assert not has_sentence(imported, "warnings", "points down")


def test_fore_aft_reading_of_an_empty_plate_is_removed(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    plain = run_import(*paths)
    edit_columns(paths[1], lambda label, s: s + 20.0 if label.endswith("_vx") else s)
    imported = run_import(*paths)
    compare(imported, plain)
    assert has_sentence(imported, "warnings", "plate 1 reads 0.0 N vertically and 20.0 N fore-aft")


def turn_back(walker: Walker, side: str) -> np.ndarray:
    """Return the centre of pressure as a plate reports it whose corners are turned by half a turn; NaN in swing."""
    centre = walker.pressure_centre(side)
    return np.where(centre > 0.0, 2.0 * walker.points(side)["ANKLE"][:, 0] + 0.1 - centre, np.nan)


def test_corners_in_the_wrong_order_are_named(tmp_path: Path) -> None:
    paths, walker = write_markers(tmp_path), Walker()
    turned = {f"ground_force_{k}_px": turn_back(walker, side) for k, side in ((1, "right"), (2, "left"))}
    edit_columns(paths[1], lambda label, s: np.nan_to_num(turned[label]) if label in turned else s)
    with pytest.raises(ImplausibleInputError, match="`cop` moves from the toe to the heel of the loaded foot") as error:
        run_import(*paths)
    assert {finding.name for finding in error.value.findings} == {"cop-sign"}


def test_centre_of_pressure_in_a_column_may_not_run_backward(tmp_path: Path) -> None:
    path, walker = tmp_path / "walk.csv", Walker()
    names, columns = ["time [s]"], [walker.time]
    channels = {"hip_flexion_deg": "hip_angle [deg]", "knee_flexion_deg": "knee_angle [deg]"}
    channels |= {"ankle_dorsiflexion_deg": "ankle_angle [deg]", "grf_vertical_n_per_kg": "grf_vertical [N]"}
    channels |= {"grf_forward_n_per_kg": "grf_forward [N]"}
    ankle = walker.points("right")["ANKLE"]
    positions = {"cop_x [m]": turn_back(walker, "right"), "ankle_x [m]": ankle[:, 0], "ankle_z [m]": ankle[:, 1]}
    names += [*channels.values(), *positions]
    columns += [*(walker.of(column, "right") for column in channels), *positions.values()]
    rows = [",".join("" if np.isnan(v) else repr(float(v)) for v in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([",".join(names), *rows]) + "\n")
    with pytest.raises(ImplausibleInputError, match="`cop_x` moves from the toe to the heel"):
        run_import(path)


@pytest.mark.parametrize("delay", [0.2, 0.3])
def test_angles_of_another_clock_are_named(delay: float, tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    for path in (paths[0], paths[2]):
        edit_columns(path, lambda label, s: s + delay if label == "time" else s)
    with pytest.raises(ImplausibleInputError, match="% of the stride later than the load: they have different clocks"):
        run_import(*paths)


def test_angles_and_markers_of_one_trial_have_one_clock(tmp_path: Path) -> None:
    (c3d,), (angles, _, moments) = write_c3d(tmp_path), write_opensim(tmp_path)
    agreeing = run_import(c3d, angles, moments)
    assert has_sentence(agreeing, "derived", "Clock check: the right knee angle in walk.c3d and in ik.mot")
    for path in (angles, moments):
        edit_columns(path, lambda label, s: s + 0.05 if label == "time" else s)
    late = run_import(c3d, angles, moments)
    assert has_sentence(late, "warnings", "an offset of 50 ms: if the clocks differ, set '\"walk.c3d\" = 0.05'")


def remove_samples(path: Path, rows: slice) -> None:
    def remove(label: str, samples: np.ndarray) -> np.ndarray:
        return np.where(np.isin(np.arange(len(samples)), np.arange(1000)[rows]), np.nan, samples)

    edit_columns(path, lambda label, s: remove(label, s) if label.endswith(("_vx", "_vy")) else s)


def test_a_short_dropout_is_interpolated_before_the_feet_are_told_apart(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    plain = run_import(*paths)
    remove_samples(paths[1], slice(150, 162))  # 0.12 s of the right foot's stance, while the left one swings
    imported = run_import(*paths)
    assert {side: len(strides) for side, strides in imported.strides.items()} == {"right": 3, "left": 3}
    compare(imported, plain, tolerance=0.25)


@pytest.mark.parametrize("rows", [slice(150, 180), slice(115, 125), slice(110, 135)])
def test_a_dropout_makes_no_heel_strike(rows: slice, tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    plain = run_import(*paths)
    remove_samples(paths[1], rows)
    imported = run_import(*paths)
    starts = [stride.start for side in ("right", "left") for stride in plain.strides[side]]
    for side in imported.strides:
        for stride in imported.strides[side]:
            assert min(abs(stride.start - start) for start in starts) < 1e-6
            assert not 0.01 * rows.start < stride.start < 0.01 * rows.stop


def test_an_empty_plate_may_read_nothing(tmp_path: Path) -> None:
    paths = write_opensim(tmp_path)
    plain = run_import(*paths)
    is_empty = {plate: storage.read(paths[1]).columns[f"ground_force_{plate}_vy"] == 0.0 for plate in "12"}
    edit_columns(paths[1], lambda label, s: s if label == "time" else np.where(is_empty[label[13]], np.nan, s))
    compare(run_import(*paths), plain)


def test_moment_of_a_single_step_needs_no_mass(tmp_path: Path) -> None:
    """The mass of the foot follows from the load in the step, not from the mean over the whole recording."""
    trc_path, grf = write_markers(tmp_path)
    step = (Walker().time > 1.0) & (Walker().time < 2.5)
    edit_columns(grf, lambda label, s: np.where(step, s, 0.0) if "force" in label else s)
    given = run_import(trc_path, grf)
    estimated = reference_import.import_reference([trc_path, grf], ImportOptions())
    assert estimated.mass * estimated.table[MOMENT] == pytest.approx(MASS * given.table[MOMENT], abs=0.3)


@pytest.mark.parametrize("offset", [-80.0, 0.0, 90.0])
def test_empty_plate_is_told_from_a_plate_under_two_feet(offset: float) -> None:
    walker, rng = Walker(rate=500.0), np.random.default_rng(0)
    right, left = (walker.of("grf_vertical_n_per_kg", side) for side in ("right", "left"))
    noise = 2.0 * rng.standard_normal(len(right))
    empty = find_unloaded_samples(right + offset + noise)
    assert not empty[walker.of("grf_vertical_n_per_kg", "right") > 60.0].any()
    assert np.median((right + offset + noise)[empty]) == pytest.approx(offset, abs=1.0)
    assert not find_unloaded_samples(right + left + offset + noise).any()
    assert not find_unloaded_samples(np.full(100, 700.0)).any()
    assert not find_unloaded_samples(np.full(100, np.nan)).any()
