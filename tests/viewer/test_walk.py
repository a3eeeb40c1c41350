"""Viewer recording of a walk: its poses are those of the walk, and a folder without it gets one."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import klute_sim as ks
from klute_sim.recording.recording import Recording
from klute_sim.viewer import scene, stream
from klute_sim.viewer.folders import detect_folder_kind, ensure_recording
from klute_sim.viewer.layouts import walk as layout
from klute_sim.viewer.picture.rrd_reader import RrdContents, iter_views, read_rrd

rr = pytest.importorskip("rerun")


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [{"intact": True, "slope": 2.0}, {"spring_foot": 8.0, "uneven": 5.0}, {}])
def test_poses_stand_on_the_ground_and_a_missing_recording_is_rebuilt(
    arguments: dict[str, float], tmp_path: Path
) -> None:
    walked = ks.simulate_walk(seconds=1.0, **arguments)  # type: ignore[arg-type]
    folder = walked.save(tmp_path / "walk")
    model = layout.build_model(walked.recording, folder)
    frames = scene.select_frames(walked.recording)
    positions = layout.compute_postures(walked.recording, model, frames)
    data = mujoco.MjData(model)
    soles = [g for g in range(model.ngeom) if model.geom_contype[g] == 1]
    for k in range(0, len(frames), 20):
        data.qpos[:] = positions[k]
        mujoco.mj_kinematics(model, data)
        lowest = min(float(data.geom_xpos[g, 2] - model.geom_size[g].max()) for g in soles)
        assert -0.1 < lowest < 0.05
    np.testing.assert_array_equal(positions[:, 0], walked.recording["hip_x"][frames])
    assert detect_folder_kind(folder).name == "walk"
    original = (folder / "recording.rrd").read_bytes()
    contents = read_rrd(folder / "recording.rrd")
    check_legends(contents, walked.recording)
    assert ("world/muscle" in contents.entities) == (not arguments)
    if not arguments:
        strips = np.array([strip[0] for strip in contents.entities["world/muscle"].rows["strips"]])
        lengths = np.linalg.norm(strips[:, 1] - strips[:, 0], axis=1)
        assert lengths == pytest.approx(walked.recording["muscle_length"][frames], abs=1e-6)
    (folder / "recording.rrd").unlink()
    with ensure_recording(folder) as rebuilt:
        assert len(rebuilt.read_bytes()) == pytest.approx(len(original), rel=0.01)


def check_legends(contents: RrdContents, recording: Recording) -> None:
    """Assert that both legs have one legend, which lies above the lines."""
    views = {view.name: view for view in iter_views(contents.root) if view.kind == "TimeSeries"}
    with_legend = [name for name, view in views.items() if view.legend]
    has_device = ["gauge pressure [bar]"] if "pressure" in recording else []
    assert with_legend == ["hip angle [deg], flexion up", "metabolic energy since the start [J]", *has_device]
    hip = views[with_legend[0]]
    assert hip.legend_corner == "upper left"
    assert hip.value_range is not None
    low, high = hip.value_range
    values = np.concatenate([recording["hip_angle_left"], recording["hip_angle_right"]])
    assert low < values.min()
    assert (values.max() - low) / (high - low) < 0.66


def test_curves_are_scaled_by_the_shown_strides_and_not_by_the_first_steps(tmp_path: Path) -> None:
    time = np.arange(0.0, 6.0, 0.01)
    wave = np.where(time < 1.0, 5.0, 1.0) * np.sin(2.0 * np.pi * time)
    channels = {f"{name}_{side}": wave for _, name in layout.LEG_PLOTS for side in ("left", "right")}
    channels |= {"time": time, "speed": np.full(600, 1.3)}
    channels |= {f"metabolic_energy_{law}": 100.0 * time for law in ("minetti", "bhargava")}
    walked = Recording(channels, dict.fromkeys(channels, "1"), {"prosthesis": None, "kind": "intact"})
    with stream.open_recording(tmp_path / "r.rrd", "walk", [], lambda: layout.build_blueprint(walked)) as out:
        line = stream.SeriesLine("channels/speed", "speed", stream.BLUE, 1.0, walked["speed"])
        stream.send_lines(out, rr.TimeColumn(layout.TIMELINE, duration=time), [line])
    views = {view.name: view.value_range for view in iter_views(read_rrd(tmp_path / "r.rrd").root)}
    assert views["vertical ground reaction [N], predicted"] == pytest.approx((-1.1, 1.1), abs=1e-2)
    assert views["forward speed [m/s]"] == pytest.approx((1.25, 1.35))
    assert views[layout.ENERGY_TITLE] == pytest.approx((-30.0, 960.0), abs=2.0)  # with room for the legend
