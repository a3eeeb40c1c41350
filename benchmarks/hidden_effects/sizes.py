"""How large an effect is in a dataset, and effects as large as is wanted.

The *size* is what an effect leaves when the device's uncertain numbers may follow: root mean square over the noise, in
the channel where that is most. Their following is linear, as much as their uncertainty and all channels together allow.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from catalogue import CHANNELS, EFFECTS, OTHER_FORMS, UNCERTAIN, Forms, instrument_forms, neutral_law, with_effects
from inputs import Program
from simulate import Floats, Hidden, Noise, reported
from strangers import STRANGERS

EVERY = 10  # trace samples per sample of a size: 100 Hz
DIFFERENCE = 0.1
"""Of a number's uncertainty, to see what it changes."""
NEAR, ROUNDS = 0.1, 6
"""Relative error of a size at which the search for it ends, and rounds after which it ends anyway."""
DEVICE: Forms = EFFECTS | OTHER_FORMS
Effect = Mapping[str, Any]


class Scale:
    """What sizes are measured by: a device, what is done to it, and the noise."""

    def __init__(
        self,
        base: Mapping[str, float],
        bench: Sequence[Program],
        recorded: Sequence[str],
        noise: Noise,
        known: Sequence[Effect] = (),
    ) -> None:
        """``known`` effects are in the device anyway."""
        self._bench, self._recorded, self._noise = [p for p in bench if p.use == "fit"], recorded, noise
        self._base, self._known = dict(base), list(known)
        self._plain = self._seen(self._base, Hidden())
        columns = []
        for key, share in UNCERTAIN.items():
            step = DIFFERENCE * share * base[key]
            moved = self._seen({**self._base, key: base[key] + step}, Hidden())
            columns.append((moved - self._plain) / DIFFERENCE)
        # What an uncertain number may do is worth as much as one more sample of unit noise.
        self._columns = np.concatenate([np.stack(columns, axis=1), np.eye(len(columns))])

    def size(self, hidden: Hidden) -> float:
        """Of all that is ``hidden``, together."""
        change = self._seen(self._base, hidden) - self._plain
        target = np.concatenate([change, np.zeros(self._columns.shape[1])])
        left = (target - self._columns @ np.linalg.lstsq(self._columns, target)[0])[: len(change)]
        whole = [float(np.sqrt(np.mean(row * row))) for row in left.reshape(len(self._recorded), -1)]
        for fault in hidden.instruments:
            if fault["name"] == "quantisation":  # of signals that pass through many steps
                step = fault["parameters"]["step"] / CHANNELS[fault["channel"]].noise
                whole.append(step / float(np.sqrt(12.0)))
        return max(whole)

    def sized(self, effect: Effect) -> dict[str, Any]:
        """``effect`` as large as is wanted of it, or as nearly as its parameters may be; with its size."""
        key, wanted = (effect["name"], effect["form"]), effect["wanted"]
        kind = "strangers" if key in STRANGERS else "instruments" if "channel" in effect else "effects"
        forms: Forms = instrument_forms(effect["channel"]) if kind == "instruments" else DEVICE | STRANGERS
        own = forms[key]

        def of(scale: float) -> dict[str, Any]:
            values = {
                key: value if own[key].neutral is None else _scaled(own[key], value, scale)
                for key, value in effect["parameters"].items()
            }
            return {**{key: value for key, value in effect.items() if key != "wanted"}, "parameters": values}

        def measured(scale: float) -> float:
            return self.size(Hidden(**{kind: [of(scale)]}))

        scale, size = _sought(measured, wanted, lambda s: of(s) == of(1.3 * s))
        return {**of(scale), "size": round(size, 3)}

    def _seen(self, base: Mapping[str, float], hidden: Hidden) -> Floats:
        """Every recorded channel over its noise, one channel after the other."""
        plain = with_effects(*neutral_law(base), self._known)
        found = [reported(program, plain, hidden) for program in self._bench]
        rows = [
            np.concatenate([each[name][::EVERY] for each in found]) / getattr(self._noise, name)
            for name in self._recorded
        ]
        return np.concatenate(rows)


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
    for _ in range(ROUNDS):
        if size <= 0.0 or abs(size / wanted - 1.0) < NEAR or (size < wanted and at_limit(scale)):
            break
        other = scale * float(np.clip((wanted / size) ** (1.0 / power), 0.1, 10.0))
        new = measured(other)
        if new > 0.0 and abs(np.log(other / scale)) > 1e-6:
            power = float(np.clip(np.log(new / size) / np.log(other / scale), 0.3, 3.0))
        scale, size = other, new
    return scale, size
