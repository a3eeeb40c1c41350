"""How well the measured channels of a trial agree with a simulation of the declared device."""

import math
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.bench.trial import MEASURED, MIN_FORCE, RecordedTrial, Response
from klute_sim.plausibility.samples import compute_correlation
from klute_sim.types import Array

MAX_STEPS = 20_000
"""Maximum number of time steps of a simulation; a longer trial is compared in the window that moves most."""
STEPS_PER_SAMPLE = 2
"""Time steps per sample of the command."""
MIN_TIME_STEP, MAX_TIME_STEP = 1e-5, 0.01
"""Limits of the time step [s]."""
MAX_SCALE = 3.0
"""Largest ratio of a right force or length to the simulated one, and of the simulated one to it (assumed: a muscle of
twice or half the strength is possible; the closest units, newton and pound, differ by 4.4)."""
MIN_SCALE_CORRELATION = 0.8
"""Smallest correlation with which the ratio of ranges is a ratio of scales."""
MIN_CALIBRATION, MIN_CALIBRATION_CORRELATION = 20.0, 0.95
"""Smallest ratio of scales, and smallest correlation with the simulation, of a force that was never calibrated
(assumed)."""
MIN_RELATIVE_FORCE_RANGE, MIN_LENGTH_RANGE = 0.15, 1e-3
"""Smallest range of a simulated force, relative to its level, and of a simulated muscle length [m] whose waveform can
be compared."""
MIN_PRESSURE_SCALE = 0.02
"""Smallest fraction of the supply pressure to which pressure residuals are related."""


class Agreement(NamedTuple):
    """Agreement of one measured channel with its simulation."""

    misfit: float
    """0: the channel agrees; 1: it contradicts the simulation."""
    measured: Array
    """Measured samples [SI] that are compared: the finite ones in the simulated time."""
    simulated: Array
    """Simulated samples [SI] at the times of the measured ones."""
    size_ratio: float
    """Ratio of measured to simulated magnitude; 0 or infinite where one of them is 0."""
    span_ratio: float
    """Ratio of measured to simulated range, which a wrong zero of the sensor does not change."""
    correlation: float
    """Correlation of measured and simulated waveform."""

    @property
    def scale_error(self) -> float:
        """Natural logarithm of the ratio of magnitudes, without sign."""
        return abs(math.log(self.size_ratio)) if 0.0 < self.size_ratio < math.inf else math.inf


def simulate_trial(trial: RecordedTrial) -> Response | None:
    """Return the simulated response, at most :data:`MAX_STEPS` long, or None where the simulation fails."""
    length, command = trial.channels["length"], trial.channels["pressure_command"]
    start = max(length.time[0], command.time[0])
    end = min(length.time[-1], command.time[-1])
    interval = min(float(np.median(np.diff(channel.time))) for channel in (length, command))
    dt = min(max(interval / STEPS_PER_SAMPLE, MIN_TIME_STEP), MAX_TIME_STEP)
    n_steps = math.floor(min((end - start) / dt, 1e7))
    if n_steps < 2:
        return None
    if n_steps > MAX_STEPS:
        start = _find_window(trial, start, end - MAX_STEPS * dt, MAX_STEPS * dt)
        n_steps = MAX_STEPS
    time = start + dt * np.arange(1.0, n_steps + 1.0)
    inputs = []
    for channel in (length, command):
        is_finite = np.isfinite(channel.samples.value)
        inputs.append(np.interp(time, channel.time[is_finite], channel.samples.value[is_finite]))
    response = trial.simulate(dt, inputs[0], inputs[1])
    return None if response is None else response._replace(time=response.time + start)


def _find_window(trial: RecordedTrial, first: float, last: float, duration: float) -> float:
    """Return the start, between ``first`` and ``last``, of the window in which the inputs change most [s]."""
    starts = np.linspace(first, last, 50)
    activity = np.zeros(len(starts))
    for name in ("length", "pressure_command"):
        channel = trial.channels[name]
        path = np.cumsum(np.abs(np.diff(np.nan_to_num(channel.samples.value), prepend=channel.samples.value[0])))
        total = float(path[-1])
        if total > 0.0:
            activity += np.interp(starts + duration, channel.time, path / total)
            activity -= np.interp(starts, channel.time, path / total)
    return float(starts[int(np.argmax(np.round(activity, 3)))])


def moves_under_load(trial: RecordedTrial) -> bool:
    """Return whether the unit moves under a nearly constant force, as with a hanging weight.

    All its lengths must be possible: in a clamped trial with exchanged columns, the force stands under length.
    """
    if "force" not in trial.channels:
        return False
    possible = trial.limits.get_range("length")
    shortest, longest = np.percentile(trial.get_samples("length").finite, [1.0, 99.0])
    if not possible.low <= shortest <= longest <= possible.high:
        return False
    force = _clip_outliers(trial.get_samples("force").finite)
    span = MIN_RELATIVE_FORCE_RANGE * float(np.median(np.abs(force)))
    return compute_span(trial.get_samples("length").finite) > MIN_LENGTH_RANGE and compute_span(force) < span


def compare_trial(
    trial: RecordedTrial, response: Response | None, *, has_constant_load: bool = False
) -> dict[str, Agreement]:
    """Return measured channel -> agreement for the channels whose simulation is informative.

    Under a constant load any error of the law gives the simulated force another waveform, so with ``has_constant_load``
    its magnitude alone is compared.
    """
    agreements: dict[str, Agreement] = {}
    if response is None:
        return agreements
    simulated = {"force": response.force, "pressure": response.pressure, "muscle_length": response.muscle_length}
    for name in MEASURED:
        channel = trial.channels.get(name)
        if channel is None:
            continue
        is_inside = (channel.time >= response.time[0]) & (channel.time <= response.time[-1])
        is_inside &= np.isfinite(channel.samples.value)
        measured = channel.samples.value[is_inside]
        expected = np.interp(channel.time[is_inside], response.time, simulated[name])
        if len(measured) < 5:
            continue
        compute_misfit = _compute_load_misfit if has_constant_load and name == "force" else _MISFITS[name]
        misfit = compute_misfit(trial, _clip_outliers(measured), expected)
        if misfit is not None:
            sizes = (float(np.percentile(np.abs(values), 95.0)) for values in (measured, expected))
            spans = (compute_span(values) for values in (measured, expected))
            agreements[name] = Agreement(
                misfit, measured, expected, _divide(*sizes), _divide(*spans), compute_correlation(measured, expected)
            )
    return agreements


def find_calibration(agreement: Agreement) -> float | None:
    """Return the factor from measured to simulated force where both have one waveform and scales of no common unit."""
    if agreement.scale_error < math.log(MIN_CALIBRATION) or agreement.correlation < MIN_CALIBRATION_CORRELATION:
        return None
    if not (varies(agreement.measured) and varies(agreement.simulated)):  # a force that hardly varies is a load
        return None
    return 1.0 / agreement.span_ratio


def varies(force: Array) -> bool:
    """Return whether the waveform of ``force`` can be compared."""
    return compute_span(force) >= MIN_RELATIVE_FORCE_RANGE * float(np.percentile(np.abs(force), 95.0))


def _divide(measured: float, expected: float) -> float:
    return measured / expected if expected > 0.0 else math.inf


def _clip_outliers(values: Array) -> Array:
    """Return ``values`` without the spikes of a loose contact."""
    low, high = np.percentile(values, [1.0, 99.0])
    return np.clip(values, low, high)


def compute_span(values: Array) -> float:
    """Return the range of ``values`` without their outermost two percent on each side."""
    low, high = np.percentile(values, [2.0, 98.0])
    return float(high - low)


def _compute_pressure_misfit(trial: RecordedTrial, measured: Array, expected: Array) -> float | None:
    """Return the residual relative to the range; the pressure follows the command closely, whatever the muscle does."""
    scale = max(
        compute_span(expected),
        0.3 * float(np.median(np.abs(expected))),
        MIN_PRESSURE_SCALE * trial.limits.supply_pressure,
    )
    return min(1.0, float(np.sqrt(np.mean((measured - expected) ** 2))) / scale)


def _compute_force_misfit(trial: RecordedTrial, measured: Array, expected: Array) -> float | None:
    """Return the unexplained share of the waveform of a force, or 1 for a force of another scale or sign."""
    level = float(np.median(np.abs(expected)))
    largest = float(np.percentile(np.abs(expected), 95.0))
    if largest < max(MIN_FORCE, 0.02 * trial.limits.max_force):
        return None
    if compute_span(expected) < MIN_RELATIVE_FORCE_RANGE * largest:
        ratio = float(np.median(measured)) / float(np.median(expected)) if level > 0.0 else 1.0
        return 0.0 if 1.0 / MAX_SCALE <= ratio <= MAX_SCALE else 1.0
    misfit, scale = _compare_waveforms(measured, expected)
    ratio = float(np.percentile(np.abs(measured), 95.0)) / largest
    is_off = [not 1.0 / MAX_SCALE <= value <= MAX_SCALE for value in (scale, ratio)]
    return 1.0 if all(is_off) else misfit


def _compute_load_misfit(trial: RecordedTrial, measured: Array, expected: Array) -> float | None:
    """Return 1 for a constant load of another scale or sign than the simulated force, or 0."""
    level = float(np.median(np.abs(expected)))
    if level < max(MIN_FORCE, 0.02 * trial.limits.max_force):
        return None
    return 0.0 if 1.0 / MAX_SCALE <= float(np.median(measured)) / level <= MAX_SCALE else 1.0


def _compute_muscle_length_misfit(trial: RecordedTrial, measured: Array, expected: Array) -> float | None:
    """Return the unexplained share of the waveform of a muscle length, whose sensor may have any zero."""
    if compute_span(expected) < MIN_LENGTH_RANGE:
        return None
    misfit, scale = _compare_waveforms(measured, expected)
    return misfit if 1.0 / MAX_SCALE <= scale <= MAX_SCALE else 1.0


def _compare_waveforms(measured: Array, expected: Array) -> tuple[float, float]:
    """Return the share of the waveform that a linear relation leaves, and the ratio of the ranges where it is small."""
    correlation = compute_correlation(measured, expected)
    misfit = 1.0 if correlation <= 0.0 else math.sqrt(max(0.0, 1.0 - correlation**2))
    if abs(correlation) < MIN_SCALE_CORRELATION:
        return misfit, 1.0
    return misfit, compute_span(measured) / max(compute_span(expected), 1e-12)


_MISFITS = {
    "force": _compute_force_misfit,
    "pressure": _compute_pressure_misfit,
    "muscle_length": _compute_muscle_length_misfit,
}
