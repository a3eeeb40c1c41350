"""Result of a diagnosis, and the options of the workflow."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from klute_sim.datasets.dataset import Dataset
from klute_sim.datasets.split import Split
from klute_sim.device.device import Device
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.localization.equation_residuals import EquationResidual
from klute_sim.diagnosis.localization.misfit_map import MapCell
from klute_sim.diagnosis.localization.misfit_regions import MisfitRegion
from klute_sim.diagnosis.noise.quantization import Quantizer
from klute_sim.diagnosis.noise.repeats import Noise
from klute_sim.diagnosis.planning.direct_measurements import DirectMeasurement
from klute_sim.diagnosis.selection.forward_selection import BIC_THRESHOLD
from klute_sim.diagnosis.selection.predictive_model import PredictiveResult
from klute_sim.diagnosis.selection.robustness import EquivalentModel
from klute_sim.diagnosis.selection.selection_step import SelectionStep

Verdict = Literal[
    "nothing-missing", "identified", "identified-in-part", "indistinguishable", "unexplained", "insufficient-data"
]
MIN_INPUT_ERROR_SCALE = 1.5
"""Smallest factor by which unknown inputs widen the error of a sample that the report mentions (assumed)."""
RecommendedDevice = Literal["with-effects", "without-effects", "as-declared"]
HeldOut = Literal["confirmed", "not-confirmed", "not-tested"]


@dataclass(frozen=True, eq=False, kw_only=True)
class DiagnosisOptions:
    """Options of the workflow."""

    only: tuple[str, ...] = ()
    """Names of the candidate effects; empty: all of the catalogue."""
    exclude: tuple[str, ...] = ()
    """Names of effects that are not candidates."""
    n_jobs: int = 0
    """Number of threads; 0: all cores."""
    seed: int = 0
    """Random seed for multi-start fits."""

    @property
    def absence(self) -> str:
        """Predicate of an effect that is no candidate."""
        return "is not among the effects that you allowed" if self.only or self.exclude else "is not in the catalogue"


@dataclass(frozen=True, eq=False, kw_only=True)
class ChannelRms:
    """Root mean square [SI] of measured minus simulated values of one channel on the evaluated trials."""

    nominal: float
    """Residual with the nominal device."""
    refitted: float
    """Residual with the refitted uncertain numbers of the device and no added effect."""
    with_effects: float
    """Residual with the added effects."""
    noise_floor: float | None
    """Noise between repeats, the lower limit of any model; None without repeats."""
    nominal_unweighted: float | None = None
    """Residual with the nominal device if all samples count alike; None where they count alike anyway."""
    fast_noise: float | None = None
    """Noise that successive samples show, an estimate for trials without repeats; None where they show none."""


@dataclass(eq=False, kw_only=True)
class Diagnosis:
    """Result of a diagnosis."""

    dataset: Dataset
    """Diagnosed dataset."""
    split: Split
    """Partition of the trials into fitted, validation and test trials."""
    options: DiagnosisOptions = field(default_factory=DiagnosisOptions)
    """Options of the workflow."""
    verdict: Verdict
    """Verdict."""
    reasons: list[str]
    """Sentences that explain the verdict."""
    noise: dict[str, Noise] = field(default_factory=dict)
    """Noise of each channel."""
    base_fit: Fit | None = None
    """Fit of the uncertain numbers of the device, without added effects."""
    final_fit: Fit | None = None
    """Fit with the accepted effects."""
    added_terms: tuple[EffectTerm, ...] = ()
    """Added effects; a data-driven term, if any, is the last."""
    absent_terms: tuple[EffectTerm, ...] = ()
    """Effects that were found and left out, because their interval contains their absence."""
    confidence_intervals: list[tuple[float, float]] = field(default_factory=list)
    """95 % confidence intervals of the parameters of the final fit."""
    registration_corrections: Sequence[str] = ()
    """Statements about the corrections of the registration that matter: how the truth differs from the data."""
    equivalent_models: list[EquivalentModel] = field(default_factory=list)
    """Other models that explain the data as well, best first."""
    prediction: PredictiveResult | None = None
    """Selection by prediction of left-out conditions; None where models reach the noise between repeats."""
    held_out: HeldOut = "not-tested"
    """Whether the test trials confirm the added effects; 'not-tested' without effects, or without test trials in which
    they act."""
    is_worse_on_test: bool = False
    """Whether the refitted device without effects predicts the test trials better."""
    is_declared_best: bool = False
    """Whether the device as declared predicts the test trials better than what would be recommended otherwise."""
    diverged_trials: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Model -> test trials in which its simulation diverges; :attr:`channel_rms` leaves them out."""
    p_value: float | None = None
    """Probability of a misfit as large as that of the base fit if nothing is missing; None without repeats."""
    misfit_map: list[MapCell] = field(default_factory=list)
    """Misfit of the base fit in each channel and condition; empty without repeats."""
    misfit_regions: list[MisfitRegion] = field(default_factory=list)
    """Channels and conditions in which the base fit deviates, largest deviation first."""
    equation_residuals: list[EquationResidual] = field(default_factory=list)
    """Residual of each equation of the device without added effects; empty without repeats or a common clock."""
    selection_history: list[SelectionStep] = field(default_factory=list)
    """Steps of the forward selection."""
    channel_rms: dict[str, ChannelRms] = field(default_factory=dict)
    """Residuals of each channel on the evaluated trials."""
    evaluated_on: Literal["test", "fit"] = "test"
    """Trials of :attr:`channel_rms`: test trials, or fitted trials where no test trial exists or can be simulated."""
    experiments: list[Experiment] = field(default_factory=list)
    """All trials, ready to be simulated."""
    fitted_experiments: list[Experiment] = field(default_factory=list)
    """Trials of :attr:`base_fit` and :attr:`final_fit`, in the order of their residuals."""
    quantizers: dict[str, Quantizer] = field(default_factory=dict)
    """Quantised channels."""
    n_independent: float = 0.0
    """Number of independent samples in the fitted trials."""
    has_repeats: bool = True
    """Whether noise was measured from repeats; otherwise the residuals of the base fit count as noise."""
    bic_threshold: float = BIC_THRESHOLD
    """Difference of BIC that decides between models."""
    next_experiment: dict[str, Any] | None = None
    """Experiment that would separate the equivalent models."""
    direct_measurements: Sequence[DirectMeasurement] = ()
    """Quantities that would separate them if they were measured directly."""
    fitted_device: Device | None = None
    """Recommended device: with its refitted numbers and the added effects unless test trials speak against them; None
    without a fit."""
    n_simulations: int = 0
    """Number of simulations."""

    def list_added_terms(self, fit: Fit) -> tuple[EffectTerm, ...]:
        """Return the terms of ``fit`` that the base fit does not have."""
        n_known = 0 if self.base_fit is None else len(self.base_fit.hypothesis.terms)
        return fit.hypothesis.terms[n_known:]

    @property
    def has_proxies(self) -> bool:
        """Whether added effects, if there are any, only stand for what is missing."""
        return self.verdict in ("unexplained", "insufficient-data")

    @property
    def evaluated_experiments(self) -> list[Experiment]:
        """Trials of :attr:`channel_rms`."""
        diverged = {name for names in self.diverged_trials.values() for name in names}
        return [e for e in self.experiments if e.use == self.evaluated_on and e.measured and e.name not in diverged]

    @property
    def has_input_weights(self) -> bool:
        """Whether samples of :attr:`channel_rms` count less where the logged inputs leave open what happened."""
        scales = [scale for e in self.evaluated_experiments for scale in e.input_error_scale.values()]
        return any(float(np.max(scale)) > MIN_INPUT_ERROR_SCALE for scale in scales)

    @property
    def recommended_device(self) -> RecommendedDevice:
        """The device of the final fit, or one without effects, or as declared, that predicts the test trials better."""
        if self.is_declared_best:
            return "as-declared"
        return "without-effects" if self.is_worse_on_test else "with-effects"

    @property
    def recommended_fit(self) -> Fit:
        """Fit of :attr:`recommended_device`.

        For the device as declared, only hypothesis and parameters are its own; the residuals are those after the fit.
        """
        assert self.base_fit is not None
        assert self.final_fit is not None
        if self.is_declared_best:
            return replace(self.base_fit, x=self.base_fit.hypothesis.initial_point())
        return self.base_fit if self.is_worse_on_test else self.final_fit
