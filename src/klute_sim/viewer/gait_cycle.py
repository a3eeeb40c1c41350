"""The last stride of a gait recording over percent of the gait cycle: the timeline on which a gait run opens."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.recording.recording import Recording
from klute_sim.viewer.stream import import_rerun

TIMELINE = "gait cycle [%]"
"""Integer timeline; 0 % and 100 % are foot strikes, so that it has the 101 points of published gait curves."""
PERCENTAGES = np.arange(101)
"""Positions on the timeline."""


def select_last_stride(recording: Recording) -> Recording:
    """Return all samples of the last stride, which a gait run always completes."""
    return recording.select(recording["stride"] == recording["stride"][-1])


def find_samples(recording: Recording) -> NDArray[np.int64]:
    """Return the sample of ``recording`` at each of :data:`PERCENTAGES` of its last stride: the nearest one.

    Samples are not interpolated, so that values on the timeline are values of the recording.
    """
    is_last = recording["stride"] == recording["stride"][-1]
    distance = np.abs(recording["gait_phase"][is_last] - PERCENTAGES[:, None])
    return np.asarray(np.flatnonzero(is_last)[distance.argmin(axis=1)])


def build_axis() -> Any:
    """Return the timeline as a rerun TimeColumn with a row for each of :data:`PERCENTAGES`."""
    return import_rerun().TimeColumn(TIMELINE, sequence=PERCENTAGES)


def compute_frame_rate(recording: Recording) -> float:
    """Return the percentages per second at which the last stride plays in real time [1/s]."""
    return float(PERCENTAGES[-1] / max(np.ptp(select_last_stride(recording)["time"]), 1e-3))
