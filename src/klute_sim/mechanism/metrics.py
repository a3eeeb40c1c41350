"""Metrics of the tests of a joint: responses to steps, sines, multisines, loads and releases."""

from collections.abc import Mapping

import numpy as np

from klute_sim.mechanism.protocols import MULTISINE_HARMONICS, MULTISINE_PERIOD
from klute_sim.recording.sinusoid import fit_sinusoid
from klute_sim.types import Array

SETTLING_FRACTION = 0.02
"""A response has settled when it stays within this fraction of its change."""
BANDWIDTH_GAIN = 10.0 ** (-3.0 / 20.0)
"""Gain over that of the lowest frequency that ends the bandwidth (-3 dB)."""


def measure_step(time: Array, value: Array, begin: float, end: float, unit: str) -> dict[str, float]:
    """Return final change, rise (10 to 90 %), overshoot and settling of ``value`` after a step at ``begin`` [s]."""
    is_part = (time >= begin) & (time < end)
    t, y = time[is_part] - begin, value[is_part]
    start, final = float(y[0]), float(y[-max(1, len(y) // 20) :].mean())
    change = final - start
    metrics = {f"change_{unit}": change}
    if change == 0.0:
        return metrics | {"rise_s": np.nan, "overshoot_pct": np.nan, "settling_s": np.nan}
    response = (y - start) / change
    outside = np.flatnonzero(np.abs(response - 1.0) > SETTLING_FRACTION)
    return metrics | {
        "rise_s": float(t[np.argmax(response >= 0.9)] - t[np.argmax(response >= 0.1)]),
        "overshoot_pct": 100.0 * max(0.0, float(response.max()) - 1.0),
        "settling_s": float(t[min(outside[-1] + 1, len(t) - 1)]) if len(outside) else 0.0,
    }


def measure_sine(
    time: Array, value: Array, difference: Array, events: Mapping[str, float], unit: str
) -> dict[str, float]:
    """Return gain [unit per bar], phase (negative: lag) and coherence of ``value`` to ``difference`` [bar]."""
    is_part = (time >= events["begin"]) & (time < events["end"])
    command = fit_sinusoid(time[is_part], difference[is_part], events["frequency_hz"])
    response = fit_sinusoid(time[is_part], value[is_part], events["frequency_hz"])
    ratio = response.phasor / command.phasor if command.phasor != 0.0 else complex(np.nan)
    return {
        f"gain_{unit}_per_bar": abs(ratio),
        "phase_deg": float(np.degrees(np.angle(ratio))),
        "coherence": response.coherence,
    }


def measure_multisine(
    time: Array, value: Array, difference: Array, events: Mapping[str, float], unit: str
) -> dict[str, float]:
    """Return gain at the lowest frequency, bandwidth (-3 dB) and the share of variance outside the input's frequencies.

    The bandwidth lies between the two harmonics around it, interpolated over the logarithm of the frequency; NaN where
    the gain stays above.
    """
    is_part = (time >= events["begin"]) & (time < events["end"])
    n_samples = int(is_part.sum())
    spectra = [np.fft.rfft(x[is_part] - x[is_part].mean())[: n_samples // 2] for x in (difference, value)]
    harmonics = np.array(MULTISINE_HARMONICS)
    gain = np.abs(spectra[1][harmonics]) / np.abs(spectra[0][harmonics])
    power = np.abs(spectra[1]) ** 2
    below = np.flatnonzero(gain / gain[0] < BANDWIDTH_GAIN)
    bandwidth = float("nan")
    if len(below) and below[0] > 0:
        k = int(below[0])
        log_frequency = np.log(harmonics[k - 1 : k + 1] / MULTISINE_PERIOD)
        relative = gain[k - 1 : k + 1] / gain[0]
        bandwidth = float(np.exp(np.interp(BANDWIDTH_GAIN, relative[::-1], log_frequency[::-1])))
    return {
        f"gain_{unit}_per_bar": float(gain[0]),
        "bandwidth_hz": bandwidth,
        "nonlinear_pct": 100.0 * float(1.0 - power[harmonics].sum() / power[1:].sum()),
    }


def measure_stiffness(time: Array, value: Array, load: float, begin: float, unit: str) -> dict[str, float]:
    """Return the position before ``load``, the change by it, and their ratio (the static stiffness)."""
    before = float(value[time < begin][-1])
    change = float(value[-1]) - before
    load_unit = "n_m" if unit == "deg" else "n"
    stiffness = load / change if change != 0.0 else float("nan")
    return {f"before_{unit}": before, f"change_{unit}": change, f"stiffness_{load_unit}_per_{unit}": stiffness}


def measure_release(time: Array, value: Array, begin: float, end: float, unit: str) -> dict[str, float]:
    """Return the response to the end of a load at ``begin`` [s], and its peak speed."""
    is_part = (time >= begin) & (time < end)
    speed = np.gradient(value[is_part], time[is_part])
    peak = float(np.abs(speed).max())
    return {**measure_step(time, value, begin, end, unit), f"peak_speed_{unit}_per_s": peak}
