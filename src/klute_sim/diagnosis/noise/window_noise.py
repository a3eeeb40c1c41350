"""Moving averages and Savitzky-Golay filters of channels, detected from the spectrum of their noise.

The mean of a window of samples removes some frequencies altogether and lets those between them pass in part. The
spectra of other filters and of instruments are smooth, so this one shows the number of samples exactly.
"""

from collections.abc import Sequence

import numpy as np

from klute_sim.diagnosis.experiments.window_filter import WindowFilter
from klute_sim.diagnosis.noise.spectrum import (
    Spectrum,
    compute_negative_log_likelihood,
    compute_spectrum,
    compute_stop_ratio,
)
from klute_sim.types import Array

MIN_WINDOW, MAX_WINDOW = 4, 151
"""Number of samples of the windows that are tried (assumed)."""
N_PASSES = 1, 2
"""Numbers of passes of a moving average that are tried."""
DEGREES = 2, 4
"""Degrees of the polynomials of Savitzky-Golay filters that are tried, beside moving averages."""
MIN_WINDOWS_PER_RECORD = 20
"""Fewest windows in a record whose spectrum shows one (assumed)."""
PASS_FRACTION = 0.05
"""Part of the spectrum that is compared with the highest frequencies (assumed)."""
MAX_STOP_RATIO = 1.0 / 6.0
"""Largest ratio of the power of the noise at the highest frequencies to that in this band where windows are tried: of
these, a Savitzky-Golay filter of five samples leaves most, an eighth (assumed)."""
N_REFINED = 8
"""Number of windows for which a lag of the sensor is tried."""
POLE_FACTORS = np.array([np.inf, 4.0, 2.0, 1.0, 0.5, 0.25])
"""Frequencies above which the noise before the filter falls, over the cut-off frequency."""
N_SMOOTH_BANDS = 30
"""Number of bands, evenly spaced on a logarithmic scale, whose mean powers a smooth spectrum follows."""
MIN_WINDOW_GAIN = 50.0
"""Gain of the logarithm of the likelihood over a smooth spectrum by which the noise shows a window (assumed)."""


def find_window(differences: Sequence[tuple[Array, Array]], sampling_rate: float) -> WindowFilter | None:
    """Return the window that the noise of a channel went through; None where it does not show one.

    ``differences`` between repeats are pairs of times [s] (n,) and values [SI] (n,). ``sampling_rate`` [Hz] is that of
    the channel, before samples were left out.
    """
    computed = (compute_spectrum(*difference, is_banded=False) for difference in differences)
    spectra = [s for s in computed if s is not None]
    if not spectra or compute_stop_ratio(spectra, PASS_FRACTION * spectra[0].frequency[-1]) > MAX_STOP_RATIO:
        return None
    duration = min(1.0 / float(s.frequency[1] - s.frequency[0]) for s in spectra)
    longest = min(MAX_WINDOW, int(duration * sampling_rate / MIN_WINDOWS_PER_RECORD))
    lengths = range(MIN_WINDOW, longest + 1)
    windows = [WindowFilter(n, sampling_rate, n_passes=n_passes) for n_passes in N_PASSES for n in lengths]
    for degree in DEGREES:
        windows += [WindowFilter(n, sampling_rate, degree) for n in range(2 * degree + 1, longest + 1, 2)]
    if not windows:
        return None
    windows.sort(key=lambda window: _compute_negative_log_likelihood(spectra, window, POLE_FACTORS[:1]))
    losses = {window: _compute_negative_log_likelihood(spectra, window, POLE_FACTORS) for window in windows[:N_REFINED]}
    best = min(losses, key=lambda window: losses[window])
    return best if losses[best] < sum(map(_compute_smooth_negative_log_likelihood, spectra)) - MIN_WINDOW_GAIN else None


def _compute_negative_log_likelihood(spectra: Sequence[Spectrum], tried: WindowFilter, pole_factors: Array) -> float:
    """Return the negative logarithm of the likelihood of noise through the filter."""

    def compute_power(frequency: Array) -> Array:
        # Of m samples, one is left: the noise at higher frequencies appears at the lower ones, too.
        kept_rate = 2.0 * (frequency[-1] + frequency[1] - frequency[0])
        n_folds = max(1, round(tried.sampling_rate / kept_rate))
        return np.asarray(sum(tried.compute_gain(frequency + k * kept_rate) ** 2 for k in range(n_folds)))

    return compute_negative_log_likelihood(spectra, compute_power, tried.cutoff * pole_factors)


def _compute_smooth_negative_log_likelihood(spectrum: Spectrum) -> float:
    """Return the negative logarithm of the likelihood of noise with a smooth spectrum."""
    frequency, power, _ = spectrum
    edges = np.geomspace(frequency[0], frequency[-1], N_SMOOTH_BANDS + 1)[:-1]
    starts = np.unique(np.searchsorted(frequency, edges))
    counts = np.diff(np.append(starts, len(frequency)))
    centres, means = (np.add.reduceat(values, starts) / counts for values in (np.log(frequency), power))
    shape = np.exp(np.interp(np.log(frequency), centres, np.log(means)))
    return float(len(frequency) * np.log(np.mean(power / shape)) + np.log(shape).sum())
