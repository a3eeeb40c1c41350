"""Files of walkers: gains and initial state with the body, the contact and the condition that they belong to."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from klute_sim.errors import InputError, suggest
from klute_sim.files.limits import WALKER
from klute_sim.files.reading import read_bytes
from klute_sim.files.toml import format_toml, parse_toml
from klute_sim.types import Array
from klute_sim.walker.person.body import Body
from klute_sim.walker.reflexes.gain_table import GAINS, INITIAL_STATE, Reflexes, SearchedNumber

FORMAT = "klute-sim-walker/1"
"""Format of the files."""
CONTACT_TOLERANCE = 1e-12
"""Difference between two numbers of a contact that counts as none."""
_LIBRARY = "klute_sim.walker.reflexes"
"""Package that holds the folder ``walkers`` of shipped files."""

Contact = Mapping[str, list[float]]
"""Numbers of a contact (:func:`klute_sim.walker.person.build.get_contact`)."""


@dataclass(frozen=True)
class Walker:
    """A walker that has adapted to a condition."""

    name: str
    """Name, such as that of its file."""
    reflexes: Reflexes
    """Gains and initial state."""
    body_digest: str
    """Digest of the body (:attr:`klute_sim.walker.person.body.Body.digest`)."""
    contact: Contact
    """Contact in which the walker walks."""
    condition: Mapping[str, Any]
    """Prosthesis and controller that it has adapted to (JSON types)."""
    search: Mapping[str, Any] = field(default_factory=dict)
    """Seed, cost, evaluations and weights of the search that found the reflexes (JSON types)."""

    @property
    def is_intact(self) -> bool:
        """Whether the walker has two legs of flesh."""
        return self.condition.get("prosthesis") == "none"

    @property
    def digest(self) -> str:
        """SHA-256 of the reflexes."""
        rows = (self.reflexes.left, self.reflexes.right, self.reflexes.initial)
        return hashlib.sha256(b"".join(np.ascontiguousarray(row).tobytes() for row in rows)).hexdigest()

    def check_legs(self, *, is_intact: bool) -> None:
        """Raise InputError unless the walker has two legs of flesh where ``is_intact``, and a prosthesis otherwise."""
        if self.is_intact != is_intact:
            kinds = ("two legs of flesh", "a prosthesis on the right leg")
            actual_kind, needed_kind = kinds if self.is_intact else kinds[::-1]
            raise InputError(
                f"walker {self.name} walks with {actual_kind}, not with {needed_kind}; choose another walker"
            )

    def check_fits(self, body: Body, contact: Contact) -> None:
        """Raise InputError when the walker belongs to another body or another contact, in which it would fall."""
        if self.body_digest != body.digest:
            raise InputError(
                f"walker {self.name} was adapted in another body (sha256 {self.body_digest[:12]}..., this is "
                f"{body.digest[:12]}...); adapt a walker in this one with klute-sim walk adapt"
            )
        for key, values in contact.items():
            walker_values = self.contact.get(key, [])
            if len(walker_values) != len(values) or any(
                abs(a - b) > CONTACT_TOLERANCE for a, b in zip(walker_values, values, strict=True)
            ):
                raise InputError(
                    f"walker {self.name} was adapted to a contact with {key} = {list(walker_values)}, this one has "
                    f"{list(values)}; adapt a walker to this contact with klute-sim walk adapt"
                )

    def to_toml(self) -> str:
        """Return the content of the walker's file."""
        content = {
            "format": FORMAT,
            "body": {"sha256": self.body_digest},
            "contact": dict(self.contact),
            "condition": dict(self.condition),
            "search": dict(self.search),
            "left": _name(GAINS, self.reflexes.left),
            "right": _name(GAINS, self.reflexes.right),
            "initial": _name(INITIAL_STATE, self.reflexes.initial),
        }
        return format_toml(content)


def describe_condition(
    prosthesis: str, device: str | None = None, controller: Mapping[str, Any] | None = None, **numbers: float
) -> dict[str, Any]:
    """Return the condition of a walker in TOML types: ``prosthesis`` is none, device or spring-foot."""
    condition: dict[str, Any] = {"prosthesis": prosthesis, **numbers}
    if device is not None:
        condition["device_sha256"] = device
    if controller is not None:
        condition["controller"] = json.dumps(controller, sort_keys=True)
    return condition


def list_walkers() -> list[str]:
    """Return the names of the shipped walkers: the condition and the rank by cost, as in machine-1."""
    folder = resources.files(_LIBRARY) / "walkers"
    names = [Path(file.name).stem for file in folder.iterdir() if file.name.endswith(".toml")]

    def get_rank(name: str) -> tuple[str, int]:
        condition, _, number = name.rpartition("-")
        return condition, int(number)

    return sorted(names, key=get_rank)


def load_walker(name_or_path: str | Path) -> Walker:
    """Return the shipped walker of a name, or that of a file.

    Raises InputError when there is no such walker, or the file is not one.
    """
    names = list_walkers()
    if str(name_or_path) in names:
        content = (resources.files(_LIBRARY) / "walkers" / f"{name_or_path}.toml").read_bytes()
        return parse_walker(content, str(name_or_path))
    path = Path(name_or_path)
    if not (path.suffix or path.exists()):
        raise InputError(
            f"there is no walker '{name_or_path}'; "
            + suggest(str(name_or_path), names, f"allowed: {', '.join(names)}, or the file of a walker (.toml)")
        )
    return parse_walker(read_bytes(path, WALKER), path.stem)


def select_walkers(condition: Mapping[str, Any]) -> list[Walker]:
    """Return the shipped walkers that have adapted to ``condition``, or those that are nearest to it.

    A walker with the same kind of prosthesis is nearer than any other, then one with the same controller, then one with
    the same kind of controller. An intact one never replaces an amputee.

    Raises InputError when no walker has legs of this kind.
    """
    walkers = [load_walker(name) for name in list_walkers()]
    usable = [walker for walker in walkers if walker.is_intact == (condition["prosthesis"] == "none")]
    if not usable:
        raise InputError("no walker of this kind is shipped; adapt one with klute-sim walk adapt")

    def measure_distance(walker: Walker) -> int:
        if dict(walker.condition) == dict(condition):
            return 0
        if walker.condition.get("prosthesis") != condition["prosthesis"]:
            return 4
        if walker.condition.get("controller") == condition.get("controller"):
            return 1
        return 2 if _get_controller_kind(walker.condition) == _get_controller_kind(condition) else 3

    distances = [measure_distance(walker) for walker in usable]
    return [walker for walker, distance in zip(usable, distances, strict=True) if distance == min(distances)]


def _get_controller_kind(condition: Mapping[str, Any]) -> str | None:
    """Return the kind of the controller of ``condition``, such as machine; None without a controller."""
    kind: str | None = json.loads(condition.get("controller", "{}")).get("kind")
    return kind


def select_walker(condition: Mapping[str, Any]) -> Walker:
    """Return the first of :func:`select_walkers`."""
    return select_walkers(condition)[0]


def parse_walker(content: bytes, name: str) -> Walker:
    """Return the walker in ``content`` (TOML); raises InputError when it is not a walker."""
    source = f"walker {name}"
    keys = parse_toml(content, source)
    if keys.get("format") != FORMAT:
        raise InputError(f"{source}: 'format' is {keys.get('format')!r}; allowed: '{FORMAT}'")
    tables = {title: keys.get(title) for title in ("body", "contact", "condition", "search")}
    for title, table in tables.items():
        if not isinstance(table, dict):
            raise InputError(f"{source}: table [{title}] is missing")
    body, contact, condition, search = (dict(table or {}) for table in tables.values())
    if not isinstance(body.get("sha256"), str):
        raise InputError(f"{source}: 'body.sha256' is missing")
    if not all(isinstance(v, list) and all(_is_number(x) for x in v) for v in contact.values()):
        raise InputError(f"{source}: [contact] holds something else than lists of numbers")
    return Walker(
        name,
        Reflexes(
            _parse_numbers(keys, "left", GAINS, source),
            _parse_numbers(keys, "right", GAINS, source),
            _parse_numbers(keys, "initial", INITIAL_STATE, source),
        ),
        body["sha256"],
        {key: [float(x) for x in values] for key, values in contact.items()},
        condition,
        search,
    )


def _name(numbers: tuple[SearchedNumber, ...], row: Array) -> dict[str, float]:
    return {number.name: float(value) for number, value in zip(numbers, row, strict=True)}


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _parse_numbers(keys: Mapping[str, Any], title: str, numbers: tuple[SearchedNumber, ...], source: str) -> Array:
    table = keys.get(title)
    if not isinstance(table, dict):
        raise InputError(f"{source}: table [{title}] is missing")
    names = [number.name for number in numbers]
    for key in table:
        if key not in names:
            raise InputError(f"{source}: unknown key '{title}.{key}'; " + suggest(key, names, "see docs/walk.md"))
    row = []
    for number in numbers:
        value = table.get(number.name)
        if not _is_number(value) or not number.low <= value <= number.high:
            raise InputError(
                f"{source}: '{title}.{number.name}' is {value!r}; allowed: {number.low:g} to {number.high:g}"
            )
        row.append(float(value))
    return np.array(row)
