"""Measured frequency responses: their table, and what a simulated response lacks in gain, lag and dead time."""

import itertools
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from klute_sim.errors import InputError, suggest
from klute_sim.files.limits import TABLE
from klute_sim.files.lines import read_csv_records
from klute_sim.types import Array

Response = NDArray[np.complex128]
GAIN_COLUMNS = ("gain [1]", "gain [deg/bar]", "gain [mm/bar]", "gain [dB]")
"""Possible headings of the gain."""
COLUMNS = ("frequency [Hz]", "phase [deg]")
"""Headings of frequency and phase."""
MIN_FREQUENCY, MAX_FREQUENCY = 0.01, 50.0
"""Limits of a frequency [Hz]."""
MIN_POINTS, MAX_POINTS = 3, 500
"""Smallest number of points (a gain, a lag and a dead time are fitted), and largest."""
MAX_LAG, MAX_DEAD_TIME = 10.0, 2.0
"""Bounds of a fitted time constant and a fitted dead time [s]."""
INITIAL_LAGS, INITIAL_DEAD_TIMES = (0.01, 0.1), (-0.1, -0.03, 0.0, 0.03, 0.1, 0.3)
"""Lags and dead times [s] from which fits start (assumed)."""
SCALES, FIT_TOLERANCE = (1.0, 0.03, 0.03), 1e-12
"""Scales of the fitted numbers [neper, s, s], and relative tolerance of a fit."""


class FrequencyResponse(NamedTuple):
    """A frequency response."""

    frequency: Array
    """Frequencies [Hz], increasing."""
    response: Response
    """Output over input at each frequency; the phase of a lag is negative."""
    gain_unit: str
    """Unit of the gain: ``1`` where it is a ratio without a scale."""


class Correction(NamedTuple):
    """Factor, first-order lag and dead time by which a measured response differs from a simulated one."""

    gain: float
    """Factor; 1 where both agree and have the same unit."""
    lag: float
    """Time constant of a first-order lag [s]."""
    dead_time: float
    """Dead time [s]; negative where the simulation is late."""
    gain_error_db: float
    """Root mean square error of the gain that is left [dB]."""
    phase_error_deg: float
    """Root mean square error of the phase that is left [deg]."""

    def compute_response(self, frequency: Array) -> Response:
        """Return gain times exp(-i w T) / (1 + i w tau) at ``frequency`` [Hz]."""
        pace = 2j * np.pi * frequency
        return np.asarray(self.gain * np.exp(-pace * self.dead_time) / (1.0 + pace * self.lag))


class ResponseComparison(NamedTuple):
    """A measured beside a simulated frequency response."""

    measured: FrequencyResponse
    """Measured response."""
    simulated: Response
    """Simulated response at the same frequencies, in its own unit."""
    coherence: Array
    """Fraction of the variance of the simulated output that is a sine."""
    factor: Correction
    """Factor alone."""
    correction: Correction
    """Factor, lag and dead time."""


def read_frequency_response(path: str | Path) -> FrequencyResponse:
    """Read a CSV table with the columns ``frequency [Hz]``, ``gain [...]`` and ``phase [deg]``.

    Raises InputError for a missing column, a cell that is no number, frequencies that do not increase or are out of
    range, a gain that is not positive, and too few or too many rows.
    """
    records, description = read_csv_records(path, TABLE), TABLE.describe(path)
    headings = {name.strip(): name for name in (records[0] if records else {})}
    gains = [name for name in GAIN_COLUMNS if name in headings]
    for name in (*COLUMNS, *(() if gains else ("gain [1]",))):
        if name not in headings:
            allowed = f"the first line names frequency [Hz], phase [deg] and one of {', '.join(GAIN_COLUMNS)}"
            raise InputError(f"{description} has no column '{name}'; {suggest(name, headings, allowed)}")
    if not MIN_POINTS <= len(records) <= MAX_POINTS:
        raise InputError(f"{description} has {len(records)} rows; allowed: {MIN_POINTS} to {MAX_POINTS}")
    frequency, gain, phase = (
        np.array([_parse_cell(row[headings[name]], name, number, description) for number, row in enumerate(records, 2)])
        for name in (COLUMNS[0], gains[0], COLUMNS[1])
    )
    if (np.diff(frequency) <= 0.0).any() or frequency[0] < MIN_FREQUENCY or frequency[-1] > MAX_FREQUENCY:
        raise InputError(
            f"{description}: frequencies are {frequency[0]:g} to {frequency[-1]:g} Hz; allowed: increasing, "
            f"{MIN_FREQUENCY:g} to {MAX_FREQUENCY:g} Hz"
        )
    if gains[0] == "gain [dB]":
        gain = 10.0 ** (gain / 20.0)
    if (gain <= 0.0).any():
        raise InputError(
            f"{description}: a gain is {gain.min():g}; allowed: above 0 (a sign is a phase of 180 degrees)"
        )
    unit = gains[0].removeprefix("gain [").removesuffix("]")
    return FrequencyResponse(frequency, gain * np.exp(1j * np.radians(phase)), "1" if unit == "dB" else unit)


def _parse_cell(text: str, column: str, row: int, description: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InputError(f"{description}: row {row} of '{column}' is '{text.strip()}'; allowed: a finite number")
    return value


def compare_responses(measured: FrequencyResponse, simulated: Response, coherence: Array) -> ResponseComparison:
    """Return ``measured`` beside ``simulated``, and what the simulation lacks."""
    factor, correction = fit_factor(measured, simulated), fit_correction(measured, simulated)
    return ResponseComparison(measured, simulated, coherence, factor, correction)


def fit_factor(measured: FrequencyResponse, simulated: Response) -> Correction:
    """Return the factor alone that brings the gain of ``simulated`` closest to ``measured``, by its logarithm."""
    difference = _compute_difference(measured, simulated)
    gain = float(np.exp(difference.real.mean()))
    return _measure_errors(difference - np.log(gain), gain, 0.0, 0.0)


def fit_correction(measured: FrequencyResponse, simulated: Response) -> Correction:
    """Return the factor, lag and dead time that bring ``simulated`` closest to ``measured``.

    Least squares of the logarithm of their ratio: a neper of gain counts as much as a radian of phase.
    """
    difference = _compute_difference(measured, simulated)

    def compute_rest(values: Array) -> Response:
        correction = Correction(float(np.exp(values[0])), float(values[1]), float(values[2]), 0.0, 0.0)
        model = np.log(correction.compute_response(measured.frequency))
        rest = difference - model
        return np.asarray(rest.real + 1j * _wrap(rest.imag))

    def compute_residuals(values: Array) -> Array:
        rest = compute_rest(values)
        return np.concatenate([rest.real, rest.imag])

    fits = [
        least_squares(
            compute_residuals,
            [float(difference.real.mean()), lag, dead_time],
            bounds=([-np.inf, 0.0, -MAX_DEAD_TIME], [np.inf, MAX_LAG, MAX_DEAD_TIME]),
            x_scale=SCALES,
            xtol=FIT_TOLERANCE,
            ftol=FIT_TOLERANCE,
            gtol=FIT_TOLERANCE,
        )
        for lag, dead_time in itertools.product(INITIAL_LAGS, INITIAL_DEAD_TIMES)
    ]
    fit = min(fits, key=lambda result: float(result.cost))  # whole turns of the phase make several minima
    return _measure_errors(compute_rest(fit.x), float(np.exp(fit.x[0])), float(fit.x[1]), float(fit.x[2]))


def _compute_difference(measured: FrequencyResponse, simulated: Response) -> Response:
    """Return the logarithm of measured over simulated; its imaginary part is between -pi and pi."""
    return np.asarray(np.log(measured.response / simulated))


def _wrap(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _measure_errors(rest: Response, gain: float, lag: float, dead_time: float) -> Correction:
    nepers, radians = (float(np.sqrt(np.mean(part**2))) for part in (rest.real, rest.imag))
    return Correction(gain, lag, dead_time, float(20.0 / np.log(10.0) * nepers), float(np.degrees(radians)))
