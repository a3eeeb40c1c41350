"""A trial with given samples, for tests of what happens to them before any simulation."""

from pathlib import Path

import numpy as np

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.device.device import load_device


def make_trial(time: np.ndarray, length: np.ndarray, command: np.ndarray, **measured: np.ndarray) -> Trial:
    """Return a trial with the length [m], the command [Pa] and the ``measured`` channels [SI] at ``time`` [s]."""
    return Trial(
        name="t",
        group="t",
        use="fit",
        device=load_device("klute-3-4-pair"),
        files=(Path("t.csv"),),
        prescribed={"length": TimeSeries(time, length), "pressure_command": TimeSeries(time, command)},
        measured={name: TimeSeries(time, values) for name, values in measured.items()},
    )
