"""Identification of markers by the names of common marker sets, and of the walking frame.

Recognised names, after a side (``R``, ``L``, ``Right``, ``_r`` ...): Plug-in Gait (``RKNE``, ``RANK``, ``RHEE``), words
(``R ANKLE LAT``, ``R.Heel``) and numbered clusters (``R SHANK 1``). ``--map`` assigns other names.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from klute_sim.errors import InputError
from klute_sim.mocap.formats.trc import Markers
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.parsing.channel_names import SIDES, Side
from klute_sim.mocap.parsing.mapping import ImportMapping
from klute_sim.types import Array

_ROLE_PATTERNS: tuple[tuple[str, str], ...] = (
    ("asis", r"asis?"),
    ("psis", r"psis?"),
    ("hip", r"g?troch(anter)?|gtr?|hjc|hip(jc|centre|center)?|greatertrochanter"),
    (
        "knee",
        r"m?kne|knee(lat|med|lateral|medial|jc|l|m)?|kjc|[lm]fe|(lat|med)(eral|ial)?(femoral)?(epi)?(condyle|knee)",
    ),
    (
        "ankle",
        r"m?ank|ankle(lat|med|lateral|medial|jc|l|m)?|ajc|[lm]mal(l|leolus)?|(lat|med)(eral|ial)?(malleolus|ankle)",
    ),
    ("midfoot", r"midfoot(lat|med|sup|\d)?|nav(icular)?"),
    ("heel", r"hee|heel|cal(c|caneus)?"),
    (
        "toe",
        r"toe(tip|lat|med|\d)?|foot(lat|med)|[15]?mt[p125]?h?|[125](st|nd|th)?met|d?[125]m[th]?|meta[125]",
    ),
    ("thigh", r"thi(gh)?(upper|front|rear|\d+)?|th\d+"),
    ("shank", r"sha?n?k(upper|front|rear|\d+)?|tib(ia)?\d*|sh\d+"),
)
_COMPILED_PATTERNS = tuple((role, re.compile(pattern)) for role, pattern in _ROLE_PATTERNS)
_SACRUM_PATTERN = re.compile(r"v?sacr(um|al)?")
MAX_AXIS_DEVIATION = 20.0
"""Largest angle [deg] between the feet and a laboratory axis at which the axis is used as the walking direction."""


@dataclass(frozen=True)
class MarkerRoles:
    """Roles of the markers of both legs."""

    roles: Mapping[tuple[Side, str], tuple[str, ...]]
    """(side, role) -> marker names."""
    sacrum: tuple[str, ...]
    """Names of the markers on the sacrum."""

    def select(self, side: Side, role: str) -> tuple[str, ...]:
        """Return the names of the markers with ``role`` on ``side``."""
        return self.roles.get((side, role), ())


def identify_markers(markers: Markers, mapping: ImportMapping, file_name: str) -> MarkerRoles:
    """Return the roles of ``markers`` by their names, overridden by ``mapping``.

    Raises InputError if ``mapping`` names a marker that does not exist.
    """
    recognised: dict[tuple[Side, str], list[str]] = {}
    sacrum = []
    for name in markers.positions:
        side, landmark = _split_side(name)
        if side is None:
            sacrum += [name] if _SACRUM_PATTERN.fullmatch(landmark) else []
            continue
        role = next((role for role, pattern in _COMPILED_PATTERNS if pattern.fullmatch(landmark)), None)
        if role is not None:
            recognised.setdefault((side, role), []).append(name)
    roles = {key: tuple(names) for key, names in recognised.items()} | dict(mapping.markers)
    for (side, role), names in mapping.markers.items():
        for name in names:
            if name not in markers.positions:
                raise InputError(f"{file_name}: marker '{name}' ({role}, {side}) is missing")
    return MarkerRoles(roles, tuple(sacrum))


def _split_side(marker_name: str) -> tuple[Side | None, str]:
    """Return the side in a marker name and the normalized rest of the name."""
    name = marker_name.split(":")[-1].strip()
    for side, words in (("right", r"right|r"), ("left", r"left|l")):
        separated = re.fullmatch(rf"(?i:{words})[\s._-]+(.*)|(.*?)[\s._-]+(?i:{words})|(?i:{words[:-2]})(.+)", name)
        rest = next((group for group in separated.groups() if group), None) if separated else None
        if rest is None:
            prefixed = re.fullmatch(rf"(?i:{words[-1]})(.+)", name)
            candidate = _normalize_name(prefixed[1]) if prefixed else ""
            if candidate and any(pattern.fullmatch(candidate) for _, pattern in _COMPILED_PATTERNS):
                rest = candidate
        if rest:
            return ("right" if side == "right" else "left"), _normalize_name(rest)
    return None, _normalize_name(name)


def _normalize_name(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


@dataclass(frozen=True, eq=False)
class WalkingFrame:
    """Axes of walking in the laboratory frame."""

    rotation: Array
    """Rotation matrix (3, 3) with the rows forward, up and right."""
    description: str
    """Directions of the axes and how they were determined."""

    def rotate(self, vectors: Array) -> Array:
        """Return laboratory ``vectors`` (..., 3) in the components forward, up and right."""
        return np.asarray(vectors @ self.rotation.T, dtype=np.float64)


def find_walking_frame(
    markers: Markers, roles: MarkerRoles, mapping: ImportMapping, file_name: str, log: ImportLog
) -> WalkingFrame:
    """Return the walking frame by ``mapping``, or by the mean directions of feet and legs.

    Raises InputError if no foot is recognised.
    """
    if mapping.axes:
        forward, up = (_parse_axis(mapping.axes[key]) for key in ("forward", "up"))
        description = f"forward is {mapping.axes['forward']}, up is {mapping.axes['up']}: as specified"
        return WalkingFrame(np.array([forward, up, np.cross(forward, up)]), description)
    feet, legs = [], []
    for side in SIDES:
        heel, toe = (compute_mean_position(markers, roles.select(side, role)) for role in ("heel", "toe"))
        upper_names = [n for role in ("shank", "knee", "thigh", "hip", "asis") for n in roles.select(side, role)]
        upper = compute_mean_position(markers, tuple(upper_names))
        if heel is not None and toe is not None and upper is not None:
            visible = np.isfinite(toe + heel + upper).all(axis=1)
            if visible.any():
                feet.append(np.mean((toe - heel)[visible], axis=0))
                legs.append(np.mean((upper - heel)[visible], axis=0))
    if not feet:
        raise InputError(
            f"{file_name}: no foot was recognised among the markers, which shows the direction of walking; in a file "
            "for --map, name markers of heel, toe and a higher segment under [markers.right] or [markers.left], or "
            "state forward and up under [axes]"
        )
    leg, foot = np.mean(legs, axis=0), np.mean(feet, axis=0)
    vertical = int(np.abs(leg).argmax())
    up = np.zeros(3)
    up[vertical] = np.sign(leg[vertical])
    forward = foot - (foot @ up) * up
    forward /= np.linalg.norm(forward)
    nearest = int(np.abs(forward).argmax())
    angle = float(np.degrees(np.arccos(min(1.0, abs(forward[nearest])))))
    method = "from heels to toes"
    if angle <= MAX_AXIS_DEVIATION:
        axis = np.zeros(3)
        axis[nearest] = np.sign(forward[nearest])
        forward, method = axis, f"{method}, which deviate by {angle:.0f} degrees"
    else:
        log.add_warning(
            f"{file_name}: the feet point {angle:.0f} degrees away from the laboratory axes; their direction is used "
            "as the walking direction"
        )
    description = f"forward is {_format_axis(forward)} ({method}), up is {_format_axis(up)} (from heels to legs)"
    frame = WalkingFrame(np.array([forward, up, np.cross(forward, up)]), description)
    _warn_if_sides_swapped(markers, roles, frame, file_name, log)
    return frame


def _warn_if_sides_swapped(
    markers: Markers, roles: MarkerRoles, frame: WalkingFrame, file_name: str, log: ImportLog
) -> None:
    right, left = (compute_mean_position(markers, roles.select(side, "heel")) for side in SIDES)
    if right is not None and left is not None and np.nanmean(frame.rotate(right - left)[:, 2]) < 0.0:
        log.add_warning(
            f"{file_name}: the right heel is to the left of the left heel; check the sides of the marker names"
        )


def compute_mean_position(markers: Markers, marker_names: tuple[str, ...]) -> Array | None:
    """Return the mean position (n, 3) [m] of ``marker_names``, NaN where a marker is hidden; None without names."""
    if not marker_names:
        return None
    return np.asarray(np.mean([markers.positions[name] for name in marker_names], axis=0), dtype=np.float64)


def _parse_axis(axis_name: str) -> Array:
    vector = np.zeros(3)
    vector["xyz".index(axis_name[-1])] = -1.0 if axis_name[0] == "-" else 1.0
    return vector


def _format_axis(vector: Array) -> str:
    index = int(np.abs(vector).argmax())
    if abs(vector[index]) < 0.999:
        return "(" + ", ".join(f"{v:.2f}" for v in vector) + ")"
    return ("-" if vector[index] < 0 else "+") + "xyz"[index]
