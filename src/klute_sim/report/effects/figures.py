"""Pictures of effects: what one changes in a standard protocol, and which look alike.

Matplotlib is imported when something is drawn.
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
    from matplotlib.figure import Figure

WITHOUT_EFFECT_COLOUR, WITH_EFFECT_COLOUR = "0.55", "#1f77b4"
DPI = 80
N_LINE_FIGURE_COLOURS, N_MATRIX_COLOURS = 48, 256
"""Colours in the file of a picture: few make it small."""


def format_file_name(effect: str, form: str) -> str:
    """Of the file with the picture of a form."""
    return f"{effect}_{form}.png"


def save_signature_figure(signature: EffectResponse, folder: Path) -> None:
    """Put the picture of ``found`` into ``folder`` (:func:`file_name`)."""
    _save_figure(
        build_signature_figure(signature),
        folder / format_file_name(signature.term.effect, signature.term.form),
        N_LINE_FIGURE_COLOURS,
    )


def write_matrices(similarities: Sequence[RigIdentifiability], folder: Path) -> None:
    """Put a table of cosines ``matrix_N.csv`` and its picture ``matrix_N.png`` into ``folder``, of each rig in turn."""
    for number, one in enumerate(similarities):
        _save_figure(build_similarity_figure(one), folder / f"matrix_{number}.png", N_MATRIX_COLOURS)
        names = [str(signature.term) for signature in one.signatures]
        with (folder / f"matrix_{number}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([one.rig_change.description, *names])
            writer.writerows(
                [name, *(f"{c:.3f}" for c in line)] for name, line in zip(names, one.cosine_matrix(), strict=True)
            )


def _save_figure(figure: "Figure", path: Path, n_colours: int) -> None:
    from PIL import Image  # Matplotlib writes its own pictures with it

    whole = io.BytesIO()
    figure.savefig(whole, dpi=DPI, format="png")
    Image.open(whole).convert("RGB").quantize(n_colours).save(path, optimize=True)


def build_signature_figure(signature: EffectResponse) -> "Figure":
    """Inputs on top, then every channel without and with the effect, and the difference."""
    from matplotlib.figure import Figure

    count = len(signature.channels)
    figure = Figure(figsize=(10.0, 1.6 + 2.4 * count), layout="constrained")
    axes = figure.subplots(count + 1, 1, sharex=True, height_ratios=[0.8, *([1.4] * count)])
    experiment = signature.experiment
    grid = experiment.dt * np.arange(1, len(experiment.command) + 1)
    axes[0].plot(grid, 1e3 * experiment.unit_length, color="0.3", linewidth=1.0)
    axes[0].set_ylabel("length [mm]")
    beside = axes[0].twinx()
    beside.plot(grid, experiment.command / BAR, color="#e6842a", linewidth=1.0)
    beside.set_ylabel("command [bar]", color="#e6842a")
    for axis, one in zip(axes[1:], signature.channels, strict=True):
        unit, si = CHANNEL_UNITS[one.channel]
        axis.plot(one.time, one.without_effect / si, color=WITHOUT_EFFECT_COLOUR, linewidth=1.0, label="without")
        axis.plot(one.time, one.with_effect / si, color=WITH_EFFECT_COLOUR, linewidth=1.0, label="with")
        axis.set_ylabel(f"{words.humanize_identifier(one.channel)} [{unit}]")
        apart = axis.twinx()
        apart.plot(one.time, (one.with_effect - one.without_effect) / si, color="#d62728", linewidth=0.8)
        apart.set_ylabel("difference", color="#d62728")
        axis.set_zorder(apart.get_zorder() + 1)
        axis.patch.set_visible(False)
    axes[1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=2, frameon=False, fontsize=8)
    axes[-1].set_xlabel("time [s]")
    where = f"protocol '{signature.protocol}', {experiment.device.name}"
    figure.suptitle(f"{signature.term.effect} ({signature.term.form}) at its typical size, {where}")
    return figure


def build_similarity_figure(similarity: RigIdentifiability) -> "Figure":
    """Cosines between all signatures on one rig."""
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
    figure.colorbar(image, ax=axis, shrink=0.6, label="|cosine| of signatures (a dot: alike)")
    axis.set_title(f"Which effects look alike {similarity.rig_change.description}", fontsize=9.5)
    return figure
