"""Pictures of effects: what one changes in a standard protocol, and which look alike.

Matplotlib is imported when something is drawn.
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from klute_sim.diagnose.confusable import ALIKE, Confusion
from klute_sim.diagnose.experiment import UNITS
from klute_sim.diagnose.signature import Signature
from klute_sim.report import diagnosis_words as words
from klute_sim.units import BAR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WITHOUT, HAVING = "0.55", "#1f77b4"
DPI = 80
LINES, SHADES = 48, 256
"""Colours in the file of a picture: few make it small."""


def file_name(effect: str, form: str) -> str:
    """Of the file with the picture of a form."""
    return f"{effect}_{form}.png"


def draw(found: Signature, folder: Path) -> None:
    """Put the picture of ``found`` into ``folder`` (:func:`file_name`)."""
    _save(signature(found), folder / file_name(found.term.effect, found.term.form), LINES)


def write_matrices(found: Sequence[Confusion], folder: Path) -> None:
    """Put a table of cosines ``matrix_N.csv`` and its picture ``matrix_N.png`` into ``folder``, of each rig in turn."""
    for number, one in enumerate(found):
        _save(matrix(one), folder / f"matrix_{number}.png", SHADES)
        names = [str(signature.term) for signature in one.signatures]
        with (folder / f"matrix_{number}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([one.change.words, *names])
            writer.writerows(
                [name, *(f"{c:.3f}" for c in line)] for name, line in zip(names, one.cosines(), strict=True)
            )


def _save(figure: "Figure", path: Path, colours: int) -> None:
    from PIL import Image  # Matplotlib writes its own pictures with it

    whole = io.BytesIO()
    figure.savefig(whole, dpi=DPI, format="png")
    Image.open(whole).convert("RGB").quantize(colours).save(path, optimize=True)


def signature(found: Signature) -> "Figure":
    """Inputs on top, then every channel without and with the effect, and the difference."""
    from matplotlib.figure import Figure

    count = len(found.shown)
    figure = Figure(figsize=(10.0, 1.6 + 2.4 * count), layout="constrained")
    axes = figure.subplots(count + 1, 1, sharex=True, height_ratios=[0.8, *([1.4] * count)])
    experiment = found.experiment
    grid = experiment.step * np.arange(1, len(experiment.command) + 1)
    axes[0].plot(grid, 1e3 * experiment.unit_length, color="0.3", linewidth=1.0)
    axes[0].set_ylabel("length [mm]")
    beside = axes[0].twinx()
    beside.plot(grid, experiment.command / BAR, color="#e6842a", linewidth=1.0)
    beside.set_ylabel("command [bar]", color="#e6842a")
    for axis, one in zip(axes[1:], found.shown, strict=True):
        unit, si = UNITS[one.channel]
        axis.plot(one.time, one.without / si, color=WITHOUT, linewidth=1.0, label="without")
        axis.plot(one.time, one.having / si, color=HAVING, linewidth=1.0, label="with")
        axis.set_ylabel(f"{words.spoken(one.channel)} [{unit}]")
        apart = axis.twinx()
        apart.plot(one.time, (one.having - one.without) / si, color="#d62728", linewidth=0.8)
        apart.set_ylabel("difference", color="#d62728")
        axis.set_zorder(apart.get_zorder() + 1)
        axis.patch.set_visible(False)
    axes[1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=2, frameon=False, fontsize=8)
    axes[-1].set_xlabel("time [s]")
    where = f"protocol '{found.protocol}', {experiment.device.name}"
    figure.suptitle(f"{found.term.effect} ({found.term.form}) at its typical size, {where}")
    return figure


def matrix(found: Confusion) -> "Figure":
    """Cosines between all signatures on one rig."""
    from matplotlib.figure import Figure

    names = [words.term(signature.term) for signature in found.signatures]
    cosines = found.cosines()
    size = 3.0 + 0.22 * len(names)
    figure = Figure(figsize=(size + 1.0, size), layout="constrained")
    axis = figure.subplots()
    image = axis.imshow(cosines, cmap="magma_r", vmin=0.0, vmax=1.0)
    axis.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    axis.set_yticks(range(len(names)), names, fontsize=7)
    for row, column in np.argwhere(cosines > ALIKE):
        if row != column:
            axis.plot(column, row, marker="o", markersize=3.0, color="white")
    figure.colorbar(image, ax=axis, shrink=0.6, label="|cosine| of signatures (a dot: alike)")
    axis.set_title(f"Which effects look alike {found.change.words}", fontsize=9.5)
    return figure
