"""Screening of candidate effects by their predicted gain: one simulation each, and a projection.

The sensitivity to a small effect is projected onto the complement of the sensitivities to all fitted parameters, and
the remainder is compared with the residual. So an effect that the uncertain numbers of the device can imitate counts
only by the part that they cannot. A parameter at its bound imitates nothing by going beyond it.
"""

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.data_quality import is_supply_only
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, linearize
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.types import Array, Mask

PROBE_FRACTION = 0.3
"""Fraction of its typical size at which an effect is probed."""
SUPPLY_PROBES = 3.0, 30.0
"""Sizes, over the typical one, at which effects are probed as well where only the pressure was measured (assumed: a
needle valve that fills a thin muscle in seconds resists thirty times as much as the typical valve of a pair)."""
MAX_SMALL_EFFECT, MIN_SMALL_PROBE = 0.5 * PROBE_FRACTION, 0.01
"""Predicted size below which an effect is probed again at this size, and the smallest size of that probe (assumed)."""
PRIOR_DEVIATION_SIGMAS = 1.5
"""Deviation of a device's number from its prior [standard deviations], above which effects are probed there, too
(assumed)."""
MIN_PRIOR_GAIN_FRACTION, MAX_PRIOR_CANDIDATES = 0.5, 3
"""Smallest fraction of the residual at the prior that an effect explains, and largest number of such effects
(assumed)."""
REPROBE_ORTHOGONAL_FRACTION = 0.6
"""Orthogonal fraction of a sensitivity below which an effect is probed again at its typical size (assumed)."""
MIN_ORTHOGONAL_FRACTION = 1e-6
"""Orthogonal fraction of a sensitivity below which an effect counts as imitated by the fitted parameters."""
SHORTLIST_SIZE = 8
"""Number of candidates that are refitted, and of effects, whatever their form and owner, whose best one is."""
NUMBER_SHORTLIST_SIZE, DISTINCT_NUMBER_COUNT = 3, 2
"""Number of wrong numbers that are refitted beside them, and of further ones that differ from all of these
(assumed)."""
MAX_DISTINCT_COSINE = 0.98
"""Largest cosine between the sensitivities to two numbers that differ (assumed)."""


class Candidate(NamedTuple):
    """An effect that may be added."""

    term: EffectTerm
    """The effect in one of its forms."""
    predicted_gain: float
    """Fall of chi squared that linearisation predicts."""
    size: float
    """Predicted first parameter, normalized."""
    sensitivity: Array
    """Derivative of the weighted residuals by :attr:`size`."""
    direction: Array
    """Unit vector of the part of the sensitivity that is orthogonal to those of the fitted parameters."""
    orthogonal_fraction: float
    """Norm of this part over the norm of the sensitivity."""
    x0: Array
    """Normalized parameters at the point of linearisation, without the effect."""
    nuisance_shift: Array
    """Predicted change of these parameters with the effect."""


def screen_candidates(
    data: WeightedData,
    current: Fit,
    terms: Sequence[EffectTerm],
    report_divergence: Callable[[EffectTerm], None] = lambda term: None,
) -> list[Candidate]:
    """Return the candidates for ``terms``, largest predicted gain first.

    ``report_divergence`` receives each term with which a simulation diverges; it is no candidate.

    The fitted parameters imitate an effect in linear approximation only. An effect that they imitate for the most part
    is probed again at its typical size, with the fitted parameters shifted accordingly. The response to a friction that
    stops a joint does not show that to a small one, nor does a threshold above the pressure show that of a low one. So
    effects that are predicted to be small are probed again at that size. Where numbers of the device deviate far from
    their priors, the missing effect may be the reason, so effects are also probed at the priors.
    """
    n_known, n_device = len(current.x), current.hypothesis.n_prior_parameters
    blocked = find_blocked_directions(current)
    current_point = _LinearizationPoint(current.x, current.weighted_residuals, current.jacobian, blocked)
    sizes = (PROBE_FRACTION, *SUPPLY_PROBES) if is_supply_only(data.experiments) else (PROBE_FRACTION,)
    probes = [
        (term, size, np.zeros(n_known))
        for term in terms
        for size in (sizes if term.channel is None and term.number is None else sizes[:1])
    ]
    candidates = _evaluate_probes(data, current.hypothesis, current_point, probes, report_divergence)
    full_size_probes: list[tuple[EffectTerm, float, Array]] = []
    for candidate in candidates:
        if candidate.orthogonal_fraction < REPROBE_ORTHOGONAL_FRACTION and candidate.term.channel is None:
            size = math.copysign(1.0, candidate.size)
            shift = -size * _solve_least_squares(current.jacobian, candidate.sensitivity)
            shift[blocked * shift > 0.0] = 0.0
            full_size_probes.append((candidate.term, size, shift))
    more_probes = [*full_size_probes, *_list_small_probes(candidates, current_point)]
    if more_probes:
        candidates += _evaluate_probes(data, current.hypothesis, current_point, more_probes)
    if np.abs(current.x[:n_device]).max(initial=0.0) > PRIOR_DEVIATION_SIGMAS:
        prior = np.concatenate([np.zeros(n_device), current.x[n_device:]])
        prior_point = _LinearizationPoint(prior, *linearize(data, current.hypothesis, prior), np.zeros(n_known))
        # Far from the fit, linearisation overestimates gains, so the fraction explained there scales the gain here.
        nuisance = -_solve_least_squares(prior_point.jacobian, prior_point.residual)
        remainder = prior_point.residual + prior_point.jacobian @ nuisance
        total = float(remainder @ remainder)
        probes = [(term, PROBE_FRACTION, np.zeros(n_known)) for term in terms]
        promising = [
            candidate
            for candidate in _evaluate_probes(data, current.hypothesis, prior_point, probes)
            if candidate.predicted_gain > MIN_PRIOR_GAIN_FRACTION * total
        ]
        promising = sorted(promising, key=lambda candidate: -candidate.predicted_gain)[:MAX_PRIOR_CANDIDATES]
        candidates += [c._replace(predicted_gain=c.predicted_gain * min(1.0, current.chi2 / total)) for c in promising]
    best: dict[EffectTerm, Candidate] = {}
    for candidate in candidates:
        if candidate.term not in best or candidate.predicted_gain > best[candidate.term].predicted_gain:
            best[candidate.term] = candidate
    return sorted(best.values(), key=lambda candidate: -candidate.predicted_gain)


def predict_gains(current: Fit, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return ``candidates`` of another fit with their predicted gain and size beside ``current``, largest gain first.

    Nothing is simulated: the sensitivities are those to the effects alone. Candidates of causes that ``current`` has
    must not be among them.
    """
    point = _LinearizationPoint(
        current.x, current.weighted_residuals, current.jacobian, find_blocked_directions(current)
    )
    predicted = []
    for candidate in candidates:
        lower, upper = (bound[len(current.x)] for bound in current.hypothesis.with_term(candidate.term).bounds())
        projection = point.project(candidate.sensitivity, float(lower), float(upper))
        gain = point.remaining_chi2 - projection.remaining_chi2
        predicted.append(candidate._replace(predicted_gain=gain, size=projection.size))
    return sorted(predicted, key=lambda candidate: -candidate.predicted_gain)


def select_best_causes(candidates: Sequence[Candidate], count: int) -> list[Candidate]:
    """Return the best form of each of the ``count`` best causes."""
    return _select_best(candidates, count, lambda term: term.identity)


def select_best_effects(candidates: Sequence[Candidate], count: int) -> list[Candidate]:
    """Return the best form and owner of each of the ``count`` best effects, wrong numbers and instrument faults.

    A mechanism has each effect of a device once for all devices and once for each of them.
    """
    return _select_best(candidates, count, lambda term: (term.effect, term.channel, term.number))


def _select_best(
    candidates: Sequence[Candidate], count: int, classify: Callable[[EffectTerm], Hashable]
) -> list[Candidate]:
    best: dict[Hashable, Candidate] = {}
    for candidate in candidates:
        if candidate.predicted_gain > 0.0:
            best.setdefault(classify(candidate.term), candidate)
    return list(best.values())[:count]


def select_shortlist(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the best candidates, the best one of each of the best effects, other forms of leaders, and numbers.

    The leaders are the best three candidates. Forms and owners of one effect alone could fill the list, and so could
    numbers that are one to the data, such as the lengths of muscle and tendon.
    """
    leaders = {c.term.identity for c in candidates[:3]}
    effects = [c for c in candidates if not c.term.number]
    shortlist = {c.term for c in [*effects[:SHORTLIST_SIZE], *select_best_effects(effects, SHORTLIST_SIZE)]}
    shortlist |= {c.term for c in effects if c.term.identity in leaders}
    all_numbers = [c for c in candidates if c.term.number]
    numbers, others = all_numbers[:NUMBER_SHORTLIST_SIZE], all_numbers[NUMBER_SHORTLIST_SIZE:]
    for candidate in others:
        if len(numbers) == NUMBER_SHORTLIST_SIZE + DISTINCT_NUMBER_COUNT:
            break
        if all(abs(float(candidate.direction @ number.direction)) < MAX_DISTINCT_COSINE for number in numbers):
            numbers.append(candidate)
    shortlist |= {c.term for c in numbers}
    return [c for c in candidates if c.term in shortlist]


@dataclass(frozen=True, eq=False)
class _LinearizationPoint:
    """Point at which the residuals are linearised."""

    x: Array
    """Normalized parameters."""
    residual: Array
    """Weighted residuals."""
    jacobian: Array
    """Derivative of the residuals by the parameters."""
    blocked: Array
    """Direction in which a bound blocks each parameter: 1 upwards, -1 downwards, 0 for one that is free."""
    bases: dict[bytes, Array] = field(default_factory=dict)
    """Which parameters change -> orthonormal basis of their derivatives."""

    @cached_property
    def remaining_chi2(self) -> float:
        """Chi squared after a step of the parameters alone."""
        return self.project(np.zeros(len(self.residual)), 0.0, 0.0).remaining_chi2

    def project(self, sensitivity: Array, lower: float, upper: float) -> "_Projection":
        """Return what an effect with this ``sensitivity`` and a size within ``lower`` and ``upper`` explains.

        The parameters change with it (Gauss-Newton step), except those that would leave their bounds: these are held,
        and none is released again, unlike in an active-set method (Nocedal & Wright 2006, Numerical Optimization,
        section 16.5; quoted from memory).
        """
        free = np.ones(len(self.x), dtype=bool)
        while True:
            basis = self._find_basis(free)
            orthogonal = sensitivity - basis @ (basis.T @ sensitivity)
            squared_norm = float(orthogonal @ orthogonal)
            size = -float(orthogonal @ self.residual) / squared_norm if squared_norm > 0.0 else 0.0
            size = min(max(size, lower), upper)
            shift = np.zeros(len(self.x))
            shift[free] = -_solve_least_squares(self.jacobian[:, free], self.residual + size * sensitivity)
            leaving = free & (self.blocked * shift > 0.0)
            if not leaving.any():
                break
            free &= ~leaving
        after = self.residual + size * sensitivity + self.jacobian @ shift
        return _Projection(size, float(after @ after), orthogonal, shift)

    def _find_basis(self, free: Mask) -> Array:
        key = free.tobytes()
        if key not in self.bases:
            self.bases[key] = np.linalg.qr(self.jacobian[:, free])[0]
        return self.bases[key]


class _Projection(NamedTuple):
    """Effect beside the parameters that change with it."""

    size: float
    """Size of the effect, normalized."""
    remaining_chi2: float
    """Chi squared with it."""
    orthogonal: Array
    """Part of the sensitivity that is orthogonal to those of the parameters."""
    nuisance_shift: Array
    """Change of the parameters."""


def find_blocked_directions(fit: Fit) -> Array:
    """Return the direction in which a bound blocks each parameter of ``fit``: 1 upwards, -1 downwards, 0 in none.

    A parameter is blocked at a bound beyond which chi squared falls.
    """
    blocked, gradient = np.zeros(len(fit.x)), fit.jacobian.T @ fit.weighted_residuals
    lower = fit.hypothesis.bounds()[0]
    for index, bound in fit.find_bounds_reached().items():
        outwards = -1.0 if bound == lower[index] else 1.0
        if outwards * gradient[index] < 0.0:
            blocked[index] = outwards
    return blocked


def _evaluate_probes(
    data: WeightedData,
    base_hypothesis: Hypothesis,
    point: _LinearizationPoint,
    probes: Sequence[tuple[EffectTerm, float, Array]],
    report_divergence: Callable[[EffectTerm], None] = lambda term: None,
) -> list[Candidate]:
    """Return the candidates of ``probes`` (term, normalized size, shift of the known parameters)."""
    n_known, experiments = len(point.x), data.experiments
    hypotheses = [base_hypothesis.with_term(term) for term, _, _ in probes]
    points = [
        _probe_parameters(h, point.x, size, shift) for h, (_, size, shift) in zip(hypotheses, probes, strict=True)
    ]
    setups = [h.build_setups(x, experiments) for h, x in zip(hypotheses, points, strict=True)]
    all_changes = data.compute_changes(base_hypothesis.build_setups(point.x, experiments), setups, coarse=True)
    candidates = []
    for (term, _, _), hypothesis, x, changes in zip(probes, hypotheses, points, all_changes, strict=True):
        probe_size, shift = float(x[n_known]), x[:n_known] - point.x
        if probe_size == 0.0:
            continue
        if not all(np.isfinite(values).all() for row in changes for values in row.values()):
            report_divergence(term)
            continue
        # The linear part of the shift's influence is subtracted; the projection would remove it anyway.
        change = np.concatenate([data.weight_residuals(changes), shift[: hypothesis.n_prior_parameters]])
        sensitivity = (change - point.jacobian @ shift) / probe_size
        lower, upper = hypothesis.bounds()
        size, remaining_chi2, orthogonal, nuisance_shift = point.project(
            sensitivity, float(lower[n_known]), float(upper[n_known])
        )
        gain = point.remaining_chi2 - remaining_chi2
        norm, full_norm = float(np.linalg.norm(orthogonal)), float(np.linalg.norm(sensitivity))
        if not (np.isfinite(norm) and norm > MIN_ORTHOGONAL_FRACTION * max(full_norm, 1.0)):
            continue
        candidates.append(
            Candidate(term, gain, size, sensitivity, orthogonal / norm, norm / full_norm, point.x, nuisance_shift)
        )
    return candidates


def _list_small_probes(
    candidates: Sequence[Candidate], point: _LinearizationPoint
) -> list[tuple[EffectTerm, float, Array]]:
    """Return probes near the predicted size of the effects among ``candidates`` that are predicted to be small.

    An effect whose probe makes the fit worse in every size is probed where it changes the readings as much as the
    residual.
    """
    residual = float(np.linalg.norm(point.residual))
    probes = []
    for candidate in candidates:
        size_of_residual = residual / float(np.linalg.norm(candidate.sensitivity))
        size = abs(candidate.size) or size_of_residual
        if candidate.term.channel is None and candidate.term.number is None and size < MAX_SMALL_EFFECT:
            signed = math.copysign(max(size, MIN_SMALL_PROBE), candidate.size)
            probes.append((candidate.term, signed, np.zeros(len(point.x))))
    return probes


def _solve_least_squares(matrix: Array, target: Array) -> Array:
    return np.linalg.lstsq(matrix, target)[0].astype(np.float64)


def _probe_parameters(hypothesis: Hypothesis, x: Array, size: float, shift: Array) -> Array:
    """Return normalized parameters: ``x`` shifted, the last term at ``size``, shapes at typical values."""
    point = hypothesis.initial_point()
    point[: len(x)] = x + shift
    for k in range(len(x), len(point)):
        if not hypothesis.parameters[k].is_logarithmic:
            point[k] = size
    return np.clip(point, *hypothesis.bounds())
