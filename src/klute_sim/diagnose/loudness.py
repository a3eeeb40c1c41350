"""How loud noise is at each instant: a device lets the noise of its inputs through more in some states than in others.

A hardly inflated muscle moves far for a little pressure, a stiff one pulls hard for a little length. The variance of a
channel is taken to be ``A + B s_p^2 + C s_L^2``, with the channel's sensitivities to commanded pressure and prescribed
length from two simulations, and A, B and C, none negative, from what sets repeats apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from klute_sim.diagnose import noise as noises
from klute_sim.diagnose.experiment import Array, Bench, Experiment, Setting

PRESSURE, LENGTH = 2e3, -1e-4
"""What the inputs are moved by [Pa, m]; the length towards where a bare muscle can go."""
LEAST = 0.05
"""Of the mean variance, that is left wherever noise is least (assumed)."""
ROUNDS = 3
"""Of weighing what sets repeats apart by the variance found so far."""


def heard(experiments: Sequence[Experiment], fitted: Sequence[Experiment], bench: Bench) -> list[Experiment]:
    """``experiments`` with the loudness of their noise, as repeats of ``fitted`` ones have it on average 1 (rms).

    Nothing changes without repeats, and in a channel that one of the inputs never moves: its noise is taken to be
    equally loud everywhere.
    """
    seen = _sensitivities(experiments, bench)
    known = {e.name: row for e, row in zip(experiments, seen, strict=True)}
    residuals = [{c: series.value - known[e.name][c][0] for c, series in e.measured.items()} for e in fitted]
    shares = {c: _shares(fitted, residuals, known, c) for c in noises.channels(fitted)}
    result = []
    for e, row in zip(experiments, seen, strict=True):
        loud = {}
        for channel in e.measured:
            share = shares.get(channel)
            if share is not None and len(e.measured[channel].time):
                loud[channel] = np.sqrt(np.maximum(LEAST, row[channel][1:].T @ share[1:] + share[0]))
        result.append(replace(e, loud=loud))
    return result


def _sensitivities(experiments: Sequence[Experiment], bench: Bench) -> list[dict[str, Array]]:
    """Per experiment: channel -> (3, samples): as simulated, and the squares of what each input's move changes."""
    moved = [
        experiments,
        [replace(e, command=e.command + PRESSURE) for e in experiments],
        [replace(e, unit_length=e.unit_length + LENGTH) for e in experiments],
    ]
    shown = [bench.simulate([[Setting(e.device.parameters) for e in each]], each)[0] for each in moved]
    return [
        {c: np.stack([here[c], (there[c] - here[c]) ** 2, (beyond[c] - here[c]) ** 2]) for c in here}
        for here, there, beyond in zip(*shown, strict=True)
    ]


def _shares(
    fitted: Sequence[Experiment], residuals: noises.Residuals, known: Mapping[str, dict[str, Array]], channel: str
) -> Array | None:
    """A, B and C of ``channel``, over their mean variance; None where they cannot be known."""
    rows, apart = [], []
    first = {e.group: e for e in reversed(fitted) if channel in e.measured}
    for stack in noises.stacks(fitted, residuals, channel):
        e = first[stack.group]
        clock = e.measured[channel].time - e.begin
        rows.append(
            np.stack(
                [np.ones(len(stack.clock)), *(np.interp(stack.clock, clock, s) for s in known[e.name][channel][1:])]
            )
        )
        apart.append(((stack.rows - stack.rows.mean(axis=0)) ** 2).sum(axis=0) / (len(stack.rows) - 1))
    if not rows:
        return None
    columns, squares = np.concatenate(rows, axis=1).T, np.concatenate(apart)
    mean = columns.mean(axis=0)
    if not (squares.any() and mean.all()):
        return None
    variance, found = np.full(len(squares), squares.mean()), np.zeros(3)
    for _ in range(ROUNDS):
        found = nnls(columns / mean / variance[:, np.newaxis], squares / variance)[0] / mean
        variance = np.maximum(columns @ found, LEAST * squares.mean())
    return np.asarray(found / (columns @ found).mean())
