"""Columns of channels in standard units."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.errors import InputError
from klute_sim.mocap.formats import storage
from klute_sim.mocap.formats.storage import Storage
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics.postprocess import apply_sign
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import mapping, sources
from klute_sim.mocap.parsing.channel_lookup import Column, apply_given_sign, find_column
from klute_sim.mocap.parsing.channel_names import Side

TIME = np.arange(100) / 100.0
SWING = np.sin(2 * np.pi * TIME)


def find(folder: Path, columns: dict[str, np.ndarray], channel: str, side: Side | None, map_text: str = "") -> Column:
    """Return the column of ``channel`` in a table with ``columns`` over time."""
    table = np.column_stack([TIME, *columns.values()])
    np.savetxt(folder / "a.csv", table, delimiter=",", header=",".join(["time [s]", *columns]), comments="")
    (folder / "map.toml").write_text(map_text)
    options = ImportOptions(mapping=mapping.read(folder / "map.toml"))
    column = find_column(sources.read(folder / "a.csv"), channel, side, options)
    assert column is not None
    return column


def test_zero_is_a_reading_in_the_unit_of_the_column(tmp_path: Path) -> None:
    log = ImportLog()
    force = find(
        *(tmp_path, {"LC [kgf]": np.full(100, -12.0)}, "force", None),
        '[prosthesis]\nforce = { column = "LC [kgf]", sign = -1, zero = 2.0 }\n',
    )
    assert apply_given_sign(force, "prosthesis", log) == pytest.approx(10.0 * 9.80665)
    angle = find(
        *(tmp_path, {"A [rad]": SWING + 1.5}, "ankle_angle", "right"),
        '[right]\nankle_angle = { column = "A [rad]", sign = 1, zero = 1.5 }\n',
    )
    assert apply_sign(angle, (), "right", log) == pytest.approx(np.degrees(SWING))
    assert [(entry["unit"], entry["zero"]) for entry in log.channels] == [("kgf", 2.0), ("rad", 1.5)]


def test_angles_without_unit_have_that_of_the_knee(tmp_path: Path) -> None:
    tilt = find(tmp_path, {"pelvis_tilt": SWING, "knee_angle_r": 30.0 * SWING}, "pelvis_tilt", None)
    assert (tilt.unit, tilt.unit_reason) == ("deg", "by the magnitude")
    tilt = find(tmp_path, {"pelvis_tilt": 0.02 * SWING, "hip_flexion_r": 0.3 * SWING}, "pelvis_tilt", None)
    assert tilt.unit == "rad"
    mapped = find(
        *(tmp_path, {"A": SWING, "K": 30.0 * SWING}, "ankle_angle", "right"),
        '[right]\nankle_angle = "A"\nknee_angle = "K"\n',
    )
    assert mapped.unit == "deg"
    with pytest.raises(InputError, match=r"'pelvis_tilt' has no unit, and the file has no joint angle that shows it"):
        find(tmp_path, {"pelvis_tilt": SWING}, "pelvis_tilt", None)


def test_stated_unit_holds_without_a_knee(tmp_path: Path) -> None:
    columns = {"time": TIME, "pelvis_tilt": SWING, "ankle_angle_r": 30.0 * SWING}
    storage.write(Storage(columns, True), tmp_path / "a.mot")
    tilt = find_column(sources.read(tmp_path / "a.mot"), "pelvis_tilt", None, ImportOptions())
    assert tilt is not None
    assert (tilt.unit, tilt.unit_reason) == ("deg", "stated")


def test_decimal_mark_is_that_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time [s];force [N]\n0,000;1,234\n0,001;2,345\n")
    assert sources.read(path)[0].get_column("force [N]").tolist() == [1.234, 2.345]
    path.write_text("time [s];force [N]\n1;1,234\n2;2,345\n")
    with pytest.raises(InputError, match=r"'1,234' may have a decimal comma or separate thousands"):
        sources.read(path)[0].get_column("force [N]")
