"""Prediction of another dataset by what a diagnosis has found: other lengths, another diameter, another specimen."""

from dataclasses import dataclass, replace

import numpy as np

from klute_sim.datasets.dataset import Dataset, split_dataset
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData
from klute_sim.diagnosis.noise.repeats import list_channels
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.errors import InputError
from klute_sim.types import Array


@dataclass(frozen=True)
class ChannelPrediction:
    """Errors of prediction of one channel over all trials, rms [SI]; infinite where a simulation diverges."""

    nominal: float
    """Error of the other dataset's device as declared."""
    refitted: float
    """Error with the numbers as refitted to the first dataset, without effects."""
    with_effects: float
    """Error with the added effects as well."""
    measured_range: float
    """Largest minus smallest measured value [SI]."""


@dataclass(frozen=True)
class TransferPrediction:
    """Prediction of a dataset that a diagnosis has not seen."""

    dataset_name: str
    """Name of the folder of the predicted dataset."""
    channels: dict[str, ChannelPrediction]
    """Channel -> errors."""
    recommended: str
    """Which device the diagnosis recommends: 'with-effects' or 'without-effects'."""

    def to_dict(self) -> dict[str, object]:
        """Return the errors in the units of their channels, for JSON; None where a simulation diverges."""
        rows = {}
        for channel, p in self.channels.items():
            unit, si = CHANNEL_UNITS[channel]
            rows[channel] = {
                "unit": unit,
                "nominal": _get_finite(p.nominal / si),
                "refitted": _get_finite(p.refitted / si),
                "with_effects": _get_finite(p.with_effects / si),
                "range": p.measured_range / si,
                "with_effects_pct_of_range": _get_finite(100.0 * p.with_effects / p.measured_range)
                if p.measured_range
                else None,
            }
        return {"dataset": self.dataset_name, "recommended": self.recommended, "channels": rows}


def _get_finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def predict_dataset(diagnosis: Diagnosis, dataset: Dataset, n_jobs: int = 0) -> TransferPrediction:
    """Return how well the device that ``diagnosis`` found predicts ``dataset``, without any fit to it.

    The other dataset declares its own device, which states the changes of geometry. A number that the diagnosis fitted
    keeps its *relative* change. Effects of device and body are added as they were found. Faults of instruments and
    errors of the registration belong to the first set-up and stay there.

    Raises InputError when nothing was fitted, the rigs differ, or the other device lacks a fitted number.
    """
    if diagnosis.base_fit is None or diagnosis.final_fit is None:
        raise InputError("the diagnosis fitted nothing, so it cannot predict another dataset; see its reasons")
    if dataset.rig != diagnosis.dataset.rig:
        raise InputError(
            f"dataset '{dataset.folder.name}' was recorded on rig '{dataset.rig}', but the diagnosis is of rig "
            f"'{diagnosis.dataset.rig}'; allowed: the same rig"
        )
    experiments = [e for e in prepare_experiments(dataset, split_dataset(dataset)) if e.measured]
    nominal = Hypothesis(dataset.device, (), ())
    candidates = [
        (nominal, nominal.initial_point()),
        _detach_setup(diagnosis.base_fit, dataset),
        _detach_setup(diagnosis.final_fit, dataset),
    ]
    simulator = Simulator(n_jobs)
    try:
        residuals = [
            WeightedData(simulator, experiments, {}).compute_residuals(hypothesis, [x], may_diverge=True)[0]
            for hypothesis, x in candidates
        ]
    finally:
        simulator.close()
    channels = {}
    for channel in list_channels(experiments):
        rms = [
            float(np.sqrt(np.mean(np.concatenate([row[channel] for row in rows if channel in row]) ** 2)))
            for rows in residuals
        ]
        channels[channel] = ChannelPrediction(rms[0], rms[1], rms[2], _compute_range(experiments, channel))
    recommended = "without-effects" if diagnosis.is_worse_on_test else "with-effects"
    return TransferPrediction(dataset.folder.resolve().name, channels, recommended)


def _detach_setup(fit: Fit, dataset: Dataset) -> tuple[Hypothesis, Array]:
    """Return the hypothesis and the parameters of ``fit`` without instruments and registration."""
    hypothesis = fit.hypothesis
    known = dataset.device.spec.collect_values()
    values = hypothesis.values(fit.x)
    for key in hypothesis.collect_numbers(values):
        if key not in known:
            raise InputError(
                f"the device of dataset '{dataset.folder.name}' has no number '{key}', which the diagnosis fitted; "
                "declare a device with the same sections"
            )
    if hypothesis.mechanism_numbers:
        hypothesis = _declare_mechanism_numbers(hypothesis, dataset)
    retained = [term.channel is None for term in hypothesis.terms]
    terms = tuple(term for term, keep in zip(hypothesis.terms, retained, strict=True) if keep)
    n_numbers = len(hypothesis.uncertainties)
    is_kept = [
        index < n_numbers or (parameter.term_index is not None and retained[parameter.term_index])
        for index, parameter in enumerate(hypothesis.parameters)
    ]
    return replace(hypothesis, terms=terms, registration=()), fit.x[is_kept]


def _declare_mechanism_numbers(hypothesis: Hypothesis, dataset: Dataset) -> Hypothesis:
    """Return ``hypothesis`` with the numbers of the mechanism of ``dataset``, whose relative errors stay the same."""
    known = {} if dataset.mechanism is None else dataset.mechanism.collect_nominal_numbers()
    numbers, deviations = {}, dict(hypothesis.uncertainties)
    fitted = {parameter.name for parameter in hypothesis.parameters}
    for name, declared in hypothesis.mechanism_numbers:
        if name not in fitted:
            continue
        if name not in known:
            raise InputError(
                f"the mechanism of dataset '{dataset.folder.name}' has no number '{name}', which the diagnosis fitted; "
                "use the same names in its model and devices"
            )
        numbers[name] = known[name]
        if name in deviations:
            deviations[name] *= abs(known[name] / declared) if declared != 0.0 else 1.0
    return replace(hypothesis, uncertainties=tuple(deviations.items()), mechanism_numbers=tuple(numbers.items()))


def _compute_range(experiments: list[Experiment], channel: str) -> float:
    return float(np.ptp(np.concatenate([e.measured[channel].value for e in experiments if channel in e.measured])))
