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
from klute_sim.report.style import ZERO_LINE_COLOUR, add_heading, use_style
from klute_sim.units import BAR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INPUT_COLOUR, WITHOUT_EFFECT_COLOUR, WITH_EFFECT_COLOUR, DIFFERENCE_COLOUR = "0.3", "0.55", "#1f77b4", "#d62728"
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
    """Plot the inputs, each channel without and with the effect, and the difference in a row of its own."""
    experiment, count = signature.experiment, len(signature.channels)
    grid = experiment.dt * np.arange(1, len(experiment.command) + 1)
    with use_style() as create_figure:
        figure = create_figure(1.9 + 2.6 * count)
        axes = figure.subplots(2 * count + 2, 1, sharex=True, height_ratios=[0.6, 0.6, *([1.3, 0.7] * count)])
        axes[0].plot(grid, 1e3 * experiment.unit_length, color=INPUT_COLOUR, linewidth=1.0)
        axes[0].set_ylabel("length\n[mm]")
        axes[1].plot(grid, experiment.command / BAR, color=INPUT_COLOUR, linewidth=1.0)
        axes[1].set_ylabel("command\n[bar]")
        for index, channel in enumerate(signature.channels):
            unit, si = CHANNEL_UNITS[channel.channel]
            above, below = axes[2 * index + 2], axes[2 * index + 3]
            above.plot(channel.time, channel.without_effect / si, color=WITHOUT_EFFECT_COLOUR, label="without")
            above.plot(channel.time, channel.with_effect / si, color=WITH_EFFECT_COLOUR, linewidth=1.0, label="with")
            above.set_ylabel(f"{words.humanize_identifier(channel.channel)}\n[{unit}]")
            below.axhline(0.0, color=ZERO_LINE_COLOUR, linewidth=0.6)
            below.plot(channel.time, (channel.with_effect - channel.without_effect) / si, color=DIFFERENCE_COLOUR)
            below.set_ylabel(f"with -\nwithout [{unit}]")
        axes[-1].set_xlabel("time [s]")
        figure.align_ylabels()
        protocol = f"protocol '{signature.protocol}', {experiment.device.name}"
        heading = f"{signature.term.effect} ({signature.term.form}) at its typical size\n{protocol}"
        add_heading(figure, heading, axes[2])
    return figure


def build_similarity_figure(similarity: RigIdentifiability) -> "Figure":
    """Plot the cosines between all signatures on one rig."""
    names = [words.format_term(signature.term) for signature in similarity.signatures]
    cosines = similarity.cosine_matrix()
    size = 3.0 + 0.22 * len(names)
    with use_style() as create_figure:
        figure = create_figure(size, size + 1.0)
        axis = figure.subplots()
        axis.grid(visible=False)
        image = axis.imshow(cosines, cmap="magma_r", vmin=0.0, vmax=1.0)
        axis.set_xticks(range(len(names)), names, rotation=90)
        axis.set_yticks(range(len(names)), names)
        for row, column in np.argwhere(cosines > INDISTINGUISHABLE_COSINE):
            if row != column:
                axis.plot(column, row, marker="o", markersize=3.0, color="white")
        figure.colorbar(image, ax=axis, shrink=0.6, label="|cosine| of signatures (dot: indistinguishable)")
        axis.set_title(f"Similarity of effects {similarity.rig_change.description}")
    return figure
