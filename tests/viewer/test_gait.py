"""Viewer recording of a gait run: it reads back equal, and its poses match the model."""

import math
import sys
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from klute_sim.controllers import pressure
from klute_sim.device.device import load_device
from klute_sim.errors import MissingExtraError
from klute_sim.gait.rig.build import build_gait_model
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.viewer import gait_cycle, scene, stream
from klute_sim.viewer.folders import ensure_recording
from klute_sim.viewer.layouts import gait as writer
from klute_sim.viewer.picture import rrd_reader

DEVICE = load_device("klute-1-1-4-pair")
ALIGNMENT = math.radians(-3.0)


@cache
def stride() -> Recording:
    return simulate_gait(DEVICE, pressure.load_default_profile(), GaitOptions(strides=1, dt=1e-3, alignment=ALIGNMENT))


def rig() -> mujoco.MjModel:
    return build_gait_model(DEVICE, mass=75, stature=1.75, dt=1e-3, alignment=ALIGNMENT)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run's folder without its recording for rerun."""
    made = tmp_path_factory.mktemp("run")
    parquet.write_recording(stride(), made / "recording.parquet")
    (made / "device.toml").write_bytes(DEVICE.content)
    return made


@pytest.fixture(scope="module")
def file(folder: Path) -> Path:
    pytest.importorskip("rerun")
    with ensure_recording(folder) as rrd_path:
        return rrd_path


def read(file: Path, timeline: str | None) -> dict[str, list[Any]]:
    """What is on ``timeline``; None: what is static."""
    import rerun as rr

    chunks: dict[str, list[Any]] = {}
    for chunk in rr.chunk.RrdReader(file).stream():
        if chunk.is_static if timeline is None else timeline in chunk.timeline_names:
            chunks.setdefault(str(chunk.entity_path).lstrip("/"), []).append(chunk.to_record_batch())
    return chunks


@pytest.fixture(scope="module")
def chunks(file: Path) -> dict[str, list[Any]]:
    return read(file, writer.TIMELINE)


@cache
def moved() -> list[mujoco.MjData]:
    """The model at every frame, its joints set from the channels by hand."""
    model, frames = rig(), scene.select_frames(stride())
    poses = []
    for frame in frames:
        data = mujoco.MjData(model)
        value = {name: samples[frame] for name, samples in stride().channels.items()}
        data.joint("carriage_x").qpos = value["carriage_x"]
        data.joint("carriage_z").qpos = value["carriage_z"]
        data.joint("thigh").qpos = np.radians(value["thigh_angle"])
        data.joint("knee").qpos = np.radians(value["knee_angle"])
        data.joint("liner").qpos = value["liner_displacement"]
        # The alignment turns the prosthesis against the limb; the hinge does the rest.
        data.joint("prosthesis_ankle").qpos = ALIGNMENT - np.radians(value["ankle_angle"])
        data.joint("prosthesis_heel").qpos = value["heel_compression"]
        mujoco.mj_kinematics(model, data)
        poses.append(data)
    return poses


def matrix(quaternion: list[float]) -> np.ndarray:
    """Rotation of a quaternion with its scalar last."""
    x, y, z, w = quaternion
    turned = np.empty(9)
    mujoco.mju_quat2Mat(turned, np.array([w, x, y, z]))
    return turned.reshape(3, 3)


def column(batches: list[Any], ending: str) -> list[Any]:
    values: list[Any] = []
    for batch in batches:
        (name,) = [n for n in batch.schema.names if n.endswith(ending)]
        values += batch.column(name).to_pylist()
    return values


def scalars(chunks: dict[str, list[Any]], entity: str) -> np.ndarray:
    return np.array(column(chunks[entity], "Scalars:scalars"), dtype=np.float64).ravel()


def test_channels_read_back_as_in_the_parquet_file(folder: Path, chunks: dict[str, list[Any]]) -> None:
    recording = parquet.load_recording(folder / "recording.parquet")
    assert set(recording.channels) == set(stride().channels)
    for name, samples in recording.channels.items():
        if name != "time":
            assert np.array_equal(scalars(chunks, f"channels/{name}"), samples, equal_nan=True), name


def test_energies_are_integrals_of_powers_and_balance(chunks: dict[str, list[Any]]) -> None:
    parts = {name: scalars(chunks, f"energy/{name}") for name in writer.LEDGER_STYLES}
    step = np.diff(stride()["time"]).mean()
    assert parts["gas"][-1] == pytest.approx(step * stride()["gas_power"][1:].sum())
    assert abs(parts["delivered"]).max() > 1.0
    total = sum(energy for name, energy in parts.items() if name != "delivered")
    assert parts["delivered"] == pytest.approx(total, abs=1e-6)
    assert parts["tendon"] == pytest.approx(stride()["tendon_energy"][0] - stride()["tendon_energy"], abs=1e-6)


def test_work_loop_is_that_of_the_ankle_with_a_moving_marker(chunks: dict[str, list[Any]], file: Path) -> None:
    markers = np.array(column(chunks[f"{writer.LOOP_ENTITY}/marker"], "Points2D:positions"), dtype=np.float64).reshape(
        -1, 2
    )
    angle, moment = stride()["ankle_angle"], stride()["ankle_moment"]
    for position, value in ((markers[:, 0], angle), (-markers[:, 1], moment)):  # y is down
        assert np.corrcoef(position, value)[0, 1] == pytest.approx(1.0, abs=1e-9)
    batches = read(file, None)[f"{writer.LOOP_ENTITY}/curve_001"]
    (strips,) = [b for b in batches if any(n.endswith("strips") for n in b.schema.names)]
    (points,) = column([strips], "LineStrips2D:strips")[0]
    for point in np.array(points)[:: len(points) // 20]:
        assert np.linalg.norm(markers - point, axis=1).min() < 1e-3


def test_samples_and_poses_have_their_times(chunks: dict[str, list[Any]]) -> None:
    time = stride()["time"]
    frames = scene.select_frames(stride())
    for entity, expected in [("channels/force", time), ("world/prosthesis_foot", time[frames])]:
        stamps = [batch.column(writer.TIMELINE).cast("int64").to_numpy() for batch in chunks[entity]]
        assert 1e-9 * np.concatenate(stamps) == pytest.approx(expected, abs=2e-9)


def test_recording_has_one_layout(file: Path) -> None:
    import rerun as rr

    assert len(list(rr.chunk.RrdReader(file).blueprints())) == 1


def test_title_says_that_the_ground_reaction_is_tracked() -> None:
    (title,) = [title for title, _ in writer.MOTION_PLOTS if "ground reaction" in title]
    assert "vertical: tracked, not predicted" in title


def test_band_is_one_standard_deviation_wide(chunks: dict[str, list[Any]]) -> None:
    mean, variance = (
        np.array(column(chunks["band/ankle_moment"], f"Measurements:{name}"), dtype=np.float64).ravel()
        for name in ("values", "variances")
    )
    assert mean == pytest.approx(stride()["reference_ankle_moment"])
    assert np.sqrt(variance) == pytest.approx(stride()["reference_ankle_moment_sd"])


def get_time_panel(file: Path) -> rrd_reader.Entity:
    import rerun as rr

    (layout,) = rr.chunk.RrdReader(file).blueprints()
    return rrd_reader._collect_entities(rr.chunk.RrdReader(file).stream(store=layout))["time_panel"]


def test_window_opens_on_the_last_stride_over_the_gait_cycle_and_repeats_it_in_real_time(file: Path) -> None:
    contents = rrd_reader.read_rrd(file)
    assert contents.timeline == "gait cycle [%]"
    assert [view.span for view in rrd_reader.iter_views(contents.root) if view.span] == []  # both timelines whole
    panel = get_time_panel(file)
    assert panel.rows["loop_mode"][-1] == [3]
    duration = stride()["time"][-1] - stride()["time"][0]
    assert panel.rows["fps"][-1] == pytest.approx([100.0 / duration])


def test_gait_cycle_has_the_101_points_of_the_last_stride(folder: Path, tmp_path: Path) -> None:
    first, second = stride(), Recording(dict(stride().channels), stride().units, stride().provenance)
    second.channels["time"] = second["time"] + 1.1
    second.channels["stride"] = second["stride"] + 1.0
    second.channels["force"] = 1.5 * second["force"]
    joined = {name: np.concatenate([samples, second[name]]) for name, samples in first.channels.items()}
    recording = Recording(joined, stride().units, stride().provenance)
    samples = gait_cycle.find_samples(recording)
    assert samples[0] == len(first)
    assert samples[-1] == len(recording) - 1
    half_interval = 0.5 * (recording["gait_phase"][1] - recording["gait_phase"][0])
    assert np.abs(recording["gait_phase"][samples] - np.arange(101))[:-1].max() <= half_interval + 1e-9
    writer.write_recording(recording, rig(), tmp_path / "r.rrd")
    contents = rrd_reader.read_rrd(tmp_path / "r.rrd")
    for name in ("force", "reference_ankle_angle", "air_mass"):
        entity = contents.entities[f"channels/{name}"]
        assert np.array_equal(entity.get_times(gait_cycle.TIMELINE), np.arange(101))
        assert np.array_equal(np.ravel(entity.rows["scalars"]), recording[name][samples])
    band = contents.entities["band/ankle_angle"]
    assert np.ravel(band.rows["values"]) == pytest.approx(recording["reference_ankle_angle"][samples])
    foot = contents.entities["world/prosthesis_foot"]
    assert np.array(foot.rows["translation"])[:, 0, 0] == pytest.approx(recording["ankle_x"][samples], abs=1e-6)


def test_totals_begin_at_0_on_both_timelines(chunks: dict[str, list[Any]], file: Path) -> None:
    of_stride = read(file, gait_cycle.TIMELINE)
    for entity in writer.TOTALS:
        assert scalars(of_stride, entity)[0] == 0.0
        assert scalars(of_stride, entity)[-1] == pytest.approx(
            scalars(chunks, entity)[-1] - scalars(chunks, entity)[0], abs=1e-9
        )


def test_work_loop_shows_earlier_strides_thinly() -> None:
    channels = {name: np.tile(samples, 2) for name, samples in stride().channels.items()}
    channels["stride"] = np.repeat([1.0, 2.0], len(stride()))
    curves = writer.build_loop_chart(Recording(channels, stride().units, stride().provenance)).curves
    assert [(curve.name, curve.thin, len(curve.x)) for curve in curves] == [
        (name, thin, len(stride()))
        for name, thin in (("earlier strides", True), ("human", True), ("prosthesis", False))
    ]


def test_plots_have_room_for_their_bands(file: Path) -> None:
    ranges = {view.name: view.value_range for view in rrd_reader.iter_views(rrd_reader.read_rrd(file).root)}
    low, high = ranges["ankle angle [deg], dorsiflexion up"] or (np.nan, np.nan)
    mean, sd = stride()["reference_ankle_angle"], stride()["reference_ankle_angle_sd"]
    assert low < (mean - sd).min()
    assert high > (mean + sd).max()
    assert ranges["device forces [N]"] is None


def test_legend_lies_where_the_lines_leave_room() -> None:
    phase = np.linspace(0.0, 1.0, 101)
    assert stream.choose_legend_corner(phase, [phase]) in ("RightBottom", "LeftTop")
    assert stream.choose_legend_corner(phase, [np.where(phase < 0.5, 1.0, 0.9 * phase)]) == "LeftBottom"
    assert stream.choose_legend_corner(phase, [np.full(101, np.nan)]) == "RightTop"
    assert stream.choose_legend_corner(phase, [np.exp(-((phase - 0.8) ** 2) * 50.0)]) == "LeftTop"


def test_body_positions_match_the_simulation(chunks: dict[str, list[Any]]) -> None:
    places = np.array(column(chunks["world/prosthesis_foot"], "Transform3D:translation"), dtype=np.float64)
    frames = scene.select_frames(stride())
    places = places.reshape(len(frames), 3)
    assert places[:, 0] == pytest.approx(stride()["ankle_x"][frames], abs=1e-6)
    assert places[:, 2] == pytest.approx(stride()["ankle_z"][frames], abs=1e-6)


def test_body_poses_match_the_model(chunks: dict[str, list[Any]]) -> None:
    model = rig()
    for body in range(1, model.nbody):
        batches = chunks[scene.format_body_entity(model, body)]
        places = np.array(column(batches, "Transform3D:translation"), dtype=np.float64).reshape(-1, 3)
        turns = [value[0] for value in column(batches, "Transform3D:quaternion")]
        assert places == pytest.approx(np.array([data.xpos[body] for data in moved()]), abs=1e-6)
        for turn, data in zip(turns, moved(), strict=True):
            assert matrix(turn) == pytest.approx(data.xmat[body].reshape(3, 3), abs=1e-6)


def test_geometry_matches_the_model(file: Path) -> None:
    model = rig()
    static_chunks = read(file, None)
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        name = model.geom(geom).name or f"geom_{geom}"
        path = f"{scene.format_body_entity(model, body) if body else 'world'}/{name}"
        if model.geom_group[geom] in (1, 3):  # a muscle that changes is drawn; contact is hidden
            assert path not in static_chunks
            continue
        batches = static_chunks[path]
        (batch,) = [b for b in batches if any(n.endswith("Transform3D:quaternion") for n in b.schema.names)]
        (turn,), (place,) = column([batch], "Transform3D:quaternion")[0], column([batch], "Transform3D:translation")[0]
        turned = np.empty(9)
        mujoco.mju_quat2Mat(turned, model.geom_quat[geom])
        assert matrix(turn) == pytest.approx(turned.reshape(3, 3), abs=1e-6)
        assert place == pytest.approx(model.geom_pos[geom], abs=1e-6)


def test_muscle_and_tendon_span_the_sites(chunks: dict[str, list[Any]]) -> None:
    frames = scene.select_frames(stride())
    muscle, tendon = (
        np.array([strip[0] for strip in column(chunks[f"world/{name}"], "LineStrips3D:strips")])
        for name in ("muscle", "achilles")
    )
    ends = [[data.site(f"prosthesis_achilles_{end}").xpos for end in ("origin", "insertion")] for data in moved()]
    assert muscle[:, 0] == pytest.approx(np.array(ends)[:, 0], abs=1e-6)
    assert muscle[:, 1] == pytest.approx(tendon[:, 0], abs=1e-6)
    assert tendon[:, 1] == pytest.approx(np.array(ends)[:, 1], abs=1e-6)
    length = np.linalg.norm(muscle[:, 1] - muscle[:, 0], axis=1)
    assert length == pytest.approx(stride()["muscle_length"][frames], abs=1e-6)


def test_tendon_colour_follows_its_force(chunks: dict[str, list[Any]]) -> None:
    colours = [c[0] for c in column(chunks["world/achilles"], "LineStrips3D:colors")]
    frames = scene.select_frames(stride())
    force = stride()["force"][frames]
    assert len(colours) == len(frames)
    red = np.array([colour >> 24 & 255 for colour in colours])
    green = np.array([colour >> 16 & 255 for colour in colours])
    assert red[force.argmax()] > 210 > green[force.argmax()]
    assert green[force.argmin()] > 130
    assert len(set(colours)) > 20


def test_ground_reaction_is_zero_in_swing(chunks: dict[str, list[Any]]) -> None:
    arrows = np.array(column(chunks["world/ground_reaction"], "Arrows3D:vectors"), dtype=np.float64).reshape(-1, 3)
    frames = scene.select_frames(stride())
    phase = stride()["gait_phase"][frames]
    assert np.abs(arrows[(phase > 70) & (phase < 90)]).max() == 0.0
    feet = np.array(column(chunks["world/ground_reaction"], "Arrows3D:origins"), dtype=np.float64).reshape(-1, 3)
    pressed = np.isfinite(stride()["cop_x"][frames])
    assert feet[pressed, 0] == pytest.approx(stride()["cop_x"][frames][pressed], abs=1e-6)
    assert arrows[:, 2].max() * scene.ARROW_SCALE_N_PER_M == pytest.approx(stride()["grf_vertical"][frames].max())


def test_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[rerun\]'"):
        writer.write_recording(stride(), rig(), tmp_path / "r.rrd")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("without", ["cop_x", "reference_ankle_angle", "reference_ankle_angle_sd"])
def test_optional_channel_may_be_missing(without: str, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    recording = [
        (stride().format_heading(name), values) for name, values in stride().channels.items() if name != without
    ]
    writer.write_recording(Recording.from_columns(recording), rig(), tmp_path / "r.rrd")


def test_single_sample_gives_one_pose() -> None:
    recording = stride().select(slice(0, 1))
    frames = scene.select_frames(recording)
    assert frames.tolist() == [0]
    assert len(scene.compute_postures(recording, rig(), frames)) == 1
