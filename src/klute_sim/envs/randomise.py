"""Domain randomisation: what differs from episode to episode, within which ranges.

Numbers and effects of the device are a row of the model, which is written anew. Mass, speed and slope need another
rig; it is put together when it is first drawn, and kept, so they are drawn from a grid. Its model has the same shape:
only what differs is carried over, and nothing is compiled in between.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS

from klute_sim.dataset.override import overridden, to_toml
from klute_sim.device.files import Device
from klute_sim.device.schema import parse
from klute_sim.device.step import Parameters
from klute_sim.device.vector import SIZE, pack
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.rigs.gait.assembly import Assembly, GaitOptions, assemble
from klute_sim.rigs.gait.body import ANKLE

GRID = 9
"""Values of mass, speed and slope each, the ends of their ranges among them."""
MOST_SHARE = 0.5
"""Of a number, by which it may be randomised."""
ROW = "actuator_user"
"""Where a model keeps its devices' parameters."""

Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Randomise:
    """Ranges to draw from when an episode starts; validated when made, and left out: as it is."""

    mass_share: float = 0.0
    """Body mass is within this share of the usual one."""
    speed_m_per_s: Range | None = None
    """Walking speed, lowest and highest."""
    slope_deg: Range | None = None
    """Slope of the ground, uphill positive."""
    device: Mapping[str, float] = field(default_factory=dict)
    """``section.key`` of the device file -> share of its value by which it varies."""
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Name of an effect -> parameter -> range; ``form`` names a form, as in a device file."""

    def __post_init__(self) -> None:
        """Raise InputError for what is no range."""
        for name, share in {"mass_share": self.mass_share, **self.device}.items():
            if not 0.0 <= share <= MOST_SHARE:
                raise InputError(f"randomise varies {name} by a share of {share:g}; allowed: 0 to {MOST_SHARE:g}")
        for name in ("speed_m_per_s", "slope_deg"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _range(name, getattr(self, name)))
        for effect, content in self.effects.items():
            for key, value in content.items():
                if key != "form":
                    _range(f"effects.{effect}.{key}", value)

    @classmethod
    def of(cls, asked: "Randomise | Mapping[str, Any] | None") -> "Randomise":
        """The ranges that a mapping of these names describes; raises InputError for another name."""
        if isinstance(asked, Randomise):
            return asked
        known = [each.name for each in fields(cls)]
        for name in asked or {}:
            if name not in known:
                raise InputError(f"randomise has no '{name}'; allowed: {', '.join(known)}")
        return cls(**(asked or {}))


def _range(name: str, value: Any) -> Range:
    try:
        low, high = (float(each) for each in value)
    except (TypeError, ValueError):
        raise InputError(f"randomise draws {name} from {value!r}; allowed: two numbers") from None
    if not -np.inf < low <= high < np.inf:
        raise InputError(f"randomise draws {name} from {low:g} to {high:g}; allowed: a finite range that rises")
    return low, high


@dataclass(frozen=True)
class Episode:
    """What was drawn for one episode."""

    number: int
    """Of its rig, among those of :class:`Casting`."""
    parameters: Parameters
    told: Mapping[str, float]
    """What was drawn, keys with units."""


class Casting:
    """Draws episodes of one device and walker."""

    def __init__(self, device: Device, options: GaitOptions, randomise: Randomise, interval: float) -> None:
        """Raises InputError for a range that the device or the rig cannot have throughout."""
        self._randomise, self._options, self._interval = randomise, options, interval
        self.device = with_effects(device, randomise.effects)
        """The usual device, with the effects that are randomised in the middle of their ranges."""
        self._ranges = self._device_ranges()
        for key, ends in self._ranges.items():
            for end in ends:
                overridden(self.device, {key: end}, "randomise")
        self._grids = self._options_grids()
        usual = assemble(self.device, options, interval)
        self.rigs: list[Assembly] = [usual]
        """The usual one, then those that have been drawn; all on the usual one's model, which is kept but once."""
        corners = [self._assembled(both) for both in zip(*((g[0], g[-1]) for g in self._grids.values()), strict=True)]
        self._drawn = [n for n in MODEL_FIELDS if any(_differs(n, usual.model, rig.model) for rig in corners)]
        self.changing = [*self._drawn, *([ROW] if self._ranges else [])]
        """Fields of the model that differ from episode to episode."""
        self._fields: list[dict[str, Any]] = [self._own(usual.model)]
        self._numbers: dict[tuple[float, ...], int] = {}

    def draw(self, random: np.random.Generator) -> Episode:
        """An episode; draws nothing where nothing is to be drawn."""
        told, number, parameters = {}, 0, self.device.parameters
        if self._grids:
            places = [float(grid[random.integers(GRID)]) for grid in self._grids.values()]
            number, told = self._rig(tuple(places)), dict(zip(self._grids, places, strict=True))
        if self._ranges:
            changes = {key: float(random.uniform(*ends)) for key, ends in self._ranges.items()}
            parameters = overridden(self.device, changes, "randomise").parameters
            told |= changes
        return Episode(number, parameters, told)

    def value(self, episode: Episode, name: str) -> Any:
        """What the model's field ``name`` is in ``episode``."""
        if name != ROW:
            return self._fields[episode.number][name]
        rows = self.rigs[0].model.actuator_user.copy()
        rows[self.rigs[0].actuator.id, :SIZE] = pack(episode.parameters)
        return rows

    def cast(self, episode: Episode, model: mujoco.MjModel) -> Assembly:
        """The rig of ``episode`` on ``model``, a copy of the usual one's that is changed to it."""
        for name in self.changing:
            _field(model, name)[:] = self.value(episode, name)
        return replace(self.rigs[episode.number], model=model, actuator=DeviceActuator(model, ANKLE + "muscle_tendon"))

    def _rig(self, places: tuple[float, ...]) -> int:
        if places not in self._numbers:
            rig = self._assembled(places)
            self._fields.append(self._own(rig.model))
            self.rigs.append(replace(rig, model=self.rigs[0].model, actuator=self.rigs[0].actuator))
            self._numbers[places] = len(self.rigs) - 1
        return self._numbers[places]

    def _assembled(self, places: tuple[float, ...]) -> Assembly:
        drawn, usual = dict(zip(self._grids, places, strict=True)), self._options
        options = replace(
            usual,
            mass=drawn.get("mass_kg", usual.mass),
            speed=drawn.get("speed_m_per_s", usual.speed),
            slope=np.radians(drawn["slope_deg"]) if "slope_deg" in drawn else usual.slope,
        )
        return assemble(self.device, options, self._interval)

    def _own(self, model: mujoco.MjModel) -> dict[str, Any]:
        return {name: np.array(_field(model, name)) for name in self._drawn}

    def _options_grids(self) -> dict[str, np.ndarray]:
        asked, mass = self._randomise, self._options.mass
        ends: dict[str, Range | None] = {
            "mass_kg": (mass * (1.0 - asked.mass_share), mass * (1.0 + asked.mass_share)) if asked.mass_share else None,
            "speed_m_per_s": asked.speed_m_per_s,
            "slope_deg": asked.slope_deg,
        }
        return {name: np.linspace(*both, GRID) for name, both in ends.items() if both is not None}

    def _device_ranges(self) -> dict[str, Range]:
        numbers, found = self.device.spec.numbers(), {}
        may = [key for key, value in numbers.items() if isinstance(value, float) and not key.startswith("mounting.")]
        for key, share in self._randomise.device.items():
            if key not in may:
                raise InputError(f"randomise cannot vary '{key}' of '{self.device.name}'; allowed: {', '.join(may)}")
            found[key] = (numbers[key] * (1.0 - share), numbers[key] * (1.0 + share))
        for effect, content in self._randomise.effects.items():
            drawn = {key: value for key, value in content.items() if key != "form"}
            found |= {f"effects.{effect}.{key}": _range(key, value) for key, value in drawn.items()}
        return found


def with_effects(device: Device, effects: Mapping[str, Mapping[str, Any]]) -> Device:
    """``device`` with ``effects`` (name -> parameter -> range) in the middle of their ranges.

    Raises InputError for what no such effect has, or the device cannot have.
    """
    if not effects:
        return device
    keys = tomllib.loads(device.content.decode("utf-8-sig"))
    for name, content in effects.items():
        if catalogue.form_of(name, None)[0].kind == "body":
            raise InputError(f"effect '{name}' is of the body, and only the device differs between episodes")
        catalogue.form_of(name, content.get("form"))
        middle = {key: value if key == "form" else 0.5 * sum(_range(key, value)) for key, value in content.items()}
        keys.setdefault("effects", {})[name] = keys.get("effects", {}).get(name, {}) | middle
    return Device(parse(keys, f"{device.name}, with effects to randomise"), to_toml(keys).encode())


def _field(model: mujoco.MjModel, name: str) -> Any:
    owner: Any = model
    for part in name.split("."):
        owner = getattr(owner, part)
    return owner


def _differs(name: str, one: mujoco.MjModel, other: mujoco.MjModel) -> bool:
    return not np.array_equal(_field(one, name), _field(other, name))
