"""A recorded gait, walk or bench run as a video, without a display: MuJoCo draws its model in the recorded postures."""

from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from klute_sim.bench.build import build_tester
from klute_sim.device.backend.packing import unpack_parameters
from klute_sim.device.device import parse_device
from klute_sim.errors import InputError
from klute_sim.files.json import read_json
from klute_sim.files.limits import DEVICE, RESULT
from klute_sim.files.reading import read_bytes
from klute_sim.plant.callbacks import get_parameter_row
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.rendering.caption import draw_caption, format_caption
from klute_sim.rendering.frames import FrameSource, RenderOptions
from klute_sim.rendering.video import FRAME_RATE, MAX_SECONDS, check_video_path, write_video
from klute_sim.types import Array, ProgressCallback
from klute_sim.viewer import scene
from klute_sim.viewer.folders import detect_folder_kind
from klute_sim.viewer.layouts import bench, gait, walk
from klute_sim.walker.outcomes import find_strikes

MAX_TRIAL_SECONDS = 10.0
"""Longest duration of a bench trial in a video [s]; longer trials play faster."""
METRES = {"m": 1.0, "mm": 1e-3}
"""Unit of a channel -> factor to metres."""


class Motion(NamedTuple):
    """Postures of a model at each frame of a video."""

    model: mujoco.MjModel
    positions: Array
    """Joint positions (n, nq)."""
    device_states: Array
    """Pressure [bar] and muscle length minus resting length [m] (n, 2); NaN: the device is not drawn."""
    captions: tuple[str, ...]
    """Captions (n,)."""


def save_video(
    folder: Path,
    path: Path,
    *,
    camera: str,
    size: tuple[int, int],
    progress: ProgressCallback = lambda fraction, stage: None,
) -> None:
    """Write the run in ``folder``, seen from ``camera``, to ``path`` (.gif, .webp or .mp4).

    Gait and walks play in real time. A bench run plays the trials that have a tab in the viewer, one after the other,
    each for at most :data:`MAX_TRIAL_SECONDS`. Each image has a caption: phase of the gait cycle or name of the trial,
    time, and pressure of the device. ``size`` is width and height [pixels]. Raises InputError for other
    folders and for values out of range, MissingExtraError and RenderingError when a library is missing.
    """
    check_video_path(path)
    options = RenderOptions(render_mode="rgb_array", width=size[0], height=size[1], camera=camera)
    motions = load_motions(folder)
    n_frames, source = sum(len(motion.positions) for motion in motions), FrameSource(options)

    def draw() -> Iterator[NDArray[np.uint8]]:
        number = 0
        for motion in motions:
            for data, caption in zip(pose(motion), motion.captions, strict=True):
                progress(number / n_frames, "drawing")
                yield draw_caption(np.asarray(source.draw(motion.model, data), dtype=np.uint8), caption)
                number += 1

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_video(path, draw(), FRAME_RATE)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}") from None
    finally:
        source.close()
    progress(1.0, "drawing")


def load_motions(folder: Path) -> list[Motion]:
    """Return what a video of the run in ``folder`` shows, in its order.

    Raises InputError if ``folder`` is no gait, walk or bench run, or if its video would be too long.
    """
    if not folder.is_dir():
        raise InputError(f"a video needs the folder of a gait, walk or bench run, which {folder} is not")
    kind = detect_folder_kind(folder).name
    loaders: dict[str, Callable[[Path], list[Motion]]] = {
        "gait run": _load_gait,
        "walk": _load_walk,
        "bench run": _load_bench,
    }
    if kind not in loaders:
        raise InputError(f"{folder} is a {kind}, which has no video; allowed: {', '.join(loaders)}")
    try:
        return loaders[kind](folder)
    except (AttributeError, KeyError, TypeError, ValueError, OSError, pa.ArrowException) as error:
        raise InputError(f"cannot draw the {kind} {folder}: {type(error).__name__}: {error}") from None


def pose(motion: Motion) -> Iterator[mujoco.MjData]:
    """Yield the model of ``motion`` in the posture of each frame, ready to be drawn; the data are always the same."""
    model, data = motion.model, mujoco.MjData(motion.model)
    device = _find_device(model)
    for position, device_state in zip(motion.positions, motion.device_states, strict=True):
        data.qpos[:] = position
        if device is not None:
            first = int(model.actuator_actadr[device])
            data.act[first : first + 2] = device_state
        for update in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight, mujoco.mj_tendon):
            update(model, data)
        yield data


def select_frames(recording: Recording, max_seconds: float) -> NDArray[np.int64]:
    """Return the samples at the frames of a video in real time; at most ``max_seconds`` [s], evenly spaced."""
    time = recording["time"]
    n_frames = max(1, round(min(float(time[-1] - time[0]), max_seconds) * FRAME_RATE))
    times = np.linspace(time[0], time[-1], n_frames, endpoint=False)
    return np.searchsorted(time, times)


def compute_walk_phase(recording: Recording) -> Array:
    """Return the phase [%] of the right leg's gait cycle (n,); NaN before its first and after its last foot strike."""
    strikes = find_strikes(recording, "right", float(recording.provenance["options"]["mass_kg"]))
    phase = np.full(len(recording), np.nan)
    for begin, end in pairwise(strikes):
        phase[begin:end] = 100.0 * np.arange(end - begin) / (end - begin)
    return phase


def _load_gait(folder: Path) -> list[Motion]:
    recording = _load_recording(folder)
    model, frames = gait.build_model(recording, folder), select_frames(recording, MAX_SECONDS)
    positions, phase = scene.compute_postures(recording, model, frames), recording["gait_phase"]
    return [_build_motion(model, recording, frames, positions, phase=phase)]


def _load_walk(folder: Path) -> list[Motion]:
    recording = _load_recording(folder)
    model, frames = walk.build_model(recording, folder), select_frames(recording, MAX_SECONDS)
    positions, phase = walk.compute_postures(recording, model, frames), compute_walk_phase(recording)
    return [_build_motion(model, recording, frames, positions, phase=phase)]


def _load_recording(folder: Path) -> Recording:
    recording = parquet.load_recording(folder / "recording.parquet")
    duration = float(np.ptp(recording["time"]))
    if duration > MAX_SECONDS:
        raise InputError(f"{folder} lasts {duration:g} s; allowed in a video: up to {MAX_SECONDS:g} s")
    return recording


def _load_bench(folder: Path) -> list[Motion]:
    summary, file = read_json(folder / "summary.json", RESULT), folder / "device.toml"
    model = build_tester(parse_device(read_bytes(file, DEVICE), str(file)), 1e-3 * summary["step_ms"])
    crosshead, motions = int(model.joint("crosshead").qposadr[0]), []
    trials = bench.load_trials(folder, summary)
    for number in bench.select_tab_trials(trials):
        name, recording = trials[number - 1].name, trials[number - 1].recording
        frames = select_frames(recording, MAX_TRIAL_SECONDS)
        positions = np.zeros((len(frames), model.nq))
        positions[:, crosshead] = METRES[recording.units["length"]] * recording["length"][frames]
        motions.append(_build_motion(model, recording, frames, positions, name=name))
    return motions


def _build_motion(
    model: mujoco.MjModel,
    recording: Recording,
    frames: NDArray[np.int64],
    positions: Array,
    *,
    phase: Array | None = None,
    name: str = "",
) -> Motion:
    """Return the motion at ``frames``; ``phase`` [%] is that of the gait cycle, ``name`` that of a trial."""
    device, states = _find_device(model), np.full((len(frames), 2), np.nan)
    row = None if device is None else get_parameter_row(model, device)
    if row is not None and scene.has_muscle(recording):
        length = METRES[recording.units["muscle_length"]] * recording["muscle_length"][frames]
        states[:, 0] = recording["pressure"][frames]
        states[:, 1] = length - unpack_parameters(row).muscle.resting_length
    captions = (
        format_caption(
            time=float(recording["time"][frame]),
            gait_cycle=None if phase is None else float(phase[frame]),
            pressure=float(pressure),
            name=name,
        )
        for frame, pressure in zip(frames, states[:, 0], strict=True)
    )
    return Motion(model, positions, states, tuple(captions))


def _find_device(model: mujoco.MjModel) -> int | None:
    """Return the actuator of the device; None without one."""
    return next((a for a in range(model.nactuator) if get_parameter_row(model, a) is not None), None)
