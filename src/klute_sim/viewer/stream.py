"""Write recordings for the rerun viewer: lines over a timeline, text, and the layout of the window.

rerun is an optional extra, which is imported when a recording is written.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from klute_sim.errors import MissingExtraError
from klute_sim.recording.atomic_file import write_atomically
from klute_sim.types import Array

Colour = tuple[int, int, int]

GREY, WHITE = (150, 150, 150), (220, 220, 220)
BLUE, ORANGE = (58, 141, 214), (255, 150, 40)
DARK_ORANGE, PALE_ORANGE = (150, 90, 30), (255, 215, 170)
GREEN, PALE_GREEN, RED = (44, 160, 44), (190, 240, 190), (224, 59, 60)
VIOLET, BROWN, CYAN = (158, 113, 209), (170, 106, 90), (23, 190, 207)
COMMAND_COLOUR = (245, 245, 245)
"""Colour of the thin line of a command, visible on that of the delivered value."""
LINE_WIDTH, THIN_LINE_WIDTH = 4.0, 1.5
"""Widths of a line, and of a thin one on top of it with which it is compared [points]; both stay visible."""
PALETTE: tuple[Colour, ...] = (
    *(BLUE, ORANGE, GREEN, RED, VIOLET, BROWN, CYAN),
    *((227, 119, 194), (188, 189, 34), (127, 127, 127)),
)
"""Colours that are distinguishable on black, for lines without a colour of their own."""


LEGEND_BEGIN = 0.6
"""Position, as a fraction of the width of a plot, from which a legend covers it."""
LEGEND_ROOM = 0.6
"""Room above the lines that a legend of two rows needs, as a fraction of the range of the lines."""
LINE_MARGIN = 0.05
"""Room below the lines, as a fraction of their range."""


class SeriesLine(NamedTuple):
    """A line in a plot; the viewer draws lines in the order of their entities' names."""

    entity: str
    name: str
    """Name in the legend."""
    colour: Colour
    width: float
    """Width of the line, or size of the markers [points]."""
    values: Array
    """Values in the unit of the plot; NaN where undefined."""
    markers_only: bool = False
    """Whether the values are shown as markers that are not joined."""


class Span(NamedTuple):
    """A part of a timeline of durations."""

    begin: float
    """First time [s]."""
    end: float
    """Last time [s]."""


class BandLine(NamedTuple):
    """A line with a band of one standard deviation on each side."""

    entity: str
    name: str
    """Name in the legend."""
    colour: Colour
    mean: Array
    """Values in the unit of the plot."""
    deviation: Array
    """Standard deviations in the same unit."""


def import_rerun() -> Any:
    """Import the package rerun.

    Raises MissingExtraError without it.
    """
    try:
        import rerun
    except ImportError:
        raise MissingExtraError("a rerun recording", "rerun") from None
    return rerun


@contextmanager
def open_recording(path: Path, kind: str, identity: Any, make_blueprint: Callable[[], Any]) -> Iterator[Any]:
    """Open a recording stream, which is written to ``path`` (.rrd) when it is complete.

    The viewer stores a user's changes of the layout by ``kind``. Equal ``identity`` (JSON types) means the same
    recording. Raises MissingExtraError without rerun.
    """
    rr = import_rerun()
    digest = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
    stream = rr.RecordingStream(f"klute-sim {kind}", recording_id=digest, send_properties=False)
    memory = stream.memory_recording()  # a thread of rerun that writes a file reports no error of its last part
    try:
        stream.send_blueprint(make_blueprint(), make_active=False, make_default=True)
        yield stream
        stream.flush()
        write_atomically(path, memory.drain_as_bytes())
    finally:
        stream.disconnect()


def send_lines(stream: Any, axis: Any, lines: Iterable[SeriesLine]) -> None:
    """Send the values of ``lines`` over ``axis`` (a rerun TimeColumn), and their styles."""
    rr = import_rerun()
    for line in lines:
        stream.send_columns(line.entity, indexes=[axis], columns=rr.Scalars.columns(scalars=line.values))
        log_line_style(stream, line)


def send_band(stream: Any, axis: Any, band: BandLine) -> None:
    """Send the line and the band of ``band`` over ``axis`` (a rerun TimeColumn), and their style."""
    rr = import_rerun()
    columns = rr.Measurements.columns(values=band.mean, variances=np.square(band.deviation))
    stream.send_columns(band.entity, indexes=[axis], columns=columns)
    style = rr.Measurements.from_fields(names=band.name, colors=np.array(band.colour), widths=1.0)
    stream.log(band.entity, style, static=True)


def log_line_style(stream: Any, line: SeriesLine) -> None:
    """Log name, colour and width of ``line``."""
    rr, colour = import_rerun(), np.array(line.colour)
    style: Any = rr.SeriesLines(names=line.name, colors=colour, widths=line.width)
    if line.markers_only:
        style = rr.SeriesPoints(names=line.name, colors=colour, markers="circle", marker_sizes=line.width)
    stream.log(line.entity, style, static=True)


def log_text(stream: Any, entity: str, text: str) -> None:
    """Log a Markdown document."""
    rr = import_rerun()
    stream.log(entity, rr.TextDocument(text, media_type="text/markdown"), static=True)


def format_markdown_table(headings: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a Markdown table; numbers have four digits, and None is a dash."""
    lines = [headings, ["---"] * len(headings), *([_format_cell(cell) for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _format_cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return "-"
    return f"{value + 0.0:.4g}" if isinstance(value, float) else str(value).replace("|", "/").replace("\n", " ")


def build_plot_view(
    name: str,
    entities: Sequence[str],
    view_range: tuple[int, int] | Span | None = None,
    legend_corner: str | None = "RightTop",
    value_range: tuple[float, float] | None = None,
) -> Any:
    """Build a view of the lines of ``entities`` over the timeline.

    ``view_range`` is what the view shows first. It is needed for integer timelines, of which the viewer otherwise shows
    1000 steps around the cursor. ``legend_corner`` is the corner of the legend (:func:`choose_legend_corner`); None:
    the plot has no legend. ``value_range`` is the range of the vertical axis, by default that of the lines.
    """
    import rerun.blueprint as rrb

    rr, axis = import_rerun(), None
    if view_range is not None:
        unit = "seconds" if isinstance(view_range, Span) else "seq"
        first, last = (rr.TimeRangeBoundary.absolute(**{unit: end}) for end in view_range)
        axis = rrb.TimeAxis(view_range=rr.TimeRange(first, last))
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"/{entity}" for entity in entities],
        name=name,
        axis_x=axis,
        axis_y=None if value_range is None else rrb.ScalarAxis(range=value_range),
        plot_legend=rrb.PlotLegend(legend_corner, visible=legend_corner is not None),
    )


def pad_range(lines: Iterable[Array], room_above: float = LINE_MARGIN) -> tuple[float, float]:
    """Return a range of values that holds the ``lines``, with ``room_above`` them as a fraction of their range.

    For a legend above the lines that is :data:`LEGEND_ROOM`. The range of constant lines is 1.
    """
    values = np.concatenate(list(lines))
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    extent = high - low or 1.0
    return low - LINE_MARGIN * extent, high + room_above * extent


def choose_legend_corner(phase: Array, lines: Iterable[Array]) -> str:
    """Return the corner of a plot in which the ``lines`` over ``phase`` (0 to 1) leave most room for a legend."""
    known = [line for line in lines if np.isfinite(line).any()]
    if not known:
        return "RightTop"
    values = np.concatenate(known)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    position, height = np.tile(phase, len(known)), (values - low) / max(high - low, 1e-12)
    rooms = {
        f"{side}{end}": np.nanmin(np.where(is_beside, distance, np.inf), initial=np.inf)
        for side, is_beside in (("Right", position > LEGEND_BEGIN), ("Left", position < 1.0 - LEGEND_BEGIN))
        for end, distance in (("Top", 1.0 - height), ("Bottom", height))
    }
    return max(rooms, key=lambda corner: rooms[corner])


def build_text_view(name: str, entity: str) -> Any:
    """Build a view of the document that :func:`log_text` logged."""
    import rerun.blueprint as rrb

    return rrb.TextDocumentView(origin=f"/{entity}", name=name)


def build_window_blueprint(root: Any, timeline: str, loop: Span | None = None, frame_rate: float | None = None) -> Any:
    """Build the layout of a window: ``root`` over ``timeline``, with collapsed panels.

    The window repeats ``loop``, a part of a timeline of durations, or with ``frame_rate`` (positions per second) the
    whole of an integer timeline. Without either it shows the start and waits.
    """
    import rerun.blueprint as rrb

    playing: dict[str, Any] = {}
    if frame_rate is not None:
        playing = {"loop_mode": "all", "fps": frame_rate}
    elif loop is not None:
        from rerun.encodings import AbsoluteTimeRange

        selection = AbsoluteTimeRange(*(round(1e9 * end) for end in loop))
        playing = {"loop_mode": "selection", "time_selection": selection}
    return rrb.Blueprint(
        root,
        rrb.TimePanel(state="collapsed", timeline=timeline, **playing),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )
