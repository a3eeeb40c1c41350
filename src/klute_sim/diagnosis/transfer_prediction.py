"""Result of the prediction of another dataset: errors of each device, what was carried over, and warnings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.result import RecommendedDevice
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
    fitted: float
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
    remarks: tuple[str, ...] = ()
    """Sentences about the channels and samples that are not compared."""

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
        names_effects = any(p.with_effects != p.refitted for p in self.channels.values())
        return f"best: {self.recommended if names_effects or self.recommended == 'as-declared' else 'refitted'}"

    def _compute_errors(self) -> dict[RecommendedDevice, float]:
        """Return the error of each device over all channels, relative to their ranges."""
        scales = {channel: p.measured_range or 1.0 for channel, p in self.channels.items()}
        return {
            device: float(np.linalg.norm([p.by_device[device] / scales[c] for c, p in self.channels.items()]))
            for device in DEVICE_WORDS
        }

    @property
    def warnings(self) -> list[str]:
        """Remarks, and a sentence for each channel that another device predicts better, or that needs the effects."""
        sentences = [f"'{self.dataset_name}': {remark}" for remark in self.remarks]
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
                advice = f"What was found does not hold there; use {DEVICE_WORDS[self.recommended]} there."
                if self.recommended == "with-effects":
                    advice = "Over all channels, the device with the added effects is still the best."
                sentences.append(
                    f"On '{self.dataset_name}' {DEVICE_WORDS[best]} predicts {channel} best: it misses by "
                    f"{texts[best]}, {', '.join(others)}. {advice}"
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
                {"name": number.name, "found": number.fitted, "used": number.used, "rule": number.rule}
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
