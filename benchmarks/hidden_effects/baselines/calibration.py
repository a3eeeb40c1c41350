"""Fits of a device with sets of effects to the fit trials, by the simulator and the least squares of the package."""

from collections.abc import Sequence
from types import TracebackType
from typing import Any, Self

import numpy as np
from benchmarks.hidden_effects.baselines.trials import Trials, Verdict, compute_gap, compute_rms, join_channels

from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, complete_fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise, Residuals, estimate_noise_from_repeats
from klute_sim.diagnosis.selection.candidates import list_candidate_terms
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.screening import Candidate, screen_candidates
from klute_sim.errors import InputError

MAX_EFFECTS = 3
"""Largest number of effects in a device, equal to that of the workflow."""
N_SWITCHES = 6
"""Number of effects that a method combines: those that explain most alone, by the linear screening of the package. A
method that fits every model cannot combine all effects and numbers of the catalogue in a reasonable time."""


class Calibration:
    """Simulator, weighted fit trials, and the fits so far; a context manager that stops the simulator."""

    def __init__(self, trials: Trials, exclude: Sequence[str], *, with_repeats: bool = False) -> None:
        """Fit the numbers of the device without effects.

        Channels are weighted by the textbook noise, which is the residual of that fit, independent in every sample; or
        ``with_repeats`` by the noise that repeats show, with its autocorrelation. Raises InputError without fit trials,
        or without the repeats.
        """
        self.trials = trials
        self._experiments = trials.with_use("fit")
        if not self._experiments:
            raise InputError("no trial to fit")
        self._simulator = Simulator()
        try:
            self.base, self.data = self._fit_base(with_repeats=with_repeats)
            terms = list_candidate_terms(self.data, trials.dataset, (), exclude)
            self.terms = [term for term in terms if term.number not in trials.dataset.uncertainties]
        except BaseException:
            self._simulator.close()
            raise
        self._fits: dict[frozenset[EffectTerm], Fit] = {frozenset(): self.base}

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Stop the simulator."""
        self._simulator.close()

    def _fit_base(self, *, with_repeats: bool) -> tuple[Fit, WeightedData]:
        dataset = self.trials.dataset
        hypothesis = Hypothesis(dataset.device, tuple(dataset.uncertainties.items()), ())
        x = hypothesis.initial_point()
        residuals: Residuals = WeightedData(self._simulator, self._experiments, {}).compute_residuals(hypothesis, [x])[
            0
        ]
        for _ in range(2):  # the weights follow from the residuals, and these from the weights
            noise = (
                estimate_noise_from_repeats(self._experiments, residuals)
                if with_repeats
                else estimate_textbook_noise(residuals)
            )
            if not noise:
                raise InputError("no trial was repeated, so the noise is unknown")
            data = WeightedData(self._simulator, self._experiments, noise)
            deviations = tuple((channel, entry.std) for channel, entry in noise.items())
            fit = fit_hypothesis(data, Hypothesis(dataset.device, hypothesis.uncertainties, deviations), x)
            residuals, x = fit.residuals, fit.x
        return fit, data

    def select_switches(self) -> list[EffectTerm]:
        """Return the :data:`N_SWITCHES` effects that are predicted to explain most, each in its best form."""
        best: dict[Any, EffectTerm] = {}
        for candidate in screen_candidates(self.data, self.base, self.terms):
            best.setdefault(candidate.term.identity, candidate.term)
        return list(best.values())[:N_SWITCHES]

    def fit(self, terms: Sequence[EffectTerm]) -> Fit | None:
        """Return the device with the effects ``terms`` fitted; None where a simulation diverges.

        The last effect is added to the best fit with one effect less.
        """
        key = frozenset(terms)
        if key not in self._fits:
            known = [(fit.chi2, term) for term in terms if (fit := self._fits.get(key - {term}))]
            last = min(known, key=lambda pair: pair[0])[1] if known else terms[-1]
            parent = self.fit([term for term in terms if term != last])
            candidates: list[Candidate] = [] if parent is None else screen_candidates(self.data, parent, [last])
            if parent is None or not candidates:
                return None
            (best, *_) = ForwardSelection(self.data, [], self.terms).refit_candidates(parent, candidates)
            self._fits[key] = complete_fit(self.data, best)
        fit = self._fits[key]
        return None if fit.has_diverged else fit

    def describe(self, fit: Fit) -> Verdict:
        """Return the verdict that exactly the effects of ``fit`` are missing, with the gap that they remove."""
        test = self.data.with_experiments(self.trials.with_use("test"))
        before, after = (test.compute_residuals(f.hypothesis, [f.x])[0] for f in (self.base, fit))
        effects = [
            {
                "name": term.effect,
                "form": term.form,
                "channel": term.channel,
                "number": term.number,
                "parameters": {
                    parameter.name: {"value": value}
                    for parameter, value in zip(fit.hypothesis.parameters, fit.values, strict=True)
                    if parameter.term_index == index
                },
            }
            for index, term in enumerate(fit.hypothesis.terms)
        ]
        return {
            "verdict": "identified" if effects else "nothing-missing",
            "effects": effects,
            "gap": compute_gap(test.experiments, before, after),
        }


def estimate_textbook_noise(residuals: Residuals) -> dict[str, Noise]:
    """Return the residuals of a fit as noise that is independent in every sample."""
    return {
        channel: Noise(compute_rms(values), (Autocorrelation(1e-9, 1.0, len(values)),))
        for channel, values in join_channels(residuals).items()
    }


def compute_bic(fit: Fit) -> float:
    """Return the BIC with a separate variance of each channel, without constants.

    It is ``sum over channels of n log(RSS / n) + k log n`` over all samples (Schwarz 1978, Ann Stat 6:461).
    """
    joined = join_channels(fit.residuals).values()
    count = sum(map(len, joined))
    return float(sum(len(v) * np.log(np.mean(v * v)) for v in joined) + len(fit.x) * np.log(count))
