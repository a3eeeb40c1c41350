"""Find a force plate that is late or early against the device, or that recorded another trial.

The tendon balances the moment of the ground reaction whatever the muscle does, so tension and plate tell the time of
every step twice, and the ankle angle tells it once more through the law of the muscle. A replay under the load at other
times shows which time removes the misfit. Other causes delay a channel against the load: the filter of an instrument
delays its own channel only, and never makes it early; friction and damping of the ankle delay all channels, but leave a
misfit that no shift removes (10 N.m of dry friction: a third of the variance of the force).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.datasets.trial import Trial
from klute_sim.gait.replay.measured_trial import PLATE_CHANNELS, MeasuredTrial
from klute_sim.plausibility.finding import Finding

DIRECT_CHANNEL = "force"
"""Channel that follows the load at once."""
OTHER_CHANNELS = ("ankle_angle", "muscle_length")
"""Channels that follow it through the law of the muscle, in order of preference."""
MIN_DELAY = 0.012
"""Shortest delay [s] that is reported (assumed; a diagnosis fits shorter ones with the registration of the walk. In
right walks with all effects of the benchmark the nearer channel has 3 ms or less)."""
MAX_DELAY, MAX_NEAR_DELAY = 0.4, 0.08
"""Longest delays [s] that are tried: less than half a stride, because strides resemble each other, and for a channel
that the load as recorded explains."""
DELAY_STEP = 0.01
"""Interval between the delays that are tried [s]."""
MAX_DISAGREEMENT = 0.01
"""Largest difference between the delays by two channels [s] (assumed; plates of other trials have up to 9 ms)."""
MAX_REMAINING_SHARE = 0.25
"""Largest ratio of the unexplained shares of a channel with and without the shift (assumed; 0.1 for 15 ms)."""
MAX_UNEXPLAINED = 0.05
"""Unexplained share of a channel above which distant delays are tried (assumed; 50 ms leave as much of a force)."""


class PlateDelay(NamedTuple):
    """Delay of the plate in one trial."""

    delay: float
    """Time by which the plate is late [s]."""
    unexplained: Mapping[str, tuple[float, float]]
    """Measured channel -> unexplained share of its variance as recorded, and with the load shifted."""


def find_plate_delays(trials: Sequence[MeasuredTrial]) -> list[Finding]:
    """Return a finding for each trial whose plate has another clock."""
    return [_describe(each.trial, found) for each in trials if (found := estimate_plate_delay(each)) is not None]


def estimate_plate_delay(measured: MeasuredTrial) -> PlateDelay | None:
    """Return the delay of the plate, or None where the trial shows none that matters.

    Where a single channel tells, only a late plate is one: a filter of its instrument makes the plate look early.
    """
    as_recorded = measured.compare()
    channels = [name for name in (DIRECT_CHANNEL, *OTHER_CHANNELS) if name in as_recorded][:2]
    if not channels:
        return None
    is_near = as_recorded[channels[0]].unexplained < MAX_UNEXPLAINED
    first_guess = _find_best_delay(measured, channels[0], [-2.0 * DELAY_STEP, 0.0, 2.0 * DELAY_STEP])
    if is_near and abs(first_guess) < 0.75 * MIN_DELAY:
        return None
    tried = _list_delays(MAX_NEAR_DELAY if is_near else MAX_DELAY)
    delays = [_find_best_delay(measured, name, tried) for name in channels]
    is_agreed = min(map(abs, delays)) >= MIN_DELAY and max(delays) - min(delays) <= MAX_DISAGREEMENT
    if not is_agreed or abs(delays[0]) > tried[-2] or (len(channels) == 1 and delays[0] < 0.0):
        return None
    shifted = measured.compare(plate_delay=delays[0])
    unexplained = {name: (as_recorded[name].unexplained, shifted[name].unexplained) for name in channels}
    if any(after > MAX_REMAINING_SHARE * before for before, after in unexplained.values()):
        return None
    return PlateDelay(delays[0], unexplained)


def _list_delays(longest: float) -> list[float]:
    count = round(longest / DELAY_STEP)
    return [DELAY_STEP * number for number in range(-count, count + 1)]


def _find_best_delay(measured: MeasuredTrial, channel: str, delays: list[float]) -> float:
    """Return the delay [s] at which ``channel`` is explained best, by a parabola through the three best ``delays``."""
    replays = [measured.compare(plate_delay=delay) for delay in delays]
    shares = [replay[channel].unexplained if channel in replay else np.inf for replay in replays]
    best = int(np.argmin(shares))
    if not 0 < best < len(delays) - 1 or not np.isfinite(shares[best - 1 : best + 2]).all():
        return delays[best]
    before, at, after = shares[best - 1 : best + 2]
    curvature = before - 2.0 * at + after
    offset = 0.5 * (before - after) / curvature if curvature > 0.0 else 0.0
    return delays[best] + offset * (delays[1] - delays[0])


def _describe(trial: Trial, found: PlateDelay) -> Finding:
    size, direction = f"{1e3 * abs(found.delay):.0f} ms", "late" if found.delay > 0.0 else "early"
    channel, shares = next(iter(found.unexplained.items()))
    before, after = (f"{100.0 * share:.2g} %" for share in shares)
    statement = (
        f"the force plate is {size} {direction} against {' and '.join(found.unexplained)}: a replay under its load "
        f"leaves {before} of the variance of {channel} unexplained, and {after} if grf_vertical, grf_forward and cop_x "
        f"are shifted by this time; {_advise(trial, found.delay)} under [delay] or [trial.delay], or, if the file of "
        "the plate is that of another trial, exchange it"
    )
    return Finding("plate-delay", f"trial '{trial.name}'", statement)


def _advise(trial: Trial, delay: float) -> str:
    """Return which delays to state, where ``delay`` [s] remains beside those that ``trial`` states already."""
    totals = {name: f"{1e3 * (trial.delays.get(name, 0.0) + delay):.0f} ms" for name in PLATE_CHANNELS}
    if len(set(totals.values())) == 1:
        advice = f"state '{totals[PLATE_CHANNELS[0]]}' for each of the three"
    else:
        advice = "state " + ", ".join(f"{name} = '{total}'" for name, total in totals.items())
    is_stated = any(trial.delays.get(name) for name in PLATE_CHANNELS)
    return f"{advice} in place of the delay stated now" if is_stated else advice
