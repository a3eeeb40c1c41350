"""Bandwidth of the load of a walk: a force plate that was low-pass filtered like markers rounds every foot strike."""

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

from klute_sim.datasets.trial import TimeSeries, Trial

LOAD_CHANNEL = "grf_vertical"
"""Vertical load of a walk."""
SLOW_BAND_HZ, FAST_BAND_HZ = (1.0, 4.0), (12.0, 18.0)
"""Bands [Hz] of the strides, and of foot strikes."""
MIN_FAST_DENSITY = 2e-6
"""Smallest mean power density in the fast band over that in the slow band of a load that was not filtered (assumed:
3e-5 and 7e-5 under the feet of a published walk, 4e-4 in simulated ones; 1e-7 after a zero-lag filter of fourth order
at 6 Hz)."""
WINDOW_TIME = 2.0
"""Length of the windows whose spectra are averaged [s]."""


def describe_filtered_loads(trials: Sequence[Trial]) -> list[str]:
    """Return a remark on the walks among ``trials`` whose vertical load has no fast content."""
    filtered = [t for t in trials if LOAD_CHANNEL in t.prescribed and _is_filtered(t.prescribed[LOAD_CHANNEL])]
    if not filtered:
        return []
    names = ", ".join(f"'{trial.name}'" for trial in filtered)
    where = "all trials" if len(filtered) == len(trials) else f"trial{'s' if len(filtered) > 1 else ''} {names}"
    return [
        f"`{LOAD_CHANNEL}` of {where} has next to no content from {FAST_BAND_HZ[0]:g} to {FAST_BAND_HZ[1]:g} Hz, as "
        "after a low-pass filter at 10 Hz or less: foot strikes and push-off are rounded, and force and angle of the "
        "prosthesis are not; use the force plate as it was recorded"
    ]


def _is_filtered(load: TimeSeries) -> bool:
    """Return whether ``load`` lacks the content of foot strikes, as far as its samples can show it."""
    time = np.arange(load.time[0], load.time[-1], load.sampling_interval)
    if 0.5 / load.sampling_interval < FAST_BAND_HZ[1] or time[-1] - time[0] < WINDOW_TIME:
        return False
    value = np.nan_to_num(load.value)
    n_window = int(WINDOW_TIME / load.sampling_interval)
    frequency, density = welch(np.interp(time, load.time, value), 1.0 / load.sampling_interval, nperseg=n_window)
    slow, fast = (
        float(density[(frequency >= low) & (frequency < high)].mean()) for low, high in (SLOW_BAND_HZ, FAST_BAND_HZ)
    )
    return slow > 0.0 and fast < MIN_FAST_DENSITY * slow
