"""Pressure step test: a step of the pressure command up and down at a held length."""

from typing import ClassVar, Literal

import numpy as np

from klute_sim.bench.limits import check_supply_pressure, unit_length
from klute_sim.bench.metrics import get_sampling_interval, select_half_open_interval
from klute_sim.bench.protocols.protocol import NonNegative, Positive, PressureProtocol, Ratio, TrialPlan, format_value
from klute_sim.bench.trajectory import LengthTrajectory, sample_staircase
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording
from klute_sim.types import Array
from klute_sim.units import BAR

SETTLING_TOLERANCE = 0.05
"""Fraction of a step within which the response counts as settled."""


class PressureStepProtocol(PressureProtocol):
    """Steps from a low pressure to each of ``pressures_bar`` and back; one trial per pressure."""

    summary: ClassVar[str] = "Pressure steps up and down: rise, fall, delay, overshoot, settling."

    kind: Literal["step"] = "step"
    low_bar: NonNegative
    """Gauge pressure [bar] before and after the step."""
    muscle_ratio: Ratio
    """Muscle length over resting length, with the tendon just taut."""
    hold_s: Positive
    """Time [s] after each step."""

    def plan_trials(self, device: Device) -> list[TrialPlan]:
        """Return one trial per pressure."""
        check_supply_pressure(device, [self.low_bar, *self.pressures_bar])
        if self.low_bar in self.pressures_bar:
            raise InputError(
                f"the protocol steps from {self.low_bar:g} bar to {self.low_bar:g} bar, which changes nothing; "
                "remove low_bar from pressures_bar"
            )
        plans = []
        for bar in self.pressures_bar:
            low = self.low_bar * BAR
            levels = [(0.0, low), (self.rest_s, bar * BAR), (self.rest_s + self.hold_s, low)]
            plans.append(
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
        return plans

    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Return the step responses of pressure and force, up and down (:func:`compute_step_response`)."""
        metrics: dict[str, float] = {}
        for direction in ("up", "down"):
            begin = plan.event_times[direction]
            # A sample is the state after its time step, so the response starts at the sample before the command.
            part = select_half_open_interval(recording, begin - get_sampling_interval(recording), begin + self.hold_s)
            for channel in ("pressure", "force"):
                response = compute_step_response(part["time"] - part["time"][0], part[channel])
                metrics |= {f"{channel}_{direction}_{key}": value for key, value in response.items()}
            metrics[f"force_{direction}_n"] = float(part["force"][-1])
        return metrics


def compute_step_response(time: Array, samples: Array) -> dict[str, float]:
    """Return the metrics of a step response from the first to the last of ``samples``, all NaN without a response.

    ``time`` [s] starts at the step of the command. ``delay_s`` is the time to 10 %, ``rise_s`` from 10 % to 90 %,
    ``settling_s`` until the response stays within :data:`SETTLING_TOLERANCE`; ``overshoot_pct`` is relative to the
    step.
    """
    step = samples[-1] - samples[0]
    if step == 0.0:
        return dict.fromkeys(("delay_s", "rise_s", "settling_s", "overshoot_pct"), float("nan"))
    fraction = (samples - samples[0]) / step
    time_10, time_90 = (_first_crossing(time, fraction, level) for level in (0.1, 0.9))
    outside = np.flatnonzero(np.abs(fraction - 1.0) > SETTLING_TOLERANCE)
    settling_time = float(time[min(int(outside[-1]) + 1, len(time) - 1)]) if len(outside) else 0.0
    return {
        "delay_s": time_10,
        "rise_s": time_90 - time_10,
        "settling_s": settling_time,
        "overshoot_pct": 100.0 * max(0.0, float(fraction.max()) - 1.0),
    }


def _first_crossing(time: Array, fraction: Array, level: float) -> float:
    """Return the time at which ``fraction`` first reaches ``level``, linearly interpolated."""
    k = int(np.argmax(fraction >= level))
    if k == 0:
        return float(time[0])
    return float(np.interp(level, fraction[k - 1 : k + 1], time[k - 1 : k + 1]))
