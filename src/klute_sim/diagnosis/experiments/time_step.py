"""Time steps of experiments: how long they are, and how much longer coarse ones are."""

import math

STEPS_PER_SAMPLE = 6
"""Time steps per sample of the prescribed channels, within the limits of the time step: at 200 Hz the error of the
simulation is 0.075 times the noise of a load cell, where ten leave 0.054 and the unknown inputs between samples alone
0.048."""
COARSE_STEP_FACTOR = 2
"""Time steps that a coarse simulation merges into one. Its derivatives are accurate to within two fifths, and its
error relative to the normal time step is subtracted."""


def choose_time_step(
    sampling_interval: float,
    min_step: float,
    max_step: float,
    steps_per_sample: int = STEPS_PER_SAMPLE,
    merged_steps: int = COARSE_STEP_FACTOR,
) -> float:
    """Return the time step [s] for inputs with ``sampling_interval`` [s].

    It is about a ``steps_per_sample``-th of the interval where that lies between its limits [s]. The interval is a
    whole number of the longest steps, which merge ``merged_steps`` steps. Otherwise a command that changes at a sample
    would act early in long steps alone, and the extrapolation to a vanishing time step would be off by 1.5 times the
    noise of a gauge. To that end, the steps of a fast log are shorter than ``min_step``, down to half of it.
    """
    step = min(max(sampling_interval / steps_per_sample, min_step), max_step)
    n_steps = merged_steps * math.ceil(sampling_interval / (merged_steps * step) - 1e-6)
    return max(sampling_interval / n_steps, 0.5 * min_step)
