"""Isokinetic test: force at constant velocity, read when the muscle or the unit passes a length (Figs 3.7-3.9, 7.6)."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from klute_sim.bench.limits import check_reachable_speed, check_supply_pressure, isometric_force, unit_length
from klute_sim.bench.metrics import compute_shortening_velocity, find_crossing
from klute_sim.bench.protocols.protocol import (
    Positive,
    PressureProtocol,
    Ratio,
    TrialPlan,
    format_value,
    make_constant_command,
)
from klute_sim.bench.trajectory import LengthTrajectory
from klute_sim.device.device import Device
from klute_sim.device.dynamics import compute_tension
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.recording.recording import Recording
from klute_sim.units import BAR


class IsokineticProtocol(PressureProtocol):
    """Force at constant velocity; one trial per pressure, velocity and measurement length.

    Measurement lengths are ``muscle_ratios`` (of the moving muscle) or ``unit_lengths_mm`` (of the unit).
    """

    summary: ClassVar[str] = "Force at constant velocity, shortening and lengthening, read at a length."

    kind: Literal["isokinetic"] = "isokinetic"
    concentric_mm_per_s: list[Positive] = Field(default=[])
    """Shortening velocities [mm/s]."""
    eccentric_mm_per_s: list[Positive] = Field(default=[])
    """Lengthening velocities [mm/s]."""
    muscle_ratios: list[Ratio] = Field(default=[])
    """Muscle lengths over resting length at which force is read."""
    long_muscle_ratio: Ratio = 0.995
    """Muscle length over resting length at the long end of the stroke, at rest under the pressure."""
    short_muscle_ratio: Ratio = 0.85
    """Muscle length over resting length at the short end of the stroke."""
    unit_lengths_mm: list[Positive] = Field(default=[])
    """Unit lengths [mm] at which force is read, instead of ``muscle_ratios``."""
    approach_mm: Positive = 12.0
    """Distance [mm] of both ends of the stroke from each of ``unit_lengths_mm``."""
    acceleration_m_per_s2: Annotated[Positive, Field(le=1000)] = 20.0

    @model_validator(mode="after")
    def _check_targets(self) -> Self:
        if bool(self.muscle_ratios) == bool(self.unit_lengths_mm):
            raise PydanticCustomError("protocol", "give either muscle_ratios or unit_lengths_mm")
        if not self.concentric_mm_per_s and not self.eccentric_mm_per_s:
            raise PydanticCustomError("protocol", "give concentric_mm_per_s, eccentric_mm_per_s or both")
        if self.short_muscle_ratio >= self.long_muscle_ratio:
            raise PydanticCustomError("protocol", "short_muscle_ratio must be less than long_muscle_ratio")
        for ratio in self.muscle_ratios:
            if not self.short_muscle_ratio < ratio < self.long_muscle_ratio:
                raise PydanticCustomError(
                    "protocol",
                    "a muscle_ratio is {ratio}, which is outside the stroke; allowed: above short_muscle_ratio, "
                    "below long_muscle_ratio ({short} to {long})",
                    {"ratio": ratio, "short": self.short_muscle_ratio, "long": self.long_muscle_ratio},
                )
        return self

    def plan_trials(self, device: Device) -> list[TrialPlan]:
        """Return one trial per pressure, length and velocity, from fast shortening to fast lengthening."""
        check_supply_pressure(device, self.pressures_bar)
        velocities = [*sorted(self.concentric_mm_per_s, reverse=True), *(-v for v in sorted(self.eccentric_mm_per_s))]
        return [
            self._plan_trial(bar, key, length, long, short, 1e-3 * shortening)
            for bar in self.pressures_bar
            for key, length, long, short in self._list_measurement_lengths(device, bar * BAR)
            for shortening in velocities
        ]

    def _list_measurement_lengths(self, device: Device, pressure: float) -> Iterator[tuple[str, float, float, float]]:
        """Yield key and value of each measurement length, and the unit lengths [m] of the long and short end."""
        for ratio in self.muscle_ratios:
            long, short = (unit_length(device, r, pressure) for r in (self.long_muscle_ratio, self.short_muscle_ratio))
            yield "muscle_ratio", ratio, long, short
        for length in self.unit_lengths_mm:
            yield "unit_length_mm", length, 1e-3 * (length + self.approach_mm), 1e-3 * (length - self.approach_mm)

    def _plan_trial(
        self,
        pressure_bar: float,
        key: str,
        measurement_length: float,
        long: float,
        short: float,
        shortening_velocity: float,
    ) -> TrialPlan:
        speed, acceleration = abs(shortening_velocity), self.acceleration_m_per_s2
        check_reachable_speed(speed, long - short, acceleration)
        begin, end = (long, short) if shortening_velocity > 0.0 else (short, long)
        path = LengthTrajectory(begin, self.rest_s).move(end, speed, acceleration)
        marks = {"begin": self.rest_s + speed / acceleration, "end": path.end_time - speed / acceleration}
        path.hold(0.05)
        position = format_value(measurement_length)
        direction = "concentric" if shortening_velocity > 0.0 else "eccentric"
        return TrialPlan(
            name=f"{format_value(pressure_bar)}bar_{position}_{direction}_{format_value(1e3 * speed)}mm_per_s",
            conditions={
                "pressure_bar": pressure_bar,
                "velocity_mm_per_s": 1e3 * shortening_velocity,
                key: measurement_length,
            },
            trajectory=path,
            command=make_constant_command(pressure_bar * BAR),
            event_times=marks,
        )

    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Return the metrics at the measurement length; NaN if it is not passed at full speed."""
        resting_length, pressure = 1e3 * device.parameters.muscle.resting_length, plan.conditions["pressure_bar"] * BAR
        if "muscle_ratio" in plan.conditions:
            ratio = plan.conditions["muscle_ratio"]
            time = find_crossing(
                recording, "muscle_length", ratio * resting_length, plan.event_times["begin"], plan.event_times["end"]
            )
            isometric = isometric_force(device, ratio, pressure)
        else:
            length = plan.conditions["unit_length_mm"]
            time = find_crossing(recording, "length", length, plan.event_times["begin"], plan.event_times["end"])
            state = compute_equilibrium_state(device.parameters, 1e-3 * length, pressure)
            isometric = compute_tension(device.parameters, state, 1e-3 * length, 0.0)
        series = {
            "force_n": recording["force"],
            "unit_length_mm": recording["length"],
            **({"muscle_ratio_reached": recording["muscle_length"] / resting_length} if resting_length else {}),
            "velocity_reached_mm_per_s": compute_shortening_velocity(recording, "length"),
            "muscle_velocity_mm_per_s": compute_shortening_velocity(recording, "muscle_length"),
        }
        metrics = {key: float(np.interp(time, recording["time"], samples)) for key, samples in series.items()}
        ratio = metrics["force_n"] / isometric if isometric > 0.0 else float("nan")
        return {**metrics, "isometric_force_n": isometric, "force_ratio": ratio}
