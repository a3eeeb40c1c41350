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
    plates = c3d["data"].get("platform") or []
    metadata = {
        "labels": labels,
        "unit": _get_text(point.get("UNITS")),
        "rate": float(point["RATE"]["value"][0]),
        "analog_rate": float(c3d["header"]["analogs"]["frame_rate"]),
        "software": _get_text(parameters.get("MANUFACTURER", {}).get("SOFTWARE")),
        "plates": [[str(plate["unit_force"]), str(plate["unit_position"])] for plate in plates],
    }
    metadata["events"] = _list_events(parameters.get("EVENT", {}))
    metadata["first_frame"] = int(c3d["header"]["points"]["first_frame"])
    arrays = {"points": np.asarray(c3d["data"]["points"], dtype=np.float64)[:3]}
    for number, plate in enumerate(plates):
        arrays[f"force{number}"] = np.asarray(plate["force"], dtype=np.float64)
        arrays[f"cop{number}"] = np.asarray(plate["center_of_pressure"], dtype=np.float64)
    return {"metadata": np.array(json.dumps(metadata)), **arrays}


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
        return extract_arrays(library.c3d(path, extract_forceplat_data=True))

    read_and_reply(read, lambda: importlib.import_module("ezc3d"), size, MEMORY_LIMIT)


if __name__ == "__main__":
    main()
