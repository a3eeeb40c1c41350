"""Viewer recording of a predicted walk: the person in 3-D, both legs, cost and device."""

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.device.device import DEFAULT_DEVICE, load_device, parse_device
from klute_sim.files.limits import DEVICE
from klute_sim.files.reading import read_bytes
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.types import Array
from klute_sim.viewer import scene, stream
from klute_sim.viewer.stream import BLUE, COMMAND_COLOUR, GREEN, ORANGE, RED, VIOLET, Colour, SeriesLine, Span
from klute_sim.walker.person.body import SIDES, load_body
from klute_sim.walker.person.build import Ground, Prosthesis, build_walker_model

TIMELINE = "time"
CHANNEL_RATE_HZ = 200.0
"""Number of samples per second of the lines; the poses have those of the scene."""
SHOWN_SECONDS = 2.5
"""Duration at the end of the walk that the window shows first and repeats [s]: about two strides."""
LEG_COLOURS: dict[str, Colour] = {"left": ORANGE, "right": BLUE}
FLESH_JOINTS = ("hip_left", "knee_left", "ankle_left", "hip_right", "knee_right")
"""Joints whose angle is a channel of the same sign."""
LEG_PLOTS = (
    ("hip angle [deg], flexion up", "hip_angle"),
    ("knee angle [deg], flexion up", "knee_angle"),
    ("ankle angle [deg], dorsiflexion up", "ankle_angle"),
    ("vertical ground reaction [N], predicted", "grf_vertical"),
    ("fore-aft ground reaction [N], predicted", "grf_forward"),
)
"""Title and channel of the plots of both legs."""
ENERGY_TITLE = "metabolic energy since the start [J]"


def write_recording(recording: Recording, model: mujoco.MjModel, path: Path) -> None:
    """Write a walk ``recording`` of the person ``model`` to ``path`` (.rrd).

    Raises MissingExtraError without rerun.
    """
    rr = stream.import_rerun()
    identity = recording.provenance
    with stream.open_recording(path, "walk", identity, lambda: build_blueprint(recording)) as out:
        has_muscle, frames = scene.has_muscle(recording), scene.select_frames(recording)
        scene.log_geometry(out, model, scene.WORLD_ENTITY, omits_muscle_at_rest=has_muscle)
        times = rr.TimeColumn(TIMELINE, duration=recording["time"][frames])
        sites = scene.UNIT_SITES if has_muscle else ()
        positions = compute_postures(recording, model, frames)
        ends = scene.log_poses(out, model, positions, times, scene.WORLD_ENTITY, sites=sites)
        if has_muscle:
            scene.log_unit(out, recording, frames, times, ends, scene.WORLD_ENTITY)
        every = max(1, round(1.0 / (CHANNEL_RATE_HZ * float(recording["time"][1]))))
        axis = rr.TimeColumn(TIMELINE, duration=recording["time"][::every])
        lines = [line for plot in build_plots(recording).values() for line in plot]
        # The command lies on the line of the delivered pressure.
        widths = {"pressure_command": stream.THIN_LINE_WIDTH, "pressure": stream.LINE_WIDTH}
        stream.send_lines(
            out,
            axis,
            (
                SeriesLine(f"channels/{name}", text, colour, widths.get(name, 2.0), recording[name][::every])
                for name, text, colour in lines
            ),
        )


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files in the ``folder`` of a walk.

    Raises MissingExtraError without rerun, and InputError for damaged files.
    """
    recording = parquet.load_recording(folder / "recording.parquet")
    write_recording(recording, build_model(recording, folder), path)


def build_model(recording: Recording, folder: Path) -> mujoco.MjModel:
    """Return the model of the person in ``recording``, whose device is in ``folder``."""
    provenance, options = recording.provenance, recording.provenance["options"]
    described = provenance["prosthesis"]
    ground = Ground(unevenness=1e-3 * options["unevenness_mm"], seed=provenance["seed"])
    prosthesis = None
    if described is not None:
        alignment = math.radians(provenance["condition"]["alignment_deg"])
        stiffness = provenance["condition"].get("stiffness_nm_per_deg")
        file = folder / "device.toml"
        if stiffness is None:
            prosthesis = Prosthesis(device=parse_device(read_bytes(file, DEVICE), str(file)), alignment=alignment)
        else:
            device = load_device(DEFAULT_DEVICE).with_foot(described["foot"]["name"])
            foot = SpringFoot(stiffness=math.degrees(stiffness))
            prosthesis = Prosthesis(device=device, spring_foot=foot, alignment=alignment)
    return build_walker_model(load_body(), prosthesis, dt=options["step_s"], ground=ground)


def compute_postures(recording: Recording, model: mujoco.MjModel, frames: NDArray[np.int64]) -> Array:
    """Return the joint positions (n, nq) at the samples ``frames``."""
    slope = math.radians(recording.provenance["options"]["slope_deg"])
    joints = {
        "forward": recording["hip_x"],
        "up": recording["hip_z"],
        "lean": np.radians(recording["trunk_lean"]) + slope,
        **{name: np.radians(recording[name.replace("_", "_angle_")]) for name in FLESH_JOINTS},
    }
    if recording.provenance["prosthesis"] is None:
        joints["ankle_right"] = np.radians(recording["ankle_angle_right"])
    else:
        joints[PROSTHESIS_PREFIX + "ankle"] = -np.radians(recording["ankle_angle_right"])
        joints[PROSTHESIS_PREFIX + "heel"] = recording["heel_compression"]
    positions = np.zeros((len(frames), model.nq))
    for name, values in joints.items():
        positions[:, model.joint(name).qposadr[0]] = values[frames]
    return positions


def build_plots(recording: Recording) -> dict[str, list[tuple[str, str, Colour]]]:
    """Return title -> (channel, name in the legend, colour) of the lines."""
    has_prosthesis = recording.provenance["prosthesis"] is not None
    names = {"left": "left leg", "right": "prosthesis" if has_prosthesis else "right leg"}
    plots = {
        title: [(f"{channel}_{side}", names[side], LEG_COLOURS[side]) for side in SIDES] for title, channel in LEG_PLOTS
    }
    plots["forward speed [m/s]"] = [("speed", "speed", VIOLET)]
    plots[ENERGY_TITLE] = [
        ("metabolic_energy_minetti", "Minetti and Alexander", RED),
        ("metabolic_energy_bhargava", "Bhargava et al.", ORANGE),
    ]
    if "pressure_command" in recording:
        plots["gauge pressure [bar]"] = [
            ("pressure_command", "commanded", COMMAND_COLOUR),
            ("pressure", "delivered", GREEN),
        ]
        plots["device moment [N·m], plantarflexor up"] = [("device_moment", "device", RED)]
    return plots


def _build_plot_views(recording: Recording, span: Span) -> list[Any]:
    """Build the plots. A single line needs no legend; the plots of the legs share that of the first, above its lines.

    Curves of both legs over several strides leave no corner of a plot free. The vertical axes hold the curves in
    ``span``, because the first steps of a walk load a leg several times as much; only what sums up from the start
    has the range of the whole walk.
    """
    shown = recording.select(recording["time"] >= span.begin)
    views = []
    for title, lines in build_plots(recording).items():
        names = [name for name, _, _ in lines]
        has_legend = len(names) > 1 and title not in [shared for shared, _ in LEG_PLOTS[1:]]
        values = [(recording if title == ENERGY_TITLE else shown)[name] for name in names]
        room = stream.LEGEND_ROOM if has_legend else stream.LINE_MARGIN
        corner, value_range = "LeftTop" if has_legend else None, stream.pad_range(values, room)
        views.append(stream.build_plot_view(title, [f"channels/{name}" for name in names], span, corner, value_range))
    return views


def build_blueprint(recording: Recording) -> Any:
    """Build the layout: side view of the person on the left, plots on the right.

    It opens on the last seconds, which it repeats.
    """
    import rerun.blueprint as rrb

    end = float(recording["time"][-1])
    span = Span(max(0.0, end - SHOWN_SECONDS), end)

    kind = recording.provenance["kind"]
    left = scene.build_view(f"person, {kind}", origin="trunk", height=-0.15, distance=3.0)
    right = rrb.Grid(*_build_plot_views(recording, span), grid_columns=2, name="walk")
    return stream.build_window_blueprint(rrb.Horizontal(left, right, column_shares=[1, 2]), TIMELINE, loop=span)
