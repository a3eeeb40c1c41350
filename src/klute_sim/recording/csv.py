"""Write recordings as CSV with the same ``name [unit]`` headings as Parquet; without provenance."""

from pathlib import Path

import numpy as np

from klute_sim.recording.recording import Recording


def write(recording: Recording, path: Path) -> None:
    """Write every sample with the digits that read back to the same number; missing samples are empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(recording.format_heading(name) for name in recording.channels) + "\n")
        for row in zip(*recording.channels.values(), strict=True):
            file.write(",".join("" if np.isnan(value) else repr(float(value)) for value in row) + "\n")
