"""Prediction of another dataset by what a diagnosis has found: other lengths, another diameter, another specimen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from klute_sim.datasets.dataset import Dataset, split_dataset
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import FitParameter, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData
from klute_sim.diagnosis.noise.repeats import list_channels
from klute_sim.diagnosis.result import Diagnosis, RecommendedDevice
from klute_sim.errors import InputError
from klute_sim.types import Array

MIN_DIFFERENCE = 0.02
"""Relative difference between two errors of prediction below which neither device is better (assumed)."""
DEVICE_WORDS: dict[RecommendedDevice, str] = {
    "with-effects": "the refitted device with the added effects",
    "without-effects": "the refitted device without effects",
    "as-declared": "the device as declared",
}
"""Device -> words, the most complete device first."""


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

    @property
    def errors(self) -> dict[str, float]:
        """Device -> error [SI]: 'nominal', 'refitted', 'with_effects'."""
        return {"nominal": self.nominal, "refitted": self.refitted, "with_effects": self.with_effects}

    @property
    def by_device(self) -> dict[RecommendedDevice, float]:
        """Device -> error [SI], the most complete device first."""
        return {"with-effects": self.with_effects, "without-effects": self.refitted, "as-declared": self.nominal}


@dataclass(frozen=True)
class TransferredNumber:
    """A fitted number or parameter of an effect, as found and as used for the other dataset."""

    name: str
    """``section.key`` of a number, or ``effect.key`` of a parameter."""
    found: float
    """Value that the diagnosis found, in the unit of the name."""
    used: float
    """Value for the device of the other dataset, in the unit of the name."""
    rule: str
    """How the second value follows from the first."""


@dataclass(frozen=True)
class PredictedTrial:
    """One channel of one trial of the predicted dataset, at the measured samples [SI]."""

    name: str
    """Name of the trial."""
    channel: str
    """Measured channel."""
    measured: Array
    """Measured values (samples,)."""
    refitted: Array
    """Simulated values with the refitted numbers, without effects (samples,)."""
    with_effects: Array
    """Simulated values with the added effects as well (samples,)."""


@dataclass(frozen=True)
class TransferPrediction:
    """Prediction of a dataset that a diagnosis has not seen."""

    dataset_name: str
    """Name of the folder of the predicted dataset."""
    channels: dict[str, ChannelPrediction]
    """Channel -> errors."""
    numbers: tuple[TransferredNumber, ...] = ()
    """Numbers and parameters that were carried over."""
    trials: tuple[PredictedTrial, ...] = ()
    """Measured and predicted values."""

    @property
    def recommended(self) -> RecommendedDevice:
        """The device that predicts the dataset best; the more complete one where two are equally good."""
        return _find_best(self._compute_errors())

    @property
    def best(self) -> str:
        """Which device predicts the dataset best; effects that change nothing are not mentioned."""
        errors = self._compute_errors()
        if (1.0 - MIN_DIFFERENCE) * max(errors.values()) <= min(errors.values()):
            return "none is better"
        changes = any(p.with_effects != p.refitted for p in self.channels.values())
        return f"best: {self.recommended if changes or self.recommended == 'as-declared' else 'refitted'}"

    def _compute_errors(self) -> dict[RecommendedDevice, float]:
        """Return the error of each device over all channels, relative to their ranges."""
        scales = {channel: p.measured_range or 1.0 for channel, p in self.channels.items()}
        return {
            device: float(np.linalg.norm([p.by_device[device] / scales[c] for c, p in self.channels.items()]))
            for device in DEVICE_WORDS
        }

    @property
    def warnings(self) -> list[str]:
        """Sentences for each channel that what was found predicts worse than less of it would, or not at all."""
        sentences = []
        for channel, p in self.channels.items():
            errors = p.by_device
            texts = {device: _format_error(error, p, channel) for device, error in errors.items()}
            best = _find_best(errors)
            if not (np.isfinite(p.with_effects) or np.isfinite(p.refitted)):
                sentences.append(
                    f"On '{self.dataset_name}' the simulations of {channel} diverge with and without the added "
                    "effects: what was found predicts nothing there."
                )
            elif best != "with-effects":
                others = [
                    f"{DEVICE_WORDS[device]} {texts[device]}"
                    for device in DEVICE_WORDS
                    if device != best and not (device == "with-effects" and p.with_effects == p.refitted)
                ]
                sentences.append(
                    f"On '{self.dataset_name}' {DEVICE_WORDS[best]} predicts {channel} best: it misses by "
                    f"{texts[best]}, {', '.join(others)}. What was found does not hold there; use "
                    f"{DEVICE_WORDS[self.recommended]} there."
                )
            elif (1.0 - MIN_DIFFERENCE) * p.refitted > p.nominal:
                sentences.append(
                    f"On '{self.dataset_name}' the refitted numbers without the added effects predict {channel} worse "
                    f"than the device as declared ({texts['without-effects']} instead of {texts['as-declared']}); with "
                    f"them, the error is {texts['with-effects']}. Use the numbers only together with the effects there."
                )
        return sentences

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
                **{
                    f"{name}_pct_of_range": _get_finite(100.0 * error / p.measured_range) if p.measured_range else None
                    for name, error in p.errors.items()
                },
            }
        return {
            "dataset": self.dataset_name,
            "recommended": self.recommended,
            "warnings": self.warnings,
            "channels": rows,
            "numbers": [
                {"name": number.name, "found": number.found, "used": number.used, "rule": number.rule}
                for number in self.numbers
            ],
        }


def _find_best(errors: Mapping[RecommendedDevice, float]) -> RecommendedDevice:
    """Return the device with the smallest of ``errors``, the more complete one where two are equally good."""
    best: RecommendedDevice = "with-effects"
    for device in DEVICE_WORDS:
        if errors[device] < (1.0 - MIN_DIFFERENCE) * errors[best]:
            best = device
    return best


def _format_error(error: float, prediction: ChannelPrediction, channel: str) -> str:
    if not np.isfinite(error):
        return "a simulation that diverges"
    if not prediction.measured_range:
        unit, si = CHANNEL_UNITS[channel]
        return f"{error / si:.3g} {unit}"
    return f"{100.0 * error / prediction.measured_range:.1f} % of the range"


def _get_finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def summarize_predictions(predictions: Sequence[TransferPrediction]) -> list[dict[str, object]]:
    """Return the entries of ``verdict.json``: dataset, device that predicts it best, and warnings."""
    return [
        {"dataset": prediction.dataset_name, "recommended": prediction.recommended, "warnings": prediction.warnings}
        for prediction in predictions
    ]


def predict_dataset(diagnosis: Diagnosis, dataset: Dataset, n_jobs: int = 0) -> TransferPrediction:
    """Return how well the device that ``diagnosis`` found predicts ``dataset``, without any fit to it.

    The other dataset declares its own device, which states the changes of geometry. A number that the diagnosis fitted
    keeps its *relative* change. Effects of device and body are added as they were found; a parameter that changes with
    the muscle's diameter changes with the ratio of the bladder radii. Faults of instruments and errors of the
    registration belong to the first set-up and stay there.

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
    # A command that is linear in the diagnosis has a variant that is held.
    if any(e.holds_command for e in diagnosis.experiments) and not any(e.held_variant for e in diagnosis.experiments):
        experiments = [e.held_variant or e for e in experiments]
    nominal = Hypothesis(dataset.device, (), ())
    final_hypothesis, final_x = _detach_setup(diagnosis.final_fit, dataset)
    ratio = _compute_diameter_ratio(diagnosis.dataset, dataset)
    scaled_x = _scale_parameters(final_hypothesis, final_x, ratio)
    candidates = [
        (nominal, nominal.initial_point()),
        _detach_setup(diagnosis.base_fit, dataset),
        (final_hypothesis, scaled_x),
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
    return TransferPrediction(
        dataset_name=dataset.folder.resolve().name,
        channels=channels,
        numbers=_list_numbers(diagnosis.dataset, dataset, final_hypothesis, final_x, scaled_x, ratio),
        trials=tuple(
            PredictedTrial(
                name=e.name,
                channel=channel,
                measured=series.value,
                refitted=series.value - residuals[1][k][channel],
                with_effects=series.value - residuals[2][k][channel],
            )
            for k, e in enumerate(experiments)
            for channel, series in e.measured.items()
        ),
    )


def _compute_diameter_ratio(first: Dataset, other: Dataset) -> float:
    """Return the bladder radius of the device of ``other`` over that of ``first``, both as declared [1]."""
    muscles = first.device.spec.muscle, other.device.spec.muscle
    if muscles[0] is None or muscles[1] is None:
        return 1.0
    return muscles[1].bladder_radius_mm / muscles[0].bladder_radius_mm


def _scale_parameters(hypothesis: Hypothesis, x: Array, ratio: float) -> Array:
    """Return the normalized parameters ``x`` for a muscle with ``ratio`` times the diameter."""
    scaled = x.copy()
    for index, (parameter, value) in enumerate(zip(hypothesis.parameters, hypothesis.values(x), strict=True)):
        exponent = _find_diameter_exponent(hypothesis, parameter)
        if exponent and ratio != 1.0:
            scaled[index] = parameter.normalize(value * ratio**exponent)
    return scaled


def _find_diameter_exponent(hypothesis: Hypothesis, parameter: FitParameter) -> float:
    if parameter.term_index is None or hypothesis.terms[parameter.term_index].number:
        return 0.0
    term = hypothesis.terms[parameter.term_index]
    return next(p.diameter_exponent for p in term.parameters if p.key == parameter.name)


def _list_numbers(
    first: Dataset, other: Dataset, hypothesis: Hypothesis, x: Array, scaled_x: Array, ratio: float
) -> tuple[TransferredNumber, ...]:
    """Return the fitted numbers and the parameters of effects, at ``x`` as found and at ``scaled_x`` as used."""
    listed = []
    found_numbers = hypothesis.correct_numbers(first.device, None, hypothesis.values(x))
    used_numbers = hypothesis.correct_numbers(other.device, None, hypothesis.values(scaled_x))
    declared = other.device.spec.collect_values()
    for key, found in found_numbers.items():
        if key in used_numbers:
            rule = f"the declared {declared[key]:.4g}, changed as much as in the fit" if declared[key] else "as found"
            listed.append(TransferredNumber(key, found, used_numbers[key], rule))
    rows = zip(hypothesis.parameters, hypothesis.values(x), hypothesis.values(scaled_x), strict=True)
    for parameter, found, used in rows:
        if parameter.term_index is None or hypothesis.terms[parameter.term_index].number:
            continue
        term = hypothesis.terms[parameter.term_index]
        exponent = _find_diameter_exponent(hypothesis, parameter)
        rule = f"diameter to the power {exponent:g}" if exponent else f"as found, in {term.form_definition.equation}"
        if not np.isclose(used, found * ratio**exponent):
            rule += ", cut off at a limit of the effect"
        listed.append(TransferredNumber(f"{term.effect}.{parameter.name}", found, used, rule))
    return tuple(listed)


def _detach_setup(fit: Fit, dataset: Dataset) -> tuple[Hypothesis, Array]:
    """Return the hypothesis and the parameters of ``fit`` without instruments, registration and single specimens."""
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
    retained = [term.channel is None and term.specimen is None for term in hypothesis.terms]
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
