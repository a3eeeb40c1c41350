"""Whether names only imitate an effect outside the catalogue, judged by the prediction of left-out conditions.

Where no model reaches the noise, a large share of the error does not prove a name: effects that resemble a missing
one take a large share, too. A data-driven term represents any missing effect, as in
:mod:`klute_sim.diagnosis.discrepancy.data_driven_rival` where models reach the noise. The names must predict nearly as
well as such a term *of the same size*, because a longer formula also describes the error of the law. They may be
completed by functions of that term: names that are a part of the truth remain then, and imitations do not. A term
that is no larger than the names, does not contain them and predicts as well cannot be told from them.

Two kinds of terms are tried: functions in the equation with the misfit, and linear functions of the channels in the
reading of one instrument (a load cell that responds to the pressure).
"""

from collections.abc import Collection, Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.discrepancy.data_driven_rival import contains_names, locate_term
from klute_sim.diagnosis.discrepancy.sparse_regression import find_supports, format_formula, list_data_driven_terms
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.localization.equation_residuals import compute_equation_residuals
from klute_sim.diagnosis.selection.bounds import simplify_terms
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.naming import MAX_POSSIBLE_GAIN_ERROR
from klute_sim.diagnosis.selection.predictive_model import (
    MIN_TERM_SHARE,
    PredictiveModel,
    PredictiveResult,
    compute_rival_margin,
    has_several_specimens,
    is_as_good,
)
from klute_sim.diagnosis.selection.predictive_selection import COMPARISON_MAX_NFEV, PredictiveSelection
from klute_sim.types import Array

MAX_REMAINING_FRACTION = 0.5
"""Fraction of what the names leave above the noise that a data-driven term must leave at most to refuse them
(assumed). It must also take :data:`MIN_TERM_SHARE` more of the error than they do."""


class DataDrivenModel(NamedTuple):
    """A data-driven term beside names."""

    description: str
    """Where the term is, and its formula."""
    error: float
    """Its squared error of prediction."""
    fit: Fit | None
    """Fit of a term in an equation; None for one in a reading, which no device file holds."""


class DataDrivenComparison(NamedTuple):
    """Data-driven terms beside names."""

    better: DataDrivenModel | None = None
    """Term that predicts much better than the names; None if they stand."""
    rival: DataDrivenModel | None = None
    """Term of the size of the names, and another cause, that predicts as well; None without one."""


class ReadingFunction(NamedTuple):
    """A function that may be added to the reading of a channel."""

    factor: str
    """Channel that the coefficient multiplies; '' for a constant."""
    unit: str
    """Unit of the coefficient."""
    sensitivity: Array
    """Derivative of the weighted residuals by the coefficient, (residuals,)."""


def compare_with_data_driven_models(
    search: ForwardSelection,
    base_fit: Fit,
    selection: PredictiveSelection,
    result: PredictiveResult,
    exclude: Collection[str] = (),
) -> DataDrivenComparison:
    """Return the data-driven terms that refuse the names of ``result``, or that cannot be told from them.

    ``base_fit`` is the fit of ``search`` without added effects; ``exclude`` names effects that are not candidates. A
    term in the equation of a name may contain it, so only terms elsewhere are rivals.
    """
    names = result.chosen.terms
    rivals: list[DataDrivenModel] = []
    min_gain = MIN_TERM_SHARE * (result.base.error - result.noise)

    def find_limit(named_error: float) -> float:
        remaining = MAX_REMAINING_FRACTION * max(0.0, named_error - result.noise)
        return min(result.noise + remaining, named_error - min_gain)

    limit = find_limit(result.chosen.error)
    for n_functions in range(1, len(names) + 1):
        models = _fit_readings(selection, result.base.fit, n_functions)
        best = min(models, key=lambda model: model.error, default=None)  # few channels have few functions
        if best is not None and best.error < limit:
            return DataDrivenComparison(better=best)
    equation_residuals = compute_equation_residuals(search.data, base_fit)
    for library in list_data_driven_terms(base_fit, equation_residuals, exclude).values():
        # Smallest first, so that the shortest of the formulas that predict as well is compared.
        extended = [model for model in _extend(selection, result.base.fit, library) if np.isfinite(model.error)]
        if not extended:  # no function has an influence, or simulations diverge with each of them
            continue
        small = [model for model in extended if len(model.terms[-1].parameter_keys) <= len(names)]
        rivals += [
            _describe(model)
            for model in small
            if _predicts_as_well(model, result) and _is_other_cause(selection, model.fit, result)
        ]
        best_model = min(extended, key=lambda model: model.error)
        free = next(
            model for model in extended if is_as_good(model, best_model) or model.error < best_model.error + min_gain
        )
        if free.error >= limit:
            continue
        # Where one condition alone determines the shape of a friction, names fail to predict it. Medians pass over it.
        named_error = min(_complete_names(selection, result, library, len(free.terms[-1].parameter_keys)))
        if float(np.median(free.errors)) < find_limit(named_error):
            return DataDrivenComparison(better=_describe(free))
    return DataDrivenComparison(rival=min(rivals, key=lambda rival: rival.error, default=None))


def _describe(model: PredictiveModel) -> DataDrivenModel:
    return DataDrivenModel(f"in one equation ({format_formula(model.fit)})", model.error, model.fit)


def _predicts_as_well(model: PredictiveModel, result: PredictiveResult) -> bool:
    """Return whether ``model`` is a rival of the chosen one, as other names would be."""
    chosen = result.chosen
    margin = compute_rival_margin(chosen.error, result.models, result.noise)
    return is_as_good(model, chosen) or model.error <= chosen.error + margin


def _is_other_cause(selection: PredictiveSelection, term_fit: Fit, result: PredictiveResult) -> bool:
    """Return whether the data-driven term of ``term_fit`` is another cause than the names of ``result``.

    A term elsewhere is. A term at the place of a name is if it does not contain the names, unless specimens differ:
    then any function describes a part of their scatter.
    """
    names, term = result.chosen.terms, term_fit.hypothesis.terms[-1]
    if locate_term(term) not in {locate_term(name) for name in names}:
        return True
    return not has_several_specimens(selection.data.experiments) and not contains_names(
        term_fit, result.chosen.fit, names
    )


def _extend(
    selection: PredictiveSelection, current: Fit, library: EffectTerm, sizes: Collection[int] = ()
) -> Iterator[PredictiveModel]:
    """Yield ``current`` with sets of functions of ``library``, smallest first, of given ``sizes`` (default: all)."""
    for support in find_supports(selection.data, current, library):
        if not sizes or len(support.term.parameter_keys) in sizes:
            hypothesis = current.hypothesis.with_term(support.term)
            yield selection.assess(
                fit_hypothesis(selection.data, hypothesis, support.x0, max_nfev=COMPARISON_MAX_NFEV[-1])
            )


def _complete_names(
    selection: PredictiveSelection, result: PredictiveResult, library: EffectTerm, n_functions: int
) -> Iterator[float]:
    """Yield the median errors of the names, and of names with functions of ``library``: together up to ``n_functions``.

    A name counts as one function, so it is completed in its simplest form, too.
    """
    yield float(np.median(result.chosen.errors))
    n_further = n_functions - len(result.chosen.terms)
    if n_further < 1:
        return
    named_fit = result.chosen.fit
    simplified = simplify_terms(selection.data, named_fit, named_fit.hypothesis.terms)
    for fit in [named_fit] if simplified is named_fit else [named_fit, simplified]:
        yield from (
            float(np.median(model.errors)) for model in _extend(selection, fit, library, range(1, n_further + 1))
        )


def _fit_readings(selection: PredictiveSelection, base_fit: Fit, n_functions: int) -> Iterator[DataDrivenModel]:
    """Yield each set of ``n_functions`` linear functions of the channels in the reading of each channel.

    They enter linearly, so the numbers of the device are refitted by one linear step beside them.
    """
    for channel in sorted({channel for weights in selection.data.weights for channel in weights}):
        library = _list_reading_functions(selection, base_fit, channel)
        for functions in combinations(library, n_functions):
            model = _predict_with_reading(selection, base_fit, channel, functions)
            if model is not None:
                yield model


def _list_reading_functions(selection: PredictiveSelection, base_fit: Fit, channel: str) -> list[ReadingFunction]:
    """Return the functions that may be added to the reading of ``channel``: a constant and the simulated channels."""
    data, unit = selection.data, CHANNEL_UNITS[channel]
    simulated = [
        {name: series.value - row[name] for name, series in e.measured.items()}
        for e, row in zip(data.experiments, base_fit.residuals, strict=True)
    ]
    library = []
    for name in ("", *sorted({name for row in simulated for name in row})):
        rows = []
        for e, row in zip(data.experiments, simulated, strict=True):
            values = {other: np.zeros(len(series.time)) for other, series in e.measured.items()}
            if channel in values and not name:
                values[channel] += unit[1]
            elif channel in values and name in row:
                simulated_values = np.interp(e.measured[channel].time, e.measured[name].time, row[name])
                values[channel] = simulated_values / CHANNEL_UNITS[name][1] * unit[1]
            rows.append(values)
        priors = np.zeros(base_fit.hypothesis.n_prior_parameters)
        coefficient_unit = f"{unit[0]} per {CHANNEL_UNITS[name][0]}" if name else unit[0]
        sensitivity = np.concatenate([-data.weight_residuals(rows), priors])
        library.append(ReadingFunction(name, coefficient_unit, sensitivity))
    return library


def _predict_with_reading(
    selection: PredictiveSelection, base_fit: Fit, channel: str, functions: Sequence[ReadingFunction]
) -> DataDrivenModel | None:
    """Return the model with ``functions`` in the reading of ``channel``, and its error of prediction.

    Returns None where the gain of the instrument would be wrong by more than :data:`MAX_POSSIBLE_GAIN_ERROR`.
    """
    columns = np.column_stack([base_fit.jacobian, *(function.sensitivity for function in functions)])
    target = -base_fit.weighted_residuals
    coefficients = np.linalg.lstsq(columns, target)[0][-len(functions) :]
    terms = []
    for coefficient, function in zip(coefficients, functions, strict=True):
        if function.factor == channel and abs(coefficient) > MAX_POSSIBLE_GAIN_ERROR:
            return None
        terms.append(f"{coefficient:+.3g} {function.unit}" + (f" of '{function.factor}'" if function.factor else ""))
    errors = []
    for fold in selection.folds:
        retained = selection.find_retained_rows(fold, base_fit.hypothesis)
        solution = np.linalg.lstsq(columns[retained], target[retained])[0]
        residuals = selection.data.split_weighted_residuals(columns @ solution - target)
        errors.append(selection.compute_fold_error(fold, dict(enumerate(residuals))))
    return DataDrivenModel(f"in the reading of '{channel}' ({', '.join(terms)})", float(np.mean(errors)), None)
