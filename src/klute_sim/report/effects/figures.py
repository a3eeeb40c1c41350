"""Figures of effects: the signature of an effect in a standard protocol, and the similarity of signatures.

Matplotlib is imported when a figure is built.
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.planning.identifiability import INDISTINGUISHABLE_COSINE, RigIdentifiability
from klute_sim.diagnosis.planning.signatures import EffectResponse
from klute_sim.report.diagnosis import text as words
from klute_sim.units import BAR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WITHOUT_EFFECT_COLOUR, WITH_EFFECT_COLOUR = "0.55", "#1f77b4"
MAX_DISTANCE_FROM_ZERO = 0.5
"""Largest lower limit of a channel, over its upper limit, whose axis is extended to zero; further away, as for a
length, the curve would lose its detail, and its axis shows no zero."""
DPI = 80
N_LINE_FIGURE_COLOURS, N_MATRIX_COLOURS = 48, 256
"""Number of colours in the file of a figure; few colours make a small file."""


def format_file_name(effect: str, form: str) -> str:
    """Return the name of the file with the signature of a form."""
    return f"{effect}_{form}.png"


def save_signature_figure(signature: EffectResponse, folder: Path) -> None:
    """Write the figure of ``signature`` into ``folder`` (:func:`format_file_name`)."""
    _save_figure(
        build_signature_figure(signature),
        folder / format_file_name(signature.term.effect, signature.term.form),
        N_LINE_FIGURE_COLOURS,
    )


def write_matrices(similarities: Sequence[RigIdentifiability], folder: Path) -> None:
    """Write the cosines of each rig into ``folder`` as ``matrix_N.csv``, and their figure as ``matrix_N.png``."""
    for number, similarity in enumerate(similarities):
        _save_figure(build_similarity_figure(similarity), folder / f"matrix_{number}.png", N_MATRIX_COLOURS)
        names = [str(signature.term) for signature in similarity.signatures]
        with (folder / f"matrix_{number}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([similarity.rig_change.description, *names])
            writer.writerows(
                [name, *(f"{c:.3f}" for c in row)] for name, row in zip(names, similarity.cosine_matrix(), strict=True)
            )


def _save_figure(figure: "Figure", path: Path, n_colours: int) -> None:
    from PIL import Image  # a dependency of Matplotlib

    png = io.BytesIO()
    figure.savefig(png, dpi=DPI, format="png")
    Image.open(png).convert("RGB").quantize(n_colours).save(path, optimize=True)


def build_signature_figure(signature: EffectResponse) -> "Figure":
    """Plot the inputs, and each channel without and with the effect and its difference."""
    from matplotlib.figure import Figure

    count = len(signature.channels)
    figure = Figure(figsize=(10.0, 1.6 + 2.4 * count), layout="constrained")
    axes = figure.subplots(count + 1, 1, sharex=True, height_ratios=[0.8, *([1.4] * count)])
    experiment = signature.experiment
    grid = experiment.dt * np.arange(1, len(experiment.command) + 1)
    axes[0].plot(grid, 1e3 * experiment.unit_length, color="0.3", linewidth=1.0)
    axes[0].set_ylabel("length [mm]")
    command_axis = axes[0].twinx()
    command_axis.plot(grid, experiment.command / BAR, color="#e6842a", linewidth=1.0)
    command_axis.set_ylabel("command [bar]", color="#e6842a")
    for axis, channel in zip(axes[1:], signature.channels, strict=True):
        unit, si = CHANNEL_UNITS[channel.channel]
        axis.plot(
            channel.time, channel.without_effect / si, color=WITHOUT_EFFECT_COLOUR, linewidth=1.0, label="without"
        )
        axis.plot(channel.time, channel.with_effect / si, color=WITH_EFFECT_COLOUR, linewidth=1.0, label="with")
        axis.set_ylabel(f"{words.humanize_identifier(channel.channel)} [{unit}]")
        difference_axis = axis.twinx()
        difference_axis.plot(
            channel.time, (channel.with_effect - channel.without_effect) / si, color="#d62728", linewidth=0.8
        )
        difference_axis.set_ylabel("difference", color="#d62728")
        low, high = axis.get_ylim()
        if low < MAX_DISTANCE_FROM_ZERO * high and np.ptp(channel.with_effect - channel.without_effect) > 0.0:
            _align_zeros(axis, difference_axis)
        axis.set_zorder(difference_axis.get_zorder() + 1)
        axis.patch.set_visible(False)
    axes[1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=2, frameon=False, fontsize=8)
    axes[-1].set_xlabel("time [s]")
    protocol = f"protocol '{signature.protocol}', {experiment.device.name}"
    figure.suptitle(f"{signature.term.effect} ({signature.term.form}) at its typical size, {protocol}")
    return figure


def _align_zeros(*axes: "Axes") -> None:
    """Extend the limits of ``axes``, which share a panel, so that zero is at one height."""
    scales = [max(map(abs, axis.get_ylim())) for axis in axes]
    relative = [(low / s, high / s) for s, (low, high) in zip(scales, (axis.get_ylim() for axis in axes), strict=True)]
    low, high = min(0.0, *(low for low, _ in relative)), max(0.0, *(high for _, high in relative))
    for axis, scale in zip(axes, scales, strict=True):
        axis.set_ylim(scale * low, scale * high)


def build_similarity_figure(similarity: RigIdentifiability) -> "Figure":
    """Plot the cosines between all signatures on one rig."""
    from matplotlib.figure import Figure

    names = [words.format_term(signature.term) for signature in similarity.signatures]
    cosines = similarity.cosine_matrix()
    size = 3.0 + 0.22 * len(names)
    figure = Figure(figsize=(size + 1.0, size), layout="constrained")
    axis = figure.subplots()
    image = axis.imshow(cosines, cmap="magma_r", vmin=0.0, vmax=1.0)
    axis.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    axis.set_yticks(range(len(names)), names, fontsize=7)
    for row, column in np.argwhere(cosines > INDISTINGUISHABLE_COSINE):
        if row != column:
            axis.plot(column, row, marker="o", markersize=3.0, color="white")
    figure.colorbar(image, ax=axis, shrink=0.6, label="|cosine| of signatures (dot: indistinguishable)")
    axis.set_title(f"Similarity of effects {similarity.rig_change.description}", fontsize=9.5)
    return figure
