"""OpenSim's own library (``pip install opensim``, where it is installed) reads what is exported, and the other way."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.controllers.pressure import create_off_controller
from klute_sim.device.device import load_device
from klute_sim.gait.rig import rig
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.mocap import export
from klute_sim.mocap.formats import storage, trc
from klute_sim.recording.recording import Recording

opensim = pytest.importorskip("opensim")


@pytest.fixture(scope="module")
def walked() -> Recording:
    return rig.simulate_gait(load_device("klute-1-1-4-pair"), create_off_controller(), GaitOptions(strides=1, dt=1e-3))


def test_opensim_reads_what_is_exported_to_the_last_bit(walked: Recording, tmp_path: Path) -> None:
    export.write_files(walked, "left", ("mot", "sto", "trc"), tmp_path)
    for file, columns in {
        "angles.mot": {
            "ankle_angle_l": walked["ankle_angle"],
            "knee_angle_l": walked["knee_angle"],
            "hip_flexion_l": -walked["thigh_angle"],
            "pelvis_tx": walked["carriage_x"],
        },
        "moments.sto": {"ankle_angle_l_moment": -walked["ankle_moment"]},
        "ground_reaction.mot": {"ground_force_vy": walked["grf_vertical"], "ground_force_vx": walked["grf_forward"]},
    }.items():
        table = opensim.TimeSeriesTable(str(tmp_path / file))
        assert np.array_equal(table.getIndependentColumn(), walked["time"])
        for label, wanted in columns.items():
            assert np.array_equal(table.getDependentColumn(label).to_numpy(), wanted), label
        degrees = "yes" if file == "angles.mot" else "no"
        assert table.getTableMetaDataString("inDegrees") == degrees
    markers = opensim.TimeSeriesTableVec3(str(tmp_path / "markers.trc"))
    assert markers.getTableMetaDataString("Units") == "m"
    flat = markers.flatten(["_x", "_y", "_z"])
    for axis, channel in (("_x", "ankle_x"), ("_y", "ankle_z")):
        assert np.array_equal(flat.getDependentColumn("L ANKLE" + axis).to_numpy(), walked[channel])


def test_what_opensim_writes_is_read(walked: Recording, tmp_path: Path) -> None:
    export.write_files(walked, "right", ("mot", "trc"), tmp_path)
    opensim.STOFileAdapter.write(opensim.TimeSeriesTable(str(tmp_path / "angles.mot")), str(tmp_path / "its.sto"))
    found = storage.read(tmp_path / "its.sto")
    assert found.in_degrees
    assert found.columns["ankle_angle_r"] == pytest.approx(walked["ankle_angle"], abs=1e-9)
    opensim.TRCFileAdapter.write(opensim.TimeSeriesTableVec3(str(tmp_path / "markers.trc")), str(tmp_path / "its.trc"))
    places = trc.read(tmp_path / "its.trc").positions["R ANKLE"]
    assert places[:, 0] == pytest.approx(walked["ankle_x"], abs=1e-7)
    assert places[:, 1] == pytest.approx(walked["ankle_z"], abs=1e-7)
