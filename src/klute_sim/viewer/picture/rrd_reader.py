"""Read a recording for the rerun viewer: its entities, and its layout as a tree of views."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from klute_sim.errors import InputError
from klute_sim.types import Array
from klute_sim.viewer.stream import import_rerun

CONTAINER_KINDS = {1: "tabs", 2: "row", 3: "column", 4: "grid"}
"""Number that rerun gives to a kind of container -> name of the kind."""
LegendPlace: TypeAlias = Literal["best", "upper left", "upper right", "lower left", "lower right"]
LEGEND_CORNERS: dict[int, LegendPlace] = {1: "upper left", 2: "upper right", 3: "lower left", 4: "lower right"}
"""Number that rerun gives to a corner -> place of a legend in matplotlib."""
NANOSECOND = 1e-9
"""Unit of rerun's durations [s]."""
INTERNAL_PREFIXES = ("rerun.controls", "log_tick", "log_time", "blueprint")


class Entity:
    """Components of one entity: static ones, and those over a timeline."""

    def __init__(self) -> None:
        """Create an entity without components."""
        self.static: dict[str, list[Any]] = {}
        self.rows: dict[str, list[Any]] = {}
        self.times: dict[str, list[Array]] = {}
        self.archetypes: set[str] = set()
        """Archetypes of the entity, such as ``Boxes3D``."""
        self.duration_timelines: set[str] = set()
        """Timelines of durations; others count."""

    def get_times(self, timeline: str) -> Array:
        """Return the times of the rows: [s] on a timeline of durations, otherwise the numbers of the timeline."""
        return np.concatenate(self.times[timeline])

    def get_value(self, component: str, timeline: str, position: float) -> Any:
        """Return the last value at or before ``position`` on ``timeline``, or the static value; None without both."""
        if component in self.rows and timeline in self.times:
            past = np.flatnonzero(self.get_times(timeline) <= position)
            row = int(past[np.argmax(self.get_times(timeline)[past])]) if len(past) else 0
            return self.rows[component][row]
        return self.static.get(component)


class View(NamedTuple):
    """A view of the layout."""

    kind: str
    """``TimeSeries``, ``2D``, ``3D``, ``TextDocument``."""
    name: str
    """Title of the view."""
    origin: str
    """Path of the entity to which ``$origin`` refers."""
    query: tuple[str, ...]
    """Paths of the entities in the view; ``/**`` includes all entities below."""
    legend: bool
    """Whether the view has a legend."""
    bounds: tuple[tuple[float, float], tuple[float, float]] | None
    """Ranges of x and y of a 2-D view."""
    span: tuple[float, float] | None = None
    """Part of the timeline that a plot shows, [s] on a timeline of durations; None: all of it."""
    value_range: tuple[float, float] | None = None
    """Range of the vertical axis of a plot; None: that of its lines."""
    legend_corner: LegendPlace = "best"
    """Place of the legend in matplotlib."""

    def select_entities(self, entities: dict[str, Entity]) -> dict[str, Entity]:
        """Return the entities in this view."""
        selected = {}
        for path, entity in entities.items():
            for expression in self.query:
                root = expression.replace("$origin", self.origin).strip("/")
                below = root.removesuffix("**").rstrip("/")
                if path == root or (root.endswith("**") and (f"{path}/".startswith(f"{below}/") or not below)):
                    selected[path] = entity
        return selected


class Container(NamedTuple):
    """Views in a row, in a column, in a grid, or as tabs."""

    kind: str
    """``row``, ``column``, ``grid`` or ``tabs``."""
    name: str
    """Title of the container."""
    children: tuple["View | Container", ...]
    """Views and containers inside, in their order."""
    relative_sizes: tuple[float, ...]
    """Relative width of the children of a row, or height of those of a column."""
    columns: int
    """Number of columns of a grid."""


class RrdContents(NamedTuple):
    """Content of a recording."""

    entities: dict[str, Entity]
    """Logged entities by path."""
    root: View | Container
    """Outermost container or view of the layout."""
    timeline: str
    """Name of the selected timeline."""


def read_rrd(path: Path) -> RrdContents:
    """Read the recording ``path`` (.rrd).

    Raises InputError for a recording without a layout, and MissingExtraError without rerun.
    """
    rr = import_rerun()
    try:
        reader = rr.chunk.RrdReader(path)
        layouts = list(reader.blueprints())
        layout = _collect_entities(reader.stream(store=layouts[-1])) if layouts else {}
        if not layout:
            raise InputError(f"{path} has no layout: it was not made by klute-sim")
        timeline = str(_get_single(layout["time_panel"], "timeline"))
        entities = _collect_entities(reader.stream(), timeline)
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {error}") from None
    is_duration = any(timeline in entity.duration_timelines for entity in entities.values())
    return RrdContents(entities, _build_root(layout, NANOSECOND if is_duration else 1.0), timeline)


def iter_views(node: View | Container) -> Iterator[View]:
    """Yield all views below ``node``, in the order of the layout."""
    if isinstance(node, View):
        yield node
    else:
        for child in node.children:
            yield from iter_views(child)


def _collect_entities(chunks: Any, timeline: str | None = None) -> dict[str, Entity]:
    """Return the entities in ``chunks``: what is static, and what is on ``timeline`` (None: on any)."""
    entities: dict[str, Entity] = {}
    for chunk in chunks:
        if not chunk.is_static and timeline not in (None, *chunk.timeline_names):
            continue
        entity = entities.setdefault(str(chunk.entity_path).lstrip("/"), Entity())
        batch = chunk.to_record_batch()
        components = [n for n in batch.schema.names if ":" in n]
        for name in components:
            archetype, short = name.split(":", 1)
            entity.archetypes.add(archetype)
            column = batch.column(name).to_pylist()
            if chunk.is_static:
                entity.static[short] = column[-1]
            else:
                entity.rows.setdefault(short, []).extend(column)
        if not chunk.is_static:
            for name in batch.schema.names:
                if name not in components and not name.startswith(INTERNAL_PREFIXES):
                    column = batch.column(name)
                    stamps = np.asarray(column.cast("int64").to_numpy(zero_copy_only=False))
                    is_duration = str(column.type).startswith("duration")
                    if is_duration:
                        entity.duration_timelines.add(name)
                    entity.times.setdefault(name, []).append((NANOSECOND if is_duration else 1.0) * stamps)
    return entities


def _get_single(entity: Entity, component: str, default: Any = None) -> Any:
    """Return the single value of a component of the layout."""
    values = entity.rows.get(component, [None])[-1]
    return default if not values else values[0]


def _build_root(layout: dict[str, Entity], time_unit: float) -> View | Container:
    raw = bytes(_get_single(layout["viewport"], "root_container")).hex()
    name = f"{raw[:8]}-{raw[8:12]}-{raw[12:16]}-{raw[16:20]}-{raw[20:]}"
    return _build_node(layout, f"container/{name}", time_unit)


def _build_node(layout: dict[str, Entity], path: str, time_unit: float) -> View | Container:
    entity = layout[path]
    name = str(_get_single(entity, "display_name", ""))
    if path.startswith("container"):
        children = tuple(_build_node(layout, str(child), time_unit) for child in entity.rows["contents"][-1])
        kind = CONTAINER_KINDS[int(_get_single(entity, "container_kind"))]
        shares: Sequence[float] = entity.rows.get({"row": "col_shares", "column": "row_shares"}.get(kind, ""), [[]])[-1]
        has_shares = len(shares or ()) == len(children)
        relative_sizes = tuple(float(s) for s in shares) if has_shares else (1.0,) * len(children)
        return Container(kind, name, children, relative_sizes, int(_get_single(entity, "grid_columns", 1)))
    bounds = layout.get(f"{path}/VisualBounds2D")
    box = None if bounds is None else _get_single(bounds, "range")
    legend = layout.get(f"{path}/PlotLegend")
    query = layout.get(f"{path}/ViewContents")
    axis = layout.get(f"{path}/TimeAxis")
    value_axis = layout.get(f"{path}/ScalarAxis")
    values = None if value_axis is None else _get_single(value_axis, "range")
    return View(
        kind=str(_get_single(entity, "class_identifier")),
        name=name,
        origin=str(_get_single(entity, "space_origin", "/")).strip("/"),
        query=tuple(query.rows["query"][-1]) if query else ("$origin/**",),
        legend=legend is None or bool(_get_single(legend, "visible", True)),
        bounds=None if box is None else (tuple(box["x_range"]), tuple(box["y_range"])),
        span=None if axis is None else _read_span(_get_single(axis, "view_range"), time_unit),
        value_range=None if values is None else (float(values[0]), float(values[1])),
        legend_corner="best" if legend is None else LEGEND_CORNERS.get(_get_single(legend, "corner"), "best"),
    )


def _read_span(view_range: dict[str, Any] | None, time_unit: float) -> tuple[float, float] | None:
    """Return the range of a time axis; None where it follows the cursor."""
    start, end = (None if view_range is None else view_range.get(name) for name in ("start", "end"))
    if isinstance(start, int) and isinstance(end, int):
        return time_unit * start, time_unit * end
    return None
