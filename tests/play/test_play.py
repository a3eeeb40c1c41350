"""Play: controls and their ranges, sessions that follow them, and videos."""

import math
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from klute_sim.device.device import load_device
from klute_sim.errors import InputError, MissingExtraError
from klute_sim.play import controls as keys
from klute_sim.play.controls import SCENES, Controls
from klute_sim.play.recording import record_video
from klute_sim.play.session import PlaySession
from klute_sim.rendering import graphics_context, video, window
from klute_sim.rendering.frames import RenderOptions
from klute_sim.rendering.graphics_context import RenderingError
from klute_sim.rendering.video import FRAME_RATE
from tests.command_line import run

DEVICE = load_device("klute-1-1-4-pair")
KEYS = (keys.KEY_UP, keys.KEY_DOWN, keys.KEY_LEFT, keys.KEY_RIGHT, keys.KEY_PAGE_UP, keys.KEY_PAGE_DOWN)
needs_library = pytest.mark.skipif(
    not (graphics_context.has_egl_device() or graphics_context.has_osmesa()), reason="neither EGL nor OSMesa"
)


def start(scene: str, **values: float) -> PlaySession:
    return PlaySession(DEVICE, Controls(scene=scene, max_pressure_bar=5.0, **values))


def run_for(session: PlaySession, steps: int) -> float:
    """Return the mean pressure [bar] over ``steps`` of 10 ms."""
    pressures = []
    for _ in range(steps):
        session.advance()
        pressures.append(session.data.act[-2])
    return float(np.mean(pressures))


@given(st.sampled_from(SCENES), st.lists(st.sampled_from([*KEYS, 0, 65]), max_size=60))
def test_no_key_leads_out_of_range(scene: str, pressed: list[int]) -> None:
    controls = Controls(scene=scene, max_pressure_bar=5.0)
    for key in pressed:
        controls = controls.press(key)
    lowest, highest = controls.pressure_range
    assert lowest <= controls.pressure_bar <= highest
    if scene != "gait":
        assert (controls.speed, controls.slope_deg) == (1.2, 0.0)


def test_keys_change_what_they_name() -> None:
    controls = Controls(scene="gait", max_pressure_bar=5.0)
    assert controls.press(keys.KEY_UP).pressure_bar == 0.25
    assert controls.press(keys.KEY_DOWN).press(keys.KEY_UP) == controls
    assert controls.press(keys.KEY_RIGHT).speed == 1.3
    assert controls.press(keys.KEY_PAGE_DOWN).slope_deg == -1.0
    assert controls.press(keys.KEY_ENTER).is_paused
    assert controls.press(keys.KEY_HOME).n_restarts == 1
    assert controls.press(65) == controls
    for scene, names in keys.KEY_HELP.items():
        text = Controls(scene=scene, max_pressure_bar=5.0).describe()
        assert all(name in text for name in names)


def test_pressure_of_the_tester_is_that_of_the_control() -> None:
    session = start("bench", pressure_bar=1.0)
    run_for(session, 30)
    session.set_controls(session.controls.press(keys.KEY_UP))
    run_for(session, 30)
    assert session.data.act[-2] == pytest.approx(1.25, abs=0.02)


def test_gait_adds_the_control_to_the_profile_and_none_is_no_air() -> None:
    profile, more, none = (run_for(start("gait", pressure_bar=bar), 110) for bar in (0.0, 1.0, -5.0))
    assert profile + 0.5 < more < profile + 1.1
    assert none < 0.1


def test_another_speed_is_another_model_and_an_impossible_one_is_refused() -> None:
    session = start("gait")
    model = session.model
    session.advance()
    session.set_controls(session.controls.press(keys.KEY_ENTER))
    time = session.data.time
    assert not session.advance()
    assert session.data.time == time
    assert session.model is model
    with pytest.raises(InputError, match="speed"):
        session.set_controls(Controls(scene="gait", max_pressure_bar=5.0, speed=9.0))
    assert session.controls.speed == 1.2
    session.set_controls(session.controls.press(keys.KEY_ENTER).press(keys.KEY_PAGE_UP))
    assert session.model is not model
    assert math.degrees(math.atan2(-session.model.opt.gravity[0], -session.model.opt.gravity[2])) == pytest.approx(1.0)


def test_invalid_scenes_and_pressures_are_refused() -> None:
    with pytest.raises(InputError, match="there is no scene 'run' to play; allowed: gait, bench, walk"):
        Controls(scene="run", max_pressure_bar=5.0)
    with pytest.raises(InputError, match="pressure is 6 bar; allowed: 0 to 5 bar"):
        Controls(scene="bench", max_pressure_bar=5.0, pressure_bar=6.0)


def test_caption_follows_phase_time_and_pressure() -> None:
    bench = start("bench", pressure_bar=1.0)
    run_for(bench, 50)
    assert "time\u20070.50 s" in bench.describe_state().replace("time ", "time")
    assert bench.describe_state().endswith("pressure 1.00 bar")
    assert "gait cycle" not in bench.describe_state()
    gait = start("gait")
    run_for(gait, 25)
    stride_time = 100 * 0.25 / float(gait.describe_state().split("%")[0].split()[-1])
    assert stride_time == pytest.approx(1.1, abs=0.1)


def test_phase_of_a_walk_is_unknown_before_the_first_foot_strike() -> None:
    session, phases = start("walk"), []
    for _ in range(250):
        session.advance()
        phases.append(session.describe_state().split("% (estimated)")[0].removeprefix("gait cycle").strip())
    n_unknown = phases.count("\u2013")
    assert 0 < n_unknown < 150
    assert phases[:n_unknown] == n_unknown * ["\u2013"]
    assert float(phases[n_unknown]) < 5.0
    assert float(phases[n_unknown + 40]) == pytest.approx(35.0, abs=10.0)


@needs_library
def test_a_video_lasts_as_long_as_the_simulation_and_moves(tmp_path: Path) -> None:
    path = tmp_path / "bench.gif"
    session = start("bench", pressure_bar=3.0)
    record_video(session, path, seconds=0.4, camera="side", size=(64, 48))
    with Image.open(path) as image:
        assert image.size == (64, 48)
        assert image.n_frames == 0.4 * FRAME_RATE
        assert image.info["duration"] == 1000.0 / FRAME_RATE
        assert image.info["loop"] == 0
        first = np.asarray(image.convert("RGB"))
        image.seek(9)
        assert not np.array_equal(first, np.asarray(image.convert("RGB")))
    assert session.data.time == pytest.approx(0.4)
    with pytest.raises(InputError, match="allowed: above 0, up to 600 s"):
        record_video(session, path, seconds=0.0, camera="side", size=(64, 48))


def test_videos_of_every_kind_keep_their_images(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    images = [np.full((20, 31, 3), level, dtype=np.uint8) for level in (0, 120, 240)]
    for suffix in video.VIDEO_SUFFIXES:
        path = tmp_path / f"levels{suffix}"
        video.write_video(path, iter(images), 25.0)
        assert path.stat().st_size > 100
        if suffix != ".mp4":
            with Image.open(path) as image:
                assert image.n_frames == 3
                image.seek(1)
                assert np.asarray(image.convert("RGB")).mean() == pytest.approx(120, abs=3)


def test_unknown_endings_and_a_missing_encoder_are_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"walk\.avi is no video file; allowed endings: \.gif, \.webp, \.mp4"):
        video.check_video_path(Path("walk.avi"))
    monkeypatch.setattr(video.importlib.util, "find_spec", lambda name: None)
    video.check_video_path(Path("walk.gif"))
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[video\]'"):
        video.check_video_path(Path("walk.mp4"))


@needs_library
def test_command_writes_a_video(tmp_path: Path) -> None:
    options = ["--seconds", "0.2", "--size", "48", "32", "--video", "walk.webp"]
    completed = run("play", "bench", *options, cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    assert completed.stdout == "walk.webp\n"
    assert (tmp_path / "walk.webp").read_bytes()[8:12] == b"WEBP"
    refused = run("play", "gait", "--camera", "top", *options, cwd=tmp_path)
    assert refused.returncode == 2
    assert "the model has no camera 'top'" in refused.stderr


@needs_library
def test_without_a_display_the_command_is_repeated_as_one_for_a_video(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(window, "has_display", lambda: False)
    refused = run("play", "walk", "--pressure", "0.50", "--size", "48", "32")
    assert refused.returncode != 0
    assert "write a video instead: klute-sim play walk --pressure 0.5 --size 48 32 --video walk.gif" in refused.stderr
    assert "render_mode" not in refused.stderr
    assert run("play").stderr.endswith("klute-sim play --video gait.gif\n")
    with pytest.raises(RenderingError, match=r"draw images instead: render_mode 'rgb_array'$"):
        RenderOptions(render_mode="human")


@pytest.mark.extras
@pytest.mark.skipif(not graphics_context.has_display(), reason="no display")
def test_a_window_shows_the_session_until_it_is_closed() -> None:
    from klute_sim.play import window_loop
    from klute_sim.rendering.window import ViewerWindow

    session, windows = start("gait"), list[ViewerWindow]()

    class Window(ViewerWindow):
        def show(self, text: str = "") -> None:
            super().show(text)
            if self not in windows:
                windows.append(self)
                self._key(keys.KEY_RIGHT if len(windows) == 1 else keys.KEY_UP)
            elif session.data.time > 0.1 and len(windows) == 2:
                self._handle.close()

        def __init__(self, *arguments: object) -> None:
            super().__init__(*arguments)
            self._key = arguments[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(window_loop, "ViewerWindow", Window)
        window_loop.play_in_window(session, "side")
    assert len(windows) == 2  # the first key changed the speed, and with it the model
    assert session.controls.speed == 1.3
    assert session.controls.pressure_bar == 0.25
    assert threading.active_count() < 10
