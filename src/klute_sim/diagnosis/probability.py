"""Probability of each name, and of the statement that nothing is missing, calibrated on the hidden-effect benchmark.

Differences of BIC are no probabilities of a name: they compare models of the catalogue alone, with the noise as it was
estimated, and effects outside of the catalogue are imitated. How often verdicts were right on datasets with
known truth is measured, and a logistic regression states it as a function of the verdict and of the evidence (Platt
1999, *Advances in Large Margin Classifiers*, pages 61 to 74). Such a probability holds for data like those of the
benchmark, with its share of clean datasets.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from klute_sim.diagnosis.evidence import collect_evidence
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.result import ChannelRms, Diagnosis

CALIBRATION_FILE = "calibration.json"
NAMING_VERDICTS = ("identified", "identified-in-part", "indistinguishable", "unexplained")
"""Verdicts that name effects; those of `unexplained` are proxies."""
MIN_MARGIN = 1e-3
"""Smallest margin that is distinguished."""
SIZE_RANGE = (0.1, 100.0)
"""Range of the misfit over the noise that is distinguished."""


class Probabilities(NamedTuple):
    """Calibrated probabilities of a diagnosis."""

    nothing_missing: float
    """Probability that no effect as large as the noise is missing, and no instrument or number is wrong by as much."""
    names: dict[EffectTerm, float]
    """Probability of each added effect that it is missing in the device; data-driven terms have none."""
    n_datasets: int
    """Number of datasets of the benchmark that they were calibrated on."""


@cache
def load_calibration() -> dict[str, Any]:
    """Return the coefficients of the logistic regressions and where they are from."""
    content: dict[str, Any] = json.loads((files(__package__) / CALIBRATION_FILE).read_text("utf-8"))
    return content


def estimate_probabilities(diagnosis: Diagnosis) -> Probabilities | None:
    """Return the probabilities of ``diagnosis``; None without a fit, without repeats, or with insufficient data."""
    if diagnosis.final_fit is None or not diagnosis.has_repeats or diagnosis.verdict == "insufficient-data":
        return None
    calibration = load_calibration()
    size = measure_misfit_size(diagnosis.channel_rms)
    if diagnosis.added_terms and diagnosis.held_out == "not-tested":
        size = max(size, measure_effect_size(diagnosis))  # the test trials do not show what is missing
    # What a tolerance permits may be missing all the same.
    is_tolerated = diagnosis.verdict == "nothing-missing" and not diagnosis.selection_history
    features = list_nothing_features("tolerated" if is_tolerated else diagnosis.verdict, size)
    nothing = compute_logistic(calibration["nothing_missing"], features)
    names = {
        term: compute_logistic(calibration["names"], list_name_features(diagnosis.verdict, evidence.margin, size))
        for term, evidence in collect_evidence(diagnosis).items()
    }
    return Probabilities(nothing, names, calibration["datasets"])


def measure_misfit_size(channel_rms: Mapping[str, ChannelRms]) -> float:
    """Return the misfit without added effects over the noise, in the channel where it is largest; 0 without noise."""
    ratios = [rms.refitted / rms.noise_floor for rms in channel_rms.values() if rms.noise_floor]
    return float(np.sqrt(max([0.0, *(ratio**2 - 1.0 for ratio in ratios)])))


def measure_effect_size(diagnosis: Diagnosis) -> float:
    """Return what the added effects take from the fitted trials, over the noise, in the channel where it is most.

    It is the root of the difference between two mean squares. All samples count alike, those after which inputs are
    unknown as well.
    """
    assert diagnosis.base_fit is not None
    assert diagnosis.final_fit is not None
    ratios = [0.0]
    for channel, noise in diagnosis.noise.items():
        before, after = (
            np.concatenate([np.zeros(0), *(row[channel] for row in fit.residuals if channel in row)])
            for fit in (diagnosis.base_fit, diagnosis.final_fit)
        )
        if len(before) and noise.std:
            ratios.append(float(np.mean(before**2) - np.mean(after**2)) / noise.std**2)
    return float(np.sqrt(max(ratios)))


def list_name_features(verdict: str, margin: float, size: float) -> list[float]:
    """Return the regressors of a name: one indicator for each verdict, the margin and the size of the misfit."""
    kinds = [float(verdict == kind) for kind in NAMING_VERDICTS]
    return [*kinds, float(np.log10(max(margin, MIN_MARGIN))), _limit_log_size(size)]


def list_nothing_features(verdict: str, size: float) -> list[float]:
    """Return the regressors of the statement that nothing is missing.

    One indicator for the verdict that says so, one for all others; for these also the logarithm of the misfit.
    """
    if verdict == "nothing-missing":
        return [1.0, 0.0, 0.0]
    return [0.0, 1.0, _limit_log_size(size)]


def _limit_log_size(size: float) -> float:
    return float(np.log10(np.clip(size, *SIZE_RANGE)))


def compute_logistic(coefficients: Sequence[float], features: Sequence[float]) -> float:
    """Return 1 / (1 + exp(-coefficients . features))."""
    return float(1.0 / (1.0 + np.exp(-float(np.dot(coefficients, features)))))
