"""What is in a recording for the rerun viewer: its entities, and its layout as a tree of views."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.errors import InputError
from klute_sim.report.workbench.stream import sdk

KINDS = {1: "tabs", 2: "row", 3: "column", 4: "grid"}
"""rerun's numbers of containers."""
INTERNAL = ("rerun.controls", "log_tick", "log_time", "blueprint")


class Entity:
    """Components of one entity: those that are always the same, and those over a timeline."""

    def __init__(self) -> None:
        """Empty."""
        self.static: dict[str, list[Any]] = {}
        self.rows: dict[str, list[Any]] = {}
        self.times: dict[str, list[NDArray[np.float64]]] = {}
        self.archetypes: set[str] = set()
        """What it is, such as ``Boxes3D``."""

    def time(self, timeline: str) -> NDArray[np.float64]:
        """Of the rows: [s] of a timeline of durations, else its own numbers."""
        return np.concatenate(self.times[timeline])

    def at(self, component: str, timeline: str, place: float) -> Any:
        """The last value at ``place`` on ``timeline`` or before it, else the static one; None if there is none."""
        if component in self.rows and timeline in self.times:
            known = np.flatnonzero(self.time(timeline) <= place)
            row = int(known[np.argmax(self.time(timeline)[known])]) if len(known) else 0
            return self.rows[component][row]
        return self.static.get(component)


class View(NamedTuple):
    """A window of the layout with data in it."""

    kind: str
    """``TimeSeries``, ``2D``, ``3D``, ``TextDocument``."""
    name: str
    origin: str
    query: tuple[str, ...]
    """Which entities: paths, with ``/**`` for all that is below."""
    legend: bool
    bounds: tuple[tuple[float, float], tuple[float, float]] | None
    """Of a plane, (across, up)."""

    def of(self, entities: dict[str, Entity]) -> dict[str, Entity]:
        """The entities in this view."""
        found = {}
        for path, entity in entities.items():
            for wanted in self.query:
                root = wanted.replace("$origin", self.origin).strip("/")
                below = root.removesuffix("**").rstrip("/")
                if path == root or (root.endswith("**") and (f"{path}/".startswith(f"{below}/") or not below)):
                    found[path] = entity
        return found


class Container(NamedTuple):
    """Windows side by side, above each other, in a grid, or one at a time."""

    kind: str
    name: str
    children: tuple["View | Container", ...]
    shares: tuple[float, ...]
    columns: int


class Contents(NamedTuple):
    """A recording."""

    entities: dict[str, Entity]
    root: View | Container
    timeline: str


def read(file: Path) -> Contents:
    """What is in ``file`` (.rrd); raises InputError for one without a layout, MissingExtraError without rerun."""
    rr = sdk()
    try:
        reader = rr.chunk.RrdReader(file)
        layouts = list(reader.blueprints())
        entities = _entities(reader.stream())
        plan = _entities(reader.stream(store=layouts[-1])) if layouts else {}
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{file} cannot be read: {error}") from None
    if not plan:
        raise InputError(f"{file} has no layout: it was not made by klute-sim")
    return Contents(entities, _root(plan), str(_one(plan["time_panel"], "timeline")))


def views(node: View | Container) -> Iterator[View]:
    """All of them, in the order of the layout."""
    if isinstance(node, View):
        yield node
    else:
        for child in node.children:
            yield from views(child)


def _entities(chunks: Any) -> dict[str, Entity]:
    found: dict[str, Entity] = {}
    for chunk in chunks:
        entity = found.setdefault(str(chunk.entity_path).lstrip("/"), Entity())
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
                if name not in components and not name.startswith(INTERNAL):
                    column = batch.column(name)
                    stamps = np.asarray(column.cast("int64").to_numpy(zero_copy_only=False))
                    scale = 1e-9 if str(column.type).startswith("duration") else 1.0
                    entity.times.setdefault(name, []).append(scale * stamps)
    return found


def _one(entity: Entity, component: str, otherwise: Any = None) -> Any:
    """The single value of a component of the layout."""
    found = entity.rows.get(component, [None])[-1]
    return otherwise if not found else found[0]


def _root(plan: dict[str, Entity]) -> View | Container:
    raw = bytes(_one(plan["viewport"], "root_container")).hex()
    name = f"{raw[:8]}-{raw[8:12]}-{raw[12:16]}-{raw[16:20]}-{raw[20:]}"
    return _node(plan, f"container/{name}")


def _node(plan: dict[str, Entity], path: str) -> View | Container:
    entity = plan[path]
    name = str(_one(entity, "display_name", ""))
    if path.startswith("container"):
        children = tuple(_node(plan, str(child)) for child in entity.rows["contents"][-1])
        kind = KINDS[int(_one(entity, "container_kind"))]
        shares: Sequence[float] = entity.rows.get({"row": "col_shares", "column": "row_shares"}.get(kind, ""), [[]])[-1]
        filled = tuple(float(s) for s in shares) if len(shares or ()) == len(children) else (1.0,) * len(children)
        return Container(kind, name, children, filled, int(_one(entity, "grid_columns", 1)))
    bounds = plan.get(f"{path}/VisualBounds2D")
    box = None if bounds is None else _one(bounds, "range")
    legend = plan.get(f"{path}/PlotLegend")
    query = plan.get(f"{path}/ViewContents")
    return View(
        kind=str(_one(entity, "class_identifier")),
        name=name,
        origin=str(_one(entity, "space_origin", "/")).strip("/"),
        query=tuple(query.rows["query"][-1]) if query else ("$origin/**",),
        legend=legend is None or bool(_one(legend, "visible", True)),
        bounds=None if box is None else (tuple(box["x_range"]), tuple(box["y_range"])),
    )
