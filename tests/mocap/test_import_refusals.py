"""Imports that lack data or contradict themselves are refused in one sentence."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from klute_sim.errors import InputError
from klute_sim.mocap import reference_import
from klute_sim.mocap.formats import trc
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import mapping
from tests import synthetic_gait
from tests.mocap.motion_files import (
    RAW,
    edit_columns,
    empty_columns,
    remove_columns,
    write_markers,
    write_opensim,
)
from tests.mocap.test_single_stride import OPTIONS as SINGLE_STRIDE
from tests.mocap.test_single_stride import write_stride
from tests.synthetic_gait import MASS, Walker


def test_mapping_names_unknown_columns(tmp_path: Path) -> None:
    path = synthetic_gait.treadmill(tmp_path, Walker())
    heading, _, rest = path.read_text().partition("\n")
    new_labels = [f"c{number}" if number else "time" for number, _ in enumerate(heading.split(","))]
    names = dict(zip(heading.split(","), new_labels, strict=True))
    path.write_text(",".join(new_labels) + "\n" + rest)
    with pytest.raises(InputError, match="no joint angle, ankle moment, ground reaction or marker was recognised"):
        reference_import.import_reference([path], RAW)
    expected = {
        "hip_angle": "HipFlexionAngle",
        "knee_angle": "KneeFlexionAngle",
        "ankle_angle": "AnklePlantarFlexionAngle",
        "ankle_moment": "AnklePlantarFlexionMoment",
        "grf_vertical": "GRF_y",
        "grf_forward": "GRF_x",
    }
    lines = ["[right]", *(f'{channel} = "{names["Right" + name]}"' for channel, name in expected.items())]
    (tmp_path / "map.toml").write_text("\n".join(lines))
    imported = reference_import.import_reference(
        [path], ImportOptions(mass=MASS, mapping=mapping.read(tmp_path / "map.toml"))
    )
    assert list(imported.strides) == ["right"]
    assert imported.impulse_mass == pytest.approx(69.5, abs=0.3)  # twice the impulse of one foot
    assert imported.table["knee_flexion_deg"][30] == pytest.approx(8.84, abs=0.5)


@pytest.mark.parametrize(
    ("modify", "message"),
    [
        (
            lambda paths: paths[:2],
            "no ankle moment of the right leg, which angles and ground reaction do not determine",
        ),
        (lambda paths: [paths[0], paths[2]], "no ground reaction of the right foot"),
        (lambda paths: paths[1:], "neither knee and ankle angles of one leg nor markers"),
        (remove_columns(0, "hip"), "so the inclination of the leg is unknown"),
        (remove_columns(0, "ankle"), "neither knee and ankle angles of one leg nor markers"),
        (remove_columns(1, "vz"), "lacks one of the three components"),
        (empty_columns(1, "1_vy"), "column 'ground_force_1_vy' contains no numbers"),
        (empty_columns(0, "ankle"), "neither knee and ankle angles of one leg nor markers"),
        (empty_columns(2, "ankle"), "no ankle moment of the right leg"),
    ],
)
def test_missing_data_raise_one_sentence(
    modify: Callable[[list[Path]], list[Path]], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        reference_import.import_reference(modify(write_opensim(tmp_path)), ImportOptions(mass=MASS))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def _rename_column(path: Path, old: str, new: str) -> Path:
    heading, _, rest = path.read_text().partition("\n")
    assert old in heading
    path.write_text(heading.replace(old, new) + "\n" + rest)
    return path


def test_unused_columns_and_the_missing_quantity_are_named(tmp_path: Path) -> None:
    path = write_stride(tmp_path / "lab.csv")
    _rename_column(path, "GRF forward (N/kg)", "AP shear (N/kg)")
    with pytest.raises(InputError) as caught:
        reference_import.import_reference([path], SINGLE_STRIDE)
    assert "lab.csv: no fore-aft ground reaction of the right foot" in str(caught.value)
    assert "heel strikes" not in str(caught.value)  # the vertical load shows them
    assert "columns not used: 'AP shear (N/kg)'; assign them in a file for --map" in str(caught.value)
    _rename_column(path, "AP shear (N/kg)", "AP GRF (N/kg)")
    reference_import.import_reference([path], SINGLE_STRIDE)


def test_quantities_still_needed_beside_the_ankle_are_named(tmp_path: Path) -> None:
    path = write_stride(tmp_path / "lab.csv")
    rows = [row.split(",") for row in path.read_text().splitlines()]
    kept = [rows[0].index(label) for label in ("Gait cycle (%)", "Ankle dorsiflexion (deg)", "Ankle moment (Nm/kg)")]
    path.write_text("\n".join(",".join(row[i] for i in kept) for row in rows) + "\n")
    with pytest.raises(InputError) as caught:
        reference_import.import_reference([path], SINGLE_STRIDE)
    needed = "hip (or thigh, shank) angle, knee angle, vertical ground reaction, fore-aft ground reaction"
    assert f"still needed for the right leg: {needed}" in str(caught.value)
    assert "columns not used" not in str(caught.value)


def test_missing_markers_are_named(tmp_path: Path) -> None:
    paths = write_markers(tmp_path)
    old = trc.read(paths[0])
    trc.write(trc.Markers(old.time, {n: p for n, p in old.positions.items() if "KNEE" not in n}), paths[0])
    with pytest.raises(
        InputError, match=r"no markers for knee; name them in a file for --map, under \[markers.right\]"
    ):
        reference_import.import_reference(paths, RAW)
    trc.write(trc.Markers(old.time, {n.replace("KNEE", "GENU"): p for n, p in old.positions.items()}), paths[0])
    (tmp_path / "map.toml").write_text('[markers.right]\nknee = ["R_GENU"]\n[markers.left]\nknee = ["L_GENU"]\n')
    imported = reference_import.import_reference(paths, replace(RAW, mapping=mapping.read(tmp_path / "map.toml")))
    assert imported.table["knee_flexion_deg"][30] == pytest.approx(8.84, abs=0.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[right", "is not valid TOML"),
        ("[middle]", "unknown key 'middle'; allowed: right, left"),
        ('[right]\nelbow = "x"', "unknown key 'elbow'"),
        ("[right]\nknee_angle = 3", "must be a column label, or a table with 'column'"),
        ('[right]\nknee_angle = { column = "x", sign = 2 }', "sign = 2; allowed: 1 and -1"),
        ('[right]\nknee_angle = { column = "x", zero = nan }', "zero' is nan; allowed: finite numbers"),
        ('[right]\nknee_angle = "nowhere"', "column 'nowhere' of the channel knee_angle is missing"),
        ('[right]\nknee_angle = { column = "knee_angle_r", unit = "kg" }', "which is not a unit of knee_angle"),
        ('[markers.right]\nknee = "x"', "must be a list"),
        ('[axes]\nforward = "x"', "needs 'forward' and 'up'"),
        ('[axes]\nforward = "x"\nup = "-x"', "two different axes"),
        ('[axes]\nforward = "w"\nup = "y"', "allowed: x, y, z"),
    ],
)
def test_invalid_mapping_raises_one_sentence(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        reference_import.import_reference(
            write_opensim(tmp_path), replace(RAW, mapping=mapping.read(tmp_path / "map.toml"))
        )
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_implausible_numbers_are_refused(tmp_path: Path) -> None:
    paths = write_markers(tmp_path)
    force = paths[1]
    edit_columns(force, lambda label, s: s * 1e300 if label.endswith("1_vx") else s)
    with pytest.raises(InputError, match="column 'ground_force_1_vx' contains"):
        reference_import.import_reference(paths, RAW)
    write_opensim(tmp_path)
    old = trc.read(paths[0])
    moved = {name: position * (1e6 if "R_TOE" in name else 1.0) for name, position in old.positions.items()}
    trc.write(trc.Markers(old.time, moved), paths[0])
    with pytest.raises(InputError, match=r"marker 'R_TOE' is .* m away from the origin; check the unit"):
        reference_import.import_reference(paths, RAW)


def test_unprintable_names_are_refused(tmp_path: Path) -> None:
    path = synthetic_gait.treadmill(tmp_path, Walker())
    path.write_text(path.read_text().replace("LeftCOP_x", "Left\x1b[2JCOP_x", 1))
    with pytest.raises(InputError, match="unprintable characters") as caught:
        reference_import.import_reference([path], RAW)
    assert str(caught.value).isprintable()


def test_options_out_of_bounds_are_refused() -> None:
    for options in (
        {"mass": 3.0},
        {"stature": 17.5},
        {"motion_cutoff": -1.0},
        {"contact_threshold": 0.0},
        {"mass": float("nan")},
    ):
        with pytest.raises(InputError, match="allowed"):
            ImportOptions(**options)  # type: ignore[arg-type]
