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

from klute_sim.device.backend.packing import ROW_SIZE, pack_parameters
from klute_sim.device.changes import apply_changes, to_toml
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.schema.document import parse_device_spec
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.rig.setup import GaitOptions, GaitRig, build_gait_rig
from klute_sim.plant.actuator import DeviceActuator

GRID_SIZE = 9
"""Values of mass, speed and slope each, the ends of their ranges among them."""
MAX_VARIATION_FRACTION = 0.5
"""Of a number, by which it may be randomised."""
PARAMETER_FIELD = "actuator_user"
"""Where a model keeps its devices' parameters."""

Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class RandomisationRanges:
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
            if not 0.0 <= share <= MAX_VARIATION_FRACTION:
                raise InputError(
                    f"randomise varies {name} by a share of {share:g}; allowed: 0 to {MAX_VARIATION_FRACTION:g}"
                )
        for name in ("speed_m_per_s", "slope_deg"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _parse_range(name, getattr(self, name)))
        for effect, content in self.effects.items():
            for key, value in content.items():
                if key != "form":
                    _parse_range(f"effects.{effect}.{key}", value)

    @classmethod
    def from_mapping(cls, ranges: "RandomisationRanges | Mapping[str, Any] | None") -> "RandomisationRanges":
        """The ranges that a mapping of these names describes; raises InputError for another name."""
        if isinstance(ranges, RandomisationRanges):
            return ranges
        known = [each.name for each in fields(cls)]
        for name in ranges or {}:
            if name not in known:
                raise InputError(f"randomise has no '{name}'; allowed: {', '.join(known)}")
        return cls(**(ranges or {}))


def _parse_range(name: str, value: Any) -> Range:
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

    rig_index: int
    """Of its rig, among those of :class:`Casting`."""
    parameters: DeviceParameters
    drawn_values: Mapping[str, float]
    """What was drawn, keys with units."""


class DomainRandomiser:
    """Draws episodes of one device and walker."""

    def __init__(self, device: Device, options: GaitOptions, randomise: RandomisationRanges, interval: float) -> None:
        """Raises InputError for a range that the device or the rig cannot have throughout."""
        self._randomisation, self._options, self._interval = randomise, options, interval
        self.device = add_mean_effects(device, randomise.effects)
        """The usual device, with the effects that are randomised in the middle of their ranges."""
        self._parameter_ranges = self._build_parameter_ranges()
        for key, ends in self._parameter_ranges.items():
            for end in ends:
                apply_changes(self.device, {key: end}, "randomise")
        self._option_grids = self._build_option_grids()
        usual = build_gait_rig(self.device, options, interval)
        self.gait_rigs: list[GaitRig] = [usual]
        """The usual one, then those that have been drawn; all on the usual one's model, which is kept but once."""
        corners = [
            self._assemble_rig(both) for both in zip(*((g[0], g[-1]) for g in self._option_grids.values()), strict=True)
        ]
        self._rig_fields = [
            n for n in MODEL_FIELDS if any(_model_fields_differ(n, usual.model, rig.model) for rig in corners)
        ]
        self.varying_fields = [*self._rig_fields, *([PARAMETER_FIELD] if self._parameter_ranges else [])]
        """Fields of the model that differ from episode to episode."""
        self._rig_field_values: list[dict[str, Any]] = [self._copy_rig_fields(usual.model)]
        self._rig_indices: dict[tuple[float, ...], int] = {}

    def sample(self, rng: np.random.Generator) -> Episode:
        """An episode; draws nothing where nothing is to be drawn."""
        told, number, parameters = {}, 0, self.device.parameters
        if self._option_grids:
            places = [float(grid[rng.integers(GRID_SIZE)]) for grid in self._option_grids.values()]
            number, told = self._get_rig_index(tuple(places)), dict(zip(self._option_grids, places, strict=True))
        if self._parameter_ranges:
            changes = {key: float(rng.uniform(*ends)) for key, ends in self._parameter_ranges.items()}
            parameters = apply_changes(self.device, changes, "randomise").parameters
            told |= changes
        return Episode(number, parameters, told)

    def field_value(self, episode: Episode, name: str) -> Any:
        """What the model's field ``name`` is in ``episode``."""
        if name != PARAMETER_FIELD:
            return self._rig_field_values[episode.rig_index][name]
        rows = self.gait_rigs[0].model.actuator_user.copy()
        rows[self.gait_rigs[0].actuator.id, :ROW_SIZE] = pack_parameters(episode.parameters)
        return rows

    def apply(self, episode: Episode, model: mujoco.MjModel) -> GaitRig:
        """The rig of ``episode`` on ``model``, a copy of the usual one's that is changed to it."""
        for name in self.varying_fields:
            _get_model_field(model, name)[:] = self.field_value(episode, name)
        return replace(
            self.gait_rigs[episode.rig_index],
            model=model,
            actuator=DeviceActuator(model, PROSTHESIS_PREFIX + "muscle_tendon"),
        )

    def _get_rig_index(self, grid_values: tuple[float, ...]) -> int:
        if grid_values not in self._rig_indices:
            rig = self._assemble_rig(grid_values)
            self._rig_field_values.append(self._copy_rig_fields(rig.model))
            self.gait_rigs.append(replace(rig, model=self.gait_rigs[0].model, actuator=self.gait_rigs[0].actuator))
            self._rig_indices[grid_values] = len(self.gait_rigs) - 1
        return self._rig_indices[grid_values]

    def _assemble_rig(self, grid_values: tuple[float, ...]) -> GaitRig:
        drawn, usual = dict(zip(self._option_grids, grid_values, strict=True)), self._options
        options = replace(
            usual,
            mass=drawn.get("mass_kg", usual.mass),
            speed=drawn.get("speed_m_per_s", usual.speed),
            slope=np.radians(drawn["slope_deg"]) if "slope_deg" in drawn else usual.slope,
        )
        return build_gait_rig(self.device, options, self._interval)

    def _copy_rig_fields(self, model: mujoco.MjModel) -> dict[str, Any]:
        return {name: np.array(_get_model_field(model, name)) for name in self._rig_fields}

    def _build_option_grids(self) -> dict[str, np.ndarray]:
        asked, mass = self._randomisation, self._options.mass
        ends: dict[str, Range | None] = {
            "mass_kg": (mass * (1.0 - asked.mass_share), mass * (1.0 + asked.mass_share)) if asked.mass_share else None,
            "speed_m_per_s": asked.speed_m_per_s,
            "slope_deg": asked.slope_deg,
        }
        return {name: np.linspace(*both, GRID_SIZE) for name, both in ends.items() if both is not None}

    def _build_parameter_ranges(self) -> dict[str, Range]:
        numbers, found = self.device.spec.collect_values(), {}
        may = [key for key, value in numbers.items() if isinstance(value, float) and not key.startswith("mounting.")]
        for key, share in self._randomisation.device.items():
            if key not in may:
                raise InputError(f"randomise cannot vary '{key}' of '{self.device.name}'; allowed: {', '.join(may)}")
            found[key] = (numbers[key] * (1.0 - share), numbers[key] * (1.0 + share))
        for effect, content in self._randomisation.effects.items():
            drawn = {key: value for key, value in content.items() if key != "form"}
            found |= {f"effects.{effect}.{key}": _parse_range(key, value) for key, value in drawn.items()}
        return found


def add_mean_effects(device: Device, effects: Mapping[str, Mapping[str, Any]]) -> Device:
    """``device`` with ``effects`` (name -> parameter -> range) in the middle of their ranges.

    Raises InputError for what no such effect has, or the device cannot have.
    """
    if not effects:
        return device
    keys = tomllib.loads(device.content.decode("utf-8-sig"))
    for name, content in effects.items():
        if catalogue.find_form(name, None)[0].kind == "body":
            raise InputError(f"effect '{name}' is of the body, and only the device differs between episodes")
        catalogue.find_form(name, content.get("form"))
        middle = {
            key: value if key == "form" else 0.5 * sum(_parse_range(key, value)) for key, value in content.items()
        }
        keys.setdefault("effects", {})[name] = keys.get("effects", {}).get(name, {}) | middle
    return Device(parse_device_spec(keys, f"{device.name}, with effects to randomise"), to_toml(keys).encode())


def _get_model_field(model: mujoco.MjModel, name: str) -> Any:
    owner: Any = model
    for part in name.split("."):
        owner = getattr(owner, part)
    return owner


def _model_fields_differ(name: str, first: mujoco.MjModel, second: mujoco.MjModel) -> bool:
    return not np.array_equal(_get_model_field(first, name), _get_model_field(second, name))
