"""How loud noise is at each instant: a device lets the noise of its inputs through more in some states than in others.

A hardly inflated muscle moves far for a little pressure, a stiff one pulls hard for a little length. The variance of
a channel is taken to be ``A + B s_p^2 + C s_L^2``, with the channel's sensitivities to commanded pressure and
prescribed length (in a walk, to the centre of pressure) from two simulations, and A, B and C, none negative, from
what sets repeats apart. While the pressure changes at a regulator's rate, a moment counts: when it began to is known
no better than a time step, and what that changes is added.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from klute_sim.diagnosis.experiments.base import COARSE_STEP_FACTOR, Array, Experiment, SimulationSetup, Simulator
from klute_sim.diagnosis.noise import repeats as noises

MIN_VARIANCE_FRACTION = 0.05
"""Of the mean variance, that is left wherever noise is least (assumed)."""
N_REWEIGHTINGS = 3
"""Of weighing what sets repeats apart by the variance found so far."""


def add_noise_scales(
    experiments: Sequence[Experiment], fit_experiments: Sequence[Experiment], simulator: Simulator
) -> list[Experiment]:
    """``experiments`` with the loudness of their noise, as repeats of ``fitted`` ones have it on average 1 (rms).

    Nothing changes without repeats. In a channel that one of the inputs never moves noise is taken to be equally loud
    everywhere, but for the moments of the pressure.
    """
    seen = _compute_sensitivities(experiments, simulator)
    known = {e.name: row for e, row in zip(experiments, seen, strict=True)}
    residuals = [{c: series.value - known[e.name][c][0] for c, series in e.measured.items()} for e in fit_experiments]
    shares = {
        c: _fit_variance_model(fit_experiments, residuals, known, c) for c in noises.list_channels(fit_experiments)
    }
    result = []
    for e, row in zip(experiments, seen, strict=True):
        loud = {}
        for channel in e.measured:
            share = shares.get(channel)
            if share is not None and len(e.measured[channel].time):
                own = np.maximum(
                    MIN_VARIANCE_FRACTION, row[channel][1:3].T @ share.coefficients[1:] + share.coefficients[0]
                )
                loud[channel] = np.sqrt(own + row[channel][3] / share.mean_variance)
        result.append(replace(e, noise_scale=loud))
    return result


class _VarianceModel(NamedTuple):
    """What the noise of a channel is made of."""

    coefficients: Array
    """A, B and C over the mean variance."""
    mean_variance: float
    """Mean [SI]."""


def _compute_sensitivities(experiments: Sequence[Experiment], simulator: Simulator) -> list[dict[str, Array]]:
    """Per experiment: channel -> (4, samples): as simulated, and the squares of what it changes when the pressure
    command, what else is prescribed, or (by a step) the moment at which the command comes is moved [SI].
    """
    moved = [experiments, *zip(*(e.perturb_inputs(_delay_command) for e in experiments), strict=True)]
    shown = [simulator.simulate([[SimulationSetup(e.device.parameters) for e in each]], each)[0] for each in moved]
    return [
        {
            c: np.stack(
                [
                    here[c],
                    (more[c] - here[c]) ** 2,
                    (shorter[c] - here[c]) ** 2,
                    ((late[c] - here[c]) / COARSE_STEP_FACTOR) ** 2,
                ]
            )
            for c in here
        }
        for here, more, shorter, late in zip(*shown, strict=True)
    ]


def _delay_command(command: Array) -> Array:
    """``command`` so many steps later that both step lengths see all of them."""
    return np.concatenate([np.repeat(command[:1], COARSE_STEP_FACTOR), command[:-COARSE_STEP_FACTOR]])


def _fit_variance_model(
    fit_experiments: Sequence[Experiment],
    residuals: noises.Residuals,
    sensitivities: Mapping[str, dict[str, Array]],
    channel: str,
) -> _VarianceModel | None:
    """Of ``channel``; None where nothing was repeated."""
    rows, apart = [], []
    first = {e.group: e for e in reversed(fit_experiments) if channel in e.measured}
    for stack in noises.align_repeats(fit_experiments, residuals, channel):
        e = first[stack.group]
        clock = e.align_time(e.measured[channel].time - e.start_time)
        rows.append(
            np.stack(
                [
                    np.ones(len(stack.time)),
                    *(np.interp(stack.time, clock, s) for s in sensitivities[e.name][channel][1:3]),
                ]
            )
        )
        apart.append(((stack.residuals - stack.residuals.mean(axis=0)) ** 2).sum(axis=0) / (len(stack.residuals) - 1))
    if not rows:
        return None
    columns, squares = np.concatenate(rows, axis=1).T, np.concatenate(apart)
    mean, whole = columns.mean(axis=0), float(squares.mean())
    if not whole > 0.0:
        return None
    if not mean.all():
        return _VarianceModel(np.array([1.0, 0.0, 0.0]), whole)
    variance, found = np.full(len(squares), whole), np.zeros(3)
    for _ in range(N_REWEIGHTINGS):
        found = nnls(columns / mean / variance[:, np.newaxis], squares / variance)[0] / mean
        variance = np.maximum(columns @ found, MIN_VARIANCE_FRACTION * whole)
    return _VarianceModel(np.asarray(found / (columns @ found).mean()), whole)
