"""C3D files: markers and force plates, read with the library ezc3d (optional extra, imported on use).

:mod:`klute_sim.mocap.formats.force_plates` converts the channels of the plates.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.errors import InputError, MissingExtraError
from klute_sim.files.isolation import run_isolated
from klute_sim.files.json import parse_json
from klute_sim.files.limits import MAX_DECODED_BYTES
from klute_sim.files.npz import parse_npz
from klute_sim.mocap.formats import content, force_plates
from klute_sim.mocap.formats.content import FileContent
from klute_sim.mocap.formats.force_plates import FORCE_UNITS, ForcePlate, RawPlate
from klute_sim.mocap.formats.trc import LENGTH_UNITS, Markers
from klute_sim.types import Array

BLOCK_BYTES = 512
"""Block size of the format [bytes]."""
MAGIC_BYTE = 0x50
"""Second byte of every C3D file."""
MAX_SAMPLES = 16_000_000
"""Largest accepted number of samples."""
MAX_FORCE = 1e6
"""Largest accepted plate force [N]."""
EVENT_LABELS = {
    **dict.fromkeys(("foot strike", "heel strike", "initial contact"), True),
    **dict.fromkeys(("foot off", "toe off"), False),
}
"""Label of an event in lower case -> whether it is a foot strike."""


@dataclass(frozen=True)
class GaitEvent:
    """Foot strike or foot off that a file lists."""

    time: float
    """Time on the clock of the samples [s]."""
    side: str
    """Side of the foot, ``right`` or ``left``; '' if the file does not state it."""
    is_foot_strike: bool
    """Whether it is a foot strike; otherwise a foot off."""


@dataclass(frozen=True, eq=False)
class Capture:
    """Content of a C3D file that the import uses."""

    markers: Markers
    """Marker trajectories."""
    plates: tuple[ForcePlate, ...]
    """Force plates in the order of the file."""
    software: str
    """Name of the program that wrote the file; empty if the file does not state it."""
    events: tuple[GaitEvent, ...] = ()
    """Foot strikes and foot offs of the section EVENT."""


def read(path: str | Path) -> Capture:
    """Read the C3D file at ``path``.

    Raises InputError for an invalid file and MissingExtraError without ezc3d.
    """
    file = content.read(path)
    _check_header(file)
    if find_spec("ezc3d") is None:
        raise MissingExtraError("reading C3D", "c3d")
    archive = run_isolated(
        "klute_sim.mocap.formats.c3d_process", [str(Path(path).absolute())], len(file.data), str(path), "C3D"
    )
    arrays = parse_npz(archive, file.name, MAX_DECODED_BYTES)
    return _build_capture(parse_json(str(arrays["metadata"]), file.name), arrays, file.name)


def _check_header(file: FileContent) -> None:
    """Raise InputError for headers that the library accepts wrongly: not C3D, or frames beyond the end of the file."""
    data = file.data
    if len(data) < 2 * BLOCK_BYTES or data[1] != MAGIC_BYTE:
        raise InputError(f"{file.name} is not a C3D file: its second byte must be 50 (hexadecimal)")
    if len(data) < (data[0] - 1) * BLOCK_BYTES + 4 or data[0] < 2:
        raise InputError(f"{file.name} is truncated: its parameters are missing")
    processor = data[(data[0] - 1) * BLOCK_BYTES + 3] - 83
    if processor not in (1, 2, 3):
        raise InputError(f"{file.name} is not a C3D file: processor type {processor}; allowed are 1, 2 and 3")
    order = ">" if processor == 3 else "<"
    points, analog, first, last = struct.unpack_from(f"{order}4H", data, 2)
    scale = 1.0 if processor == 2 else struct.unpack_from(f"{order}f", data, 12)[0]
    (start,) = struct.unpack_from(f"{order}H", data, 16)
    frames = last - first + 1
    if frames < 2 or start < 2:
        raise InputError(f"{file.name}: frames {first} to {last}; two or more are needed")
    needed = frames * (4 * points + analog) * (4 if scale < 0 else 2)
    if processor != 2 and last < 65535 and (start - 1) * BLOCK_BYTES + needed > len(data):
        raise InputError(
            f"{file.name} is truncated: {frames} frames of {points} markers and {analog} analog samples do not fit"
        )
    if frames * (4 * points + analog) > MAX_SAMPLES:
        raise InputError(f"{file.name} has more than {MAX_SAMPLES} samples")


def _build_capture(metadata: Mapping[str, Any], arrays: Mapping[str, Array], file_name: str) -> Capture:
    unit, rate = metadata["unit"] or "mm", float(metadata["rate"])
    if unit.lower() not in LENGTH_UNITS:
        raise InputError(f"{file_name}: markers are in {unit[:20]!r}; allowed: {', '.join(LENGTH_UNITS)}")
    if not 1.0 <= rate <= 100_000.0:
        raise InputError(f"{file_name}: markers at {rate:g} Hz; allowed are 1 to 100000 Hz")
    analog_rate = float(metadata["analog_rate"])
    if metadata["plates"] and not rate <= analog_rate <= 1e6:
        raise InputError(f"{file_name}: force plates at {analog_rate:g} Hz; allowed are {rate:g} to 1000000 Hz")
    points = LENGTH_UNITS[unit.lower()] * arrays["points"]
    points[:, (points == 0.0).all(axis=0)] = np.nan  # older files write the origin for a hidden marker
    labels = [label.strip() for label in metadata["labels"]][: points.shape[1]]
    positions = {label: points[:, k].T for k, label in enumerate(labels) if label and not label.startswith("*")}
    plates = _convert_plates(metadata, arrays, LENGTH_UNITS[unit.lower()], file_name)
    time = np.arange(points.shape[2]) / rate
    events = _parse_events(metadata["events"], metadata["first_frame"] / rate, time[-1])
    return Capture(Markers(time, positions), plates, metadata["software"], events)


def _convert_plates(
    metadata: Mapping[str, Any], arrays: Mapping[str, Array], length_unit: float, file_name: str
) -> tuple[ForcePlate, ...]:
    """Return the force plates; ``length_unit`` [m] is that of the markers."""
    force_unit = metadata["force_unit"] or "N"
    if metadata["plates"] and force_unit not in FORCE_UNITS:
        raise InputError(f"{file_name}: force plates in {force_unit[:20]!r}; allowed: {', '.join(FORCE_UNITS)}")
    plates = []
    for number, described in enumerate(metadata["plates"]):
        name, channels = f"{file_name}: force plate {number + 1}", arrays[f"channels{number}"]
        if not np.isfinite(channels).all():
            raise InputError(f"{name} has samples that are not finite; its channels are damaged")
        raw = RawPlate(
            plate_type=described["type"],
            channels=channels,
            units=described["units"],
            corners=length_unit * arrays[f"corners{number}"],
            origin=length_unit * arrays[f"origin{number}"],
            calibration=arrays[f"calibration{number}"],
            cop_polynomial=arrays[f"polynomial{number}"].ravel(order="F"),
        )
        time = np.arange(channels.shape[1]) / float(metadata["analog_rate"])
        plate = force_plates.convert(raw, time, FORCE_UNITS[force_unit], length_unit, name)
        if not (np.abs(plate.force) < MAX_FORCE).all():
            raise InputError(f"{name} exceeds {MAX_FORCE:g} N; its channels are damaged")
        plates.append(plate)
    return tuple(plates)


def _parse_events(rows: Sequence[tuple[str, str, float]], start: float, duration: float) -> tuple[GaitEvent, ...]:
    """Return the foot strikes and foot offs of ``rows`` (context, label, time from frame 1) within the samples.

    The samples begin at ``start`` [s] and last ``duration`` [s].
    """
    events = []
    for context, label, time in rows:
        kind = EVENT_LABELS.get(label.strip().lower().replace("-", " ").replace("_", " "))
        if kind is not None and 0.0 <= time - start <= duration:
            side = context.strip().lower()
            events.append(GaitEvent(time - start, side if side in ("right", "left") else "", kind))
    return tuple(sorted(events, key=lambda event: event.time))
