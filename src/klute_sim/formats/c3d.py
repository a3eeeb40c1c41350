"""Motion capture in C3D: markers and force plates, through the library ezc3d (an optional extra, imported when used).

A plate's force is the one on the plate's surface that acts on the body, so up is positive; the library turns channels
of plates of types 1 to 4 into it. The centre of pressure is in the laboratory's frame.
"""

import struct
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.errors import InputError, MissingExtraError
from klute_sim.formats import content
from klute_sim.formats.content import Content
from klute_sim.formats.trc import UNITS, Markers
from klute_sim.recording.recording import Samples

BLOCK = 512
"""Bytes of a block of the format."""
MAGIC = 0x50
MOST_SAMPLES = 200_000_000
FORCE_UNITS = {"N": 1.0, "kN": 1e3}


@dataclass(frozen=True, eq=False)
class Plate:
    """A force plate, in the laboratory's frame."""

    time: Samples
    """[s]"""
    force: Samples
    """(n, 3) on the body [N]."""
    pressure_centre: Samples
    """(n, 3) [m], NaN where nothing stands on the plate."""


@dataclass(frozen=True, eq=False)
class Capture:
    """What a C3D file holds of use here."""

    markers: Markers
    plates: tuple[Plate, ...]
    software: str
    """That wrote it, where it says so."""


def read(path: str | Path) -> Capture:
    """The capture in the file at ``path``; raises InputError for what is none, MissingExtraError without ezc3d."""
    file = content.read(path)
    _check_header(file)
    try:
        import ezc3d
    except ImportError:
        raise MissingExtraError("reading C3D", "c3d") from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = ezc3d.c3d(str(path), extract_forceplat_data=True)
            return _capture(found, file.where)
    except InputError:
        raise
    except Exception as error:  # whatever C++ and its wrapper raise for what is no C3D file
        reason = (str(error).splitlines() or ["?"])[0]
        raise InputError(f"{path} cannot be read as C3D: {reason}") from None


def _check_header(file: Content) -> None:
    """Refuse what the library would take, or take for ever: no C3D at all, frames that are not there."""
    data = file.data
    if len(data) < 2 * BLOCK or data[1] != MAGIC:
        raise InputError(f"{file.where} is no C3D file: its second byte must be 50 (hexadecimal)")
    if len(data) < (data[0] - 1) * BLOCK + 4 or data[0] < 2:
        raise InputError(f"{file.where} is cut short: its parameters are missing")
    processor = data[(data[0] - 1) * BLOCK + 3] - 83
    if processor not in (1, 2, 3):
        raise InputError(f"{file.where} is no C3D file: processor type {processor}; allowed are 1, 2 and 3")
    order = ">" if processor == 3 else "<"
    points, analog, first, last = struct.unpack_from(f"{order}4H", data, 2)
    scale = 1.0 if processor == 2 else struct.unpack_from(f"{order}f", data, 12)[0]
    (start,) = struct.unpack_from(f"{order}H", data, 16)
    frames = last - first + 1
    if frames < 2 or start < 2:
        raise InputError(f"{file.where}: frames {first} to {last}; two or more are needed")
    needed = frames * (4 * points + analog) * (4 if scale < 0 else 2)
    if processor != 2 and last < 65535 and (start - 1) * BLOCK + needed > len(data):
        raise InputError(
            f"{file.where} is cut short: {frames} frames of {points} markers and {analog} analog samples do not fit"
        )
    if frames * (4 * points + analog) > MOST_SAMPLES:
        raise InputError(f"{file.where} holds more than {MOST_SAMPLES} samples")


def _capture(found: Mapping[str, Any], where: str) -> Capture:
    parameters = found["parameters"]
    labels = [str(label).strip() for label in parameters["POINT"].get("LABELS", {"value": []})["value"]]
    more = [str(v).strip() for v in parameters["POINT"].get("LABELS2", {"value": []})["value"]]
    points = np.asarray(found["data"]["points"], dtype=np.float64)
    labels = (labels + more)[: points.shape[1]]
    unit = _text(parameters["POINT"].get("UNITS")) or "mm"
    if unit.lower() not in UNITS:
        raise InputError(f"{where}: markers are in '{unit[:20]}'; allowed: {', '.join(UNITS)}")
    rate = float(parameters["POINT"]["RATE"]["value"][0])
    if not 1.0 <= rate <= 100_000.0:
        raise InputError(f"{where}: markers at {rate:g} Hz; allowed are 1 to 100000 Hz")
    places = UNITS[unit.lower()] * points[:3]
    places[:, (points[:3] == 0.0).all(axis=0)] = np.nan  # old files have the origin for a marker not seen
    time = np.arange(points.shape[2]) / rate
    positions = {label: places[:, k].T for k, label in enumerate(labels) if label and not label.startswith("*")}
    per_frame = float(found["header"]["analogs"]["frame_rate"]) / rate
    plates = tuple(_plate(plate, rate * per_frame, where) for plate in found["data"].get("platform") or [])
    return Capture(Markers(time, positions), plates, _text(parameters.get("MANUFACTURER", {}).get("SOFTWARE")))


def _plate(plate: Mapping[str, Any], rate: float, where: str) -> Plate:
    force_unit, length_unit = str(plate["unit_force"]), str(plate["unit_position"]).lower()
    if force_unit not in FORCE_UNITS or length_unit not in UNITS:
        raise InputError(f"{where}: a force plate in '{force_unit}' and '{length_unit}'; allowed: N, kN; mm, cm, m")
    force = FORCE_UNITS[force_unit] * np.asarray(plate["force"], dtype=np.float64).T
    centre = UNITS[length_unit] * np.asarray(plate["center_of_pressure"], dtype=np.float64).T
    return Plate(np.arange(len(force)) / rate, force, centre)


def _text(parameter: Any) -> str:
    value = parameter["value"] if parameter else []
    return str(value[0]).strip() if len(value) else ""
