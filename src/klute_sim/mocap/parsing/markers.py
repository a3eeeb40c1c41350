"""Which marker is what: names of common marker sets, and the laboratory's axes.

Recognised, after the side (``R``, ``L``, ``Right``, ``_r`` ...): Plug-in Gait (``RKNE``, ``RANK``, ``RHEE``), names in
words (``R ANKLE LAT``, ``R.Heel``), clusters with numbers (``R SHANK 1``). Others are named in ``--map``.
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
from klute_sim.recording.recording import Array

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
"""Walking within so many degrees of an axis of the laboratory is taken to be along it."""


@dataclass(frozen=True)
class MarkerRoles:
    """Roles of the markers of both legs."""

    roles: Mapping[tuple[Side, str], tuple[str, ...]]
    """(side, role) -> names of markers."""
    sacrum: tuple[str, ...]

    def select(self, side: Side, role: str) -> tuple[str, ...]:
        """Markers of ``side`` that are ``role``."""
        return self.roles.get((side, role), ())


def identify_markers(markers: Markers, mapping: ImportMapping, trial_name: str) -> MarkerRoles:
    """What the markers are, by ``chosen``, then by their names; raises InputError for a chosen one that is not."""
    found: dict[tuple[Side, str], list[str]] = {}
    sacrum = []
    for name in markers.positions:
        side, bare = _split_side(name)
        if side is None:
            sacrum += [name] if _SACRUM_PATTERN.fullmatch(bare) else []
            continue
        role = next((role for role, pattern in _COMPILED_PATTERNS if pattern.fullmatch(bare)), None)
        if role is not None:
            found.setdefault((side, role), []).append(name)
    roles = {key: tuple(value) for key, value in found.items()} | dict(mapping.markers)
    for (side, role), wanted in mapping.markers.items():
        for name in wanted:
            if name not in markers.positions:
                raise InputError(f"{trial_name}: there is no marker '{name}', which is to be {role} on the {side}")
    return MarkerRoles(roles, tuple(sacrum))


def _split_side(marker_name: str) -> tuple[Side | None, str]:
    """The side in a marker's name, and the rest without blanks, dots and capitals."""
    bare = marker_name.split(":")[-1].strip()
    for side, word in (("right", r"right|r"), ("left", r"left|l")):
        apart = re.fullmatch(rf"(?i:{word})[\s._-]+(.*)|(.*?)[\s._-]+(?i:{word})|(?i:{word[:-2]})(.+)", bare)
        rest = next((part for part in apart.groups() if part), None) if apart else None
        if rest is None:
            together = re.fullmatch(rf"(?i:{word[-1]})(.+)", bare)
            candidate = _normalize_name(together[1]) if together else ""
            if candidate and any(pattern.fullmatch(candidate) for _, pattern in _COMPILED_PATTERNS):
                rest = candidate
        if rest:
            return ("right" if side == "right" else "left"), _normalize_name(rest)
    return None, _normalize_name(bare)


def _normalize_name(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


@dataclass(frozen=True, eq=False)
class WalkingFrame:
    """Axes of walking in the laboratory's frame."""

    rotation: Array
    """(3, 3): rows are forward, up and right."""
    description: str
    """How they lie and how that was found, for the report."""

    def rotate(self, vectors: Array) -> Array:
        """``vectors`` (..., 3) of the laboratory as forward, up, right."""
        return np.asarray(vectors @ self.rotation.T, dtype=np.float64)


def find_walking_frame(
    markers: Markers, roles: MarkerRoles, mapping: ImportMapping, trial_name: str, log: ImportLog
) -> WalkingFrame:
    """Find how the walker went; raises InputError where no foot tells it."""
    if mapping.axes:
        forward, up = (_parse_axis(mapping.axes[key]) for key in ("forward", "up"))
        words = f"forward is {mapping.axes['forward']}, up is {mapping.axes['up']}: as given"
        return WalkingFrame(np.array([forward, up, np.cross(forward, up)]), words)
    feet, legs = [], []
    for side in SIDES:
        heel, toe = (mean_position(markers, roles.select(side, role)) for role in ("heel", "toe"))
        above = [n for role in ("shank", "knee", "thigh", "hip", "asis") for n in roles.select(side, role)]
        upper = mean_position(markers, tuple(above))
        if heel is not None and toe is not None and upper is not None:
            seen = np.isfinite(toe + heel + upper).all(axis=1)
            if seen.any():
                feet.append(np.mean((toe - heel)[seen], axis=0))
                legs.append(np.mean((upper - heel)[seen], axis=0))
    if not feet:
        raise InputError(
            f"{trial_name}: no foot was recognised among the markers; heel, toe and something above them are needed: name "
            "them in a file for --map, under [markers.right]"
        )
    leg, foot = np.mean(legs, axis=0), np.mean(feet, axis=0)
    place = int(np.abs(leg).argmax())
    up = np.zeros(3)
    up[place] = np.sign(leg[place])
    ahead = foot - (foot @ up) * up
    ahead /= np.linalg.norm(ahead)
    nearest = int(np.abs(ahead).argmax())
    angle = float(np.degrees(np.arccos(min(1.0, abs(ahead[nearest])))))
    how = "from heels to toes"
    if angle <= MAX_AXIS_DEVIATION:
        snapped = np.zeros(3)
        snapped[nearest] = np.sign(ahead[nearest])
        ahead, how = snapped, f"{how}, {angle:.0f} degrees off it"
    else:
        log.add_warning(
            f"{trial_name}: the feet point {angle:.0f} degrees off the laboratory's axes; walking was taken to be so"
        )
    words = f"forward is {_format_axis(ahead)} ({how}), up is {_format_axis(up)} (from heels to legs)"
    found = WalkingFrame(np.array([ahead, up, np.cross(ahead, up)]), words)
    _warn_if_sides_swapped(markers, roles, found, trial_name, log)
    return found


def _warn_if_sides_swapped(
    markers: Markers, roles: MarkerRoles, frame: WalkingFrame, trial_name: str, log: ImportLog
) -> None:
    right, left = (mean_position(markers, roles.select(side, "heel")) for side in SIDES)
    if right is not None and left is not None and np.nanmean(frame.rotate(right - left)[:, 2]) < 0.0:
        log.add_warning(f"{trial_name}: the right heel is to the left of the left one; are the sides' names swapped?")


def mean_position(markers: Markers, marker_names: tuple[str, ...]) -> Array | None:
    """(n, 3): mean of the markers ``names`` [m], NaN where one is missing; None for no names."""
    if not marker_names:
        return None
    return np.asarray(np.mean([markers.positions[name] for name in marker_names], axis=0), dtype=np.float64)


def _parse_axis(axis_name: str) -> Array:
    vector = np.zeros(3)
    vector["xyz".index(axis_name[-1])] = -1.0 if axis_name[0] == "-" else 1.0
    return vector


def _format_axis(vector: Array) -> str:
    place = int(np.abs(vector).argmax())
    if abs(vector[place]) < 0.999:
        return "(" + ", ".join(f"{v:.2f}" for v in vector) + ")"
    return ("-" if vector[place] < 0 else "+") + "xyz"[place]
