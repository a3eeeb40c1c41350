"""Whether the test trials confirm the effects that were added, and which device predicts them best."""

from dataclasses import replace

import numpy as np

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.misfit import MIN_MISFIT_FRACTION
from klute_sim.diagnosis.noise.repeats import Residuals
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.types import Array

MAX_REMAINING_FRACTION = 0.6
"""Largest fraction of the squared gap beyond noise that an adequate model may leave on test trials (assumed)."""
MIN_CHANGE = 0.02
"""Relative change of a gap from which on effects change a channel whose noise is unknown (assumed)."""
MIN_SHARE_FRACTION = 0.5
"""Smallest fraction of the share that a model of an imperfect law takes on other trials, to be taken on test trials
(assumed)."""
MAX_UNSEEN_RATIO = 3.0
"""Largest rms of what is left in test trials, over that of the fitted trials, that an error of the law explains
(assumed: it is largest at the ends of the range, which test trials may be)."""
MIN_DECLARED_ADVANTAGE = 0.05
"""Part of the rms gap by which the declared device must be better than the fitted one to be recommended (assumed)."""
NEGLIGIBLE_GAP = 0.15
"""Squared gap beyond noise, over the squared noise, that counts as none (assumed: sampling of the noise)."""


def exercises_effects(diagnosis: Diagnosis, evaluated: WeightedData, residuals: Residuals) -> bool:
    """Return whether the added effects change a channel of the ``evaluated`` trials by more than noise hides.

    ``residuals`` are those of the final fit. Where neither repeats nor successive samples show the noise of a channel,
    its effects count.
    """
    assert diagnosis.final_fit is not None
    fit = diagnosis.final_fit
    n_known = len(fit.hypothesis.terms) - len(diagnosis.added_terms)
    is_kept = [p.term_index is None or p.term_index < n_known for p in fit.hypothesis.parameters]
    bare = replace(fit.hypothesis, terms=fit.hypothesis.terms[:n_known])
    (bare_residuals,) = evaluated.compute_residuals(bare, [fit.x[is_kept]], may_diverge=True)
    for channel, gap in diagnosis.channel_rms.items():
        rows = zip(residuals, bare_residuals, strict=True)
        change = np.concatenate([row[channel] - bare_row[channel] for row, bare_row in rows if channel in row])
        noise = gap.noise_floor or gap.fast_noise or 0.0
        is_hidden = float(np.sqrt(np.mean(change**2))) <= MIN_MISFIT_FRACTION * noise
        if not is_hidden:  # or the simulation without the effects diverges
            return True
    return False


def leaves_more_than_in_fit(diagnosis: Diagnosis) -> bool:
    """Return whether the final model leaves much more in a channel of the test trials than in the fitted ones."""
    assert diagnosis.final_fit is not None
    for channel, gap in diagnosis.channel_rms.items():
        rows = [row[channel] for row in diagnosis.final_fit.residuals if channel in row]
        fitted_rms = float(np.sqrt(np.mean(np.concatenate(rows) ** 2))) if rows else 0.0
        if gap.with_effects > MAX_UNSEEN_RATIO * fitted_rms:
            return True
    return False


def record_confirmation(diagnosis: Diagnosis, *, is_exercised: bool = True, leaves_more: bool = True) -> None:
    """Set whether the test trials confirm the added effects, and demote a verdict that they do not confirm.

    Trials in which the effects change nothing (not ``is_exercised``) confirm none, however well they are predicted.
    They refute none if they are not repeated, because what they leave may be noise, or if they do not leave much more
    than the fitted trials do (not ``leaves_more``): that is an error of the law.
    """
    has_noise = any(gap.noise_floor for gap in diagnosis.channel_rms.values())
    squares = [  # a gap below the noise is none, and makes up for no other
        np.maximum(0.0, np.square([gap.refitted, gap.with_effects]) / gap.noise_floor**2 - 1.0)
        for gap in diagnosis.channel_rms.values()
        if gap.noise_floor
    ] or _compare_without_noise(diagnosis)
    if not squares:  # no model leaves a gap
        return
    refitted, with_effects = np.sum(squares, axis=0)
    max_remaining = MAX_REMAINING_FRACTION
    if diagnosis.prediction is not None:
        max_remaining = 1.0 - MIN_SHARE_FRACTION * diagnosis.prediction.share
    is_confirmed = bool(with_effects <= max(max_remaining * refitted, NEGLIGIBLE_GAP * len(squares)))
    is_refuted = not is_confirmed and (is_exercised or (has_noise and leaves_more))
    diagnosis.is_worse_on_test = bool(is_refuted and with_effects > refitted + NEGLIGIBLE_GAP * len(squares))
    diagnosis.held_out = "not-confirmed" if is_refuted else "confirmed" if is_exercised else "not-tested"
    if diagnosis.held_out == "not-tested":
        diagnosis.reasons.append(
            f"The test trials cannot confirm the added effects, which change no channel there by more than "
            f"{100 * MIN_MISFIT_FRACTION:.0f} % of the noise. Set use = 'test' for a trial that shows them."
        )
    if is_refuted and diagnosis.verdict in ("identified", "identified-in-part", "indistinguishable"):
        diagnosis.verdict = "unexplained"
        sentence = (
            "The test trials do not confirm the effects: the gap does not shrink there as it did on the other trials."
        )
        if diagnosis.is_worse_on_test:
            sentence = "The test trials refute the effects: the refitted device without effects predicts them better."
        diagnosis.reasons.insert(0, sentence)
    elif diagnosis.is_worse_on_test:
        diagnosis.reasons.insert(0, "On the test trials the refitted device without effects predicts better.")


def record_declared_advantage(diagnosis: Diagnosis) -> None:
    """Set whether the declared device predicts the test trials better than the recommended one, and say so.

    Then the fitted numbers compensate what the law lacks in the fitted trials, and do not hold beyond them. The verdict
    stays: it compares models whose numbers are fitted.
    """
    case = "refitted" if diagnosis.is_worse_on_test else "with_effects"
    gaps = [(gap.nominal, getattr(gap, case), gap.noise_floor) for gap in diagnosis.channel_rms.values()]
    known = [gap for gap in gaps if gap[2]] or [gap for gap in gaps if gap[0] or gap[1]]
    squares = [np.square([nominal, fitted]) / (noise or fitted or nominal) ** 2 for nominal, fitted, noise in known]
    if not squares:  # no model leaves a gap
        return
    declared, fitted = np.sum(squares, axis=0)
    if declared + NEGLIGIBLE_GAP * len(squares) >= fitted * (1.0 - MIN_DECLARED_ADVANTAGE) ** 2:
        return
    diagnosis.is_declared_best = True
    clauses = []
    for channel, gap in diagnosis.channel_rms.items():
        unit, si = CHANNEL_UNITS[channel]
        clauses.append(f"'{channel}' by {gap.nominal / si:.3g} instead of {getattr(gap, case) / si:.3g} {unit} rms")
    model = "with the refitted numbers" if case == "refitted" or not diagnosis.added_terms else "with the added effects"
    diagnosis.reasons.insert(
        1 if diagnosis.diverged_trials else 0,  # that a simulation diverges stays the first reason
        f"On the test trials the device as declared predicts better than {model}: it misses {', '.join(clauses)}. The "
        "fitted numbers do not hold there.",
    )


def _compare_without_noise(diagnosis: Diagnosis) -> list[Array]:
    """Return squared gaps, refitted and with effects, over the refitted one, of the channels that effects change."""
    gaps = [(gap.refitted, gap.with_effects) for gap in diagnosis.channel_rms.values()]
    gaps = [(refitted, with_effects) for refitted, with_effects in gaps if refitted or with_effects]
    changed = [
        (refitted, with_effects)
        for refitted, with_effects in gaps
        if abs(with_effects - refitted) > MIN_CHANGE * refitted
    ]
    return [np.square(gap) / (gap[0] or gap[1]) ** 2 for gap in changed or gaps]
