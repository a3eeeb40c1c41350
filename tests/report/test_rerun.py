"""The rerun recording: it reads back with the recording's own numbers, and moves as the model moves."""

import sys
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from klute_sim.control import pressure
from klute_sim.device.files import load
from klute_sim.errors import InputError, KluteSimError, MissingExtraError
from klute_sim.recording.recording import Recording
from klute_sim.report import rerun as writer
from klute_sim.report import scene, view
from klute_sim.rigs.gait.build import build
from klute_sim.rigs.gait.rig import GaitOptions, walk

DEVICE = load("klute-1-1-4-pair")


@cache
def stride() -> Recording:
    return walk(DEVICE, pressure.tuned(), GaitOptions(strides=1))


def rig() -> mujoco.MjModel:
    return build(DEVICE, mass=75, stature=1.75, step=5e-4)


@pytest.fixture(scope="module")
def chunks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Any]]:
    rr = pytest.importorskip("rerun")
    file = tmp_path_factory.mktemp("rerun") / "r.rrd"
    writer.write(stride(), rig(), file)
    reader = rr.chunk.RrdReader(file)
    assert len(list(reader.blueprints())) == 1
    found: dict[str, list[Any]] = {}
    for chunk in reader.stream():
        if not chunk.is_static:
            found.setdefault(str(chunk.entity_path).lstrip("/"), []).append(chunk.to_record_batch())
    return found


def column(batches: list[Any], ending: str) -> list[Any]:
    values: list[Any] = []
    for batch in batches:
        (name,) = [n for n in batch.schema.names if n.endswith(ending)]
        values += batch.column(name).to_pylist()
    return values


def test_every_channel_reads_back_equal(chunks: dict[str, list[Any]]) -> None:
    for name, samples in stride().channels.items():
        if name == "time":
            continue
        read = np.array(column(chunks[f"channels/{name}"], "Scalars:scalars"), dtype=np.float64).ravel()
        assert np.array_equal(read, samples, equal_nan=True), name


def test_the_band_is_one_deviation_wide(chunks: dict[str, list[Any]]) -> None:
    low, high = (
        np.array(column(chunks[f"band/ankle_moment_{side}"], "Scalars:scalars"), dtype=np.float64).ravel()
        for side in ("low", "high")
    )
    assert high - low == pytest.approx(2 * stride()["reference_ankle_moment_sd"])


def test_bodies_are_where_the_simulation_had_them(chunks: dict[str, list[Any]]) -> None:
    places = np.array(column(chunks["world/prosthesis_foot"], "Transform3D:translation"), dtype=np.float64)
    frames, _ = scene.postures(stride(), rig())
    places = places.reshape(len(frames), 3)
    assert places[:, 0] == pytest.approx(stride()["ankle_x"][frames], abs=1e-6)
    assert places[:, 2] == pytest.approx(stride()["ankle_z"][frames], abs=1e-6)


def test_the_tendon_reddens_with_its_force(chunks: dict[str, list[Any]]) -> None:
    colours = [c[0] for c in column(chunks["world/achilles"], "LineStrips3D:colors")]
    frames, _ = scene.postures(stride(), rig())
    force = stride()["force"][frames]
    assert len(colours) == len(frames)
    red = np.array([colour >> 24 & 255 for colour in colours])
    green = np.array([colour >> 16 & 255 for colour in colours])
    assert red[force.argmax()] > 210 > green[force.argmax()]
    assert green[force.argmin()] > 130
    assert len(set(colours)) > 20


def test_the_ground_reaction_vanishes_in_swing(chunks: dict[str, list[Any]]) -> None:
    arrows = np.array(column(chunks["world/ground_reaction"], "Arrows3D:vectors"), dtype=np.float64).reshape(-1, 3)
    frames, _ = scene.postures(stride(), rig())
    phase = stride()["gait_phase"][frames]
    assert np.abs(arrows[(phase > 70) & (phase < 90)]).max() == 0.0
    assert arrows[:, 2].max() * scene.NEWTONS_PER_METRE == pytest.approx(stride()["grf_vertical"][frames].max())


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'klute-sim\[rerun\]'"):
        writer.write(stride(), rig(), tmp_path / "r.rrd")
    assert not (tmp_path / "r.rrd").exists()
    with pytest.raises(MissingExtraError, match="viewer"):
        view.open_viewer(tmp_path)


@pytest.mark.parametrize("web", [False, True])
def test_the_viewer_listens_on_the_loopback_address_only(web: bool) -> None:
    command = view.viewer_command("rerun", Path("r.rrd"), web=web)
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert command[-1] == "r.rrd"


def test_a_folder_without_a_recording_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no run folder"):
        view.recording_of(tmp_path / "none")
    with pytest.raises(InputError, match=r"has no recording\.rrd"):
        view.recording_of(tmp_path)
    (tmp_path / "recording.parquet").touch()
    with pytest.raises(InputError, match="run the gait again"):
        view.recording_of(tmp_path)
    (tmp_path / "recording.rrd").touch()
    assert view.recording_of(tmp_path) == tmp_path / "recording.rrd"


def test_a_failing_viewer_is_one_sentence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "recording.rrd").touch()
    monkeypatch.setattr(view, "viewer_program", lambda: "false")
    with pytest.raises(KluteSimError, match="ended with code 1"):
        view.open_viewer(tmp_path)
