"""Errors of instruments: the reading of a channel differs from the physical value. They are not part of the device."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.types import Array


def apply_gain(p: Any, time: Array, value: Array) -> Array:
    """Return ``gain * y``."""
    return np.asarray(p.gain * value)


def apply_offset(p: Any, time: Array, value: Array) -> Array:
    """Return ``y + offset``."""
    return np.asarray(value + p.offset)


def apply_drift(p: Any, time: Array, value: Array) -> Array:
    """Return ``y + rate (t - t0)``, with t0 the start of the trial."""
    return np.asarray(value + p.rate * (time - time[0]))


def apply_lag(p: Any, time: Array, value: Array) -> Array:
    """Return a first-order lag of y: ``tau dz/dt = y - z``, exact for straight lines between the samples."""
    if p.time_constant <= 0.0 or len(value) < 2:
        return value
    dt = float(np.median(np.diff(time)))
    decay = np.exp(-dt / p.time_constant)
    previous_weight = p.time_constant / dt * (1.0 - decay) - decay
    current_weight = 1.0 - p.time_constant / dt * (1.0 - decay)
    from scipy.signal import lfilter  # half a second of imports that only this effect needs

    lagged, _ = lfilter([current_weight, previous_weight], [1.0, -decay], value, zi=[value[0] * (1.0 - current_weight)])
    return np.asarray(lagged)


def apply_second_order_lag(p: Any, time: Array, value: Array) -> Array:
    """Return a second-order lag of y: ``tau^2 z'' + 2 zeta tau z' + z = y``, exact for straight lines between samples.

    With zeta = 1 it is two equal lags in series, with 0.87 a Bessel filter and with 0.71 a Butterworth filter of second
    order. A slow signal is late by ``2 zeta tau``.
    """
    if p.time_constant <= 0.0 or len(value) < 2:
        return value
    from scipy.signal import TransferFunction, lfilter, lfilter_zi

    steps = float(np.median(np.diff(time))) / p.time_constant
    lag: Any = TransferFunction([1.0], [1.0, 2.0 * p.damping_ratio, 1.0])
    lag = lag.to_discrete(steps, method="foh")
    return np.asarray(lfilter(lag.num, lag.den, value, zi=lfilter_zi(lag.num, lag.den) * value[0])[0])


def apply_clock_skew(p: Any, time: Array, value: Array) -> Array:
    """Return ``y(t - shift)``."""
    return np.asarray(np.interp(time - p.shift, time, value))


def quantize(p: Any, time: Array, value: Array) -> Array:
    """Return y rounded to the nearest multiple of the step."""
    return np.asarray(np.round(value / p.step) * p.step) if p.step > 0.0 else value


def compute_delay(form: EffectForm, values: Mapping[str, float]) -> float:
    """Return how late a channel is to slow signals [s] with ``form`` of :data:`SENSOR_LAG` or :data:`CLOCK_SKEW`.

    ``values`` are those of its parameters by key.
    """
    if form.name == "second_order":
        return 2.0 * values["damping_ratio"] * values["time_constant_s"]
    return values[form.parameters[0].key]


def _make_effect(name: str, description: str, equation: str, law: Any, parameter: EffectParameter) -> Effect:
    form = EffectForm(name="linear", equation=equation, parameters=(parameter,), laws={"reading": law})
    return Effect(name=name, description=description, kind="instrument", forms=(form,))


_SOURCE = "assumed: magnitude of a wrong calibration or an inexpensive instrument"

SENSOR_GAIN = _make_effect(
    "sensor_gain",
    "The channel has a wrong scale.",
    "gain y",
    apply_gain,
    EffectParameter(key="gain", neutral=1.0, lower=0.5, upper=2.0, typical=1.05, source=_SOURCE),
)
SENSOR_OFFSET = _make_effect(
    "sensor_offset",
    "The channel has a wrong zero.",
    "y + offset",
    apply_offset,
    EffectParameter(key="offset", neutral=0.0, lower=-np.inf, upper=np.inf, typical=1.0, source=_SOURCE),
)
SENSOR_DRIFT = _make_effect(
    "sensor_drift",
    "The channel's zero drifts during a trial.",
    "y + rate (t - t0)",
    apply_drift,
    EffectParameter(key="rate_per_s", neutral=0.0, lower=-np.inf, upper=np.inf, typical=1.0, source=_SOURCE),
)
SENSOR_LAG = Effect(
    name="sensor_lag",
    description="The filter of the channel's amplifier delays the signal.",
    kind="instrument",
    forms=(
        EffectForm(
            name="first_order",
            equation="tau dz/dt = y - z",
            parameters=(
                EffectParameter(key="time_constant_s", neutral=0.0, lower=0.0, upper=0.2, typical=0.01, source=_SOURCE),
            ),
            laws={"reading": apply_lag},
        ),
        EffectForm(
            name="second_order",
            equation="dz/dt = r, tau^2 dr/dt = y - z - 2 zeta tau r",
            parameters=(
                EffectParameter(
                    key="time_constant_s", neutral=0.0, lower=0.0, upper=0.1, typical=0.005, source=_SOURCE
                ),
                EffectParameter(
                    key="damping_ratio",
                    neutral=None,
                    lower=0.4,
                    upper=3.0,
                    typical=0.7,
                    source="assumed: 0.7 is a Butterworth filter, 0.87 a Bessel filter, 1 two equal lags in series",
                ),
            ),
            laws={"reading": apply_second_order_lag},
        ),
    ),
)
CLOCK_SKEW = _make_effect(
    "clock_skew",
    "The channel's clock is late or early relative to the other channels.",
    "y(t - shift)",
    apply_clock_skew,
    EffectParameter(key="shift_s", neutral=0.0, lower=-0.1, upper=0.1, typical=0.01, source=_SOURCE),
)
QUANTIZATION = _make_effect(
    "quantisation",
    "The channel is quantised in steps.",
    "round(y / step) step",
    quantize,
    EffectParameter(key="step", neutral=0.0, lower=0.0, upper=np.inf, typical=4.0, source=_SOURCE),
)
