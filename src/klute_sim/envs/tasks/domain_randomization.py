"""Domain randomisation: sampling of subject, ground and device at each reset.

The parameters of the device and its effects are a row of the model that is rewritten at each reset. Mass, speed and
slope require another rig. It is built and cached when it is first sampled, so these three are sampled from a grid. The
models of all rigs have the same shape, so only the fields that differ are copied and nothing is recompiled.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS

from klute_sim.controllers.parse import Controller
from klute_sim.device.backend.packing import ROW_SIZE, pack_parameters
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.envs.tasks.device_ranges import (
    GRID_SIZE,
    PARAMETER_FIELD,
    DeviceRanges,
    Range,
    add_mean_effects,
    build_parameter_ranges,
    check_fraction,
    parse_range,
    sample_device,
)
from klute_sim.errors import InputError
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.rig.learning import prepare_gait_rig
from klute_sim.gait.rig.setup import GaitOptions, GaitRig, build_gait_rig
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.batch import get_model_field, model_fields_differ

SPEED_LIMITS_M_PER_S = (0.4, 2.5)
"""Lowest and highest walking speed of the gait rig [m/s], to which a range in fractions of the speed is limited."""


@dataclass(frozen=True, kw_only=True)
class RandomizationRanges(DeviceRanges):
    """Ranges of subject, ground and device; an absent range keeps the nominal value."""

    mass_fraction: float = 0.0
    """Largest relative deviation of the body mass."""
    speed_m_per_s: Range | None = None
    """Lowest and highest walking speed [m/s]."""
    speed_fraction: Range | None = None
    """Lowest and highest walking speed relative to the nominal one [1], in place of ``speed_m_per_s``."""
    slope_deg: Range | None = None
    """Lowest and highest slope of the ground [deg], positive uphill."""

    def __post_init__(self) -> None:
        """Raise InputError when a range is invalid."""
        super().__post_init__()
        check_fraction("mass_fraction", self.mass_fraction)
        if self.speed_m_per_s is not None and self.speed_fraction is not None:
            raise InputError("domain_randomization has speed_m_per_s and speed_fraction, which exclude each other")
        for name in ("speed_m_per_s", "speed_fraction", "slope_deg"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, parse_range(name, getattr(self, name)))


@dataclass(frozen=True)
class Episode:
    """Sampled rig and device parameters of one episode."""

    rig_index: int
    """Index of the rig in :class:`DomainRandomizer`."""
    parameters: DeviceParameters
    """Parameters of the device."""
    sampled_values: Mapping[str, float]
    """Sampled values; keys include units."""


@dataclass(frozen=True)
class _LearningTask:
    """What a rig learns its path for; tasks with the same ``key`` are equal."""

    key: tuple[Any, ...]
    device: Device = field(compare=False)
    controller: Controller = field(compare=False)
    options: GaitOptions = field(compare=False)


def prepare_options(device: Device, controller: Controller, options: GaitOptions) -> GaitOptions:
    """Return ``options`` with the alignment and the path of the hip that the rig learns for ``controller``.

    A process learns once for all its environments of the same device, controller, subject and ground.

    Raises SimulationError when the carriage leaves its path.
    """
    subject = options.mass, options.stature, options.reference.digest, options.reference.stride_time
    walk = options.speed, options.slope, options.dt, options.alignment, options.learning_strides
    key = device.content, json.dumps(controller.describe(), sort_keys=True), *subject, *walk
    learned = _learn(_LearningTask(key, device, controller, options))
    return replace(options, alignment=learned.alignment, hip_path=learned.hip_path)


@lru_cache(maxsize=1024)
def _learn(task: _LearningTask) -> GaitOptions:
    return prepare_gait_rig(task.device, task.controller, task.options).options


class DomainRandomizer:
    """Sampler of the episodes of one device and subject."""

    def __init__(
        self,
        device: Device,
        controller: Controller,
        options: GaitOptions,
        ranges: RandomizationRanges,
        interval: float,
    ) -> None:
        """Set up the sampler; raises InputError when device or rig do not support a range throughout.

        Each rig learns the path of the hip with ``controller`` on the nominal device.
        """
        self._ranges, self._controller, self._interval = ranges, controller, interval
        self.device = add_mean_effects(device, ranges.effects)
        """Nominal device, with the randomised effects at the middle of their ranges."""
        self._parameter_ranges = build_parameter_ranges(self.device, ranges)
        nominal_options = prepare_options(self.device, controller, options)
        nominal_rig = build_gait_rig(self.device, nominal_options, interval)
        # The prosthesis keeps its alignment; the path of the hip is another one.
        self._options = replace(options, alignment=nominal_options.alignment)
        self._option_grids = self._build_option_grids(nominal_rig.trajectory.speed)
        self.gait_rigs: list[GaitRig] = [nominal_rig]
        """Nominal rig, followed by the sampled rigs; all refer to the model of the nominal rig."""
        corners = [
            build_gait_rig(self.device, self._build_options(grid_ends), interval)
            for grid_ends in zip(*((g[0], g[-1]) for g in self._option_grids.values()), strict=True)
        ]
        self.max_commands_per_stride = max(rig.commands_per_stride for rig in (nominal_rig, *corners))
        """Number of commands in a stride at the lowest walking speed."""
        self._rig_fields = [
            n for n in MODEL_FIELDS if any(model_fields_differ(n, nominal_rig.model, rig.model) for rig in corners)
        ]
        self.varying_fields = [*self._rig_fields, *([PARAMETER_FIELD] if self._parameter_ranges else [])]
        """Model fields that differ between episodes."""
        self._rig_field_values: list[dict[str, Any]] = [self._copy_rig_fields(nominal_rig.model)]
        self._rig_indices: dict[tuple[float, ...], int] = {}

    def sample(self, rng: np.random.Generator) -> Episode:
        """Return an episode; without ranges, no random number is generated."""
        sampled_values, rig_index, parameters = {}, 0, self.device.parameters
        if self._option_grids:
            grid_values = [float(grid[rng.integers(GRID_SIZE)]) for grid in self._option_grids.values()]
            rig_index, sampled_values = (
                self._get_rig_index(tuple(grid_values)),
                dict(zip(self._option_grids, grid_values, strict=True)),
            )
        if self._parameter_ranges:
            parameters, numbers = sample_device(self.device, self._parameter_ranges, rng)
            sampled_values |= numbers
        return Episode(rig_index, parameters, sampled_values)

    def get_field_value(self, episode: Episode, name: str) -> Any:
        """Return the value of the model field ``name`` in ``episode``."""
        if name != PARAMETER_FIELD:
            return self._rig_field_values[episode.rig_index][name]
        rows = self.gait_rigs[0].model.actuator_user.copy()
        rows[self.gait_rigs[0].actuator.id, :ROW_SIZE] = pack_parameters(episode.parameters)
        return rows

    def apply(self, episode: Episode, model: mujoco.MjModel) -> GaitRig:
        """Apply ``episode`` to ``model``, a copy of the nominal model, and return its rig."""
        for name in self.varying_fields:
            get_model_field(model, name)[:] = self.get_field_value(episode, name)
        return replace(
            self.gait_rigs[episode.rig_index],
            model=model,
            actuator=DeviceActuator(model, PROSTHESIS_PREFIX + "muscle_tendon"),
        )

    def _get_rig_index(self, grid_values: tuple[float, ...]) -> int:
        if grid_values not in self._rig_indices:
            options = prepare_options(self.device, self._controller, self._build_options(grid_values))
            rig = build_gait_rig(self.device, options, self._interval)
            self._rig_field_values.append(self._copy_rig_fields(rig.model))
            self.gait_rigs.append(replace(rig, model=self.gait_rigs[0].model, actuator=self.gait_rigs[0].actuator))
            self._rig_indices[grid_values] = len(self.gait_rigs) - 1
        return self._rig_indices[grid_values]

    def _build_options(self, grid_values: tuple[float, ...]) -> GaitOptions:
        values, nominal = dict(zip(self._option_grids, grid_values, strict=True)), self._options
        return replace(
            nominal,
            mass=values.get("mass_kg", nominal.mass),
            speed=values.get("speed_m_per_s", nominal.speed),
            slope=np.radians(values["slope_deg"]) if "slope_deg" in values else nominal.slope,
        )

    def _copy_rig_fields(self, model: mujoco.MjModel) -> dict[str, Any]:
        return {name: np.array(get_model_field(model, name)) for name in self._rig_fields}

    def _build_option_grids(self, nominal_speed: float) -> dict[str, np.ndarray]:
        ranges, mass = self._ranges, self._options.mass
        speeds = ranges.speed_m_per_s
        if ranges.speed_fraction is not None:
            lowest, highest = np.clip(nominal_speed * np.array(ranges.speed_fraction), *SPEED_LIMITS_M_PER_S)
            speeds = (float(lowest), float(highest))
        ranges_by_option: dict[str, Range | None] = {
            "mass_kg": (mass * (1.0 - ranges.mass_fraction), mass * (1.0 + ranges.mass_fraction))
            if ranges.mass_fraction
            else None,
            "speed_m_per_s": speeds,
            "slope_deg": ranges.slope_deg,
        }
        return {name: np.linspace(*ends, GRID_SIZE) for name, ends in ranges_by_option.items() if ends is not None}
