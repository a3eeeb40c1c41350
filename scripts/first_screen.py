"""Draw the first screen, a predicted walk with its curves and a diagnosis, and a picture of the environments.

    python scripts/first_screen.py docs/pictures

Requires the extra 'rendering'. A test compares the digest of the drawing code, which all of them contain.
"""

import argparse
import hashlib
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from PIL import Image

from klute_sim import rendering
from klute_sim.api.diagnosis import diagnose, load_example_dataset
from klute_sim.constants import GRAVITY
from klute_sim.device.device import DEFAULT_DEVICE, load_device
from klute_sim.envs.ankle_bench import AnkleBenchEnv
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.ankle_walk import AnkleWalkEnv
from klute_sim.envs.antagonist_joint import AntagonistJointEnv
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.reference import load_default_reference
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.models import get_models_folder
from klute_sim.play.controls import Controls
from klute_sim.play.session import PlaySession
from klute_sim.rendering.renderer import SceneRenderer
from klute_sim.report.diagnosis.text import format_term, join_words
from klute_sim.report.diagnosis.traces import simulate_shown_trials
from klute_sim.report.style import HUMAN_COLOUR, PROSTHESIS_COLOUR, STYLE
from klute_sim.types import Array
from klute_sim.units import BAR

WALK, DIAGNOSIS, ENVIRONMENTS = "first-walk.webp", "first-diagnosis.webp", "environments.webp"
"""Files of the animations, and of the picture."""
ENVIRONMENT_SIZE = 300
"""Width and height of the picture of one environment [pixels]."""
WARM_UP_STEPS, STRIKE_LOAD = 500, 50.0
"""Steps of 10 ms before the drawn stride, and vertical load of a foot strike [N]."""
STEPS_PER_FRAME, SLOW_DOWN = 2, 2.0
"""Steps of 10 ms for a frame of the walk, and by how much it is slower than real time."""
PICTURE_HEIGHT, PERSON_WIDTH, ANKLE_WIDTH, CURVES_WIDTH = 420, 330, 230, 400
"""Size of the parts of the walk [pixels]."""
SOUND_COLOUR, PRESSURE_COLOUR = "#d98c21", "#2ca02c"
"""Colours of the other leg, and of the pressure."""
EFFECT_OPTIONS = ["braid_hysteresis", "seal_friction"]
"""Effects that the diagnosis considers, which limits its duration."""
DIAGNOSIS_SIZE = 860, 400
"""Size of the diagnosis [pixels]."""
DIAGNOSIS_RATE, N_LOOP_FRAMES, N_HOLD_FRAMES = 12.0, 24, 18
"""Frames per second of the diagnosis, frames in which a loop is drawn, and in which it stays."""
QUALITY = 72
"""Quality of the WebP files, of 100."""
DPI = 100


@dataclass
class StrideSamples:
    """Samples of a stride, every 10 ms."""

    ankle_deg: dict[str, list[float]] = field(default_factory=lambda: {"left": [], "right": []})
    load_bw: dict[str, list[float]] = field(default_factory=lambda: {"left": [], "right": []})
    pressure_bar: list[float] = field(default_factory=list)


def compute_digest() -> str:
    """Return the digest of the code and the models that draw the animations."""
    files = [Path(__file__), *sorted(Path(rendering.__file__).parent.glob("*.py"))]
    files += sorted(get_models_folder().glob("*.xml"))
    return hashlib.sha256(b"".join(file.read_bytes().replace(b"\r\n", b"\n") for file in files)).hexdigest()


def read_digest(path: Path) -> str:
    """Return the digest in an animation."""
    with Image.open(path) as image:
        return bytes(image.info["xmp"]).decode()


def save_animation(path: Path, images: list[NDArray[np.uint8]], frame_rate: float) -> None:
    """Write looping ``images`` with the digest of the code."""
    first, *others = (Image.fromarray(image) for image in images)
    options: dict[str, Any] = {"quality": QUALITY, "method": 6, "xmp": compute_digest().encode()}
    first.save(path, None, save_all=True, append_images=others, duration=round(1000.0 / frame_rate), loop=0, **options)


def draw_figure(figure: Figure) -> NDArray[np.uint8]:
    """Return the pixels of ``figure``."""
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def sample(session: PlaySession, samples: StrideSamples) -> None:
    """Append the state of the walk to ``samples``."""
    model, data = session.model, session.data
    weight = float(model.body_mass.sum()) * GRAVITY
    samples.ankle_deg["left"].append(float(np.degrees(data.joint("ankle_left").qpos[0])))
    samples.ankle_deg["right"].append(-float(np.degrees(data.joint(PROSTHESIS_PREFIX + "ankle").qpos[0])))
    for side in ("left", "right"):
        samples.load_bw[side].append(get_load(data, side) / weight)
    samples.pressure_bar.append(get_actuator(model).get_state(data).pressure / BAR)


def get_load(data: mujoco.MjData, side: str) -> float:
    """Return the vertical load of a foot [N]."""
    return abs(float(data.sensor(f"load_{side}").data[2]))


def get_actuator(model: mujoco.MjModel) -> DeviceActuator:
    """Return the device of the prosthesis."""
    return DeviceActuator(model, PROSTHESIS_PREFIX + "muscle_tendon")


def wait_for_strike(session: PlaySession) -> None:
    """Advance until the prosthetic foot has just struck the ground."""
    was_loaded = True
    while True:
        session.advance()
        is_loaded = get_load(session.data, "right") > STRIKE_LOAD
        if is_loaded and not was_loaded:
            return
        was_loaded = is_loaded


def simulate_stride(session: PlaySession) -> tuple[StrideSamples, list[NDArray[np.uint8]]]:
    """Return samples and pictures of one stride, from strike to strike of the prosthetic foot."""
    for _ in range(WARM_UP_STEPS):
        session.advance()
    wait_for_strike(session)
    person, ankle = (SceneRenderer(session.model, PICTURE_HEIGHT, width) for width in (PERSON_WIDTH, ANKLE_WIDTH))
    samples, pictures, is_swinging = StrideSamples(), [], False
    while not is_swinging or get_load(session.data, "right") < STRIKE_LOAD:
        is_swinging |= get_load(session.data, "right") < STRIKE_LOAD and len(samples.pressure_bar) > 10
        if len(samples.pressure_bar) % STEPS_PER_FRAME == 0:
            views = person.draw(session.data, "side"), ankle.draw(session.data, PROSTHESIS_PREFIX + "close")
            pictures.append(np.concatenate(views, axis=1))
        sample(session, samples)
        session.advance()
    for renderer in (person, ankle):
        renderer.close()
    return samples, pictures


class Curve(NamedTuple):
    """A curve that grows: its line, the dot at its end, and all of its values."""

    line: Line2D
    dot: Line2D
    series: Array


def add_curve(axis: Axes, phase: Array, series: Array, colour: str, label: str) -> Curve:
    """Add a curve over ``phase`` to ``axis``: pale as a whole, and as strong as it has grown."""
    axis.plot(100.0 * phase, series, color=colour, linewidth=0.8, alpha=0.35)
    (line,) = axis.plot([], [], color=colour, linewidth=1.8, label=label)
    (dot,) = axis.plot([], [], "o", color=colour, markersize=4.5)
    return Curve(line, dot, series)


def draw_curves(samples: StrideSamples) -> Iterator[NDArray[np.uint8]]:
    """Yield the curves up to each frame."""
    reference, count = load_default_reference(), len(samples.pressure_bar)
    phase = np.arange(count) / count
    figure = Figure(figsize=(CURVES_WIDTH / DPI, PICTURE_HEIGHT / DPI), dpi=DPI, layout="constrained")
    angle, load, pressure = figure.subplots(3, 1, sharex=True)
    human = reference("ankle_dorsiflexion_deg", phase)
    deviation = reference.compute_standard_deviation("ankle_dorsiflexion_sd_deg", phase)
    band = {"color": "0.87", "linewidth": 0.0}
    angle.fill_between(100.0 * phase, human - deviation, human + deviation, **band, label="able-bodied, ±1 sd")
    human_load = reference("grf_vertical_n_per_kg", phase) / GRAVITY
    load.plot(100.0 * phase, human_load, color="0.75", linewidth=3.0, label="able-bodied")
    is_loaded = np.array(samples.load_bw["left"]) > 0.0
    shift = int(np.flatnonzero(is_loaded & ~np.roll(is_loaded, 1))[0])  # the other leg over its own stride
    curves = []
    for axis, values in ((angle, samples.ankle_deg), (load, samples.load_bw)):
        curves.append(add_curve(axis, phase, np.roll(values["left"], -shift), SOUND_COLOUR, "sound leg"))
        curves.append(add_curve(axis, phase, np.array(values["right"]), PROSTHESIS_COLOUR, "prosthesis"))
    curves.append(add_curve(pressure, phase, np.array(samples.pressure_bar), PRESSURE_COLOUR, ""))
    titles = ("ankle angle [deg], dorsiflexion up", "vertical ground reaction [body weights]", "muscle pressure [bar]")
    for axis, title in zip((angle, load, pressure), titles, strict=True):
        axis.set_title(title, loc="left")
        axis.set_xlim(0.0, 100.0)
    angle.set_ylim(top=angle.get_ylim()[1] + 14.0)
    angle.legend(ncols=3, loc="upper center", handlelength=1.2, columnspacing=1.0)
    pressure.set_xlabel("gait cycle [%]")
    for end in range(1, count + 1, STEPS_PER_FRAME):
        for curve in curves:
            curve.line.set_data(100.0 * phase[:end], curve.series[:end])
            curve.dot.set_data([100.0 * phase[end - 1]], [curve.series[end - 1]])
        yield draw_figure(figure)


def draw_walk(path: Path) -> None:
    """Write the animation of a stride of the predicted walk beside its curves."""
    device = load_device(DEFAULT_DEVICE)
    controls = Controls(scene="walk", max_pressure_bar=device.parameters.supply.max_pressure / BAR)
    samples, pictures = simulate_stride(PlaySession(device, controls))
    with rc_context({**STYLE, "font.size": 8, "axes.titlesize": 8.5, "legend.fontsize": 7}):
        images = [
            np.concatenate([picture, curves], axis=1)
            for picture, curves in zip(pictures, draw_curves(samples), strict=True)
        ]
    save_animation(path, images, 1.0 / (0.01 * STEPS_PER_FRAME * SLOW_DOWN))


@dataclass(frozen=True)
class LoopData:
    """Force over length of a test trial: measured, simulated without and with the effect that was found."""

    time_s: Array
    length_mm: Array
    measured_n: Array
    before_n: Array
    after_n: Array
    effect: str


def diagnose_example() -> LoopData:
    """Return what the example diagnosis shows of its first test trial."""
    with tempfile.TemporaryDirectory() as folder:
        diagnosis = diagnose(load_example_dataset(Path(folder) / "data"), only=EFFECT_OPTIONS).diagnosis
    simulated = simulate_shown_trials(diagnosis)[0]
    experiment, prescribed = simulated.experiment, simulated.experiment.prescribed_input
    grid = experiment.start_time + experiment.dt * np.arange(1, len(prescribed.values) + 1)
    length = np.interp(experiment.measured["force"].time, grid, prescribed.values) * 1e3
    return LoopData(
        simulated.get_sample_times("force"),
        length,
        experiment.measured["force"].value,
        simulated.before["force"],
        simulated.after["force"],
        join_words([format_term(term) for term in diagnosis.added_terms]),
    )


def draw_loop_frames(loop: LoopData) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames: the model fails, the effect is named, the model fits."""
    figure = Figure(figsize=(DIAGNOSIS_SIZE[0] / DPI, DIAGNOSIS_SIZE[1] / DPI), dpi=DPI, layout="constrained")
    axis, residual = figure.subplots(1, 2, width_ratios=[3, 2])
    headline = figure.suptitle("", fontsize=13, fontweight="bold", x=0.01, ha="left")
    axis.plot(loop.length_mm, loop.measured_n, ".", color="0.6", markersize=3.0, label="measured, in no fit")
    (model,) = axis.plot([], [], color=HUMAN_COLOUR, linewidth=2.0, label="simulated")
    axis.set(xlabel="length [mm]", ylabel="force [N]", title="work loop of the muscle on a tester")
    legend = axis.legend(loc="upper left")
    (gap,) = residual.plot([], [], color=HUMAN_COLOUR, linewidth=1.5)
    residual.axhline(0.0, color="0.8", linewidth=1.0)
    limit = 1.15 * float(np.abs(loop.measured_n - loop.before_n).max())
    count = len(loop.length_mm)
    residual.set(xlim=loop.time_s[[0, -1]], ylim=(-limit, limit), xlabel="time [s]", title="measured - simulated [N]")
    rms_before, rms_after = (float(np.std(loop.measured_n - force)) for force in (loop.before_n, loop.after_n))
    for force, colour, sentence in (
        (loop.before_n, "#c0392b", f"{rms_before:.0f} N rms are missing in the simulation. What does the model lack?"),
        (loop.after_n, PROSTHESIS_COLOUR, f"Identified: {loop.effect}. {rms_after:.1f} N rms are left: noise."),
    ):
        headline.set_text(sentence)
        for artist in (model, gap, legend.get_lines()[1]):
            artist.set_color(colour)
        for frame in range(1, N_LOOP_FRAMES + N_HOLD_FRAMES + 1):
            end = min(frame, N_LOOP_FRAMES) * count // N_LOOP_FRAMES
            model.set_data(loop.length_mm[:end], force[:end])
            gap.set_data(loop.time_s[:end], (loop.measured_n - force)[:end])
            yield draw_figure(figure)


def draw_diagnosis(path: Path) -> None:
    """Write the animation of the example diagnosis."""
    loop = diagnose_example()
    with rc_context(STYLE):
        save_animation(path, list(draw_loop_frames(loop)), DIAGNOSIS_RATE)


def draw_environments(path: Path) -> None:
    """Write a picture of all environments side by side, with pressure in their muscles."""
    look = {"render_mode": "rgb_array", "width": ENVIRONMENT_SIZE, "height": ENVIRONMENT_SIZE}
    scenes: tuple[tuple[Any, dict[str, Any], int, list[float]], ...] = (
        (AnkleGaitEnv, {"camera": "corner", "action": "residual", "strides": 1}, 55, [0.0]),
        (AnkleWalkEnv, {"camera": "corner", "action": "residual", "duration": 3.0}, 190, [0.0]),
        (AnkleBenchEnv, {"task": "work"}, 40, [0.5]),
        (AntagonistJointEnv, {}, 60, [0.9, -0.4]),
    )
    pictures = []
    for create, options, steps, action in scenes:
        env = create(**options, **look)
        env.reset(seed=0)
        for _ in range(steps):
            env.step(np.array(action, dtype=np.float32))
        pictures.append(env.render())
        env.close()
    xmp = compute_digest().encode()
    Image.fromarray(np.concatenate(pictures, axis=1)).save(path, None, quality=QUALITY, method=6, xmp=xmp)


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where the animations go")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    draw_environments(folder / ENVIRONMENTS)
    draw_walk(folder / WALK)
    draw_diagnosis(folder / DIAGNOSIS)
    return 0


if __name__ == "__main__":
    sys.exit(main())
