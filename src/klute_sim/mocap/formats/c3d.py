"""Motion capture in C3D: markers and force plates, through the library ezc3d (an optional extra, used when needed).

A plate's force is the one on the plate's surface that acts on the body, so up is positive; the library turns channels
of plates of types 1 to 4 into it. The centre of pressure is in the laboratory's frame.
"""

import io
import json
import os
import struct
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.errors import InputError, MissingExtraError
from klute_sim.mocap.formats import content
from klute_sim.mocap.formats.content import FileContent
from klute_sim.mocap.formats.trc import LENGTH_UNITS, Markers
from klute_sim.recording.recording import Array

BLOCK_BYTES = 512
"""Bytes of a block of the format."""
MAGIC_BYTE = 0x50
MAX_SAMPLES = 200_000_000
STARTUP_TIMEOUT, MIN_READ_RATE = 15.0, 1e6
"""Time [s] the library may take to start, and bytes that it has to read in each second more: damage can keep it busy
for ever (both assumed)."""
MAX_FORCE = 1e6
"""[N]"""
FORCE_UNITS = {"N": 1.0, "kN": 1e3}


@dataclass(frozen=True, eq=False)
class ForcePlate:
    """A force plate, in the laboratory's frame."""

    time: Array
    """[s]"""
    force: Array
    """(n, 3) on the body [N]."""
    cop: Array
    """(n, 3) [m], NaN where nothing stands on the plate."""


@dataclass(frozen=True, eq=False)
class Capture:
    """What a C3D file holds of use here."""

    markers: Markers
    plates: tuple[ForcePlate, ...]
    software: str
    """That wrote it, where it says so."""


def read(path: str | Path) -> Capture:
    """The capture in the file at ``path``; raises InputError for what is none, MissingExtraError without ezc3d."""
    file = content.read(path)
    _check_header(file)
    if find_spec("ezc3d") is None:
        raise MissingExtraError("reading C3D", "c3d")
    with np.load(
        io.BytesIO(_read_in_subprocess(path, STARTUP_TIMEOUT + len(file.data) / MIN_READ_RATE)), allow_pickle=False
    ) as arrays:
        return _build_capture(json.loads(str(arrays["about"])), arrays, file.name)


def _read_in_subprocess(path: str | Path, timeout: float) -> bytes:
    """What :mod:`klute_sim.mocap.formats.c3d_process` finds in the file, in ``longest`` [s] at most."""
    # -P: nothing is imported from the working folder
    command = [
        sys.executable,
        "-P",
        "-m",
        "klute_sim.mocap.formats.c3d_process",
        str(Path(path).absolute()),
        f"{timeout + 2:.0f}",
    ]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        done = subprocess.run(command, capture_output=True, env=environment, timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        raise InputError(f"{path} cannot be read as C3D within {timeout:.0f} s: it is damaged") from None
    if done.returncode == 0:
        return done.stdout
    lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
    reason = lines[-1] if lines and done.returncode == 1 else "it is damaged, and the library that reads it gave up"
    raise InputError(f"{path} cannot be read as C3D: {''.join(c for c in reason if c.isprintable())}")


def _check_header(file: FileContent) -> None:
    """Refuse what the library would take, or take for ever: no C3D at all, frames that are not there."""
    data = file.data
    if len(data) < 2 * BLOCK_BYTES or data[1] != MAGIC_BYTE:
        raise InputError(f"{file.name} is no C3D file: its second byte must be 50 (hexadecimal)")
    if len(data) < (data[0] - 1) * BLOCK_BYTES + 4 or data[0] < 2:
        raise InputError(f"{file.name} is cut short: its parameters are missing")
    processor = data[(data[0] - 1) * BLOCK_BYTES + 3] - 83
    if processor not in (1, 2, 3):
        raise InputError(f"{file.name} is no C3D file: processor type {processor}; allowed are 1, 2 and 3")
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
            f"{file.name} is cut short: {frames} frames of {points} markers and {analog} analog samples do not fit"
        )
    if frames * (4 * points + analog) > MAX_SAMPLES:
        raise InputError(f"{file.name} holds more than {MAX_SAMPLES} samples")


def _build_capture(metadata: Mapping[str, Any], arrays: Mapping[str, Array], file_name: str) -> Capture:
    unit, rate = metadata["unit"] or "mm", float(metadata["rate"])
    if unit.lower() not in LENGTH_UNITS:
        raise InputError(f"{file_name}: markers are in {unit[:20]!r}; allowed: {', '.join(LENGTH_UNITS)}")
    if not 1.0 <= rate <= 100_000.0:
        raise InputError(f"{file_name}: markers at {rate:g} Hz; allowed are 1 to 100000 Hz")
    analog_rate = float(metadata["analog_rate"])
    if metadata["plates"] and not rate <= analog_rate <= 1e6:
        raise InputError(f"{file_name}: force plates at {analog_rate:g} Hz; allowed are {rate:g} to 1000000 Hz")
    places = LENGTH_UNITS[unit.lower()] * arrays["points"]
    places[:, (places == 0.0).all(axis=0)] = np.nan  # old files have the origin for a marker not seen
    labels = [label.strip() for label in metadata["labels"]][: places.shape[1]]
    positions = {label: places[:, k].T for k, label in enumerate(labels) if label and not label.startswith("*")}
    plates = []
    for number, (force_unit, length_unit) in enumerate(metadata["plates"]):
        if force_unit not in FORCE_UNITS or length_unit.lower() not in LENGTH_UNITS:
            raise InputError(
                f"{file_name}: a force plate in {force_unit[:20]!r} and {length_unit[:20]!r}; allowed: N, kN; mm, cm, m"
            )
        force = FORCE_UNITS[force_unit] * arrays[f"force{number}"].T
        if not (np.abs(force) < MAX_FORCE).all():
            raise InputError(f"{file_name}: force plate {number + 1} reads what no force is; its channels are damaged")
        centre = LENGTH_UNITS[length_unit.lower()] * arrays[f"centre{number}"].T
        plates.append(ForcePlate(np.arange(len(force)) / analog_rate, force, centre))
    return Capture(Markers(np.arange(places.shape[2]) / rate, positions), tuple(plates), metadata["software"])
