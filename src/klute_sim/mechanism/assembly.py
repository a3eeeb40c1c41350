"""A mechanism: an MJCF model with devices on its tendons, and the objects that its channels belong to."""

import copy
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import mujoco
import numpy as np

from klute_sim.datasets.mechanism_channels import QUANTITIES, Channel, normalize_name, parse_channel
from klute_sim.device.backend.packing import ROW_SIZE, pack_parameters
from klute_sim.device.dynamics import DeviceParameters, has_internal_state
from klute_sim.errors import InputError, suggest
from klute_sim.mechanism import drives
from klute_sim.plant import models
from klute_sim.plant.callbacks import compile_model
from klute_sim.plant.coupling import N_BASE_STATES
from klute_sim.plant.mjcf.model_effects import JOINT_TYPES, ModelEffect, apply_model_effects
from klute_sim.plant.mjcf.model_file import ModelFile, describe_model_error
from klute_sim.plant.mjcf.model_numbers import set_model_numbers
from klute_sim.types import Array

SENSOR_TYPES = {
    "sensor_force": (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_ACTUATORFRC, mujoco.mjtSensor.mjSENS_TOUCH),
    "sensor_moment": (mujoco.mjtSensor.mjSENS_TORQUE, mujoco.mjtSensor.mjSENS_JOINTACTFRC),
    "sensor_angle": (mujoco.mjtSensor.mjSENS_JOINTPOS,),
    "sensor_position": (mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtSensor.mjSENS_TENDONPOS),
}
"""Quantity -> types of sensors that measure it."""
SENSOR_AXES = ("_x", "_y", "_z")
"""Endings of a channel that belongs to one component of a sensor."""
MAX_CACHED_MODELS = 16
"""Compiled models kept in memory: those of the experiments and points that run at once."""


class Binding(NamedTuple):
    """A channel and the object that it belongs to."""

    channel: Channel
    """The channel."""
    name: str
    """Name of the object in the model."""
    component: int = 0
    """Component of a sensor with several."""


@dataclass(frozen=True)
class Mechanism:
    """An MJCF model whose tendons carry devices, with the channels that are prescribed.

    Mechanisms with the same file, devices and channels are equal and share compiled models.

    Raises InputError on construction when a device has no tendon, or a prescribed channel has no object, two channels
    prescribe the same motion or pressure, or a device has neither a commanded nor a prescribed pressure.
    """

    file: ModelFile
    """The MJCF file."""
    device_names: tuple[str, ...]
    """Names of the devices, which are those of their tendons."""
    prescribed: tuple[str, ...]
    """Prescribed channels."""
    bindings: Mapping[str, Binding] = field(init=False, repr=False, compare=False)
    """Prescribed channel -> object."""

    def __post_init__(self) -> None:
        """Bind the prescribed channels."""
        tendons = [tendon.name for tendon in self.spec.tendons if tendon.name]
        for name in self.device_names:
            if name not in tendons:
                listing = f"the tendons of {self.file.path} are: {', '.join(tendons) or 'none'}"
                raise InputError(f"the device '{name}' has no tendon; {suggest(name, tendons, listing)}")
        if not self.device_names:
            raise InputError(f"{self.file.path}: no tendon has a device; name at least one of: {', '.join(tendons)}")
        bindings: dict[str, Binding] = {}
        owners: dict[tuple[str, bool], str] = {}
        for name in self.prescribed:
            binding = self.bind(parse_channel(name))
            # A joint either follows a motion or carries a load; a device has one source of pressure.
            owner = binding.name, QUANTITIES[binding.channel.quantity].object_kind == "device"
            if owner in owners:
                raise InputError(f"'{owners[owner]}' and '{name}' cannot both be prescribed; remove one of them")
            owners[owner] = name
            bindings[name] = binding
        for device in self.device_names:
            if (device, True) not in owners:
                object_name = normalize_name(device)
                raise InputError(
                    f"device '{device}' has no pressure; prescribe pressure_command_{object_name} or "
                    f"pressure_{object_name} (measured in the muscle)"
                )
        object.__setattr__(self, "bindings", bindings)

    @cached_property
    def spec(self) -> mujoco.MjSpec:
        """The model of the file; copies of it are edited, never the model itself."""
        return self.file.make_spec()

    @property
    def driven_joints(self) -> tuple[str, ...]:
        """Joints whose motion is prescribed."""
        return tuple(b.name for b in self.bindings.values() if b.channel.quantity in ("angle", "position"))

    def bind(self, channel: Channel) -> Binding:
        """Return the object of ``channel``; raises InputError when the model has no such object."""
        candidates = dict(self._list_objects(channel))
        if channel.object_name not in candidates:
            kind = QUANTITIES[channel.quantity].object_kind
            listing = f"there are: {', '.join(candidates)}" if candidates else f"{self.file.path} has none"
            raise InputError(
                f"the channel '{channel.name}' belongs to no {kind}; "
                f"{suggest(channel.object_name, candidates, listing)}"
            )
        return candidates[channel.object_name]

    def _list_objects(self, channel: Channel) -> Iterable[tuple[str, Binding]]:
        kind = QUANTITIES[channel.quantity].object_kind
        if kind == "device":
            names: list[str] = list(self.device_names)
        elif kind == "site":
            names = [site.name for site in self.spec.sites]
        elif kind == "sensor":
            yield from self._list_sensors(channel)
            return
        else:
            names = [joint.name for joint in self.spec.joints if joint.type == JOINT_TYPES[kind]]
        for name in filter(None, names):
            yield normalize_name(name), Binding(channel, name)

    def _list_sensors(self, channel: Channel) -> Iterable[tuple[str, Binding]]:
        for sensor in self.spec.sensors:
            if sensor.name and sensor.type in SENSOR_TYPES[channel.quantity]:
                has_axes = sensor.type in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE)
                for index, axis in enumerate(SENSOR_AXES if has_axes else ("",)):
                    yield normalize_name(sensor.name) + axis, Binding(channel, sensor.name, index)

    def compile(
        self,
        devices: Mapping[str, DeviceParameters],
        numbers: Mapping[str, float],
        dt: float,
        effects: Sequence[ModelEffect] = (),
        *,
        with_textures: bool = True,
    ) -> mujoco.MjModel:
        """Return the model with ``devices`` (name -> parameters), changed ``numbers`` and the time step ``dt`` [s].

        ``effects`` are those of the mechanism. Without textures, which only a renderer needs, small models compile some
        ten times faster. The model is the caller's own; trials that differ in their inputs, or in
        parameters of devices with an elastic tendon, are compiled once. Raises InputError when a number or a part is
        unknown, or the model cannot be compiled with them.
        """
        mounted = tuple(_MountedDevice.mount(name, parameters) for name, parameters in devices.items())
        model = copy.copy(_compile(self, mounted, tuple(numbers.items()), dt, tuple(effects), with_textures))
        for name, parameters in devices.items():
            actuator = model.actuator(self.find_actuator(model, name)).id
            model.actuator_user[actuator, :ROW_SIZE] = pack_parameters(parameters)
        return model

    def find_actuator(self, model: mujoco.MjModel, device: str) -> str:
        """Return the name of the actuator of ``device`` in a compiled ``model``."""
        tendon = model.tendon(device).id
        for index in range(model.nactuator):
            is_tendon = model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_TENDON
            if is_tendon and model.actuator_trnid[index, 0] == tendon:
                return str(model.actuator(index).name)
        raise InputError(f"the model has no actuator on tendon '{device}'")


@dataclass(frozen=True)
class _MountedDevice:
    """A device on its tendon. Two are equal if the compiled models differ in their rows of parameters only."""

    name: str
    """Name of the device."""
    structure: DeviceParameters | bool
    """Whether the device has internal states; on a rigid tie, whose damper and stop are part of the model, its
    parameters."""
    parameters: DeviceParameters = field(compare=False)
    """Parameters."""

    @classmethod
    def mount(cls, name: str, parameters: DeviceParameters) -> "_MountedDevice":
        """Return the device ``name`` with ``parameters``."""
        return cls(name, parameters if parameters.tendon.is_rigid else has_internal_state(parameters), parameters)


@lru_cache(MAX_CACHED_MODELS)
def _compile(
    mechanism: Mechanism,
    devices: tuple[_MountedDevice, ...],
    numbers: tuple[tuple[str, float], ...],
    dt: float,
    effects: tuple[ModelEffect, ...],
    with_textures: bool,
) -> mujoco.MjModel:
    """Return the model that :meth:`Mechanism.compile` copies; its devices have the structure of ``devices``."""
    spec = mechanism.spec.copy()
    set_model_numbers(spec, dict(numbers))
    apply_model_effects(spec, effects)
    spec.option.timestep = dt
    if not with_textures:
        _remove_textures(spec)
    actuators = {prepare_actuator(spec, device.name): device.parameters for device in devices}
    for device in devices:
        _stop_at_resting_length(spec.tendon(device.name), device.parameters)
    for binding in mechanism.bindings.values():
        if binding.channel.quantity in ("angle", "position"):
            drives.add_drive(spec, spec.joint(binding.name))
        elif binding.channel.quantity.startswith("external"):
            drives.add_load(spec, spec.joint(binding.name))
    with _report_compilation(mechanism):
        return models.attach_devices(spec, actuators)


@contextmanager
def _report_compilation(mechanism: Mechanism) -> Iterator[None]:
    """Raise InputError where MuJoCo cannot compile the model, whose file alone it can compile."""
    try:
        yield
    except ValueError as error:
        raise InputError(
            f"the model {mechanism.file.path} cannot be compiled with its changed numbers "
            f"({describe_model_error(error)}); correct them"
        ) from None


def _remove_textures(spec: mujoco.MjSpec) -> None:
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)


def prepare_actuator(spec: mujoco.MjSpec, device: str) -> str:
    """Return the name of the actuator on the tendon of ``device``; it is added where there is none."""
    user_bias = mujoco.mjtBias.mjBIAS_USER
    for actuator in spec.actuators:
        if actuator.target == device and actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
            if actuator.biastype == user_bias:
                return str(actuator.name)
            raise InputError(
                f"tendon '{device}' carries the actuator '{actuator.name}' of MuJoCo beside a device; remove it"
            )
    actuator = spec.add_actuator(name=device, target=device, trntype=mujoco.mjtTrn.mjTRN_TENDON)
    actuator.dyntype, actuator.biastype = mujoco.mjtDyn.mjDYN_USER, user_bias
    actuator.gaintype, actuator.actdim = mujoco.mjtGain.mjGAIN_FIXED, N_BASE_STATES
    actuator.gainprm[0] = 0.0
    return device


def _stop_at_resting_length(tendon: mujoco.MjsTendon, parameters: DeviceParameters) -> None:
    """Let ``tendon`` end at the resting length of a muscle on a rigid tie, beyond which its braid does not stretch."""
    if parameters.tendon.is_rigid and tendon.limited != mujoco.mjtLimited.mjLIMITED_TRUE and not any(tendon.range):
        tendon.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        tendon.range = [0.0, parameters.tendon.slack_length + parameters.muscle.resting_length]


def compute_unit_lengths(
    mechanism: Mechanism, numbers: Mapping[str, float], positions: Mapping[str, Array]
) -> dict[str, Array]:
    """Return tendon -> length [m] at joint ``positions`` (joint -> m or rad, one value per sample).

    Other joints stay where the model has them; ``numbers`` changes numbers of the model. Raises InputError when the
    model cannot be compiled with them.
    """
    spec = mechanism.spec.copy()
    set_model_numbers(spec, numbers)
    with _report_compilation(mechanism):
        model = compile_model(spec)
    data = mujoco.MjData(model)
    tendons = {name: model.tendon(name).id for name in mechanism.device_names}
    n_samples = max((len(values) for values in positions.values()), default=1)
    lengths = {name: np.empty(n_samples) for name in tendons}
    addresses = {name: int(model.joint(name).qposadr[0]) for name in positions}
    for k in range(n_samples):
        for name, values in positions.items():
            data.qpos[addresses[name]] = values[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        for name, index in tendons.items():
            lengths[name][k] = data.ten_length[index]
    return lengths
