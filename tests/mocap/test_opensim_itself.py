"""Exchange of files with the OpenSim library."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from klute_sim.controllers.pressure import create_off_controller
from klute_sim.device.device import load_device
from klute_sim.gait.rig import rig
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.mocap import export
from klute_sim.mocap.formats import storage, trc
from klute_sim.recording.recording import Recording

pytestmark = pytest.mark.extras


@pytest.fixture(scope="module")
def opensim() -> Any:
    return pytest.importorskip("opensim")


@pytest.fixture(scope="module")
def gait_recording() -> Recording:
    return rig.simulate_gait(load_device("klute-1-1-4-pair"), create_off_controller(), GaitOptions(strides=1, dt=1e-3))


def test_opensim_reads_exported_files_exactly(opensim: Any, gait_recording: Recording, tmp_path: Path) -> None:
    export.write_files(gait_recording, "left", ("mot", "sto", "trc"), tmp_path)
    for file, columns in {
        "angles.mot": {
            "ankle_angle_l": gait_recording["ankle_angle"],
            "knee_angle_l": gait_recording["knee_angle"],
            "hip_flexion_l": -gait_recording["thigh_angle"],
            "pelvis_tx": gait_recording["carriage_x"],
        },
        "moments.sto": {
            "ankle_angle_l_moment": -gait_recording["ankle_moment"],
            "hip_flexion_l_moment": -gait_recording["hip_moment"],
            "knee_angle_l_moment": gait_recording["knee_moment"],
        },
        "ground_reaction.mot": {
            "ground_force_vy": gait_recording["grf_vertical"],
            "ground_force_vx": gait_recording["grf_forward"],
        },
    }.items():
        table = opensim.TimeSeriesTable(str(tmp_path / file))
        assert np.array_equal(table.getIndependentColumn(), gait_recording["time"])
        for label, expected in columns.items():
            assert np.array_equal(table.getDependentColumn(label).to_numpy(), expected), label
        degrees = "yes" if file == "angles.mot" else "no"
        assert table.getTableMetaDataString("inDegrees") == degrees
    markers = opensim.TimeSeriesTableVec3(str(tmp_path / "markers.trc"))
    assert markers.getTableMetaDataString("Units") == "m"
    flat = markers.flatten(["_x", "_y", "_z"])
    for axis, channel in (("_x", "ankle_x"), ("_y", "ankle_z")):
        assert np.array_equal(flat.getDependentColumn("L ANKLE" + axis).to_numpy(), gait_recording[channel])


def test_files_written_by_opensim_are_read(opensim: Any, gait_recording: Recording, tmp_path: Path) -> None:
    export.write_files(gait_recording, "right", ("mot", "trc"), tmp_path)
    opensim.STOFileAdapter.write(opensim.TimeSeriesTable(str(tmp_path / "angles.mot")), str(tmp_path / "written.sto"))
    written = storage.read(tmp_path / "written.sto")
    assert written.in_degrees
    assert written.columns["ankle_angle_r"] == pytest.approx(gait_recording["ankle_angle"], abs=1e-9)
    opensim.TRCFileAdapter.write(
        opensim.TimeSeriesTableVec3(str(tmp_path / "markers.trc")), str(tmp_path / "written.trc")
    )
    positions = trc.read(tmp_path / "written.trc").positions["R ANKLE"]
    assert positions[:, 0] == pytest.approx(gait_recording["ankle_x"], abs=1e-7)
    assert positions[:, 1] == pytest.approx(gait_recording["ankle_z"], abs=1e-7)
