"""How large an effect is in a dataset, and effects as large as is wanted.

The *size* is what an effect leaves when the device's uncertain numbers may follow: root mean square over the noise, in
the channel where that is most. They follow as far as their uncertainty and all channels together allow.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from catalogue import CHANNELS, EFFECTS, OTHER_FORMS, UNCERTAIN, Forms, instrument_forms, neutral_law, with_effects
from inputs import Program
from scipy.optimize import least_squares
from simulate import Floats, Hidden, Noise, reported
from strangers import STRANGERS

EVERY = 10  # trace samples per sample of a size: 100 Hz
DIFFERENCE = 0.1
"""Of a number's uncertainty, to see what it changes."""
FOLLOWED = 0.02
"""Relative change of what is left, squared, at which the numbers have followed."""
FARTHEST = 3.0
"""Standard deviations that a number may be from its nominal value."""
NEAR, ROUNDS = 0.1, 6
"""Relative error of a size at which the search for it ends, and rounds after which any search ends."""
DEVICE: Forms = EFFECTS | OTHER_FORMS
Effect = Mapping[str, Any]


class Scale:
    """What sizes are measured by: a device, what is done to it, and the noise."""

    def __init__(
        self,
        base: Mapping[str, float],
        nominal: Mapping[str, float],
        bench: Sequence[Program],
        recorded: Sequence[str],
        noise: Noise,
        known: Sequence[Effect] = (),
    ) -> None:
        """The numbers in ``base`` are true, those in ``nominal`` are believed; ``known`` effects are in the device."""
        self._bench, self._recorded, self._noise = [p for p in bench if p.use == "fit"], recorded, noise
        self._base, self._known = dict(base), list(known)
        self._sigma = {key: share * nominal[key] for key, share in UNCERTAIN.items()}
        off = np.array([(base[key] - nominal[key]) / sigma for key, sigma in self._sigma.items()])
        self._low, self._high = -FARTHEST - off, FARTHEST - off
        self._moved = np.zeros(len(UNCERTAIN))
        self._plain = self._seen(self._base, Hidden())
        columns = []
        for unit in np.eye(len(UNCERTAIN)):
            columns.append((self._refitted(DIFFERENCE * unit) - self._plain) / DIFFERENCE)
        # To be off by a standard deviation costs as much as a sample that is off by its noise.
        self._columns = np.concatenate([np.stack(columns, axis=1), np.eye(len(columns))])

    def size(self, hidden: Hidden) -> float:
        """Of all that is ``hidden``, together."""
        left = self._left(self._seen(self._base, hidden))
        whole = [float(np.sqrt(np.mean(row * row))) for row in left.reshape(len(self._recorded), -1)]
        for fault in hidden.instruments:
            if fault["name"] == "quantisation":  # of signals that pass through many steps
                step = fault["parameters"]["step"] / CHANNELS[fault["channel"]].noise
                whole.append(step / float(np.sqrt(12.0)))
        return max(whole)

    def sized(self, effect: Effect) -> dict[str, Any]:
        """``effect`` as large as is wanted of it, or as nearly as its parameters may be; with its size."""
        key = effect["name"], effect["form"]
        kind = "strangers" if key in STRANGERS else "instruments" if "channel" in effect else "effects"
        forms: Forms = instrument_forms(effect["channel"]) if kind == "instruments" else DEVICE | STRANGERS
        own = forms[key]

        return as_wanted(effect, own, lambda one: self.size(Hidden(**{kind: [one]})))

    def _left(self, target: Floats) -> Floats:
        """What is left of ``target`` when the numbers have followed, from where they were the last time."""
        margin = 1e-3
        result = least_squares(
            lambda moved: np.concatenate([self._refitted(moved) - target, moved]),
            np.clip(self._moved, self._low + margin, self._high - margin),
            lambda moved: self._columns,  # that do not change much
            bounds=(self._low, self._high),
            ftol=FOLLOWED,
            max_nfev=ROUNDS,
        )
        self._moved = result.x
        return result.fun[: len(target)]

    def _refitted(self, moved: Floats) -> Floats:
        """The plain device with its uncertain numbers so many standard deviations from the true ones."""
        numbers = {key: self._base[key] + m * sigma for m, (key, sigma) in zip(moved, self._sigma.items(), strict=True)}
        return self._seen({**self._base, **numbers}, Hidden())

    def _seen(self, base: Mapping[str, float], hidden: Hidden) -> Floats:
        """Every recorded channel over its noise, one channel after the other."""
        plain = with_effects(*neutral_law(base), self._known)
        found = [reported(program, plain, hidden) for program in self._bench]
        rows = [
            np.concatenate([each[name][::EVERY] for each in found]) / getattr(self._noise, name)
            for name in self._recorded
        ]
        return np.concatenate(rows)


def as_wanted(effect: Effect, own: Mapping[str, Any], measured: Callable[[Mapping[str, Any]], float]) -> dict[str, Any]:
    """``effect``, whose form has parameters ``own``, as large as is wanted of it, as ``measured``; with its size."""

    def of(scale: float) -> dict[str, Any]:
        values = {
            key: value if own[key].neutral is None else _scaled(own[key], value, scale)
            for key, value in effect["parameters"].items()
        }
        return {**{key: value for key, value in effect.items() if key != "wanted"}, "parameters": values}

    scale, size = _sought(lambda s: measured(of(s)), effect["wanted"], lambda s: of(s) == of(1.3 * s))
    return {**of(scale), "size": round(size, 3)}


def _scaled(parameter: Any, value: float, scale: float) -> float:
    """``value`` ``scale`` times as far from neutral, within its range."""
    slower = parameter.neutral == np.inf  # a frequency
    found = value / scale if slower else parameter.neutral + scale * (value - parameter.neutral)
    return float(f"{min(max(found, parameter.low), parameter.high):.6g}")


def _sought(
    measured: Callable[[float], float], wanted: float, at_limit: Callable[[float], bool]
) -> tuple[float, float]:
    """The scale at which ``measured`` is ``wanted``, and what it is there; sizes are nearly powers of scales."""
    scale, size, power = 1.0, measured(1.0), 1.0
    below, above = 0.0, np.inf  # scales between which it is
    for _ in range(ROUNDS):
        if size <= 0.0 or abs(size / wanted - 1.0) < NEAR or (size < wanted and at_limit(scale)):
            break
        below, above = (scale, above) if size < wanted else (below, scale)
        other = scale * float(np.clip((wanted / size) ** (1.0 / power), 0.1, 10.0))
        if not below < other < above or (below > 0.0 and above < np.inf and above / below < 1.5):
            other = float(np.sqrt(below * above))
        new = measured(other)
        if new > 0.0 and abs(np.log(other / scale)) > 1e-6:
            power = float(np.clip(np.log(new / size) / np.log(other / scale), 0.3, 3.0))
        scale, size = other, new
    return scale, size
