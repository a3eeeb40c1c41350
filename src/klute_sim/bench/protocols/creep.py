"""Relaxation test: the force at decades of time after a length step at constant pressure."""

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator
from pydantic_core import PydanticCustomError

from klute_sim.bench.limits import check_supply_pressure, unit_length
from klute_sim.bench.metrics import interpolate_channel
from klute_sim.bench.protocols.protocol import (
    NonEmpty,
    Positive,
    PressureProtocol,
    Ratio,
    TrialPlan,
    format_value,
    make_constant_command,
)
from klute_sim.bench.trajectory import LengthTrajectory
from klute_sim.device.device import Device
from klute_sim.recording.recording import Recording
from klute_sim.units import BAR


class CreepProtocol(PressureProtocol):
    """Force at decades of time after a length step; one trial per pressure."""

    summary: ClassVar[str] = "A length step, held: force at decades of time."

    kind: Literal["creep"] = "creep"
    long_muscle_ratio: Ratio
    """Muscle length over resting length before the step, at rest under the pressure."""
    short_muscle_ratio: Ratio
    """Muscle length over resting length after the step."""
    velocity_mm_per_s: Positive
    acceleration_m_per_s2: Positive
    times_s: Annotated[list[Positive], NonEmpty]
    """Times [s] after the step at which the force is read; the trial ends at the last one."""

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if sorted(set(self.times_s)) != self.times_s or len(self.times_s) < 2:
            raise PydanticCustomError("protocol", "times_s needs two or more increasing times")
        if self.short_muscle_ratio >= self.long_muscle_ratio:
            raise PydanticCustomError("protocol", "short_muscle_ratio must be less than long_muscle_ratio")
        return self

    def plan_trials(self, device: Device) -> list[TrialPlan]:
        """Return one trial per pressure."""
        check_supply_pressure(device, self.pressures_bar)
        plans = []
        for bar in self.pressures_bar:
            pressure = bar * BAR
            path = LengthTrajectory(unit_length(device, self.long_muscle_ratio, pressure), self.rest_s)
            short = unit_length(device, self.short_muscle_ratio, pressure)
            path.move(short, 1e-3 * self.velocity_mm_per_s, self.acceleration_m_per_s2)
            step_end = path.end_time
            plans.append(
                TrialPlan(
                    name=f"{format_value(bar)}bar",
                    conditions={"pressure_bar": bar},
                    trajectory=path.hold(self.times_s[-1]),
                    command=make_constant_command(pressure),
                    event_times={"step_end": step_end},
                )
            )
        return plans

    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Return the force at each time, and its change per decade relative to the first force [%]."""
        forces = [interpolate_channel(recording, "force", plan.event_times["step_end"] + time) for time in self.times_s]
        slope = float(np.polyfit(np.log10(self.times_s), np.array(forces) - forces[0], 1)[0])
        return {
            **{f"force_at_{format_value(time)}_s_n": force for time, force in zip(self.times_s, forces, strict=True)},
            "creep_pct_per_decade": 100.0 * slope / abs(forces[0]) if forces[0] else float("nan"),
        }
