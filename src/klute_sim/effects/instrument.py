"""Faults of instruments: what a channel shows is not what is there. They are no physics of the device."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter

Array = NDArray[np.float64]


def gained(own: Numbers, time: Array, value: Array) -> Array:
    """``gain * y``."""
    return np.asarray(own[0] * value)


def offset(own: Numbers, time: Array, value: Array) -> Array:
    """``y + offset``."""
    return np.asarray(value + own[0])


def drifted(own: Numbers, time: Array, value: Array) -> Array:
    """``y + rate (t - t0)``, from the start of each trial."""
    return np.asarray(value + own[0] * (time - time[0]))


def lagged(own: Numbers, time: Array, value: Array) -> Array:
    """First-order lag of ``y``: ``tau dz/dt = y - z``, exact for straight lines between the samples."""
    if own[0] <= 0.0 or len(value) < 2:
        return value
    step = float(np.median(np.diff(time)))
    keep = np.exp(-step / own[0])
    early = own[0] / step * (1.0 - keep) - keep
    late = 1.0 - own[0] / step * (1.0 - keep)
    shown, _ = lfilter([late, early], [1.0, -keep], value, zi=[value[0] * (1.0 - late)])
    return np.asarray(shown)


def late(own: Numbers, time: Array, value: Array) -> Array:
    """``y(t - shift)``: what the channel shows at t was so ``shift`` earlier."""
    return np.asarray(np.interp(time - own[0], time, value))


def rounded(own: Numbers, time: Array, value: Array) -> Array:
    """``y`` to the nearest multiple of the step."""
    return np.asarray(np.round(value / own[0]) * own[0]) if own[0] > 0.0 else value


def _effect(name: str, sentence: str, equation: str, law: Any, parameter: Parameter) -> Effect:
    form = Form(name="linear", equation=equation, parameters=(parameter,), laws={"reading": law})
    return Effect(name=name, sentence=sentence, kind="instrument", forms=(form,))


_SHEET = "assumed: what a wrong calibration or a cheap instrument does"

GAIN = _effect(
    "sensor_gain",
    "The channel is scaled wrongly.",
    "gain y",
    gained,
    Parameter(key="gain", neutral=1.0, low=0.5, high=2.0, typical=1.05, source=_SHEET),
)
OFFSET = _effect(
    "sensor_offset",
    "The channel's zero is wrong.",
    "y + offset",
    offset,
    Parameter(key="offset", neutral=0.0, low=-np.inf, high=np.inf, typical=1.0, source=_SHEET),
)
DRIFT = _effect(
    "sensor_drift",
    "The channel's zero wanders through a trial.",
    "y + rate (t - t0)",
    drifted,
    Parameter(key="rate_per_s", neutral=0.0, low=-np.inf, high=np.inf, typical=1.0, source=_SHEET),
)
LAG = _effect(
    "sensor_lag",
    "The channel's filter makes it slow.",
    "tau dz/dt = y - z",
    lagged,
    Parameter(key="time_constant_s", neutral=0.0, low=0.0, high=0.2, typical=0.01, source=_SHEET),
)
SKEW = _effect(
    "clock_skew",
    "The channel's clock is late (or early) against the others.",
    "y(t - shift)",
    late,
    Parameter(key="shift_s", neutral=0.0, low=-0.1, high=0.1, typical=0.01, source=_SHEET),
)
QUANTISATION = _effect(
    "quantisation",
    "The channel shows whole steps only.",
    "round(y / step) step",
    rounded,
    Parameter(key="step", neutral=0.0, low=0.0, high=np.inf, typical=4.0, source=_SHEET),
)
