"""Report of the prediction of another dataset: table, numbers that were carried over, and figure."""

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.transfer_prediction import TransferPrediction
from klute_sim.report.diagnosis import text as words
from klute_sim.report.diagnosis.localization_figure import CASE_COLOURS
from klute_sim.report.style import add_heading, save_figure, use_style
from klute_sim.terminal_table import create_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_POINTS = 3000
"""Largest number of samples of a channel that the figure shows."""


def build_prediction_table(prediction: TransferPrediction) -> Table:
    """Return the errors of prediction of each channel of another dataset, with per cent of the measured range."""
    headings = ("channel", "unit", "range", "nominal", "refitted", "with effects")
    table = create_table(*headings, title=f"Prediction of '{prediction.dataset_name}' (rms), {prediction.best}")
    for channel, p in prediction.channels.items():
        unit, si = CHANNEL_UNITS[channel]
        cells = []
        for error in p.errors.values():
            share = f" ({100.0 * error / p.measured_range:.1f} %)" if p.measured_range else ""
            cells.append(f"{words.format_number(error / si, 3)}{share}" if isfinite(error) else "diverges")
        table.add_row(channel, unit, words.format_number(p.measured_range / si, 3), *cells)
    return table


def build_numbers_table(prediction: TransferPrediction) -> Table:
    """Return the fitted numbers and parameters of effects, as found and as used for the other dataset."""
    table = create_table("number", "found", "used", "rule", title=f"Carried over to '{prediction.dataset_name}'")
    for number in prediction.numbers:
        table.add_row(number.name, f"{number.fitted:.4g}", f"{number.used:.4g}", number.rule)
    return table


def build_prediction_figure(prediction: TransferPrediction) -> "Figure":
    """Plot predicted over measured values of each channel; on the dotted line the prediction is right."""
    cases = {"refitted": CASE_COLOURS["before"], "with_effects": CASE_COLOURS["after"]}
    labels = {"refitted": "refitted numbers", "with_effects": "with effects added"}
    channels = [c for c in prediction.channels if any(t.channel == c for t in prediction.trials)]
    with use_style() as create_figure:
        figure = create_figure(0.8 + 3.4 * len(channels))
        axes = figure.subplots(len(channels), 1, squeeze=False)[:, 0]
        for axis, channel in zip(axes, channels, strict=True):
            unit, si = CHANNEL_UNITS[channel]
            trials = [trial for trial in prediction.trials if trial.channel == channel]
            measured = np.concatenate([trial.measured for trial in trials]) / si
            shown = slice(None, None, -(-len(measured) // MAX_POINTS))
            sizes = []
            for case, colour in cases.items():
                predicted = np.concatenate([getattr(trial, case) for trial in trials]) / si
                error = prediction.channels[channel].errors[case]
                size = f"rms {words.format_number(error / si, 3)} {unit}" if isfinite(error) else "diverges"
                sizes.append(f"{labels[case]}: {size}")
                axis.plot(measured[shown], predicted[shown], ".", markersize=3.0, color=colour, label=labels[case])
            axis.set_title("; ".join(sizes), fontsize="small")
            ends = [float(measured.min()), float(measured.max())]
            axis.plot(ends, ends, color="black", linewidth=1.2, linestyle=":", zorder=3.0)
            name = words.humanize_identifier(channel)
            axis.set_xlabel(f"measured {name} [{unit}]")
            axis.set_ylabel(f"predicted {name} [{unit}]")
        add_heading(figure, f"prediction of '{prediction.dataset_name}', not fitted to it", axes[0])
    return figure


def format_figure_name(number: int) -> str:
    """Return the name of the file with the figure of the ``number``-th prediction, from 1."""
    return f"prediction-{number}.png"


def save_prediction_figures(predictions: Sequence[TransferPrediction], folder: Path) -> None:
    """Write the figure of each prediction into ``folder``."""
    for number, prediction in enumerate(predictions, 1):
        save_figure(build_prediction_figure(prediction), folder / format_figure_name(number))
