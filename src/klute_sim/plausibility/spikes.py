"""Wrong samples: a channel jumps far away for one to three samples, and back, as no motion or process does."""

from collections.abc import Sequence

import numpy as np

from klute_sim.mask_runs import find_runs
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.samples import Samples
from klute_sim.plausibility.units import Range, format_value, round_digits
from klute_sim.types import Array, Mask

MAX_SPIKE_SAMPLES = 3
"""Largest number of samples of one spike."""
MAX_SPIKE_FRACTION = 0.005
"""Largest number of spikes over that of samples (assumed; a loose contact has more); two are always possible."""
MIN_USUAL_RATIO = 10.0
"""Smallest ratio of a spike to what noise and motion do otherwise (assumed)."""
MAX_ACCELERATIONS = {"m": 200.0, "rad": 2000.0}
"""SI unit of a position -> largest acceleration [per s2] of the muscles, testers and joints (assumed)."""
POSITION_UNITS = frozenset(MAX_ACCELERATIONS)
"""SI units of lengths and angles."""
MIN_JUMPS = {"m": 5e-3, "rad": 0.1}
"""SI unit of a position -> smallest spike [SI] that is reported (assumed)."""
WRAP_TOLERANCE = 0.2
"""Largest relative difference of a spike from a full turn that is taken for a wrap (assumed)."""


def find_spikes(time: Array, value: Array, min_jump: float, acceleration: float = 0.0) -> list[tuple[int, int]]:
    """Return first index and index + 1 of the spikes in ``value``, whose samples are all finite, at ``time`` [s].

    A spike is far beyond the samples before and after it, by more than ``min_jump`` and by more than a motion with this
    ``acceleration`` [per s2] can reach between them, and by much more than all other runs of as many samples are.
    """
    spikes: list[tuple[int, int]] = []
    n_spikes = max(2, int(MAX_SPIKE_FRACTION * len(value)))
    for width in range(1, MAX_SPIKE_SAMPLES + 1):
        n_runs = len(value) - width - 1
        if n_runs <= n_spikes:
            break
        before, after = value[:n_runs], value[width + 1 :]
        inside = np.lib.stride_tricks.sliding_window_view(value, width)[1 : n_runs + 1]
        above = inside.min(axis=1) - np.maximum(before, after)
        jump = np.maximum(np.maximum(above, np.minimum(before, after) - inside.max(axis=1)), 0.0)
        usual = float(np.partition(jump, -n_spikes - 1)[-n_spikes - 1])
        reach = 0.125 * acceleration * (time[width + 1 :] - time[:n_runs]) ** 2
        is_spike = jump > np.maximum(max(min_jump, MIN_USUAL_RATIO * usual), reach)
        spikes += [(int(row) + 1, int(row) + 1 + width) for row in np.flatnonzero(is_spike)]
    return sorted(spikes)


def check_position(
    samples: Samples, time: Array, si_unit: str, place: str, possible: Range | None = None
) -> tuple[list[Finding], Mask]:
    """Return a finding for the spikes of a length or an angle in ``si_unit``, and which ``samples`` are in them.

    Samples beyond the ``possible`` range are reported however slow the recording is. A full turn is a wrap, no spike.
    """
    is_finite = np.isfinite(samples.value)
    rows = np.flatnonzero(is_finite)
    value = samples.value[rows]
    runs = find_spikes(time[rows], value, MIN_JUMPS[si_unit], MAX_ACCELERATIONS[si_unit])
    if si_unit == "rad":
        turn = 2.0 * np.pi
        runs = [run for run in runs if abs(abs(value[run[0]] - value[run[0] - 1]) - turn) > WRAP_TOLERANCE * turn]
    if possible is not None:
        runs += _find_impossible(value, possible)
    is_wrong = mark_runs(samples.value, runs)
    return [describe_spikes(samples, time, is_wrong, place)] if runs else [], is_wrong


def mark_runs(value: Array, runs: Sequence[tuple[int, int]]) -> Mask:
    """Return which samples of ``value`` lie in the ``runs``, whose indices count the finite samples."""
    rows = np.flatnonzero(np.isfinite(value))
    mask = np.zeros(len(value), dtype=np.bool_)
    for start, stop in runs:
        mask[rows[start:stop]] = True
    return mask


def _find_impossible(value: Array, possible: Range) -> list[tuple[int, int]]:
    """Return the few short runs of ``value`` beyond the ``possible`` range, at the beginning and the end as well."""
    is_impossible = (value < possible.low) | (value > possible.high)
    runs = find_runs(is_impossible)
    is_few = len(runs) <= max(2, int(MAX_SPIKE_FRACTION * len(value)))
    return runs if is_few and all(stop - start <= MAX_SPIKE_SAMPLES for start, stop in runs) else []


def describe_spikes(samples: Samples, time: Array, is_wrong: Mask, place: str, cause: str = "") -> Finding:
    """Return the finding that the samples ``is_wrong`` are spikes; ``cause`` says what does not explain them."""
    first = int(is_wrong.argmax())
    beside = np.flatnonzero(~is_wrong & np.isfinite(samples.value))
    others = [samples.value[row] for row in (*beside[beside < first][-1:], *beside[beside > first][:1])]
    texts = _format_values(others, samples)
    number = int(is_wrong.sum())
    count = f" (the first of {number} such samples)" if number > 1 else ""
    statement = (
        f"{samples.channel} is {format_value(float(samples.value[first]), samples.unit, samples.factor)} at "
        f"{time[first]:.6g} s{count}, but {texts} before and after it; {cause or 'nothing moves as fast'}, so the "
        "sample seems wrong: remove its row, or leave its cell empty if the channel is measured"
    )
    return Finding(f"{samples.channel}-spike", place, statement)


def _format_values(values: Sequence[float], samples: Samples) -> str:
    """Return one or two ``values`` [SI] in the unit of ``samples``."""
    numbers = dict.fromkeys(f"{round_digits(float(value) / samples.factor):g}" for value in values)
    return f"{' and '.join(numbers)} {samples.unit}"
