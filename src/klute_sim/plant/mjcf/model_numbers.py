"""Numbers of an MJCF model by name, such as ``model.joint.elbow.damping``: read, and changed through ``MjSpec``.

A name is ``model.<element>.<name of the element>.<number>``, or ``model.option.<number>``. The number has the unit of
the MJCF file (SI; angles as its compiler reads them). Only numbers that the file states can be changed: the mass of a
body whose mass follows from its geoms is changed through ``model.geom.<name>.mass``.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from klute_sim.errors import InputError, suggest_from
from klute_sim.plant.mjcf.pulleys import set_radius

PREFIX = "model."
"""Beginning of the name of each number of a model."""
RADIUS = "size_1"
"""Number of a geom that is the radius of a sphere or a cylinder."""


class NumberPath(NamedTuple):
    """Where ``MjSpec`` keeps a number."""

    attribute: str
    """Attribute of the element."""
    component: int | None = None
    """Index within the attribute; None for a scalar."""


def _list_components(attribute: str) -> dict[str, NumberPath]:
    return {f"{attribute}_{axis}": NumberPath(attribute, index) for index, axis in enumerate("xyz")}


NUMBERS: dict[str, dict[str, NumberPath]] = {
    "joint": {
        "damping": NumberPath("damping", 0),
        "stiffness": NumberPath("stiffness", 0),
        **{name: NumberPath(name) for name in ("springref", "frictionloss", "armature")},
    },
    "body": {"mass": NumberPath("mass"), **_list_components("inertia"), **_list_components("ipos")},
    "geom": {
        "mass": NumberPath("mass"),
        **{f"size_{index + 1}": NumberPath("size", index) for index in range(3)},
        **_list_components("pos"),
    },
    "site": _list_components("pos"),
    "tendon": {
        "damping": NumberPath("damping", 0),
        "stiffness": NumberPath("stiffness", 0),
        "frictionloss": NumberPath("frictionloss"),
    },
    "option": _list_components("gravity"),
}
"""Element -> name of the number -> where it is."""

UNITS = {"mass": "kg", "inertia": "kg*m2", "ipos": "m", "pos": "m", "size": "m", "gravity": "m/s2"}
"""Number of a body, geom, site or the options, without its component -> unit."""
TENDON_UNITS = {"damping": "N*s/m", "stiffness": "N/m", "frictionloss": "N"}
"""Number of a tendon -> unit."""


def collect_model_numbers(spec: mujoco.MjSpec) -> dict[str, float]:
    """Return all numbers of ``spec`` that can be changed, by name."""
    numbers = {}
    for title, element in _list_elements(spec).items():
        for number, path in NUMBERS[title.split(".")[0]].items():
            value = float(_read(element, path))
            if math.isfinite(value):
                numbers[f"{PREFIX}{title}.{number}"] = value
    return numbers


def set_model_numbers(spec: mujoco.MjSpec, values: Mapping[str, float]) -> None:
    """Set numbers of ``spec`` (name -> value); raises InputError for an unknown name or a value that is not finite.

    The ends of cables on the rim of a pulley move with its radius, unless ``values`` state where they are: MuJoCo wraps
    no tendon around a geom that its end lies in.
    """
    if not values:
        return
    elements = _list_elements(spec)
    for name, value in sorted(values.items(), key=lambda item: not item[0].endswith(f".{RADIUS}")):
        title, _, number = name.removeprefix(PREFIX).rpartition(".")
        element, paths = elements.get(title), NUMBERS.get(title.split(".")[0], {})
        if element is None or number not in paths or not math.isfinite(_read(element, paths[number])):
            known = collect_model_numbers(spec)
            raise InputError(f"'{name}' is not a number of the model; {suggest_number(name, known)}")
        if not math.isfinite(value):
            raise InputError(f"'{name}' is {value}; allowed: a finite number")
        if number == RADIUS and value > 0.0:
            set_radius(spec, element, float(element.size[0]), value)
        else:
            _write(element, paths[number], value)


def suggest_number(name: str, known: Iterable[str]) -> str:
    """Return which of the ``known`` numbers of a model ``name`` may mean, and where all are listed."""
    return suggest_from(name, known, "'klute-sim bench joint MODEL --numbers' lists all")


def get_number_unit(name: str) -> str:
    """Return the unit of the number called ``name``; '' where it depends on the kind of a joint."""
    element, number = name.removeprefix(PREFIX).partition(".")[0], name.rpartition(".")[2]
    if element == "tendon":
        return TENDON_UNITS[number]
    return UNITS.get(number.rpartition("_")[0] or number, "")


def _list_elements(spec: mujoco.MjSpec) -> dict[str, Any]:
    """Return ``<element>.<name>`` -> element for all elements with a name, and ``option``."""
    groups = {
        "joint": spec.joints,
        "body": [body for body in spec.bodies if body.explicitinertial],
        "geom": spec.geoms,
        "site": spec.sites,
        "tendon": spec.tendons,
    }
    named = {f"{kind}.{element.name}": element for kind, group in groups.items() for element in group if element.name}
    return {**named, "option": spec.option}


def _read(element: Any, path: NumberPath) -> float:
    value = getattr(element, path.attribute)
    return float(value if path.component is None else np.asarray(value)[path.component])


def _write(element: Any, path: NumberPath, value: float) -> None:
    if path.component is None:
        setattr(element, path.attribute, value)
        return
    values = np.array(getattr(element, path.attribute), dtype=np.float64)
    values[path.component] = value
    setattr(element, path.attribute, values)
