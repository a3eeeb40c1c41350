"""Synchronisation check: the time offset between two recordings of the same movement."""

import numpy as np

from klute_sim.datasets.trial import TimeSeries
from klute_sim.mocap.import_log import ImportLog

MAX_LAG = 0.5
"""Largest lag that is tried in either direction [s]; with a lag of a full stride, walking looks the same."""
LAG_STEP = 2.5e-3
"""Interval between lags, and between compared samples [s]."""
MIN_REPORTED_LAG = 0.01
"""Smallest lag that is reported as suspicious [s] (assumed; at push-off the ankle rotates 2 degrees in it)."""
MIN_CORRELATION = 0.95
"""Smallest correlation of two recordings of the same movement (assumed)."""


def estimate_lag(signal: TimeSeries, reference: TimeSeries) -> tuple[float, float] | None:
    """Return the time [s] to add to ``signal`` for the highest correlation with ``reference``, and this correlation.

    Returns None if the two overlap for less than a second, or one has no known samples.
    """
    signal, reference = (TimeSeries(*(v[np.isfinite(series.value)] for v in series)) for series in (signal, reference))
    if not (len(signal.time) and len(reference.time)):
        return None
    begin = max(signal.time[0] + MAX_LAG, reference.time[0])
    end = min(signal.time[-1] - MAX_LAG, reference.time[-1])
    if end - begin < 1.0:
        return None
    grid = np.arange(begin, end, LAG_STEP)
    reference_values = np.interp(grid, reference.time, reference.value)
    lags = np.arange(-round(MAX_LAG / LAG_STEP), round(MAX_LAG / LAG_STEP) + 1) * LAG_STEP
    correlations = [
        float(np.corrcoef(np.interp(grid - lag, signal.time, signal.value), reference_values)[0, 1]) for lag in lags
    ]
    best = int(np.argmax(correlations))
    return float(lags[best]), correlations[best]


def compare_clocks(
    quantity: str, first: tuple[str, TimeSeries], second: tuple[str, TimeSeries], log: ImportLog
) -> None:
    """Log the time offset of ``quantity`` between two files, each given as (file name, signal)."""
    estimate = estimate_lag(first[1], second[1])
    if estimate is None:
        return
    lag, correlation = estimate
    pair = f"{quantity} in {first[0]} and in {second[0]}"
    if not correlation >= MIN_CORRELATION:
        log.add_warning(f"{pair} are not the same movement (correlation {correlation:.2f}): check the trials")
    elif abs(lag) >= MIN_REPORTED_LAG:
        log.add_warning(
            f"{pair} correlate best with an offset of {1e3 * abs(lag):.0f} ms: if the clocks differ, set "
            f"'\"{first[0]}\" = {lag:.4g}' under [clock] in a file for --map"
        )
    else:
        log.add_derived(f"Clock check: {pair} correlate best with an offset below {1e3 * MIN_REPORTED_LAG:.0f} ms")
