"""Which effects could explain what is left: one simulation for each, and a projection.

The change that a little of an effect makes is projected off all that the fitted unknowns could do instead; what is
left of it is compared with the residual. Effects that the device's uncertain numbers can imitate are told apart by
what they cannot.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.device.device import Device
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Array
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, linearize
from klute_sim.effects import catalogue
from klute_sim.effects.families import instrument
from klute_sim.errors import InputError

PROBE_FRACTION = 0.3
"""Of the typical size, at which an effect is tried."""
PRIOR_DEVIATION_SIGMAS = 1.5
"""Standard deviations of a device's number from what was believed of it."""
MIN_PRIOR_GAIN_FRACTION, MAX_PRIOR_CANDIDATES = 0.5, 3
"""Share of what the numbers leave, seen from what was believed, that an effect has to explain, and how many may."""
REPROBE_ORTHOGONAL_FRACTION = 0.6
"""Share of its change that projection leaves of an effect, below which it is tried once more."""


class Candidate(NamedTuple):
    """A term that might be added."""

    term: EffectTerm
    predicted_gain: float
    """By how much chi squared would fall if everything were linear."""
    size: float
    """Its first parameter then, in steps of its size."""
    sensitivity: Array
    """Of the weighted residuals, per step of it."""
    direction: Array
    """What is left of that after projection, of length 1."""
    orthogonal_fraction: float
    """Share of the change that the projection left."""
    x0: Array
    """The unknowns there were, where everything was taken to be linear."""
    nuisance_shift: Array
    """Their move from there that goes with it."""


def check_effect_names(device: Device, only: Sequence[str], exclude: Sequence[str]) -> None:
    """Raise InputError for a name of an effect that there is not, or for one to look for that ``device`` has."""
    for name in (*only, *exclude):
        catalogue.find_form(name, None)
    for name in only:
        if name not in catalogue.get_named_effects():
            raise InputError(
                f"'{name}' is no effect to look for: it is data-driven, and is fitted where no effect explains the data"
            )
        if name in device.spec.effects:
            raise InputError(
                f"device '{device.name}' has effect '{name}' already, so it cannot be looked for; take it out of the "
                f'device file, or put its numbers under [uncertain] (as "effects.{name}.<number>") to refit them'
            )
        obstacle = device.spec.find_incompatibility(name)
        if obstacle:
            raise InputError(f"device '{device.name}': {obstacle}")


def list_candidate_terms(
    data: WeightedData, device: Device, only: Sequence[str] = (), exclude: Sequence[str] = ()
) -> list[EffectTerm]:
    """Everything in the catalogue that ``evidence`` could show and ``device`` is without.

    ``only`` and ``exclude`` name effects.
    """
    found = []
    for effect in catalogue.get_named_effects().values():
        if (only and effect.name not in only) or effect.name in exclude or not device.spec.can_add_effect(effect):
            continue
        if effect.kind == "device" or (effect.kind == "body" and data.experiments[0].has_body):
            found += [EffectTerm(effect.name, form.name) for form in effect.forms]
        elif effect.kind == "instrument":
            # Displays are seen without a simulation.
            channels = [c for c in data.noise if c in CHANNEL_UNITS and effect is not instrument.QUANTISATION]
            found += [EffectTerm(effect.name, effect.forms[0].name, c) for c in channels]
    return found


def screen_candidates(data: WeightedData, current: Fit, terms: Sequence[EffectTerm]) -> list[Candidate]:
    """``candidates`` by what they promise, best first.

    What the fitted unknowns could imitate, they imitate only for a little of it: of effects of which they take most,
    the typical size is looked at, too, with the unknowns where they would follow to. And where the device's numbers had
    to go far from what was believed of them, that may be because of what is missing: effects are then looked at from
    what was believed, too.
    """
    known, base = len(current.x), current.hypothesis.n_device_parameters
    here = _LinearizationPoint(current.x, current.weighted_residuals, current.jacobian)
    every = _evaluate_probes(
        data, current.hypothesis, here, [(term, PROBE_FRACTION, np.zeros(known)) for term in terms]
    )
    again: list[tuple[EffectTerm, float, Array]] = []
    for one in every:
        if one.orthogonal_fraction < REPROBE_ORTHOGONAL_FRACTION and one.term.channel is None:
            size = math.copysign(1.0, one.size)
            again.append((one.term, size, -size * _solve_least_squares(current.jacobian, one.sensitivity)))
    every += _evaluate_probes(data, current.hypothesis, here, again) if again else []
    if np.abs(current.x[:base]).max(initial=0.0) > PRIOR_DEVIATION_SIGMAS:
        home = np.concatenate([np.zeros(base), current.x[base:]])
        there = _LinearizationPoint(home, *linearize(data, current.hypothesis, home))
        tried = [(term, PROBE_FRACTION, np.zeros(known)) for term in terms]
        # From afar little is linear: what explains most of what the numbers leave there may explain that share here.
        left = there.residual + there.jacobian @ -_solve_least_squares(there.jacobian, there.residual)
        whole = float(left @ left)
        found = [
            c
            for c in _evaluate_probes(data, current.hypothesis, there, tried)
            if c.predicted_gain > MIN_PRIOR_GAIN_FRACTION * whole
        ]
        found = sorted(found, key=lambda one: -one.predicted_gain)[:MAX_PRIOR_CANDIDATES]
        every += [one._replace(predicted_gain=one.predicted_gain * min(1.0, current.chi2 / whole)) for one in found]
    best: dict[EffectTerm, Candidate] = {}
    for one in every:
        if one.term not in best or one.predicted_gain > best[one.term].predicted_gain:
            best[one.term] = one
    return sorted(best.values(), key=lambda candidate: -candidate.predicted_gain)


class _LinearizationPoint(NamedTuple):
    """Where everything is taken to be linear."""

    x: Array
    residual: Array
    jacobian: Array


def _evaluate_probes(
    data: WeightedData,
    base_hypothesis: Hypothesis,
    point: _LinearizationPoint,
    probes: Sequence[tuple[EffectTerm, float, Array]],
) -> list[Candidate]:
    """Of every term that is ``tried`` beside ``before``: in which size, and with which move of the known unknowns."""
    known, experiments = len(point.x), data.experiments
    basis, _ = np.linalg.qr(point.jacobian)
    hypotheses = [base_hypothesis.with_term(term) for term, _, _ in probes]
    rows = [_probe_parameters(h, point.x, size, moved) for h, (_, size, moved) in zip(hypotheses, probes, strict=True)]
    settings = [h.build_setups(row, experiments) for h, row in zip(hypotheses, rows, strict=True)]
    settings.append(base_hypothesis.build_setups(point.x, experiments))
    *shown, plain = data.simulator.simulate(settings, experiments, coarse=True)
    found = []
    for (term, _, _), hypothesis, row, each in zip(probes, hypotheses, rows, shown, strict=True):
        less = [{c: before[c] - after[c] for c in after} for before, after in zip(plain, each, strict=True)]
        steps, moved = float(row[known]), row[:known] - point.x
        if steps == 0.0:
            continue
        # What the move of the others did is taken off again, as if it were linear: that is projected off anyway.
        change = np.concatenate([data.weight_residuals(less), moved[: hypothesis.n_device_parameters]])
        change = (change - point.jacobian @ moved) / steps
        left = change - basis @ (basis.T @ change)
        size, whole = float(np.linalg.norm(left)), float(np.linalg.norm(change))
        if not (np.isfinite(size) and size > 1e-6 * max(whole, 1.0)):
            continue
        signature = left / size
        along = -float(signature @ point.residual)
        low, high = hypothesis.bounds()
        best = min(max(along / size, low[known]), high[known])
        gain = 2.0 * best * size * along - (best * size) ** 2
        follow = -_solve_least_squares(point.jacobian, point.residual + best * change)
        found.append(Candidate(term, gain, best, change, signature, size / whole, point.x, follow))
    return found


def _solve_least_squares(matrix: Array, target: Array) -> Array:
    return np.linalg.lstsq(matrix, target)[0].astype(np.float64)


def _probe_parameters(hypothesis: Hypothesis, x: Array, size: float, shift: Array) -> Array:
    """The unknowns ``moved``, with ``size`` of the last term; every size parameter of it moves, shapes stay typical."""
    row = hypothesis.initial_point()
    row[: len(x)] = x + shift
    for k in range(len(x), len(row)):
        if not hypothesis.parameters[k].is_logarithmic:
            row[k] = size
    return np.clip(row, *hypothesis.bounds())
