"""Read one C3D file in a separate process: ``python -m klute_sim.mocap.formats.c3d_process FILE SECONDS PARENT``.

The library ezc3d is written in C++; see :mod:`klute_sim.files.isolation`.
"""

import importlib
import json
import os
import sys
from typing import Any

import numpy as np

from klute_sim.files.isolation import MemoryLimit, read_and_reply

MEMORY_LIMIT = MemoryLimit(fixed=200_000_000, per_file_byte=50)
"""Memory for reading a file: integers of two bytes become objects of the library and several floating-point numbers
(assumed; the largest intact files that were tried need half of it)."""


def extract_arrays(c3d: Any) -> dict[str, Any]:
    """Return the required arrays of the library's object ``c3d``, and its metadata as JSON under ``metadata``."""
    parameters, point = c3d["parameters"], c3d["parameters"]["POINT"]
    labels = [str(v) for key in ("LABELS", "LABELS2") for v in point.get(key, {"value": []})["value"]]
    plates, arrays = _extract_plates(parameters, np.asarray(c3d["data"]["analogs"], dtype=np.float64)[0])
    metadata = {
        "labels": labels,
        "unit": _get_text(point.get("UNITS")),
        "rate": float(point["RATE"]["value"][0]),
        "analog_rate": float(c3d["header"]["analogs"]["frame_rate"]),
        "software": _get_text(parameters.get("MANUFACTURER", {}).get("SOFTWARE")),
        "force_unit": _get_text(parameters.get("FORCE_PLATFORM", {}).get("UNITS")),
        "plates": plates,
    }
    metadata["events"] = _list_events(parameters.get("EVENT", {}))
    metadata["first_frame"] = int(c3d["header"]["points"]["first_frame"])
    arrays["points"] = np.asarray(c3d["data"]["points"], dtype=np.float64)[:3]
    return {"metadata": np.array(json.dumps(metadata)), **arrays}


def _extract_plates(parameters: Any, analogs: Any) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return type and units of each force plate, and its arrays, whose names end with the number of the plate.

    The library could convert the channels, too, but it assumes that every moment is in newtons times the length unit
    of the markers, keeps the offsets of plates that were not zeroed, and refuses a file with a plate of another type.
    """
    section = parameters.get("FORCE_PLATFORM", {})
    count = int(_get_values(section, "USED", 1)[0]) if "USED" in section else 0
    units = [str(v) for key in ("UNITS", "UNITS2") for v in parameters["ANALOG"].get(key, {"value": []})["value"]]
    plates: list[dict[str, Any]] = []
    arrays: dict[str, Any] = {}
    for number in range(count):
        channels = [int(v) - 1 for v in _get_values(section, "CHANNEL", 2)[:, number] if v > 0]
        if max(channels, default=0) >= len(analogs):
            raise ValueError(f"force plate {number + 1} has channel {max(channels) + 1} of {len(analogs)}")
        plate_units = [units[k] if k < len(units) else "" for k in channels]
        plates.append({"type": int(_get_values(section, "TYPE", 1)[number]), "units": plate_units})
        arrays |= {
            f"channels{number}": analogs[channels],
            f"corners{number}": _get_values(section, "CORNERS", 3)[:, :, number],
            f"origin{number}": _get_values(section, "ORIGIN", 2)[:, number],
        }
        for name, key in (("calibration", "CAL_MATRIX"), ("polynomial", "FPCOPPOLY")):
            values = _get_values(section, key, 3) if key in section else np.empty((0, 0, 0))
            arrays[f"{name}{number}"] = values[:, :, number] if number < values.shape[2] else np.empty((0, 0))
    return plates, arrays


def _get_values(section: Any, key: str, n_axes: int) -> Any:
    """Return the numbers of the parameter ``key`` with ``n_axes`` axes; files with one plate may leave out the last."""
    if key not in section:
        raise ValueError(f"FORCE_PLATFORM:{key} is missing")
    values = np.asarray(section[key]["value"], dtype=np.float64)
    return values.reshape(values.shape + (1,) * (n_axes - values.ndim))


def _list_events(section: Any) -> list[tuple[str, str, float]]:
    """Return context (such as ``Left``), label and time [s] of each event; ezc3d gives times as minutes and seconds."""
    contexts, labels = (section[key]["value"] if key in section else [] for key in ("CONTEXTS", "LABELS"))
    times = np.asarray(section["TIMES"]["value"] if "TIMES" in section else [], dtype=np.float64)
    if times.ndim != 2 or len(times) != 2:
        return []
    seconds = 60.0 * times[0] + times[1]
    rows = zip(contexts, labels, seconds, strict=False)
    return [(str(context), str(label), float(time)) for context, label, time in rows]


def _get_text(parameter: Any) -> str:
    value = parameter["value"] if parameter else []
    return str(value[0]).strip() if len(value) else ""


def main() -> None:
    """Read the file named on the command line."""
    path = sys.argv[1]
    size = os.path.getsize(path) if os.path.exists(path) else 0

    def read() -> dict[str, Any]:
        library = importlib.import_module("ezc3d")
        return extract_arrays(library.c3d(path))

    read_and_reply(read, lambda: importlib.import_module("ezc3d"), size, MEMORY_LIMIT)


if __name__ == "__main__":
    main()
