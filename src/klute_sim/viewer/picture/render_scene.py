"""Render the 3-D views of a recording with matplotlib: side view, orthographic, at one instant."""

from typing import TYPE_CHECKING, Any

import numpy as np

from klute_sim.types import Array
from klute_sim.viewer.picture.render import get_first_value, unpack_colour
from klute_sim.viewer.picture.rrd_reader import Entity, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

N_CIRCLE_POINTS = 24
"""Number of points of a circle."""
MAX_BODY_SIZE_M = 5.0
"""Largest size of a body [m]; larger shapes are ground and do not affect the limits of the axes."""
MARGIN_M = 0.08
"""Margin around the bodies [m]."""


def draw_scene(axis: "Axes", view: View, entities: dict[str, Entity], timeline: str, cursor: float) -> None:
    """Draw bodies, lines and arrows in the sagittal plane (x across, z up), the nearest last."""
    from matplotlib.patches import FancyArrowPatch, Polygon

    shapes: list[tuple[float, Array, Any]] = []
    for path, entity in entities.items():
        parent = entities.get(path.rpartition("/")[0])
        shade = unpack_colour((entity.get_value("colors", timeline, cursor) or [0x999999FF])[0])
        for points, radius in extract_solids(entity, timeline, cursor):
            placed = _transform_to_parent(
                parent, timeline, cursor, _transform_to_parent(entity, timeline, cursor, points)
            )
            shapes.append((float(placed[:, 1].mean()), compute_outline(placed[:, [0, 2]], radius), shade))
    bodies = [outline for _, outline, _ in shapes if np.ptp(outline, axis=0).max() < MAX_BODY_SIZE_M]
    for _, points, shade in sorted(shapes, key=lambda shape: (np.ptp(shape[1]) < MAX_BODY_SIZE_M, -shape[0])):
        axis.add_patch(Polygon(points, closed=True, facecolor=shade, edgecolor="none"))
    for entity in entities.values():
        if "Arrows3D" in entity.archetypes:
            begin, vector = (np.array(entity.get_value(name, timeline, cursor)[0]) for name in ("origins", "vectors"))
            if np.linalg.norm(vector) > 0.01:
                ends = (begin + vector)[[0, 2]]
                shade = unpack_colour(get_first_value(entity, "colors", 0x999999FF))
                axis.add_patch(
                    FancyArrowPatch(
                        (begin[0], begin[2]), (ends[0], ends[1]), color=shade, mutation_scale=8, linewidth=1.5
                    )
                )
                bodies.append(np.array([begin[[0, 2]], ends]))
    if bodies:
        corners = np.concatenate(bodies)
        (left, low), (right, high) = corners.min(axis=0) - MARGIN_M, corners.max(axis=0) + MARGIN_M
        axis.set_xlim(left, right)
        axis.set_ylim(low, high)
    axis.set_aspect("equal")
    axis.set_axis_off()


def extract_solids(entity: Entity, timeline: str, cursor: float) -> list[tuple[Array, float]]:
    """Return corners (n, 3) in the frame of ``entity`` and rounding radius [m] of each of its shapes."""
    if "Capsules3D" in entity.archetypes:
        begin = np.array(get_first_value(entity, "translations", [0.0, 0.0, 0.0]))
        end = begin + np.array([0.0, 0.0, get_first_value(entity, "lengths", 0.0)])
        return [(np.array([begin, end]), float(get_first_value(entity, "radii", 0.0)))]
    if "Cylinders3D" in entity.archetypes:
        radius, half_length = get_first_value(entity, "radii", 0.0), 0.5 * get_first_value(entity, "lengths", 0.0)
        rim = radius * _make_circle()
        ends = [np.column_stack([rim, np.full(len(rim), z)]) for z in (-half_length, half_length)]
        return [(np.concatenate(ends), 0.0)]
    if "Ellipsoids3D" in entity.archetypes:
        half_length, _, half_height = get_first_value(entity, "half_sizes", [0.0, 0.0, 0.0])
        circle = _make_circle()
        return [(np.column_stack([half_length * circle[:, 0], np.zeros(len(circle)), half_height * circle[:, 1]]), 0.0)]
    if "Boxes3D" in entity.archetypes:
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
        centre = np.array(get_first_value(entity, "centers", [0.0, 0.0, 0.0]))
        return [(centre + signs * np.array(get_first_value(entity, "half_sizes", [0.0, 0.0, 0.0])), 0.0)]
    if "LineStrips3D" in entity.archetypes:
        strips = entity.get_value("strips", timeline, cursor) or []
        return [(np.array(strip), float(get_first_value(entity, "radii", 0.0))) for strip in strips]
    return []


def _transform_to_parent(entity: Entity | None, timeline: str, cursor: float, points: Array) -> Array:
    """Transform ``points`` (n, 3) from the frame of ``entity`` to its parent frame."""
    if entity is None or "Transform3D" not in entity.archetypes:
        return points
    (translation,), (quaternion,) = (
        entity.get_value("translation", timeline, cursor),
        entity.get_value("quaternion", timeline, cursor),
    )
    x, y, z, w = quaternion
    vector, scalar = np.array([x, y, z]), 2.0 * w
    rotated = points + scalar * np.cross(vector, points) + 2.0 * np.cross(vector, np.cross(vector, points))
    return np.asarray(rotated + np.array(translation))


def compute_outline(points: Array, radius: float) -> Array:
    """Return the convex hull (m, 2) of circles of ``radius`` around ``points`` (n, 2)."""
    from scipy.spatial import ConvexHull

    circle = max(radius, 1e-6) * _make_circle()  # collinear points have no hull
    circle_points = (points[:, None, :] + circle[None, :, :]).reshape(-1, 2)
    return np.asarray(circle_points[ConvexHull(circle_points).vertices])


def _make_circle() -> Array:
    """Return points (n, 2) on the unit circle."""
    angles = np.linspace(0.0, 2.0 * np.pi, N_CIRCLE_POINTS, endpoint=False)
    return np.column_stack([np.cos(angles), np.sin(angles)])
