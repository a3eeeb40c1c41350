"""Where the simulation is off: in which channel, and under which circumstances."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.diagnose.check import repeated
from klute_sim.diagnose.experiment import UNITS, Array, Experiment
from klute_sim.diagnose.fit import Evidence, Fit
from klute_sim.diagnose.noise import stacks
from klute_sim.units import BAR

Mask = NDArray[np.bool_]

CONTRAST = 0.2
"""Share of the misfit less share of the samples, from which a region is worth naming."""
STEADY = 0.05e5
"""Change of the pressure command that is none [Pa/s]."""
EDGES = (0.25, 0.5, 0.75)
"""Quantiles at which a circumstance may be cut in two."""
WINDOWS = (0.08, 0.12, 0.2, 0.3, 0.4)
"""Shares of a stride that a part of it may be, beginning at any multiple of :data:`GRAIN`."""
GRAIN = 0.02


class Place(NamedTuple):
    """A share of the gap."""

    channel: str
    share: float
    """Of all channels' squared misfit in units of their noise, what is in the region."""
    region: str
    """Where in the channel most of it is; '' if everywhere alike."""
    concentration: float
    """Mean square inside of the region over the mean square everywhere."""


def locate(evidence: Evidence, base: Fit) -> list[Place]:
    """Channels by their share of what all repeats show, largest first."""
    found, sizes = [], {}
    least = 2 if repeated(evidence.experiments) else 1
    by_group = {e.group: e for e in evidence.experiments}
    for channel, noise in evidence.noise.items():
        squares, circumstances = [], []
        for group, clock, stack in stacks(evidence.experiments, base.residuals, channel, least=least):
            # Repeats' mean, less what noise leaves in it.
            mean, count = stack.mean(axis=0), len(stack)
            squares.append(mean * mean - (noise.deviation**2 / count if count > 1 else 0.0))
            circumstances.append(_circumstances(by_group[group], clock))
        if not squares:
            continue
        square = np.concatenate(squares)
        joined = {name: np.concatenate([c[name] for c in circumstances]) for name in circumstances[0]}
        sizes[channel] = max(0.0, float(square.mean())) / noise.deviation**2
        region, inside, concentration = _region(square, joined)
        found.append(Place(channel, inside, region, concentration))
    whole = sum(sizes.values()) or 1.0
    return sorted((p._replace(share=p.share * sizes[p.channel] / whole) for p in found), key=lambda p: -p.share)


def _circumstances(experiment: Experiment, clock: Array) -> dict[str, Array]:
    """What may matter, at times of the ``clock`` that repeats share."""
    grid = np.linspace(0.0, experiment.duration, len(experiment.command))
    then = experiment.clock(grid)
    return {name: np.interp(clock, then, values) for name, values in experiment.circumstances().items()}


def _region(square: Array, circumstances: dict[str, Array]) -> tuple[str, float, float]:
    """The one or two cuts that hold the most of ``square`` in the least of the samples.

    With the share of ``square`` that they hold, and its mean there over its mean everywhere.
    """
    chosen: list[str] = []
    inside: Mask = np.ones(len(square), dtype=np.bool_)
    for _ in range(2):
        best = max(_cuts(square, inside, circumstances), default=None, key=lambda cut: cut[0])
        if best is None or best[0] < CONTRAST:
            break
        chosen.append(best[1])
        inside = best[2]
        if "stride" in best[1]:
            circumstances = {name: values for name, values in circumstances.items() if name != "phase"}
    whole = float(square.sum())
    if not whole > 0.0:
        return "", 1.0, 1.0
    share = float(square[inside].sum()) / whole
    return ", ".join(chosen), min(1.0, share), share / float(inside.mean())


def _cuts(square: Array, inside: Mask, circumstances: dict[str, Array]) -> list[tuple[float, str, Mask]]:
    whole, count = float(square[inside].sum()), int(inside.sum())
    found: list[tuple[float, str, Mask]] = []
    if not whole > 0.0:
        return found
    for name, values in circumstances.items():
        if name == "phase":
            found += _windows(square, inside, values)
            continue
        edges = [0.0] if name == "speed" else [float(np.quantile(values[inside], q)) for q in EDGES]
        for edge in edges:
            for part, word in ((values > edge, "above"), (values <= edge, "below")):
                both = inside & part
                if both.sum() < 0.1 * len(square):
                    continue
                # More of the misfit than of the samples is in there.
                contrast = float(square[both].sum()) / whole - both.sum() / count
                found.append((contrast, _words(name, word, edge), both))
    return found


def _windows(square: Array, inside: Mask, phase: Array) -> list[tuple[float, str, Mask]]:
    """Parts of the stride, which may go on beyond the next foot strike."""
    whole, count, found = float(square[inside].sum()), int(inside.sum()), []
    for begin in np.arange(0.0, 1.0, GRAIN):
        for width in WINDOWS:
            both = inside & ((phase - begin) % 1.0 < width)
            if both.sum() < 0.05 * len(square):
                continue
            contrast = float(square[both].sum()) / whole - both.sum() / count
            words = f"at {100.0 * begin:.0f}-{100.0 * ((begin + width) % 1.0) or 100.0:.0f} % of the stride"
            found.append((contrast, words, both))
    return found


def _words(name: str, word: str, edge: float) -> str:
    if name == "speed":
        return "lengthening" if word == "above" else "shortening"
    if name == "pressure change":
        if edge < STEADY:
            return "while the pressure changes" if word == "above" else "at steady pressure"
        return f"where the pressure changes {'faster' if word == 'above' else 'slower'} than {edge / BAR:.1f} bar/s"
    if name == "pressure":
        return f"{word} {edge / BAR:.1f} bar"
    if name == "length":
        return f"{word} {edge / UNITS['muscle_length'][1]:.0f} mm"
    return f"{'after' if word == 'above' else 'before'} {edge:.1f} s"
