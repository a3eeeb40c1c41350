"""Videos of recorded runs: their postures and devices are those of the recording, in real time."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

import klute_sim as ks
from klute_sim.device.device import Device, load_device
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.laws import tendon
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.rendering import graphics_context
from klute_sim.rendering.caption import FIGURE_SPACE
from klute_sim.rendering.video import FRAME_RATE
from klute_sim.viewer import video
from tests.command_line import run

DEVICE = load_device("klute-1-1-4-pair")
needs_library = pytest.mark.skipif(
    not (graphics_context.has_egl_device() or graphics_context.has_osmesa()), reason="neither EGL nor OSMesa"
)


def write_files(folder: Path, recordings: dict[str, Recording], device: Device, **others: str) -> Path:
    """Write what a video needs of a run's folder."""
    folder.mkdir()
    for name, recording in recordings.items():
        parquet.write_recording(recording, folder / f"{name}.parquet")
    (folder / "device.toml").write_bytes(device.content)
    for name, content in others.items():
        (folder / name.replace("_", ".")).write_text(content)
    return folder


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    changes = {"concentric_mm_per_s": [20, 200], "eccentric_mm_per_s": [100], "pressures_bar": 3}
    tested = ks.simulate_bench("klute-3-4-pair", "isokinetic", time_step=2e-3, **changes)
    return write_files(
        tmp_path_factory.mktemp("bench") / "run",
        {trial.name: trial.recording for trial in tested.result.trials},
        tested.device,
        protocol_toml="",
        summary_json=json.dumps(tested.summary),
    )


def test_gait_is_posed_as_recorded_at_25_frames_a_second(tmp_path: Path) -> None:
    walked = ks.simulate_gait(strides=1, time_step=1e-3)
    folder = write_files(tmp_path / "gait", {"recording": walked.recording}, DEVICE)
    (motion,) = video.load_motions(folder)
    recording = parquet.load_recording(folder / "recording.parquet")
    frames = video.select_frames(recording, video.MAX_SECONDS)
    assert np.diff(recording["time"][frames]) == pytest.approx(1.0 / FRAME_RATE, rel=0.03)
    feet = [data.body(PROSTHESIS_PREFIX + "foot").xpos.copy() for data in video.pose(motion)]
    assert np.array(feet)[:, 0] == pytest.approx(recording["ankle_x"][frames], abs=1e-6)
    pressure, offset = motion.device_states.T
    assert np.array_equal(pressure, recording["pressure"][frames])
    resting_length = DEVICE.parameters.muscle.resting_length
    assert offset + resting_length == pytest.approx(recording["muscle_length"][frames])
    for text, frame in zip(motion.captions, frames, strict=True):
        words = text.replace(FIGURE_SPACE, " ").split()
        assert words[2:4] == [f"{recording['gait_phase'][frame]:.0f}", "%"]
        assert words[5] == f"{recording['time'][frame]:.2f}"


def test_recorded_muscle_of_a_walk_gives_its_recorded_moment(tmp_path: Path) -> None:
    walked = ks.simulate_walk(seconds=1.5)
    folder = write_files(tmp_path / "walk", {"recording": walked.recording}, DEVICE, walker_toml="")
    (motion,) = video.load_motions(folder)
    frames = video.select_frames(walked.recording, video.MAX_SECONDS)
    parameters = DEVICE.parameters
    moments = []
    for data, state in zip(video.pose(motion), motion.device_states, strict=True):
        muscle_length = parameters.muscle.resting_length + state[1]
        length = float(data.ten_length[0])
        force = tendon.force(parameters.tendon, length - muscle_length - parameters.tendon.slack_length)
        data.joint(PROSTHESIS_PREFIX + "ankle").qpos[0] += 1e-6
        mujoco.mj_kinematics(motion.model, data)
        mujoco.mj_tendon(motion.model, data)
        moments.append(-force * (float(data.ten_length[0]) - length) / 1e-6)
    recorded = walked.recording["device_moment"][frames]
    assert np.abs(recorded).max() > 30.0
    assert moments == pytest.approx(recorded, abs=0.02 * np.abs(recorded).max())


def test_phase_of_a_walk_runs_from_foot_strike_to_foot_strike() -> None:
    recording = ks.simulate_walk(seconds=3.5).recording
    phase = video.compute_walk_phase(recording)
    strikes = np.flatnonzero(phase == 0.0)
    assert len(strikes) >= 2
    load = recording["grf_vertical_right"]
    assert (load[strikes - 50] < 20.0).all()
    assert (load[strikes + 50] > 100.0).all()
    assert np.isnan(phase[: strikes[0]]).all()
    assert np.isnan(phase[-1])
    assert np.nanmax(phase) > 99.5
    estimate = recording["phase_estimate"][strikes[1] + 50 : strikes[1] + 300]
    assert phase[strikes[1] + 50 : strikes[1] + 300] == pytest.approx(estimate, abs=8.0)


def test_walk_on_a_spring_foot_has_no_device_to_draw(tmp_path: Path) -> None:
    walked = ks.simulate_walk(seconds=1.0, spring_foot=8.0)
    folder = write_files(tmp_path / "walk", {"recording": walked.recording}, DEVICE, walker_toml="")
    (motion,) = video.load_motions(folder)
    assert np.isnan(motion.device_states).all()
    assert len(list(video.pose(motion))) == 25


def test_trials_of_a_bench_run_follow_each_other_and_long_ones_play_faster(bench: Path) -> None:
    motions = video.load_motions(bench)
    files = sorted(bench.glob("*.parquet"))
    assert len(motions) == len(files) == 3
    durations = []
    for motion in motions:
        lengths = [1e3 * float(data.ten_length[0]) for data in video.pose(motion)]
        durations.append(len(lengths) / FRAME_RATE)
        assert len({text.split()[0] for text in motion.captions}) == 1
        matches = [abs(parquet.load_recording(file)["length"].min() - min(lengths)) for file in files]
        assert min(matches) < 4.0  # mm between two frames
    time = np.linspace(0.0, 200.0, 20001)
    slow = Recording({"time": time}, {"time": "s"}, {})
    assert len(video.select_frames(slow, video.MAX_TRIAL_SECONDS)) == video.MAX_TRIAL_SECONDS * FRAME_RATE
    assert max(durations) <= video.MAX_TRIAL_SECONDS


@pytest.mark.slow
@needs_library
def test_command_writes_a_looping_video(bench: Path, tmp_path: Path) -> None:
    completed = run("view", str(bench), "--video", "videos/bench.gif", "--size", "48", "32", cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    assert completed.stdout.split() == ["videos/bench.gif"]
    with Image.open(tmp_path / "videos" / "bench.gif") as image:
        assert image.size == (48, 32)
        duration_ms = 0.0
        for number in range(image.n_frames):
            image.seek(number)
            duration_ms += image.info["duration"]  # Pillow joins equal images
    n_frames = sum(len(motion.positions) for motion in video.load_motions(bench))
    assert duration_ms == pytest.approx(1000.0 * n_frames / FRAME_RATE)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--video", "v.gif", "--web"], "--web and --video exclude each other"),
        (["--video", "v.gif", "--picture", "p.png"], "--picture and --video exclude each other"),
        (["--video", "v.gif", "--at", "50"], "--at sets the cursor of a picture: add --picture"),
        (["--camera", "side"], "--camera and --size are those of a video: add --video"),
        (["--video", "v.avi"], "v.avi is no video file; allowed endings: .gif, .webp, .mp4"),
        (["--video", "v.gif", "--camera", "back"], "the model has no camera 'back'"),
    ],
)
def test_incompatible_options_are_refused_in_one_sentence(arguments: list[str], message: str, bench: Path) -> None:
    completed = run("view", str(bench), *arguments, cwd=bench.parent)
    assert completed.returncode == 2
    assert message in " ".join(completed.stderr.split())


def test_folders_without_motion_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ks.InputError, match="needs the folder of a gait, walk or bench run"):
        video.load_motions(tmp_path / "none")
    (tmp_path / "verdict.json").write_text("{}")
    with pytest.raises(ks.InputError, match="is a diagnosis, which has no video; allowed: gait run, walk, bench run"):
        video.load_motions(tmp_path)
    (tmp_path / "verdict.json").unlink()
    (tmp_path / "recording.parquet").write_text("nonsense")
    with pytest.raises(ks.InputError):
        video.load_motions(tmp_path)
