"""A step of the length at constant pressure, held for long: what relaxes although nothing moves."""

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator
from pydantic_core import PydanticCustomError

from klute_sim.bench.limits import check_supply_pressure, unit_length
from klute_sim.bench.metrics import interpolate_channel
from klute_sim.bench.protocols.protocol import (
    BenchProtocol,
    NonEmpty,
    Positive,
    Ratio,
    TrialPlan,
    format_value,
    make_constant_command,
)
from klute_sim.bench.trajectory import LengthTrajectory
from klute_sim.device.device import Device
from klute_sim.recording.recording import Recording
from klute_sim.units import BAR


class CreepProtocol(BenchProtocol):
    """Force at decades of time after a step of the length, one trial per pressure."""

    summary: ClassVar[str] = "A length step held for long: force at decades of time."

    kind: Literal["creep"] = "creep"
    long_muscle_ratio: Ratio
    """Muscle length over resting length before the step, at rest under the pressure."""
    short_muscle_ratio: Ratio
    """After it."""
    velocity_mm_per_s: Positive
    acceleration_m_per_s2: Positive
    times_s: Annotated[list[Positive], NonEmpty]
    """After the step, at which force is read; the last is the end."""

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if sorted(set(self.times_s)) != self.times_s or len(self.times_s) < 2:
            raise PydanticCustomError("protocol", "times_s must be two or more that rise")
        if self.short_muscle_ratio >= self.long_muscle_ratio:
            raise PydanticCustomError("protocol", "short_muscle_ratio must be less than long_muscle_ratio")
        return self

    def plan_trials(self, device: Device) -> list[TrialPlan]:
        """One trial per pressure."""
        check_supply_pressure(device, self.pressures_bar)
        found = []
        for bar in self.pressures_bar:
            pressure = bar * BAR
            path = LengthTrajectory(unit_length(device, self.long_muscle_ratio, pressure), self.rest_s)
            short = unit_length(device, self.short_muscle_ratio, pressure)
            path.move(short, 1e-3 * self.velocity_mm_per_s, self.acceleration_m_per_s2)
            done = path.end_time
            found.append(
                TrialPlan(
                    name=f"{format_value(bar)}bar",
                    conditions={"pressure_bar": bar},
                    trajectory=path.hold(self.times_s[-1]),
                    command=make_constant_command(pressure),
                    event_times={"done": done},
                )
            )
        return found

    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Force at each time, and its change per decade, as a share of the first [%]."""
        forces = [interpolate_channel(recording, "force", plan.event_times["done"] + time) for time in self.times_s]
        slope = float(np.polyfit(np.log10(self.times_s), np.array(forces) - forces[0], 1)[0])
        return {
            **{f"force_at_{format_value(time)}_s_n": force for time, force in zip(self.times_s, forces, strict=True)},
            "creep_pct_per_decade": 100.0 * slope / abs(forces[0]) if forces[0] else float("nan"),
        }
