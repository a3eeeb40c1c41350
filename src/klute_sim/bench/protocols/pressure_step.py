"""A step of the pressure command up and down, at a held length."""

from typing import ClassVar, Literal

import numpy as np

from klute_sim.bench.limits import check_supply_pressure, unit_length
from klute_sim.bench.metrics import get_sampling_interval, select_half_open_interval
from klute_sim.bench.protocols.protocol import BenchProtocol, NonNegative, Positive, Ratio, TrialPlan, format_value
from klute_sim.bench.trajectory import Array, LengthTrajectory, sample_staircase
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording
from klute_sim.units import BAR

SETTLING_TOLERANCE = 0.05
"""Share of a step within which it counts as settled."""


class PressureStepProtocol(BenchProtocol):
    """Steps from a low pressure to each of ``pressures_bar`` and back, one trial per pressure."""

    summary: ClassVar[str] = "Pressure steps up and down: rise, fall, delay, overshoot, settling."

    kind: Literal["step"] = "step"
    low_bar: NonNegative
    muscle_ratio: Ratio
    """Muscle length over resting length, with the tendon just taut."""
    hold_s: Positive
    """After either step."""

    def plan_trials(self, device: Device) -> list[TrialPlan]:
        """One trial per pressure."""
        check_supply_pressure(device, [self.low_bar, *self.pressures_bar])
        if self.low_bar in self.pressures_bar:
            raise InputError(f"the protocol steps from {self.low_bar:g} bar to {self.low_bar:g} bar, which is no step")
        found = []
        for bar in self.pressures_bar:
            low = self.low_bar * BAR
            levels = [(0.0, low), (self.rest_s, bar * BAR), (self.rest_s + self.hold_s, low)]
            found.append(
                TrialPlan(
                    name=f"{format_value(self.low_bar)}to{format_value(bar)}bar",
                    conditions={"pressure_bar": bar, "low_bar": self.low_bar},
                    trajectory=LengthTrajectory(
                        unit_length(device, self.muscle_ratio, 0.0), self.rest_s + 2.0 * self.hold_s
                    ),
                    command=lambda time, levels=levels: sample_staircase(time, levels),  # type: ignore[misc]
                    event_times={"up": self.rest_s, "down": self.rest_s + self.hold_s},
                )
            )
        return found

    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Of pressure and force, both ways (:func:`response`)."""
        found: dict[str, float] = {}
        for way in ("up", "down"):
            begin = plan.event_times[way]
            # A sample is what the step that ends there has made: the one before is where the response begins.
            part = select_half_open_interval(recording, begin - get_sampling_interval(recording), begin + self.hold_s)
            for channel in ("pressure", "force"):
                told = compute_step_response(part["time"] - part["time"][0], part[channel])
                found |= {f"{channel}_{way}_{key}": value for key, value in told.items()}
            found[f"force_{way}_n"] = float(part["force"][-1])
        return found


def compute_step_response(time: Array, samples: Array) -> dict[str, float]:
    """How ``samples`` go from their first to their last; ``time`` [s] is since the command's step.

    ``delay_s``: until a tenth is done; ``rise_s``: from a tenth to nine tenths; ``settling_s``: until less than
    :data:`NEAR` is left for good; ``overshoot_pct`` of the step. NaN if nothing moves.
    """
    whole = samples[-1] - samples[0]
    if whole == 0.0:
        return dict.fromkeys(("delay_s", "rise_s", "settling_s", "overshoot_pct"), float("nan"))
    done = (samples - samples[0]) / whole
    tenth, ninth = (_first_crossing(time, done, level) for level in (0.1, 0.9))
    far = np.flatnonzero(np.abs(done - 1.0) > SETTLING_TOLERANCE)
    settled = float(time[min(int(far[-1]) + 1, len(time) - 1)]) if len(far) else 0.0
    return {
        "delay_s": tenth,
        "rise_s": ninth - tenth,
        "settling_s": settled,
        "overshoot_pct": 100.0 * max(0.0, float(done.max()) - 1.0),
    }


def _first_crossing(time: Array, fraction: Array, level: float) -> float:
    """When ``done`` first comes to ``level``, between samples on a straight line."""
    k = int(np.argmax(fraction >= level))
    if k == 0:
        return float(time[0])
    return float(np.interp(level, fraction[k - 1 : k + 1], time[k - 1 : k + 1]))
