"""Which marker is what: names of common marker sets, and the laboratory's axes.

Recognised, after the side (``R``, ``L``, ``Right``, ``_r`` ...): Plug-in Gait (``RKNE``, ``RANK``, ``RHEE``), names in
words (``R ANKLE LAT``, ``R.Heel``), clusters with numbers (``R SHANK 1``). Others are named in ``--map``.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from klute_sim.errors import InputError
from klute_sim.formats.trc import Markers
from klute_sim.motion.findings import Findings
from klute_sim.motion.mapping import Chosen
from klute_sim.motion.names import SIDES, Side
from klute_sim.recording.recording import Samples

_PATTERNS: tuple[tuple[str, str], ...] = (
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
_COMPILED = tuple((role, re.compile(pattern)) for role, pattern in _PATTERNS)
_SACRUM = re.compile(r"v?sacr(um|al)?")
OBLIQUE = 20.0
"""Walking within so many degrees of an axis of the laboratory is taken to be along it."""


@dataclass(frozen=True)
class Named:
    """Roles of the markers of both legs."""

    roles: Mapping[tuple[Side, str], tuple[str, ...]]
    """(side, role) -> names of markers."""
    sacrum: tuple[str, ...]

    def of(self, side: Side, role: str) -> tuple[str, ...]:
        """Markers of ``side`` that are ``role``."""
        return self.roles.get((side, role), ())


def named(markers: Markers, chosen: Chosen, where: str) -> Named:
    """What the markers are, by ``chosen``, then by their names; raises InputError for a chosen one that is not."""
    found: dict[tuple[Side, str], list[str]] = {}
    sacrum = []
    for name in markers.positions:
        side, bare = _sided(name)
        if side is None:
            sacrum += [name] if _SACRUM.fullmatch(bare) else []
            continue
        role = next((role for role, pattern in _COMPILED if pattern.fullmatch(bare)), None)
        if role is not None:
            found.setdefault((side, role), []).append(name)
    roles = {key: tuple(value) for key, value in found.items()} | dict(chosen.markers)
    for (side, role), wanted in chosen.markers.items():
        for name in wanted:
            if name not in markers.positions:
                raise InputError(f"{where}: there is no marker '{name}', which is to be {role} on the {side}")
    return Named(roles, tuple(sacrum))


def _sided(name: str) -> tuple[Side | None, str]:
    """The side in a marker's name, and the rest without blanks, dots and capitals."""
    bare = name.split(":")[-1].strip()
    for side, word in (("right", r"right|r"), ("left", r"left|l")):
        apart = re.fullmatch(rf"(?i:{word})[\s._-]+(.*)|(.*?)[\s._-]+(?i:{word})|(?i:{word[:-2]})(.+)", bare)
        rest = next((part for part in apart.groups() if part), None) if apart else None
        if rest is None:
            together = re.fullmatch(rf"(?i:{word[-1]})(.+)", bare)
            candidate = _plain(together[1]) if together else ""
            if candidate and any(pattern.fullmatch(candidate) for _, pattern in _COMPILED):
                rest = candidate
        if rest:
            return ("right" if side == "right" else "left"), _plain(rest)
    return None, _plain(bare)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


@dataclass(frozen=True, eq=False)
class Frame:
    """Axes of walking in the laboratory's frame."""

    rotation: Samples
    """(3, 3): rows are forward, up and right."""
    words: str
    """How they lie and how that was found, for the report."""

    def turn(self, vectors: Samples) -> Samples:
        """``vectors`` (..., 3) of the laboratory as forward, up, right."""
        return np.asarray(vectors @ self.rotation.T, dtype=np.float64)


def frame(markers: Markers, roles: Named, chosen: Chosen, where: str, findings: Findings) -> Frame:
    """Find how the walker went; raises InputError where no foot tells it."""
    if chosen.axes:
        forward, up = (_axis(chosen.axes[key]) for key in ("forward", "up"))
        words = f"forward is {chosen.axes['forward']}, up is {chosen.axes['up']}: as given"
        return Frame(np.array([forward, up, np.cross(forward, up)]), words)
    feet, legs = [], []
    for side in SIDES:
        heel, toe = (centre(markers, roles.of(side, role)) for role in ("heel", "toe"))
        above = [n for role in ("shank", "knee", "thigh", "hip", "asis") for n in roles.of(side, role)]
        upper = centre(markers, tuple(above))
        if heel is not None and toe is not None and upper is not None:
            seen = np.isfinite(toe + heel + upper).all(axis=1)
            if seen.any():
                feet.append(np.mean((toe - heel)[seen], axis=0))
                legs.append(np.mean((upper - heel)[seen], axis=0))
    if not feet:
        raise InputError(
            f"{where}: no foot was recognised among the markers; heel, toe and something above them are needed: name "
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
    if angle <= OBLIQUE:
        snapped = np.zeros(3)
        snapped[nearest] = np.sign(ahead[nearest])
        ahead, how = snapped, f"{how}, {angle:.0f} degrees off it"
    else:
        findings.suspect(
            f"{where}: the feet point {angle:.0f} degrees off the laboratory's axes; walking was taken to be so"
        )
    words = f"forward is {_word(ahead)} ({how}), up is {_word(up)} (from heels to legs)"
    found = Frame(np.array([ahead, up, np.cross(ahead, up)]), words)
    _check_sides(markers, roles, found, where, findings)
    return found


def _check_sides(markers: Markers, roles: Named, found: Frame, where: str, findings: Findings) -> None:
    right, left = (centre(markers, roles.of(side, "heel")) for side in SIDES)
    if right is not None and left is not None and np.nanmean(found.turn(right - left)[:, 2]) < 0.0:
        findings.suspect(f"{where}: the right heel is to the left of the left one; are the sides' names swapped?")


def centre(markers: Markers, names: tuple[str, ...]) -> Samples | None:
    """(n, 3): mean of the markers ``names`` [m], NaN where one is missing; None for no names."""
    if not names:
        return None
    return np.asarray(np.mean([markers.positions[name] for name in names], axis=0), dtype=np.float64)


def _axis(word: str) -> Samples:
    vector = np.zeros(3)
    vector["xyz".index(word[-1])] = -1.0 if word[0] == "-" else 1.0
    return vector


def _word(vector: Samples) -> str:
    place = int(np.abs(vector).argmax())
    if abs(vector[place]) < 0.999:
        return "(" + ", ".join(f"{v:.2f}" for v in vector) + ")"
    return ("-" if vector[place] < 0 else "+") + "xyz"[place]
