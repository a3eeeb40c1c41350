"""Greedy forward selection by the textbook BIC: a careful engineer's approach without the workflow of the package."""

from collections.abc import Sequence

from benchmarks.hidden_effects.baselines.calibration import (
    MAX_EFFECTS,
    Calibration,
    compute_bic,
    estimate_textbook_noise,
)
from benchmarks.hidden_effects.baselines.trials import Trials, Verdict

from klute_sim.diagnosis.fitting.least_squares import complete_fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.screening import screen_candidates, select_shortlist


def select_by_bic(trials: Trials, exclude: Sequence[str]) -> Verdict:
    """Return the effects that lower the BIC over all samples, added one at a time.

    The catalogue, simulator and fits are those of the package. Repeats only add samples. There are no validation
    trials, no residual tests and no equivalent models.
    """
    with Calibration(trials, exclude) as calibration:
        current, candidates = calibration.base, calibration.terms
        for _ in range(MAX_EFFECTS):
            noise = estimate_textbook_noise(current.residuals)
            data = WeightedData(calibration.data.simulator, calibration.data.experiments, noise)
            shortlist = select_shortlist(screen_candidates(data, current, candidates))
            refits = ForwardSelection(data, [], candidates).refit_candidates(current, shortlist)
            best = min(refits, key=compute_bic, default=None)
            if best is None or compute_bic(best) >= compute_bic(current):
                break
            current, new_term = complete_fit(data, best), best.hypothesis.terms[-1]
            candidates = [t for t in candidates if t.identity != new_term.identity]
        return calibration.describe(current)
