"""Find a force plate or a log of the device with another clock, and a plate that recorded another trial.

The tendon balances the moment of the ground reaction whatever the muscle does, so tension and plate tell the time of
every step twice, and the ankle angle tells it once more through the law of the muscle. A replay under the load at other
times shows which time removes the misfit. Other causes delay a channel against the load: the filter of an instrument
delays its own channel only, and never makes it early; friction and damping of the ankle delay all channels, but leave a
misfit that no shift removes (10 N.m of dry friction: a third of the variance of the force).

A late log of the device looks much like an early plate: the ankle hardly moves while the foot is loaded. They differ at
push-off, where the ankle moves away from the centre of pressure, and in swing. Which of the two shifts leaves less
unexplained tells them apart, unless other errors leave more.
"""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

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
MAX_LOG_DIFFERENCE = 0.06
"""Largest difference between the delay of the log and that of the plate, with the opposite sign, that is tried [s]."""
MIN_CHANNEL_RATIO, MIN_TOTAL_RATIO = 1.25, 3.0
"""Smallest ratio of the unexplained shares with one and the other clock shifted that tells them apart: of each channel,
and the product of all (assumed; of 163 walks of another model with one clock 15 to 50 ms late or early, most with other
errors as well, 67 are told apart, and none of these wrongly)."""
Clock = Literal["plate", "log", "unknown"]
"""Instrument whose clock differs from those of the others."""


class UnexplainedShares(NamedTuple):
    """Shares of the variance of a measured channel that a replay leaves unexplained."""

    as_recorded: float
    """With all clocks as recorded."""
    plate_shifted: float
    """With the delay of the plate subtracted."""
    log_shifted: float
    """With the delay of the log subtracted instead."""


class ClockDelay(NamedTuple):
    """Delay of the plate, or of the log of the device, in one trial."""

    plate_delay: float
    """Time by which the plate is late, if the other clocks agree [s]."""
    log_delay: float
    """Time by which the log of the device is late, if the other clocks agree [s]."""
    unexplained: Mapping[str, UnexplainedShares]
    """Measured channel -> unexplained shares."""


def find_clock_delays(trials: Sequence[MeasuredTrial]) -> list[Finding]:
    """Return a finding for each trial whose plate or log has another clock; the instruments of all are the same."""
    estimates = [
        (measured, estimate) for measured in trials if (estimate := estimate_clock_delay(measured)) is not None
    ]
    clock = identify_clock([delay for _, delay in estimates]) if estimates else "unknown"
    return [_describe(measured, delay, clock) for measured, delay in estimates]


def estimate_clock_delay(measured: MeasuredTrial) -> ClockDelay | None:
    """Return the delay of the plate or log, or None where the trial shows none that matters.

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
    remaining = {name: shifted[name].unexplained / as_recorded[name].unexplained for name in channels}
    if any(share > MAX_REMAINING_SHARE for share in remaining.values()):
        return None
    tried = [difference - delays[0] for difference in _list_delays(MAX_LOG_DIFFERENCE)]
    log_delay = _find_best_delay(measured, channels[0], tried, "log")
    replays = as_recorded, shifted, measured.compare(log_delay=log_delay) or as_recorded
    shares = {name: UnexplainedShares(*(replay[name].unexplained for replay in replays)) for name in channels}
    return ClockDelay(delays[0], log_delay, shares)


def identify_clock(estimates: Sequence[ClockDelay]) -> Clock:
    """Return which clock differs in all trials: the other one leaves clearly more of every channel unexplained."""
    ratios: dict[str, list[float]] = {}
    for estimate in estimates:
        for name, shares in estimate.unexplained.items():
            ratios.setdefault(name, []).append(shares.plate_shifted / shares.log_shifted)
    means = np.array([np.exp(np.mean(np.log(values))) for values in ratios.values()])
    if means.prod() >= MIN_TOTAL_RATIO and means.min() >= MIN_CHANNEL_RATIO:
        return "log"
    if 1.0 / means.prod() >= MIN_TOTAL_RATIO and 1.0 / means.max() >= MIN_CHANNEL_RATIO:
        return "plate"
    return "unknown"


def _list_delays(longest: float) -> list[float]:
    count = round(longest / DELAY_STEP)
    return [DELAY_STEP * number for number in range(-count, count + 1)]


def _find_best_delay(
    measured: MeasuredTrial, channel: str, delays: list[float], clock: Literal["plate", "log"] = "plate"
) -> float:
    """Return the delay [s] of ``clock`` at which ``channel`` is explained best.

    It is that of a parabola through the three best ``delays``.
    """
    replays = [measured.compare(**{f"{clock}_delay": delay}) for delay in delays]
    shares = [replay[channel].unexplained if channel in replay else np.inf for replay in replays]
    best = int(np.argmin(shares))
    if not 0 < best < len(delays) - 1 or not np.isfinite(shares[best - 1 : best + 2]).all():
        return delays[best]
    before, at, after = shares[best - 1 : best + 2]
    curvature = before - 2.0 * at + after
    offset = 0.5 * (before - after) / curvature if curvature > 0.0 else 0.0
    return delays[best] + offset * (delays[1] - delays[0])


def _describe(measured: MeasuredTrial, delay: ClockDelay, clock: Clock) -> Finding:
    channel, shares = next(iter(delay.unexplained.items()))
    before, plate_shifted, log_shifted = (f"{100.0 * share:.2g} %" for share in shares)
    plate = f"the force plate is {_format_delay(delay.plate_delay)} against {' and '.join(delay.unexplained)}"
    log = f"the log of the device is {_format_delay(delay.log_delay)} against the motion and the force plate"
    plate_advice = _advise(measured.trial, delay.plate_delay, PLATE_CHANNELS)
    log_advice = _advise(measured.trial, delay.log_delay, measured.log_channels)
    exchange = "or, if the file of the plate is that of another trial, exchange it"
    section = "under [delay] or [trial.delay]"
    unexplained = f"{before} of the variance of {channel} unexplained"
    if clock == "plate":
        statement = (
            f"{plate}: a replay under its load leaves {unexplained}, and {plate_shifted} if {_join(PLATE_CHANNELS)} "
            f"are shifted by this time; {plate_advice} {section}, {exchange}"
        )
    elif clock == "log":
        statement = (
            f"{log}: a replay leaves {unexplained}, {log_shifted} if {_join(measured.log_channels)} are shifted by "
            f"this time, and {plate_shifted} if the plate is shifted instead; {log_advice} {section}, or "
            f"{-delay.log_delay:.3f} for the file of the log under [clock] in a file for --map of an import"
        )
    else:
        statement = (
            f"{plate}, or {log}, which replays do not tell apart: they leave {unexplained}, {plate_shifted} if the "
            f"plate is shifted, and {log_shifted} if the log is; if motion and plate have one clock, {log_advice}, "
            f"otherwise {plate_advice} {section}, {exchange}"
        )
    return Finding("log-delay" if clock == "log" else "plate-delay", f"trial '{measured.trial.name}'", statement)


def _format_delay(delay: float) -> str:
    return f"{1e3 * abs(delay):.0f} ms {'late' if delay > 0.0 else 'early'}"


def _join(channels: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(channels[:-1]), channels[-1])))


def _advise(trial: Trial, delay: float, channels: Sequence[str]) -> str:
    """Return which delays to state, where ``delay`` [s] remains beside those that ``trial`` states already."""
    totals = {name: f"{1e3 * (trial.delays.get(name, 0.0) + delay):.0f} ms" for name in channels}
    if len(set(totals.values())) == 1:
        advice = f"state '{totals[channels[0]]}' for each of {_join(channels)}"
    else:
        advice = "state " + ", ".join(f"{name} = '{total}'" for name, total in totals.items())
    is_stated = any(trial.delays.get(name) for name in channels)
    return f"{advice} in place of the delay stated now" if is_stated else advice
