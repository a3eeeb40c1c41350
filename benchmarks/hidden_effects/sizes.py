"""Size of an effect or of wrong numbers in a dataset, and scaling of effects to a required size.

The *size* is the residual of an effect after the uncertain numbers of the device have been refitted: RMS over the noise
in the channel with the largest value. The numbers are refitted within their uncertainty and to all channels together.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from benchmarks.hidden_effects.catalogue import (
    BENCH_CHANNELS,
    EFFECTS,
    OTHER_FORMS,
    RELATIVE_UNCERTAINTIES,
    Forms,
    instrument_forms,
    limit_to_range,
)
from benchmarks.hidden_effects.device import add_effects, build_neutral_law
from benchmarks.hidden_effects.inputs import InputProgram
from benchmarks.hidden_effects.out_of_catalogue import OUT_OF_CATALOGUE_FORMS
from benchmarks.hidden_effects.simulate import Floats, Hidden, Noise, simulate_measurements
from scipy.optimize import least_squares

DECIMATION_FACTOR = 10  # trace samples per sample of a size: 100 Hz
DIFFERENCE_SIGMAS = 0.1
"""Change of a number for finite differences, in standard deviations."""
COST_TOLERANCE = 0.02
"""Relative change of the cost at which the refit ends."""
MAX_SIGMAS = 3.0
"""Largest deviation of a number from its nominal value [standard deviations]."""
SIZE_TOLERANCE, MAX_ROUNDS = 0.1, 6
"""Relative error of a size at which its search ends, and the largest number of rounds."""
DEVICE_FORMS: Forms = EFFECTS | OTHER_FORMS
Effect = Mapping[str, Any]


class EffectSizer:
    """Measurement of effect sizes for a device, its programs and its noise."""

    def __init__(
        self,
        base: Mapping[str, float],
        nominal: Mapping[str, float],
        programs: Sequence[InputProgram],
        recorded_channels: Sequence[str],
        noise: Noise,
        known_effects: Sequence[Effect] = (),
    ) -> None:
        """Set up the device with the numbers ``base``, the believed numbers ``nominal`` and ``known_effects``.

        ``base`` has the true values of the uncertain numbers, and believed values of numbers that are wrong.
        """
        self._programs, self._recorded_channels, self._noise = (
            [p for p in programs if p.use == "fit"],
            recorded_channels,
            noise,
        )
        self._base, self._known_effects = dict(base), list(known_effects)
        self._sigma = {key: fraction * nominal[key] for key, fraction in RELATIVE_UNCERTAINTIES.items()}
        deviation = np.array([(base[key] - nominal[key]) / sigma for key, sigma in self._sigma.items()])
        self._lower, self._upper = -MAX_SIGMAS - deviation, MAX_SIGMAS - deviation
        self._last_offsets = np.zeros(len(RELATIVE_UNCERTAINTIES))
        self._reference = self._simulate_channels(self._base, Hidden())
        columns = []
        for unit in np.eye(len(RELATIVE_UNCERTAINTIES)):
            columns.append((self._simulate_offset(DIFFERENCE_SIGMAS * unit) - self._reference) / DIFFERENCE_SIGMAS)
        # A deviation of one standard deviation costs as much as a sample deviating by its noise.
        self._columns = np.concatenate([np.stack(columns, axis=1), np.eye(len(columns))])

    def measure_size(self, hidden: Hidden, wrong_numbers: Mapping[str, float] = MappingProxyType({})) -> float:
        """Return the size of all ``hidden`` effects and ``wrong_numbers`` (with their true values) together."""
        residual = self.compute_residual(hidden, wrong_numbers)
        sizes = [float(np.sqrt(np.mean(row * row))) for row in residual.reshape(len(self._recorded_channels), -1)]
        for fault in hidden.instruments:
            if fault["name"] == "quantisation":  # for signals that cross many steps
                step = fault["parameters"]["step"] / BENCH_CHANNELS[fault["channel"]].noise
                sizes.append(step / float(np.sqrt(12.0)))
        return max(sizes)

    def compute_residual(self, hidden: Hidden, wrong_numbers: Mapping[str, float] = MappingProxyType({})) -> Floats:
        """Return what ``hidden`` effects and ``wrong_numbers`` leave after the refit, over the noise: (channels x
        samples,), channel by channel.
        """
        return self._refit_residual(self._simulate_channels({**self._base, **wrong_numbers}, hidden))

    def scale_effect(self, effect: Effect) -> dict[str, Any]:
        """Return ``effect`` scaled to its required size as far as its parameters allow, with the reached size."""
        key = effect["name"], effect["form"]
        kind = "strangers" if key in OUT_OF_CATALOGUE_FORMS else "instruments" if "channel" in effect else "effects"
        forms: Forms = (
            instrument_forms(effect["channel"]) if kind == "instruments" else DEVICE_FORMS | OUT_OF_CATALOGUE_FORMS
        )
        parameters = forms[key]

        return scale_to_target(effect, parameters, lambda scaled: self.measure_size(Hidden(**{kind: [scaled]})))

    def _refit_residual(self, target: Floats) -> Floats:
        """Return the residual of ``target`` after a refit that starts from the last solution."""
        margin = 1e-3
        result = least_squares(
            lambda offsets: np.concatenate([self._simulate_offset(offsets) - target, offsets]),
            np.clip(self._last_offsets, self._lower + margin, self._upper - margin),
            lambda offsets: self._columns,  # that do not change much
            bounds=(self._lower, self._upper),
            ftol=COST_TOLERANCE,
            max_nfev=MAX_ROUNDS,
        )
        self._last_offsets = result.x
        return result.fun[: len(target)]

    def _simulate_offset(self, offsets: Floats) -> Floats:
        """Simulate the device without effects, with its numbers ``offsets`` standard deviations from the true ones."""
        numbers = {
            key: self._base[key] + m * sigma for m, (key, sigma) in zip(offsets, self._sigma.items(), strict=True)
        }
        return self._simulate_channels({**self._base, **numbers}, Hidden())

    def _simulate_channels(self, base: Mapping[str, float], hidden: Hidden) -> Floats:
        """Return all recorded channels over their noise, concatenated."""
        device = add_effects(*build_neutral_law(base), self._known_effects)
        measurements = [simulate_measurements(program, device, hidden) for program in self._programs]
        rows = [
            np.concatenate([channels[name][::DECIMATION_FACTOR] for channels in measurements])
            / getattr(self._noise, name)
            for name in self._recorded_channels
        ]
        return np.concatenate(rows)


def scale_to_target(
    effect: Effect, parameters: Mapping[str, Any], measure_size: Callable[[Mapping[str, Any]], float]
) -> dict[str, Any]:
    """Return ``effect`` with ``parameters`` scaled to its required size, as ``measure_size`` reports it, with that
    size.
    """

    def scale_effect(scale: float) -> dict[str, Any]:
        values = {
            key: value if parameters[key].neutral is None else _scale_value(parameters[key], value, scale)
            for key, value in effect["parameters"].items()
        }
        return {**{key: value for key, value in effect.items() if key != "wanted"}, "parameters": values}

    scale, size = _search_scale(
        lambda s: measure_size(scale_effect(s)), effect["wanted"], lambda s: scale_effect(s) == scale_effect(1.3 * s)
    )
    return {**scale_effect(scale), "size": round(size, 3)}


def _scale_value(parameter: Any, value: float, scale: float) -> float:
    """Return ``value`` at ``scale`` times its distance from neutral, off the ends of its range."""
    is_frequency = parameter.neutral == np.inf  # a frequency
    scaled = value / scale if is_frequency else parameter.neutral + scale * (value - parameter.neutral)
    return limit_to_range(parameter, scaled)


def _search_scale(
    measure_size: Callable[[float], float], target_size: float, at_limit: Callable[[float], bool]
) -> tuple[float, float]:
    """Return the scale at which ``measure_size`` gives ``target_size``, and the size there.

    Sizes are approximately powers of the scale.
    """
    scale, size, power = 1.0, measure_size(1.0), 1.0
    lower, upper = 0.0, np.inf  # scales between which it is
    for _ in range(MAX_ROUNDS):
        if size <= 0.0 or abs(size / target_size - 1.0) < SIZE_TOLERANCE or (size < target_size and at_limit(scale)):
            break
        lower, upper = (scale, upper) if size < target_size else (lower, scale)
        next_scale = scale * float(np.clip((target_size / size) ** (1.0 / power), 0.1, 10.0))
        if not lower < next_scale < upper or (lower > 0.0 and upper < np.inf and upper / lower < 1.5):
            next_scale = float(np.sqrt(lower * upper))
        next_size = measure_size(next_scale)
        if next_size > 0.0 and abs(np.log(next_scale / scale)) > 1e-6:
            power = float(np.clip(np.log(next_size / size) / np.log(next_scale / scale), 0.3, 3.0))
        scale, size = next_scale, next_size
    return scale, size
