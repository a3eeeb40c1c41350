"""How large an effect is in a dataset, and effects as large as is wanted.

The *size* is what an effect leaves when the device's uncertain numbers may follow: root mean square over the noise, in
the channel where that is most. They follow as far as their uncertainty and all channels together allow.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from benchmarks.hidden_effects.catalogue import (
    BENCH_CHANNELS,
    EFFECTS,
    OTHER_FORMS,
    RELATIVE_UNCERTAINTIES,
    Forms,
    add_effects,
    build_neutral_law,
    instrument_forms,
)
from benchmarks.hidden_effects.inputs import InputProgram
from benchmarks.hidden_effects.simulate import Floats, Hidden, Noise, simulate_measurements
from benchmarks.hidden_effects.strangers import OUT_OF_CATALOGUE_FORMS
from scipy.optimize import least_squares

DECIMATION_FACTOR = 10  # trace samples per sample of a size: 100 Hz
DIFFERENCE_SIGMAS = 0.1
"""Of a number's uncertainty, to see what it changes."""
COST_TOLERANCE = 0.02
"""Relative change of what is left, squared, at which the numbers have followed."""
MAX_SIGMAS = 3.0
"""Standard deviations that a number may be from its nominal value."""
SIZE_TOLERANCE, MAX_ROUNDS = 0.1, 6
"""Relative error of a size at which the search for it ends, and rounds after which any search ends."""
DEVICE_FORMS: Forms = EFFECTS | OTHER_FORMS
Effect = Mapping[str, Any]


class EffectSizer:
    """What sizes are measured by: a device, what is done to it, and the noise."""

    def __init__(
        self,
        base: Mapping[str, float],
        nominal: Mapping[str, float],
        programs: Sequence[InputProgram],
        recorded_channels: Sequence[str],
        noise: Noise,
        known_effects: Sequence[Effect] = (),
    ) -> None:
        """The numbers in ``base`` are true, those in ``nominal`` are believed; ``known`` effects are in the device."""
        self._programs, self._recorded_channels, self._noise = (
            [p for p in programs if p.use == "fit"],
            recorded_channels,
            noise,
        )
        self._base, self._known_effects = dict(base), list(known_effects)
        self._sigma = {key: share * nominal[key] for key, share in RELATIVE_UNCERTAINTIES.items()}
        off = np.array([(base[key] - nominal[key]) / sigma for key, sigma in self._sigma.items()])
        self._lower, self._upper = -MAX_SIGMAS - off, MAX_SIGMAS - off
        self._last_offsets = np.zeros(len(RELATIVE_UNCERTAINTIES))
        self._reference = self._simulate_channels(self._base, Hidden())
        columns = []
        for unit in np.eye(len(RELATIVE_UNCERTAINTIES)):
            columns.append((self._simulate_offset(DIFFERENCE_SIGMAS * unit) - self._reference) / DIFFERENCE_SIGMAS)
        # To be off by a standard deviation costs as much as a sample that is off by its noise.
        self._columns = np.concatenate([np.stack(columns, axis=1), np.eye(len(columns))])

    def measure_size(self, hidden: Hidden) -> float:
        """Of all that is ``hidden``, together."""
        left = self._refit_residual(self._simulate_channels(self._base, hidden))
        whole = [float(np.sqrt(np.mean(row * row))) for row in left.reshape(len(self._recorded_channels), -1)]
        for fault in hidden.instruments:
            if fault["name"] == "quantisation":  # of signals that pass through many steps
                step = fault["parameters"]["step"] / BENCH_CHANNELS[fault["channel"]].noise
                whole.append(step / float(np.sqrt(12.0)))
        return max(whole)

    def scale_effect(self, effect: Effect) -> dict[str, Any]:
        """``effect`` as large as is wanted of it, or as nearly as its parameters may be; with its size."""
        key = effect["name"], effect["form"]
        kind = "strangers" if key in OUT_OF_CATALOGUE_FORMS else "instruments" if "channel" in effect else "effects"
        forms: Forms = (
            instrument_forms(effect["channel"]) if kind == "instruments" else DEVICE_FORMS | OUT_OF_CATALOGUE_FORMS
        )
        own = forms[key]

        return scale_to_target(effect, own, lambda one: self.measure_size(Hidden(**{kind: [one]})))

    def _refit_residual(self, target: Floats) -> Floats:
        """What is left of ``target`` when the numbers have followed, from where they were the last time."""
        margin = 1e-3
        result = least_squares(
            lambda moved: np.concatenate([self._simulate_offset(moved) - target, moved]),
            np.clip(self._last_offsets, self._lower + margin, self._upper - margin),
            lambda moved: self._columns,  # that do not change much
            bounds=(self._lower, self._upper),
            ftol=COST_TOLERANCE,
            max_nfev=MAX_ROUNDS,
        )
        self._last_offsets = result.x
        return result.fun[: len(target)]

    def _simulate_offset(self, offsets: Floats) -> Floats:
        """The plain device with its uncertain numbers so many standard deviations from the true ones."""
        numbers = {
            key: self._base[key] + m * sigma for m, (key, sigma) in zip(offsets, self._sigma.items(), strict=True)
        }
        return self._simulate_channels({**self._base, **numbers}, Hidden())

    def _simulate_channels(self, base: Mapping[str, float], hidden: Hidden) -> Floats:
        """Every recorded channel over its noise, one channel after the other."""
        plain = add_effects(*build_neutral_law(base), self._known_effects)
        found = [simulate_measurements(program, plain, hidden) for program in self._programs]
        rows = [
            np.concatenate([each[name][::DECIMATION_FACTOR] for each in found]) / getattr(self._noise, name)
            for name in self._recorded_channels
        ]
        return np.concatenate(rows)


def scale_to_target(
    effect: Effect, parameters: Mapping[str, Any], measure_size: Callable[[Mapping[str, Any]], float]
) -> dict[str, Any]:
    """``effect``, whose form has parameters ``own``, as large as is wanted of it, as ``measured``; with its size."""

    def of(scale: float) -> dict[str, Any]:
        values = {
            key: value if parameters[key].neutral is None else _scale_value(parameters[key], value, scale)
            for key, value in effect["parameters"].items()
        }
        return {**{key: value for key, value in effect.items() if key != "wanted"}, "parameters": values}

    scale, size = _search_scale(lambda s: measure_size(of(s)), effect["wanted"], lambda s: of(s) == of(1.3 * s))
    return {**of(scale), "size": round(size, 3)}


def _scale_value(parameter: Any, value: float, scale: float) -> float:
    """``value`` ``scale`` times as far from neutral, within its range."""
    slower = parameter.neutral == np.inf  # a frequency
    found = value / scale if slower else parameter.neutral + scale * (value - parameter.neutral)
    return float(f"{min(max(found, parameter.low), parameter.high):.6g}")


def _search_scale(
    measure_size: Callable[[float], float], target_size: float, at_limit: Callable[[float], bool]
) -> tuple[float, float]:
    """The scale at which ``measured`` is ``wanted``, and what it is there; sizes are nearly powers of scales."""
    scale, size, power = 1.0, measure_size(1.0), 1.0
    below, above = 0.0, np.inf  # scales between which it is
    for _ in range(MAX_ROUNDS):
        if size <= 0.0 or abs(size / target_size - 1.0) < SIZE_TOLERANCE or (size < target_size and at_limit(scale)):
            break
        below, above = (scale, above) if size < target_size else (below, scale)
        other = scale * float(np.clip((target_size / size) ** (1.0 / power), 0.1, 10.0))
        if not below < other < above or (below > 0.0 and above < np.inf and above / below < 1.5):
            other = float(np.sqrt(below * above))
        new = measure_size(other)
        if new > 0.0 and abs(np.log(other / scale)) > 1e-6:
            power = float(np.clip(np.log(new / size) / np.log(other / scale), 0.3, 3.0))
        scale, size = other, new
    return scale, size
