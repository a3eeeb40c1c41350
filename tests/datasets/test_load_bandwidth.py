"""A load that was low-pass filtered like markers is told from one that was not."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from klute_sim.datasets.load_bandwidth import describe_filtered_loads
from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.types import Array

RATE_HZ = 1000.0


def make_walk(name: str, cutoff_hz: float | None, rate_hz: float = RATE_HZ, noise_n: float = 1.0) -> Trial:
    """Return strides of 1.1 s with two humps of load, after a zero-lag filter of fourth order."""
    time = np.arange(0.0, 8.0, 1.0 / RATE_HZ)
    phase = (time / 1.1) % 1.0 / 0.62
    load = np.where(phase < 1.0, 1400.0 * np.sin(np.pi * phase) * (1.0 - 0.5 * np.sin(np.pi * phase) ** 4), 0.0)
    load = load + noise_n * np.random.default_rng(0).normal(size=len(time))
    if cutoff_hz is not None:
        load = np.asarray(sosfiltfilt(butter(2, cutoff_hz, fs=RATE_HZ, output="sos"), load))
    step = round(RATE_HZ / rate_hz)
    series: Array = load[::step]
    return cast(Any, SimpleNamespace(name=name, prescribed={"grf_vertical": TimeSeries(time[::step], series)}))


@pytest.mark.parametrize("cutoff_hz", [4.0, 6.0, 8.0])
@pytest.mark.parametrize("rate_hz", [1000.0, 100.0])
def test_filtered_load_is_told(cutoff_hz: float, rate_hz: float) -> None:
    (remark,) = describe_filtered_loads([make_walk("a", cutoff_hz, rate_hz), make_walk("b", cutoff_hz, rate_hz)])
    assert remark.startswith("`grf_vertical` of all trials has next to no content from 12 to 18 Hz")


@pytest.mark.parametrize("cutoff_hz", [None, 20.0, 50.0])
def test_recorded_load_is_not(cutoff_hz: float | None) -> None:
    assert describe_filtered_loads([make_walk("a", cutoff_hz)]) == []
    assert describe_filtered_loads([make_walk("a", cutoff_hz, noise_n=0.0)]) == []


def test_trials_are_named_and_slow_samples_show_nothing() -> None:
    (remark,) = describe_filtered_loads([make_walk("a", None), make_walk("b", 6.0)])
    assert "of trial 'b' has" in remark
    assert describe_filtered_loads([make_walk("a", 6.0, 20.0)]) == []
