"""Faults of instruments: what a channel shows is not what is there. They are no physics of the device."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence

Array = NDArray[np.float64]


def apply_gain(p: FloatSequence, time: Array, value: Array) -> Array:
    """``gain * y``."""
    return np.asarray(p[0] * value)


def apply_offset(p: FloatSequence, time: Array, value: Array) -> Array:
    """``y + offset``."""
    return np.asarray(value + p[0])


def apply_drift(p: FloatSequence, time: Array, value: Array) -> Array:
    """``y + rate (t - t0)``, from the start of each trial."""
    return np.asarray(value + p[0] * (time - time[0]))


def apply_lag(p: FloatSequence, time: Array, value: Array) -> Array:
    """First-order lag of ``y``: ``tau dz/dt = y - z``, exact for straight lines between the samples."""
    if p[0] <= 0.0 or len(value) < 2:
        return value
    step = float(np.median(np.diff(time)))
    keep = np.exp(-step / p[0])
    early = p[0] / step * (1.0 - keep) - keep
    late = 1.0 - p[0] / step * (1.0 - keep)
    shown, _ = lfilter([late, early], [1.0, -keep], value, zi=[value[0] * (1.0 - late)])
    return np.asarray(shown)


def apply_clock_skew(p: FloatSequence, time: Array, value: Array) -> Array:
    """``y(t - shift)``: what the channel shows at t was so ``shift`` earlier."""
    return np.asarray(np.interp(time - p[0], time, value))


def quantize(p: FloatSequence, time: Array, value: Array) -> Array:
    """``y`` to the nearest multiple of the step."""
    return np.asarray(np.round(value / p[0]) * p[0]) if p[0] > 0.0 else value


def _make_effect(name: str, sentence: str, equation: str, law: Any, parameter: EffectParameter) -> Effect:
    form = EffectForm(name="linear", equation=equation, parameters=(parameter,), laws={"reading": law})
    return Effect(name=name, description=sentence, kind="instrument", forms=(form,))


_SOURCE = "assumed: what a wrong calibration or a cheap instrument does"

SENSOR_GAIN = _make_effect(
    "sensor_gain",
    "The channel is scaled wrongly.",
    "gain y",
    apply_gain,
    EffectParameter(key="gain", neutral=1.0, lower=0.5, upper=2.0, typical=1.05, source=_SOURCE),
)
SENSOR_OFFSET = _make_effect(
    "sensor_offset",
    "The channel's zero is wrong.",
    "y + offset",
    apply_offset,
    EffectParameter(key="offset", neutral=0.0, lower=-np.inf, upper=np.inf, typical=1.0, source=_SOURCE),
)
SENSOR_DRIFT = _make_effect(
    "sensor_drift",
    "The channel's zero wanders through a trial.",
    "y + rate (t - t0)",
    apply_drift,
    EffectParameter(key="rate_per_s", neutral=0.0, lower=-np.inf, upper=np.inf, typical=1.0, source=_SOURCE),
)
SENSOR_LAG = _make_effect(
    "sensor_lag",
    "The channel's filter makes it slow.",
    "tau dz/dt = y - z",
    apply_lag,
    EffectParameter(key="time_constant_s", neutral=0.0, lower=0.0, upper=0.2, typical=0.01, source=_SOURCE),
)
CLOCK_SKEW = _make_effect(
    "clock_skew",
    "The channel's clock is late (or early) against the others.",
    "y(t - shift)",
    apply_clock_skew,
    EffectParameter(key="shift_s", neutral=0.0, lower=-0.1, upper=0.1, typical=0.01, source=_SOURCE),
)
QUANTISATION = _make_effect(
    "quantisation",
    "The channel shows whole steps only.",
    "round(y / step) step",
    quantize,
    EffectParameter(key="step", neutral=0.0, lower=0.0, upper=np.inf, typical=4.0, source=_SOURCE),
)
