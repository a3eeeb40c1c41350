"""Measured beside simulated frequency response of a joint: sentences, table, CSV and figure."""

import csv
import io
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from klute_sim.recording.frequency_response import Correction, ResponseComparison
from klute_sim.report.style import add_heading, use_style
from klute_sim.terminal_table import create_table
from klute_sim.types import Array

CSV_HEADING = (
    *("frequency [Hz]", "measured_gain [{unit}]", "measured_phase [deg]"),
    *("simulated_gain [{simulated_unit}]", "simulated_phase [deg]", "coherence [1]"),
)
"""Columns of response.csv."""
MIN_COHERENCE = 0.95
"""Coherence below which a motion is called no sine (assumed)."""
TABLE_HEADINGS = (
    *("frequency\nHz", "measured\ngain", "simulated\ngain", "error\ndB"),
    *("measured\ndeg", "simulated\ndeg", "error\ndeg"),
)
"""Headings of the table."""
RESPONSE_DESCRIPTION = "Gain and phase over frequency: measured, simulated with a factor, and with lag and dead time."
"""Text that stands for the figure where it cannot be seen."""


def summarize_response(comparison: ResponseComparison) -> dict[str, Any]:
    """Return the comparison in JSON types."""
    return {
        "points": len(comparison.measured.frequency),
        "gain_unit": comparison.measured.gain_unit,
        "factor": _describe_correction(comparison.factor),
        "correction": _describe_correction(comparison.correction),
        "min_coherence": float(comparison.coherence.min()),
    }


def _describe_correction(correction: Correction) -> dict[str, float]:
    return {
        "gain": correction.gain,
        "lag_s": correction.lag,
        "dead_time_s": correction.dead_time,
        "gain_error_db": correction.gain_error_db,
        "phase_error_deg": correction.phase_error_deg,
    }


def describe_response(comparison: ResponseComparison, unit: str) -> list[str]:
    """Return what the comparison says, one sentence each; ``unit`` is that of the joint's position."""
    factor, correction = comparison.factor, comparison.correction
    has_unit = comparison.measured.gain_unit != "1"
    meaning = (
        f"is {factor.gain:.3g} times the simulated one" if has_unit else f"has a scale of {factor.gain:.3g} {unit}/bar"
    )
    left = f"leave {correction.gain_error_db:.2f} dB and {correction.phase_error_deg:.1f} degrees"
    if correction.dead_time >= 0.0:
        advice = (
            f"A first-order lag of {1e3 * correction.lag:.0f} ms and {1e3 * correction.dead_time:.0f} ms of dead time "
            f"would {left}: the effects pressure_lag and pressure_delay of the device do that, if that is where they "
            "are."
        )
    else:
        advice = (
            f"The simulation is later than the measurement, by {-1e3 * correction.dead_time:.0f} ms at best, which "
            f"would {left}: no lag of the supply explains that; look at load, inertia and damping of the model."
        )
    sentences = [
        f"The measured gain {meaning}; with this factor it differs by {factor.gain_error_db:.2f} dB rms and the phase "
        f"by {factor.phase_error_deg:.1f} degrees rms.",
        advice,
    ]
    if comparison.coherence.min() < MIN_COHERENCE:
        sentences.append(
            "The simulated motion is no sine at some frequencies (coherence down to "
            f"{comparison.coherence.min():.2f}): the response depends on the amplitude there, which must be that "
            "of the measurement."
        )
    return sentences


def build_response_table(comparison: ResponseComparison) -> Table:
    """Build the table of gains and phases; the simulated gain has the factor."""
    table = create_table()
    for heading in TABLE_HEADINGS:
        table.add_column(heading, justify="right")
    measured, simulated = comparison.measured, comparison.factor.gain * comparison.simulated
    ratio = simulated / measured.response
    for values in zip(
        measured.frequency,
        np.abs(measured.response),
        np.abs(simulated),
        20.0 * np.log10(np.abs(ratio)),
        np.degrees(np.angle(measured.response)),
        np.degrees(np.angle(simulated)),
        np.degrees(np.angle(ratio)),
        strict=True,
    ):
        table.add_row(*(f"{value:.3g}" for value in values))
    return table


def format_response_csv(comparison: ResponseComparison, unit: str) -> str:
    """Return response.csv: one row per frequency, the simulated gain without the factor."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    units = {"unit": comparison.measured.gain_unit, "simulated_unit": f"{unit}/bar"}
    writer.writerow(name.format(**units) for name in CSV_HEADING)
    columns = [comparison.measured.frequency]
    for response in (comparison.measured.response, comparison.simulated):
        columns += [np.abs(response), np.degrees(np.angle(response))]
    for row in zip(*columns, comparison.coherence, strict=True):
        writer.writerow(repr(float(value)) for value in row)
    return text.getvalue()


def build_response_figure(comparison: ResponseComparison) -> Figure:
    """Plot gain [dB] and phase of measurement, simulation with the factor, and simulation with the correction."""
    measured = comparison.measured
    frequency = measured.frequency
    correction = comparison.correction.compute_response(frequency)
    curves = {
        "measured": (measured.response, "o"),
        "simulated, with a factor": (comparison.factor.gain * comparison.simulated, "-"),
        "with lag and dead time": (correction * comparison.simulated, "--"),
    }
    with use_style() as create_figure:
        figure = create_figure(5.5, 7.0)
        gain, phase = figure.subplots(2, 1, sharex=True)
        for label, (response, style) in curves.items():
            look: dict[str, Any] = {"markersize": 4, "zorder": 3.0 if label == "measured" else 2.0}
            gain.semilogx(frequency, 20.0 * np.log10(np.abs(response)), style, label=label, **look)
            phase.semilogx(frequency, _unwrap_degrees(response), style, **look)
        gain.set_ylabel(f"gain [dB re 1 {measured.gain_unit}]" if measured.gain_unit != "1" else "gain [dB]")
        phase.set_ylabel("phase [deg] (negative: lag)")
        phase.set_xlabel("frequency [Hz]")
        add_heading(figure, "frequency response", gain)
    return figure


def _unwrap_degrees(response: Any) -> Array:
    return np.asarray(np.degrees(np.unwrap(np.angle(response))), dtype=np.float64)
