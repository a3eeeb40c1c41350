"""The mechanism of a dataset: the MJCF model, the devices on its tendons, and the numbers that differ from its file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco

from klute_sim.datasets.channels import MechanismChannels
from klute_sim.datasets.format import DatasetFile
from klute_sim.datasets.mechanism_channels import (
    QUANTITIES,
    normalize_name,
    parse_channel,
    parse_input_channel,
    parse_output_channel,
)
from klute_sim.device.device import Device, list_presets, load_device
from klute_sim.errors import InputError, suggest
from klute_sim.plant.callbacks import compile_model
from klute_sim.plant.mjcf.model_effects import JOINT_TYPES
from klute_sim.plant.mjcf.model_file import MODEL_NAMES, ModelFile, load_model_file
from klute_sim.plant.mjcf.model_numbers import PREFIX, collect_model_numbers, set_model_numbers, suggest_number
from klute_sim.units import split_unit

DEVICE_SEPARATOR = "/"
"""Separator of tendon and ``section.key`` in the name of a number of one device, such as ``flexor/muscle.c10_kpa``."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DatasetMechanism:
    """Mechanism that the trials of a dataset were recorded on."""

    file: ModelFile
    """MJCF file."""
    channels: MechanismChannels
    """Channels that the dataset names."""
    devices: Mapping[str, Device]
    """Tendon -> device."""
    shares_device: frozenset[str]
    """Tendons whose device is that of the dataset, with or without stated changes; the others have their own file."""
    numbers: Mapping[str, float]
    """Numbers of the model that differ from its file."""
    model_values: Mapping[str, float]
    """All numbers of the model, with these changes."""

    def compile_model(self, numbers: Mapping[str, float]) -> mujoco.MjModel | None:
        """Return the model with the ``numbers`` that differ from its file; None if MuJoCo cannot compile it.

        The preparation of a trial reports numbers that no model can have.
        """
        spec = self.file.make_spec()
        set_model_numbers(spec, numbers)
        try:
            return compile_model(spec)
        except ValueError:
            return None

    def change_devices(self, changes: Mapping[str, float], place: str) -> dict[str, Device]:
        """Return tendon -> device with ``changes`` of ``section.key`` of all, or of ``tendon/section.key`` of one.

        Raises InputError, which begins with ``place``, for a tendon without a device and for a number that a device
        lacks.
        """
        tendon_numbers: dict[str, dict[str, float]] = {tendon: {} for tendon in self.devices}
        for name, value in changes.items():
            tendon, separator, key = name.rpartition(DEVICE_SEPARATOR)
            if separator and tendon not in tendon_numbers:
                listing = f"the devices are on: {', '.join(tendon_numbers)}"
                raise InputError(f"{place}: '{name}' names no device; {suggest(tendon, tendon_numbers, listing)}")
            if separator:
                tendon_numbers[tendon][key] = value
        shared = select_shared(changes)
        return {
            tendon: self.devices[tendon].with_changes({**shared, **tendon_numbers[tendon]}, place)
            for tendon in tendon_numbers
        }

    def collect_nominal_numbers(self) -> dict[str, float]:
        """Return the numbers of the model and of each single device, by the names that ``[uncertain]`` uses."""
        device_numbers = {
            f"{tendon}{DEVICE_SEPARATOR}{key}": value
            for tendon, device in self.devices.items()
            for key, value in device.spec.collect_values().items()
        }
        return {**self.model_values, **device_numbers}


def load_dataset_mechanism(file: DatasetFile, folder: Path, device: Device, source: str) -> DatasetMechanism | None:
    """Return the mechanism that ``file`` declares; None on another rig.

    ``device`` is the device of the dataset, ``source`` names the file in errors. Raises InputError for channels,
    devices or numbers that the model or the rig does not have.
    """
    if file.rig != "mjcf":
        for key in ("model", "prescribed", "measured", "devices", "numbers"):
            if getattr(file, key):
                raise InputError(f"{source}: '{key}' is for rig = 'mjcf'; remove it, or change the rig")
        return None
    for key in ("model", "prescribed", "measured"):
        if not getattr(file, key):
            raise InputError(f"{source}: rig = 'mjcf' needs the key '{key}' (see docs/datasets.md)")
    for name in (*file.prescribed, *file.measured):
        if [*file.prescribed, *file.measured].count(name) > 1:
            raise InputError(f"{source}: the channel '{name}' is named twice; a channel is prescribed or measured")
    try:
        channels = MechanismChannels(
            tuple(parse_input_channel(name).name for name in file.prescribed),
            tuple(parse_output_channel(name).name for name in file.measured),
        )
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    model = str(file.model)
    model_file = load_model_file(model if model in MODEL_NAMES else folder / model)
    spec = model_file.make_spec()
    tendons = [tendon.name for tendon in spec.tendons if tendon.name]
    devices = {}
    for tendon in file.devices or tendons:
        if tendon not in tendons:
            listing = f"the tendons are: {', '.join(tendons) or 'none'}"
            raise InputError(f"{source}: [devices] names the tendon '{tendon}'; {suggest(tendon, tendons, listing)}")
        devices[tendon] = _load_tendon_device(file, tendon, folder, device, source)
    if not devices:
        raise InputError(f"{source}: no tendon of {model_file.path} has a name, so none can carry a device")
    _check_objects(channels, spec, tendons, list(devices), source)
    known = collect_model_numbers(spec)
    return DatasetMechanism(
        file=model_file,
        channels=channels,
        devices=devices,
        shares_device=frozenset(t for t in devices if t not in file.devices or file.devices[t].device is None),
        numbers=check_model_numbers(file.numbers, known, f"{source}: [numbers]"),
        model_values={**known, **file.numbers},
    )


def _check_objects(
    channels: MechanismChannels, spec: mujoco.MjSpec, tendons: Sequence[str], devices: Sequence[str], source: str
) -> None:
    """Raise InputError for a channel whose joint, site or device the model lacks, and for a device without pressure."""
    names: dict[str, Sequence[str]] = {
        "device": devices,
        "site": [site.name for site in spec.sites],
        **{
            kind: [joint.name for joint in spec.joints if joint.type == kind_type]
            for kind, kind_type in JOINT_TYPES.items()
        },
    }
    parsed = [parse_channel(name) for name in (*channels.prescribed, *channels.measured)]
    for channel in parsed:
        kind = QUANTITIES[channel.quantity].object_kind
        existing = [normalize_name(name) for name in names.get(kind, ()) if name]
        if kind not in names or channel.object_name in existing:
            continue
        idle = [tendon for tendon in tendons if normalize_name(tendon) == channel.object_name]
        if kind == "device" and idle:
            raise InputError(
                f"{source}: the channel '{channel.name}' belongs to the tendon '{idle[0]}', which has no device, "
                f"because [devices] names only {', '.join(devices)}; add a table [devices.{idle[0]}], which may be "
                "empty for the device of the dataset"
            )
        listing = f"there are: {', '.join(existing)}" if existing else "the model has none"
        raise InputError(
            f"{source}: the channel '{channel.name}' belongs to no {kind}; "
            f"{suggest(channel.object_name, existing, listing)}"
        )
    driven = {
        c.object_name for c in parsed[: len(channels.prescribed)] if c.quantity in ("pressure", "pressure_command")
    }
    for tendon in map(normalize_name, devices):
        if tendon not in driven:
            raise InputError(
                f"{source}: device '{tendon}' has no pressure; prescribe pressure_command_{tendon} or "
                f"pressure_{tendon} (measured in the muscle)"
            )


def _load_tendon_device(file: DatasetFile, tendon: str, folder: Path, shared: Device, source: str) -> Device:
    entry = file.devices.get(tendon)
    if entry is None:
        return shared
    base = shared
    if entry.device is not None:
        base = load_device(entry.device if entry.device in list_presets() else folder / entry.device)
        if file.diameter is not None and base.spec.muscle is not None:
            raise InputError(
                f"{source}: [diameter] scales the muscle of the dataset's device, but [devices.{tendon}] names a "
                "device with a muscle of its own; write device files for the diameters of the trials, and remove "
                "[diameter]"
            )
    return base.with_changes(entry.changes, f"{source}: [devices.{tendon}] changes")


def check_model_numbers(numbers: Mapping[str, float], known: Mapping[str, float], place: str) -> dict[str, float]:
    """Return ``numbers`` of the model; raise InputError, which begins with ``place``, for one that it lacks."""
    for name in numbers:
        if name not in known:
            raise InputError(f"{place}: '{name}' is not a number of the model; {suggest_number(name, known)}")
    return {name: float(value) for name, value in numbers.items()}


def select_shared(changes: Mapping[str, float]) -> dict[str, float]:
    """Return those of the ``changes`` of devices that are not of the device on one tendon."""
    return {name: value for name, value in changes.items() if DEVICE_SEPARATOR not in name}


COORDINATE_PREFIXES = ("pos_", "ipos_", "springref")
"""Beginnings of the names of a model's numbers whose zero is arbitrary."""
SIGNED_PREFIXES = (*COORDINATE_PREFIXES, "gravity_")
"""Beginnings of the names of a model's numbers that may have either sign."""


def is_model_number(name: str) -> bool:
    """Return whether ``name`` is that of a number of a model."""
    return name.startswith(PREFIX)


def has_arbitrary_zero(name: str) -> bool:
    """Return whether the zero of the number ``name`` is arbitrary: a coordinate of a model, or a temperature in °C."""
    key = name.rpartition(".")[2]
    return split_unit(key)[1] == "°C" or (is_model_number(name) and key.startswith(COORDINATE_PREFIXES))


def carry_error(name: str, declared: float, corrected: float, other: float) -> float:
    """Return ``other``, a value of the number ``name``, with the error for which ``declared`` became ``corrected``.

    The relative error is the same; where the zero of the number is arbitrary, or ``declared`` is 0, the absolute one.
    All values are in the unit of the number.
    """
    if declared == 0.0 or has_arbitrary_zero(name):
        return other + corrected - declared
    return other * (corrected / declared)  # exactly the other value where nothing is corrected
