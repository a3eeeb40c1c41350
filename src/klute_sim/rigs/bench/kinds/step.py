"""A step of the pressure command up and down, at a held length."""

from typing import ClassVar, Literal

import numpy as np

from klute_sim.device.files import Device
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording
from klute_sim.rigs.bench.path import Array, Path, stairs
from klute_sim.rigs.bench.plan import NotNegative, Plan, Positive, Protocol, Ratio, label
from klute_sim.rigs.bench.reach import refuse_beyond_supply, unit_length
from klute_sim.rigs.bench.reading import between, sampling
from klute_sim.units import BAR

NEAR = 0.05
"""Share of a step within which it counts as settled."""


class Step(Protocol):
    """Steps from a low pressure to each of ``pressures_bar`` and back, one trial per pressure."""

    about: ClassVar[str] = "Pressure steps up and down: rise, fall, delay, overshoot, settling."

    kind: Literal["step"] = "step"
    low_bar: NotNegative
    muscle_ratio: Ratio
    """Muscle length over resting length, with the tendon just taut."""
    hold_s: Positive
    """After either step."""

    def plans(self, device: Device) -> list[Plan]:
        """One trial per pressure."""
        refuse_beyond_supply(device, [self.low_bar, *self.pressures_bar])
        if self.low_bar in self.pressures_bar:
            raise InputError(f"the protocol steps from {self.low_bar:g} bar to {self.low_bar:g} bar, which is no step")
        found = []
        for bar in self.pressures_bar:
            low = self.low_bar * BAR
            levels = [(0.0, low), (self.rest_s, bar * BAR), (self.rest_s + self.hold_s, low)]
            found.append(
                Plan(
                    name=f"{label(self.low_bar)}to{label(bar)}bar",
                    setting={"pressure_bar": bar, "low_bar": self.low_bar},
                    path=Path(unit_length(device, self.muscle_ratio, 0.0), self.rest_s + 2.0 * self.hold_s),
                    command=lambda time, levels=levels: stairs(time, levels),  # type: ignore[misc]
                    marks={"up": self.rest_s, "down": self.rest_s + self.hold_s},
                )
            )
        return found

    def readings(self, device: Device, plan: Plan, recording: Recording) -> dict[str, float]:
        """Of pressure and force, both ways (:func:`response`)."""
        found: dict[str, float] = {}
        for way in ("up", "down"):
            begin = plan.marks[way]
            # A sample is what the step that ends there has made: the one before is where the response begins.
            part = between(recording, begin - sampling(recording), begin + self.hold_s)
            for channel in ("pressure", "force"):
                told = response(part["time"] - part["time"][0], part[channel])
                found |= {f"{channel}_{way}_{key}": value for key, value in told.items()}
            found[f"force_{way}_n"] = float(part["force"][-1])
        return found


def response(time: Array, samples: Array) -> dict[str, float]:
    """How ``samples`` go from their first to their last; ``time`` [s] is since the command's step.

    ``delay_s``: until a tenth is done; ``rise_s``: from a tenth to nine tenths; ``settling_s``: until less than
    :data:`NEAR` is left for good; ``overshoot_pct`` of the step. NaN if nothing moves.
    """
    whole = samples[-1] - samples[0]
    if whole == 0.0:
        return dict.fromkeys(("delay_s", "rise_s", "settling_s", "overshoot_pct"), float("nan"))
    done = (samples - samples[0]) / whole
    tenth, ninth = (_first(time, done, level) for level in (0.1, 0.9))
    far = np.flatnonzero(np.abs(done - 1.0) > NEAR)
    settled = float(time[min(int(far[-1]) + 1, len(time) - 1)]) if len(far) else 0.0
    return {
        "delay_s": tenth,
        "rise_s": ninth - tenth,
        "settling_s": settled,
        "overshoot_pct": 100.0 * max(0.0, float(done.max()) - 1.0),
    }


def _first(time: Array, done: Array, level: float) -> float:
    """When ``done`` first comes to ``level``, between samples on a straight line."""
    k = int(np.argmax(done >= level))
    if k == 0:
        return float(time[0])
    return float(np.interp(level, done[k - 1 : k + 1], time[k - 1 : k + 1]))
