"""Domain randomisation of a joint between two devices: its load, and the numbers and effects of each device.

The parameters of a device are a row of the model that is rewritten at each reset. The load changes masses and inertias,
which MuJoCo derives when it compiles a model, so it is drawn from a grid of models, whose different fields are copied.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS

from klute_sim.device.backend.packing import ROW_SIZE, pack_parameters
from klute_sim.device.device import Device
from klute_sim.envs.tasks.device_ranges import (
    GRID_SIZE,
    PARAMETER_FIELD,
    DeviceRanges,
    Range,
    add_mean_effects,
    build_parameter_ranges,
    parse_range,
    sample_device,
)
from klute_sim.errors import InputError
from klute_sim.plant.batch import get_model_field, model_fields_differ

CompileModel = Callable[[Mapping[str, Device], float | None], mujoco.MjModel]
"""Returns the model with the devices (tendon -> device) and the load [kg] (None: that of the model)."""


@dataclass(frozen=True, kw_only=True)
class JointRanges(DeviceRanges):
    """Ranges of the load and of both devices, each of which draws for itself."""

    load_kg: Range | None = None
    """Lowest and highest mass at the end of the lever [kg]."""

    def __post_init__(self) -> None:
        """Raise InputError when a range is invalid."""
        super().__post_init__()
        if self.load_kg is not None:
            object.__setattr__(self, "load_kg", parse_range("load_kg", self.load_kg))


class JointRandomizer:
    """Sampler of the episodes of one joint."""

    def __init__(
        self, devices: Mapping[str, Device], ranges: JointRanges, load: float | None, compile_model: CompileModel
    ) -> None:
        """Set up the sampler with the nominal ``devices`` (tendon -> device) and ``load`` [kg].

        Raises InputError when a device does not support a range throughout.
        """
        self.devices = {name: add_mean_effects(device, ranges.effects) for name, device in devices.items()}
        """Nominal devices, with the randomised effects at the middle of their ranges."""
        self._parameter_ranges = {name: build_parameter_ranges(device, ranges) for name, device in self.devices.items()}
        has_device_ranges = any(self._parameter_ranges.values())
        for name, device in self.devices.items():
            if has_device_ranges and device.parameters.tendon.is_rigid:
                raise InputError(
                    f"domain_randomization cannot vary the device '{device.name}' of the tendon '{name}': its damper "
                    "is part of the model, because its tendon is rigid; allowed: load_kg"
                )
        self.model = compile_model(self.devices, load)
        """Model with the nominal devices and load."""
        self._loads = np.empty(0) if ranges.load_kg is None else np.linspace(*ranges.load_kg, GRID_SIZE)
        models = [compile_model(self.devices, float(mass)) for mass in self._loads]
        load_fields = [
            name for name in MODEL_FIELDS if any(model_fields_differ(name, self.model, other) for other in models)
        ]
        self._load_values = [{name: np.array(get_model_field(other, name)) for name in load_fields} for other in models]
        self.varying_fields = [*load_fields, *([PARAMETER_FIELD] if has_device_ranges else [])]
        """Model fields that differ between episodes."""

    def draw(
        self, model: mujoco.MjModel, actuator_ids: Mapping[str, int], rng: np.random.Generator
    ) -> dict[str, float]:
        """Change ``model``, a copy of the nominal one, to that of an episode; return the sampled values.

        Their names have units. ``actuator_ids`` maps tendons to the actuators of the model. Without ranges no random
        number is generated.
        """
        sampled: dict[str, float] = {}
        if len(self._loads):
            index = int(rng.integers(GRID_SIZE))
            sampled["load_kg"] = float(self._loads[index])
            for name, value in self._load_values[index].items():
                get_model_field(model, name)[:] = value
        for tendon, parameter_ranges in self._parameter_ranges.items():
            if parameter_ranges:
                parameters, numbers = sample_device(self.devices[tendon], parameter_ranges, rng)
                model.actuator_user[actuator_ids[tendon], :ROW_SIZE] = pack_parameters(parameters)
                sampled |= {f"{tendon}/{key}": value for key, value in numbers.items()}
        return sampled
