"""Read one C3D file in a separate process: ``python -m klute_sim.mocap.formats.c3d_process FILE SECONDS PARENT``.

The library ezc3d is written in C++, and a damaged file (one changed byte is enough) can crash it. The crash then ends
this process instead of the user's. Other damaged files keep the library busy for ever, or make it ask for any amount of
memory; the processor time and the memory that this process may use therefore follow from the size of the file. An alarm
ends it after SECONDS, and Linux ends it together with the process PARENT, which may be killed. The result goes to
standard output as NumPy ``.npz`` without pickles.
"""

import ctypes
import io
import json
import math
import os
import signal
import sys
import time
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

MAX_MEMORY_BYTES = 2 * 1024**3
"""Largest address space of the process [bytes]; the largest accepted file needs about half of it."""
SPARE_MEMORY_BYTES, MEMORY_PER_FILE_BYTE = 200_000_000, 50
"""Memory for reading a file [bytes], and what each byte of the file adds: integers of two bytes become objects of the
library and several floating-point numbers (both assumed; the largest intact files that were tried need half of it)."""
READING_TIME, MIN_READ_RATE = 3.0, 1e6
"""Processor time for a small file [s], and the lowest reading rate [bytes/s], which extends it (both assumed)."""
PR_SET_PDEATHSIG = 1
"""Option of Linux's prctl: the signal that a process gets when its parent ends."""


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


def end_with_parent(parent: int) -> None:
    """End this process when the process ``parent`` ends (Linux only), also while the library is busy."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it has ended before the call
        sys.exit("the parent process has ended")


def limit_resources(n_bytes: int) -> None:
    """Limit memory and processor time, where the system can, to what reading a file of ``n_bytes`` needs."""
    if sys.platform == "win32":
        return
    import resource

    seconds = math.ceil(time.process_time() + READING_TIME + n_bytes / MIN_READ_RATE)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, resource.getrlimit(resource.RLIMIT_CPU)[1]))
    memory = MAX_MEMORY_BYTES
    with suppress(OSError):  # Linux only
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        needed = pages * resource.getpagesize() + SPARE_MEMORY_BYTES + MEMORY_PER_FILE_BYTE * n_bytes
        memory = min(memory, needed)
    resource.setrlimit(resource.RLIMIT_AS, (memory, resource.getrlimit(resource.RLIMIT_AS)[1]))


def main() -> None:
    """Read the file named on the command line; on failure print the reason on standard error and exit with code 1."""
    end_with_parent(int(sys.argv[3]))
    if hasattr(signal, "alarm"):  # not available on Windows
        signal.alarm(int(sys.argv[2]))
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # messages that the library prints must not mix with the result
    warnings.simplefilter("ignore")
    try:
        import ezc3d

        limit_resources(os.path.getsize(sys.argv[1]))
        arrays = extract_arrays(ezc3d.c3d(sys.argv[1], extract_forceplat_data=True))
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
    except Exception as error:  # the C++ wrapper documents no exception types
        sys.exit((str(error).splitlines() or [type(error).__name__])[0])
    output.write(buffer.getvalue())
    output.close()


if __name__ == "__main__":
    main()
