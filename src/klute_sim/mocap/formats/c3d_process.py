"""Reads one C3D file in a process of its own: ``python -m klute_sim.mocap.formats.c3d_process FILE SECONDS``.

The library is C++, and some damaged files crash it (a changed byte is enough): then this process ends, not the user's.
Others keep it busy for ever: then this process ends after so many seconds, even if nobody waits for it any more.
What was read goes to standard output as NumPy's ``.npz``, without pickles.
"""

import io
import json
import os
import signal
import sys
import warnings
from typing import Any

import numpy as np


def extract_arrays(c3d: Any) -> dict[str, Any]:
    """What is of use in the library's ``found``: arrays, and ``about`` as JSON."""
    parameters, point = c3d["parameters"], c3d["parameters"]["POINT"]
    labels = [str(v) for key in ("LABELS", "LABELS2") for v in point.get(key, {"value": []})["value"]]
    plates = c3d["data"].get("platform") or []
    about = {
        "labels": labels,
        "unit": _get_text(point.get("UNITS")),
        "rate": float(point["RATE"]["value"][0]),
        "analog_rate": float(c3d["header"]["analogs"]["frame_rate"]),
        "software": _get_text(parameters.get("MANUFACTURER", {}).get("SOFTWARE")),
        "plates": [[str(plate["unit_force"]), str(plate["unit_position"])] for plate in plates],
    }
    arrays = {"points": np.asarray(c3d["data"]["points"], dtype=np.float64)[:3]}
    for number, plate in enumerate(plates):
        arrays[f"force{number}"] = np.asarray(plate["force"], dtype=np.float64)
        arrays[f"centre{number}"] = np.asarray(plate["center_of_pressure"], dtype=np.float64)
    return {"about": np.array(json.dumps(about)), **arrays}


def _get_text(parameter: Any) -> str:
    value = parameter["value"] if parameter else []
    return str(value[0]).strip() if len(value) else ""


def main() -> None:
    """Read the file named on the command line; a reason on standard error and exit code 1 where that fails."""
    if hasattr(signal, "alarm"):  # Windows has none
        signal.alarm(int(sys.argv[2]))
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever the library prints does not belong to the result
    warnings.simplefilter("ignore")
    try:
        import ezc3d

        arrays = extract_arrays(ezc3d.c3d(sys.argv[1], extract_forceplat_data=True))
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
    except Exception as error:  # whatever C++ and its wrapper raise for what is no C3D file
        sys.exit((str(error).splitlines() or [type(error).__name__])[0])
    out.write(buffer.getvalue())
    out.close()


if __name__ == "__main__":
    main()
