"""Viewer recording of a gait run: rig in 3-D, all channels, work loop of the ankle, energy and air.

All of it stands on two timelines: the last stride over percent of the gait cycle, on which the window opens, and the
whole run over seconds.
"""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from klute_sim.device.device import DEFAULT_DEVICE, load_device, parse_device
from klute_sim.device.energy.ledger import format_effect_channel
from klute_sim.device.schema.foot import RIGID_FOOT
from klute_sim.effects import catalogue
from klute_sim.files.limits import DEVICE
from klute_sim.files.reading import read_bytes
from klute_sim.gait.metrics import is_spring_foot
from klute_sim.gait.rig.build import build_gait_model
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.types import Array
from klute_sim.viewer import chart, gait_cycle, scene, stream
from klute_sim.viewer.stream import (
    BLUE,
    BROWN,
    COMMAND_COLOUR,
    DARK_ORANGE,
    GREEN,
    GREY,
    ORANGE,
    PALE_GREEN,
    PALE_ORANGE,
    RED,
    VIOLET,
    BandLine,
    Colour,
    SeriesLine,
)

TIMELINE = "time"
"""Timeline of the whole run [s]; that of the stride is :data:`klute_sim.viewer.gait_cycle.TIMELINE`."""

PlotSeries = tuple[str, str, Colour]
"""Entity, name in the legend, and colour of a line."""
THIN_LINE_COLOURS = (ORANGE, DARK_ORANGE, PALE_ORANGE, PALE_GREEN, COMMAND_COLOUR)
"""Colours of thin lines, with which others are compared.

The viewer draws in the order of the entities' names, which puts these lines on top.
"""


def get_line_width(colour: Colour) -> float:
    """Return the width of a line of that ``colour`` [points]."""
    return stream.THIN_LINE_WIDTH if colour in THIN_LINE_COLOURS else stream.LINE_WIDTH


def _build_human_comparison(channel: str) -> tuple[PlotSeries, ...]:
    return ((f"channels/reference_{channel}", "human", ORANGE), (f"channels/{channel}", "prosthesis", BLUE))


PlotSpec = tuple[str, tuple[PlotSeries, ...]]
"""Title and lines of a plot."""
POWERS_TITLE = "device powers [W], output positive"
LEDGER_STYLES = {
    "gas": ("gas", GREEN),
    "friction": ("friction offset", VIOLET),
    "damper": ("damper", BROWN),
    "stop": ("length stops", PALE_ORANGE),
    "bladder": ("elastic bladders", PALE_GREEN),
    "tendon": ("elastic tendon", ORANGE),
    "delivered": ("delivered", RED),
    "residual": ("not accounted for", DARK_ORANGE),
}
"""Element of the energy ledger -> its name and colour, as power and as energy."""

MOTION_PLOTS: tuple[PlotSpec, ...] = (
    ("ankle angle [deg], dorsiflexion up", _build_human_comparison("ankle_angle")),
    ("net ankle moment [N·m], plantarflexor up", _build_human_comparison("ankle_moment")),
    ("net ankle power [W], generation up", _build_human_comparison("ankle_power")),
    (
        "gauge pressure [bar]",
        (
            ("channels/pressure_command", "commanded", COMMAND_COLOUR),
            ("channels/pressure", "delivered", GREEN),
        ),
    ),
    (
        "device forces [N]",
        (
            ("channels/muscle_force", "muscle", VIOLET),
            ("channels/damper_force", "damper", BROWN),
            ("channels/force", "tendon", RED),
        ),
    ),
    (
        "ground reaction [N], vertical: tracked, not predicted",
        (
            ("channels/reference_grf_vertical", "human, vertical", ORANGE),
            ("channels/reference_grf_forward", "human, forward", PALE_ORANGE),
            ("channels/grf_vertical", "vertical", BLUE),
            ("channels/grf_forward", "forward", RED),
        ),
    ),
)
"""Plots of the tab "motion and forces"."""
ENERGY_PLOTS: tuple[PlotSpec, ...] = (
    (POWERS_TITLE, tuple((f"channels/{name}_power", *look) for name, look in LEDGER_STYLES.items())),
    (
        "device energies [J], output since 0 % or 0 s",
        tuple((f"energy/{name}", *look) for name, look in LEDGER_STYLES.items()),
    ),
    (
        "air [kg] (gas model assumed), drawn and leaked since 0 % or 0 s",
        (
            ("channels/air_mass", "in the muscles", GREEN),
            ("channels/air_drawn", "drawn", BLUE),
            ("channels/air_leaked", "leaked", RED),
        ),
    ),
    (
        "lengths [m]",
        (
            ("channels/unit_length", "muscle-tendon unit", RED),
            ("channels/muscle_length", "muscle", VIOLET),
        ),
    ),
)
"""Plots of the tab "energy and air"."""
TOTALS = ("channels/air_drawn", "channels/air_leaked", *(f"energy/{name}" for name in LEDGER_STYLES))
"""Entities that sum up from the start of the run, and over the gait cycle from 0 %."""
LOOP_ENTITY = "loop/moment_over_angle"
BAND_PREFIX = "band/"
"""Beginning of the entity of a band; it replaces the line of the reference in a plot."""


def write_recording(recording: Recording, model: mujoco.MjModel, path: Path) -> None:
    """Write a gait ``recording`` on the rig ``model`` to ``path`` (.rrd).

    Raises MissingExtraError without rerun.
    """
    rr = stream.import_rerun()
    series = {f"channels/{name}": values for name, values in recording.channels.items() if name != "time"}
    series |= compute_cumulative_energies(recording)
    plotted = [line for _, lines in (*MOTION_PLOTS, *build_energy_plots(recording)) for line in lines]
    samples, loop_chart = gait_cycle.find_samples(recording), build_loop_chart(recording)
    with stream.open_recording(path, "gait", recording.provenance, lambda: build_blueprint(recording)) as out:
        scene.log_scene(out, recording, model, TIMELINE)
        scene.log_motion(out, recording, model, samples, gait_cycle.build_axis())
        chart.log_chart(out, loop_chart)
        for entity, name, colour in plotted:
            if entity in series:
                width = get_line_width(colour)
                stream.log_line_style(out, SeriesLine(entity, name, colour, width, series[entity]))
        run_axis = rr.TimeColumn(TIMELINE, duration=recording["time"])
        for axis, rows in ((run_axis, slice(None)), (gait_cycle.build_axis(), samples)):
            for entity, values in series.items():
                origin = values[samples[0]] if entity in TOTALS and rows is samples else 0.0
                columns = rr.Scalars.columns(scalars=values[rows] - origin)
                out.send_columns(entity, indexes=[axis], columns=columns)
            for band in build_bands(recording):
                stream.send_band(out, axis, band._replace(mean=band.mean[rows], deviation=band.deviation[rows]))
            chart.log_marker(out, loop_chart, axis, recording["ankle_angle"][rows], recording["ankle_moment"][rows])


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files in the ``folder`` of a gait run.

    Raises MissingExtraError without rerun, and InputError for damaged files.
    """
    recording = parquet.load_recording(folder / "recording.parquet")
    write_recording(recording, build_model(recording, folder), path)


def build_model(recording: Recording, folder: Path) -> mujoco.MjModel:
    """Return the rig of ``recording``, whose device is in ``folder``."""
    options = recording.provenance["options"]
    file = folder / "device.toml"  # written by the program; a swept or tuned number may be implausible
    device = (
        load_device(DEFAULT_DEVICE).with_foot(recording.provenance.get("foot", {}).get("name", RIGID_FOOT))
        if is_spring_foot(recording)
        else parse_device(read_bytes(file, DEVICE), str(file))
    )
    return build_gait_model(
        device,
        mass=options["mass_kg"],
        stature=options["stature_m"],
        dt=options["step_s"],
        alignment=math.radians(options["alignment_deg"]),
    )


def build_bands(recording: Recording) -> list[BandLine]:
    """Return the reference with a band of one standard deviation, for channels that have one."""
    return [
        BandLine(f"{BAND_PREFIX}{name}", "human ±1 sd", ORANGE, recording[f"reference_{name}"], sd)
        for name in ("ankle_angle", "ankle_moment", "ankle_power")
        if f"reference_{name}" in recording and f"reference_{name}_sd" in recording
        for sd in [recording[f"reference_{name}_sd"]]
    ]


def compute_cumulative_energies(recording: Recording) -> dict[str, Array]:
    """Return entity -> energy [J] that an element of the ledger has put out since the start.

    Each power is constant over the time step that ends at its sample, so energies are plain sums.
    """
    steps = np.diff(recording["time"], prepend=recording["time"][0])
    names = (f"{name}_power" for name in LEDGER_STYLES)
    return {f"energy/{n.removesuffix('_power')}": np.cumsum(recording[n] * steps) for n in names if n in recording}


def build_energy_plots(recording: Recording) -> list[PlotSpec]:
    """Return :data:`ENERGY_PLOTS` with a line among the powers for each effect of the device."""
    effects = [name for name in catalogue.get_effects() if format_effect_channel(name) in recording]
    colours = itertools.cycle((BLUE, PALE_ORANGE, DARK_ORANGE, PALE_GREEN))
    lines = tuple((f"channels/{format_effect_channel(name)}", name, next(colours)) for name in effects)
    return [(title, (*series, *lines) if title == POWERS_TITLE else series) for title, series in ENERGY_PLOTS]


def build_loop_chart(recording: Recording) -> chart.Chart:
    """Build the chart of net ankle moment over angle; counter-clockwise loops do positive net work.

    It shows the last stride, and earlier ones thinly.
    """
    last = gait_cycle.select_last_stride(recording)
    curves = []
    if len(last) < len(recording):
        earlier = recording.select(slice(0, len(recording) - len(last)))
        loop = earlier["ankle_angle"], earlier["ankle_moment"]
        curves.append(chart.ChartCurve("earlier strides", GREY, *loop, thin=True))
    if "reference_ankle_angle" in recording and "reference_ankle_moment" in recording:
        human = last["reference_ankle_angle"], last["reference_ankle_moment"]
        curves.append(chart.ChartCurve("human", ORANGE, *human, thin=True))
    curves.append(chart.ChartCurve("prosthesis", BLUE, last["ankle_angle"], last["ankle_moment"]))
    return chart.Chart(LOOP_ENTITY, "dorsiflexion [deg]", "net plantarflexor moment [N·m]", tuple(curves))


def build_blueprint(recording: Recording) -> Any:
    """Build the layout: side view of the leg and work loop on the left, plots in two tabs on the right.

    It opens on the last stride over the gait cycle, which it repeats in real time.
    """
    import rerun.blueprint as rrb

    left = rrb.Vertical(
        scene.build_view("leg (tendon: red at peak force; muscle: green at peak pressure)"),
        chart.build_view(build_loop_chart(recording), "work loop of the ankle (counter-clockwise: positive net work)"),
        row_shares=[3, 2],
    )
    right = rrb.Tabs(
        _build_grid(recording, MOTION_PLOTS, "motion and forces"),
        _build_grid(recording, build_energy_plots(recording), "energy and air"),
    )
    root, frame_rate = rrb.Horizontal(left, right, column_shares=[1, 2]), gait_cycle.compute_frame_rate(recording)
    return stream.build_window_blueprint(root, gait_cycle.TIMELINE, frame_rate=frame_rate)


def _build_grid(recording: Recording, plots: Sequence[PlotSpec], name: str) -> Any:
    """Build the views of ``plots`` with their legends beside the lines of the last stride.

    The views have no range: one in percent would be wrong on the timeline in seconds, and without one the viewer shows
    both timelines whole.
    """
    import rerun.blueprint as rrb

    bands = {band.entity for band in build_bands(recording)}
    last = gait_cycle.select_last_stride(recording)
    phase, lines_of_run, lines_of_stride = last["gait_phase"] / 100.0, _list_lines(recording), _list_lines(last)
    views = []
    for title, lines in plots:
        entities = [
            band if (band := entity.replace("channels/reference_", BAND_PREFIX)) in bands else entity
            for entity, _, _ in lines
        ]
        corner = stream.choose_legend_corner(phase, [y for e in entities for y in lines_of_stride.get(e, [])])
        # The viewer leaves no room for bands by itself.
        has_band = not bands.isdisjoint(entities)
        value_range = stream.pad_range(y for e in entities for y in lines_of_run.get(e, [])) if has_band else None
        views.append(stream.build_plot_view(title, entities, None, corner, value_range))
    return rrb.Grid(*views, grid_columns=2, name=name)


def _list_lines(recording: Recording) -> dict[str, list[Array]]:
    """Return entity -> its values, or those of both edges of its band."""
    lines = {f"channels/{name}": [values] for name, values in recording.channels.items()}
    lines |= {entity: [values] for entity, values in compute_cumulative_energies(recording).items()}
    return lines | {
        band.entity: [band.mean - band.deviation, band.mean + band.deviation] for band in build_bands(recording)
    }
