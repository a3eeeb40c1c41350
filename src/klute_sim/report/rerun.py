"""Gait recordings for the rerun viewer: every channel as a series, the rig in 3-D, and a layout made for them.

rerun is an optional extra and is imported when it is used.
"""

import hashlib
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from klute_sim.device.ledger import of_effect
from klute_sim.effects import catalogue
from klute_sim.errors import MissingExtraError
from klute_sim.recording.recording import Recording
from klute_sim.report.scene import log_scene

TIMELINE = "time"

Series = tuple[str, str, tuple[int, int, int]]
"""Entity under ``channels/`` or ``band/``, name in the legend, colour."""

BLUE, ORANGE = (31, 119, 180), (255, 150, 40)
DARK_ORANGE, PALE_ORANGE = (150, 90, 30), (255, 215, 170)
GREEN, PALE_GREEN, RED, VIOLET, BROWN = (44, 160, 44), (190, 240, 190), (214, 39, 40), (148, 103, 189), (140, 86, 75)
THIN = (ORANGE, DARK_ORANGE, PALE_ORANGE, PALE_GREEN)
"""What a series is compared with. The viewer draws in the order of the entities' names, which puts it on top."""


def _against_human(channel: str) -> tuple[Series, ...]:
    return (
        (f"band/{channel}_low", "human - 1 sd", DARK_ORANGE),
        (f"band/{channel}_high", "human + 1 sd", DARK_ORANGE),
        (f"channels/reference_{channel}", "human", ORANGE),
        (f"channels/{channel}", "prosthesis", BLUE),
    )


Plot = tuple[str, tuple[Series, ...]]
"""Title, and what is in it."""
POWERS = "device powers [W], given up"

PLOTS: tuple[Plot, ...] = (
    ("ankle angle [deg], dorsiflexion up", _against_human("ankle_angle")),
    ("net ankle moment [N·m], plantarflexor up", _against_human("ankle_moment")),
    ("net ankle power [W], generation up", _against_human("ankle_power")),
    (
        "gauge pressure [bar]",
        (
            ("channels/pressure_command", "commanded", PALE_GREEN),
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
    (
        POWERS,
        (
            ("channels/gas_power", "gas", GREEN),
            ("channels/friction_power", "friction offset", VIOLET),
            ("channels/damper_power", "damper", BROWN),
            ("channels/stop_power", "length stops", PALE_ORANGE),
            ("channels/bladder_power", "bladders' store", PALE_GREEN),
            ("channels/tendon_power", "tendon's store", ORANGE),
            ("channels/solver_power", "time step", DARK_ORANGE),
            ("channels/delivered_power", "delivered", RED),
        ),
    ),
    (
        "air [kg] (its gas assumed)",
        (
            ("channels/air_mass", "in the muscles", GREEN),
            ("channels/air_drawn", "drawn since the start", BLUE),
            ("channels/air_leaked", "leaked since the start", RED),
        ),
    ),
)
"""Title and series of each plot."""


def write(recording: Recording, model: mujoco.MjModel, path: Path) -> None:
    """Write a gait ``recording`` on the rig ``model`` to ``path`` (.rrd); raises MissingExtraError without rerun."""
    try:
        import rerun as rr
    except ImportError:
        raise MissingExtraError("a rerun recording", "rerun") from None

    identity = hashlib.sha256(json.dumps(recording.provenance, sort_keys=True).encode()).hexdigest()
    stream = rr.RecordingStream("klute-sim", recording_id=identity, send_properties=False)
    shown = plots(recording)
    stream.save(path, default_blueprint=blueprint(shown))
    log_scene(stream, recording, model, TIMELINE)
    times = [rr.TimeColumn(TIMELINE, duration=recording["time"])]
    series = {f"channels/{name}": values for name, values in recording.channels.items() if name != "time"}
    for name in ("ankle_angle", "ankle_moment", "ankle_power"):
        if f"reference_{name}" in recording and f"reference_{name}_sd" in recording:
            middle, deviation = recording[f"reference_{name}"], recording[f"reference_{name}_sd"]
            series[f"band/{name}_low"], series[f"band/{name}_high"] = middle - deviation, middle + deviation
    for entity, values in series.items():
        stream.send_columns(entity, indexes=times, columns=rr.Scalars.columns(scalars=values))
    for _, plotted in shown:
        for entity, name, colour in plotted:
            if entity in series:
                thickness = 1.0 if colour in THIN else 3.0
                style = rr.SeriesLines(names=name, colors=np.array(colour), widths=thickness)
                stream.log(entity, style, static=True)
    stream.flush()
    stream.disconnect()


def plots(recording: Recording) -> list[Plot]:
    """:data:`PLOTS`, and among the powers a line for each effect that the device has."""
    effects = [name for name in catalogue.effects() if of_effect(name) in recording]
    colours = itertools.cycle((BLUE, PALE_ORANGE, DARK_ORANGE, PALE_GREEN))
    lines = tuple((f"channels/{of_effect(name)}", name, next(colours)) for name in effects)
    return [(title, (*series, *lines) if title == POWERS else series) for title, series in PLOTS]


def blueprint(shown: Sequence[Plot]) -> Any:
    """Layout: the leg seen from its side on the left, eight plots on the right, panels folded away."""
    import rerun.blueprint as rrb

    # The view's origin is the hip, so the camera walks along.
    eye = rrb.EyeControls3D(position=[0.35, -2.1, -0.25], look_target=[0.0, 0.0, -0.45], eye_up=[0.0, 0.0, 1.0])
    scene = rrb.Spatial3DView(
        origin="world/carriage",
        contents="world/**",
        name="leg (tendon: grey slack, red at peak force)",
        eye_controls=eye,
    )
    plots = [
        rrb.TimeSeriesView(origin="/", contents=[f"/{entity}" for entity, _, _ in plotted], name=title)
        for title, plotted in shown
    ]
    return rrb.Blueprint(
        rrb.Horizontal(scene, rrb.Grid(*plots, grid_columns=2), column_shares=[1, 2]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )
