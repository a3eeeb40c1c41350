"""Which effects could explain what is left: one simulation for each, and a projection.

The change that a little of an effect makes is projected off all that the fitted unknowns could do instead; what is
left of it is compared with the residual. Effects that the device's uncertain numbers can imitate are told apart by
what they cannot.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.device.files import Device
from klute_sim.diagnose.experiment import UNITS, Array
from klute_sim.diagnose.fit import Evidence, Fit, linear
from klute_sim.diagnose.hypothesis import Hypothesis, Term
from klute_sim.effects import catalogue, instrument
from klute_sim.errors import InputError

SHARE = 0.3
"""Of the typical size, at which an effect is tried."""
FAR = 1.5
"""Standard deviations of a device's number from what was believed of it."""
MOST_OF_IT, FROM_AFAR = 0.5, 3
"""Share of what the numbers leave, seen from what was believed, that an effect has to explain, and how many may."""
FOLLOWED = 0.6
"""Share of its change that projection leaves of an effect, below which it is tried once more."""


class Candidate(NamedTuple):
    """A term that might be added."""

    term: Term
    gain: float
    """By how much chi squared would fall if everything were linear."""
    steps: float
    """Its first parameter then, in steps of its size."""
    change: Array
    """Of the weighted residuals, per step of it."""
    signature: Array
    """What is left of that after projection, of length 1."""
    kept: float
    """Share of the change that the projection left."""
    origin: Array
    """The unknowns there were, where everything was taken to be linear."""
    follow: Array
    """Their move from there that goes with it."""


def check_names(device: Device, only: Sequence[str], exclude: Sequence[str]) -> None:
    """Raise InputError for a name of an effect that there is not, or for one to look for that ``device`` has."""
    for name in (*only, *exclude):
        catalogue.form_of(name, None)
    for name in only:
        if name not in catalogue.named():
            raise InputError(
                f"'{name}' is no effect to look for: it is data-driven, and is fitted where no effect explains the data"
            )
        if name in device.spec.effects:
            raise InputError(
                f"device '{device.name}' has effect '{name}' already, so it cannot be looked for; take it out of the "
                f'device file, or put its numbers under [uncertain] (as "effects.{name}.<number>") to refit them'
            )
        obstacle = device.spec.obstacle(name)
        if obstacle:
            raise InputError(f"device '{device.name}': {obstacle}")


def terms(evidence: Evidence, device: Device, only: Sequence[str] = (), exclude: Sequence[str] = ()) -> list[Term]:
    """Everything in the catalogue that ``evidence`` could show and ``device`` is without.

    ``only`` and ``exclude`` name effects.
    """
    found = []
    for effect in catalogue.named().values():
        if (only and effect.name not in only) or effect.name in exclude or not device.spec.may_lack(effect):
            continue
        if effect.kind == "device" or (effect.kind == "body" and evidence.experiments[0].embodied):
            found += [Term(effect.name, form.name) for form in effect.forms]
        elif effect.kind == "instrument":
            # Displays are seen without a simulation.
            channels = [c for c in evidence.noise if c in UNITS and effect is not instrument.QUANTISATION]
            found += [Term(effect.name, effect.forms[0].name, c) for c in channels]
    return found


def screen(evidence: Evidence, current: Fit, candidates: Sequence[Term]) -> list[Candidate]:
    """``candidates`` by what they promise, best first.

    What the fitted unknowns could imitate, they imitate only for a little of it: of effects of which they take most,
    the typical size is looked at, too, with the unknowns where they would follow to. And where the device's numbers had
    to go far from what was believed of them, that may be because of what is missing: effects are then looked at from
    what was believed, too.
    """
    known, base = len(current.steps), current.hypothesis.base
    here = _Point(current.steps, current.vector, current.jacobian)
    every = _promises(evidence, current.hypothesis, here, [(term, SHARE, np.zeros(known)) for term in candidates])
    again: list[tuple[Term, float, Array]] = []
    for one in every:
        if one.kept < FOLLOWED and one.term.channel is None:
            size = math.copysign(1.0, one.steps)
            again.append((one.term, size, -size * _lstsq(current.jacobian, one.change)))
    every += _promises(evidence, current.hypothesis, here, again) if again else []
    if np.abs(current.steps[:base]).max(initial=0.0) > FAR:
        home = np.concatenate([np.zeros(base), current.steps[base:]])
        there = _Point(home, *linear(evidence, current.hypothesis, home))
        tried = [(term, SHARE, np.zeros(known)) for term in candidates]
        # From afar little is linear: what explains most of what the numbers leave there may explain that share here.
        left = there.vector + there.jacobian @ -_lstsq(there.jacobian, there.vector)
        whole = float(left @ left)
        found = [c for c in _promises(evidence, current.hypothesis, there, tried) if c.gain > MOST_OF_IT * whole]
        found = sorted(found, key=lambda one: -one.gain)[:FROM_AFAR]
        every += [one._replace(gain=one.gain * min(1.0, current.cost / whole)) for one in found]
    best: dict[Term, Candidate] = {}
    for one in every:
        if one.term not in best or one.gain > best[one.term].gain:
            best[one.term] = one
    return sorted(best.values(), key=lambda candidate: -candidate.gain)


class _Point(NamedTuple):
    """Where everything is taken to be linear."""

    steps: Array
    vector: Array
    jacobian: Array


def _promises(
    evidence: Evidence, before: Hypothesis, point: _Point, tried: Sequence[tuple[Term, float, Array]]
) -> list[Candidate]:
    """Of every term that is ``tried`` beside ``before``: in which size, and with which move of the known unknowns."""
    known, experiments = len(point.steps), evidence.experiments
    basis, _ = np.linalg.qr(point.jacobian)
    hypotheses = [before.plus(term) for term, _, _ in tried]
    rows = [_tried(h, point.steps, size, moved) for h, (_, size, moved) in zip(hypotheses, tried, strict=True)]
    settings = [h.settings(row, experiments) for h, row in zip(hypotheses, rows, strict=True)]
    settings.append(before.settings(point.steps, experiments))
    *shown, plain = evidence.bench.simulate(settings, experiments, coarse=True)
    found = []
    for (term, _, _), hypothesis, row, each in zip(tried, hypotheses, rows, shown, strict=True):
        less = [{c: before[c] - after[c] for c in after} for before, after in zip(plain, each, strict=True)]
        steps, moved = float(row[known]), row[:known] - point.steps
        if steps == 0.0:
            continue
        # What the move of the others did is taken off again, as if it were linear: that is projected off anyway.
        change = np.concatenate([evidence.weighted(less), moved[: hypothesis.base]])
        change = (change - point.jacobian @ moved) / steps
        left = change - basis @ (basis.T @ change)
        size, whole = float(np.linalg.norm(left)), float(np.linalg.norm(change))
        if not (np.isfinite(size) and size > 1e-6 * max(whole, 1.0)):
            continue
        signature = left / size
        along = -float(signature @ point.vector)
        low, high = hypothesis.bounds()
        best = min(max(along / size, low[known]), high[known])
        gain = 2.0 * best * size * along - (best * size) ** 2
        follow = -_lstsq(point.jacobian, point.vector + best * change)
        found.append(Candidate(term, gain, best, change, signature, size / whole, point.steps, follow))
    return found


def _lstsq(columns: Array, target: Array) -> Array:
    return np.linalg.lstsq(columns, target)[0].astype(np.float64)


def _tried(hypothesis: Hypothesis, steps: Array, size: float, moved: Array) -> Array:
    """The unknowns ``moved``, with ``size`` of the last term; every size parameter of it moves, shapes stay typical."""
    row = hypothesis.start()
    row[: len(steps)] = steps + moved
    for k in range(len(steps), len(row)):
        if not hypothesis.unknowns[k].logarithmic:
            row[k] = size
    return np.clip(row, *hypothesis.bounds())
