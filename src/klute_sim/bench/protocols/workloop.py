"""Work loops (dissertation chapter 8): stretch-shorten cycles with a square velocity, pressurised for a part of each.

A cycle is a dwell at the long end, shortening, a dwell at the short end and lengthening. The regulator fills and
empties the muscle during the dwells, where no work is done. The pressure is therefore steady when a movement starts:
*concentric* activation applies pressure during shortening only, at any velocity.
"""

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, FiniteFloat, model_validator
from pydantic_core import PydanticCustomError

from klute_sim.bench.limits import check_reachable_speed, check_supply_pressure, unit_length
from klute_sim.bench.metrics import compute_ledger_residual, compute_work, integrate_power, select_closed_interval
from klute_sim.bench.protocols.protocol import (
    NonEmpty,
    NonNegative,
    Positive,
    PressureProtocol,
    Ratio,
    TrialPlan,
    format_value,
)
from klute_sim.bench.trajectory import LengthTrajectory
from klute_sim.device.device import Device
from klute_sim.device.energy.ledger import POWER_TERMS
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording
from klute_sim.types import Array
from klute_sim.units import BAR

ACTIVATION_PHASES_PCT = {"concentric": 0.0, "eccentric": 50.0}
"""Phase of the cycle [%] at which each activation starts."""
PRESSURE_TOLERANCE = 0.05
"""Fraction of the pressure amplitude within which the pressure counts as equal to the command."""


class WorkLoopProtocol(PressureProtocol):
    """Net work per cycle; one trial per activation, velocity and pressure."""

    summary: ClassVar[str] = "Stretch-shorten cycles: net work per cycle."

    kind: Literal["workloop"] = "workloop"
    velocities_mm_per_s: Annotated[list[Positive], NonEmpty]
    """Velocities [mm/s] of shortening and lengthening."""
    activations: Annotated[list[Literal["concentric", "eccentric", "phased"]], NonEmpty]
    """Parts of the cycle in which the muscle is pressurised."""
    phases_pct: list[Annotated[FiniteFloat, Field(ge=0, lt=100)]] = Field(default=[])
    """Phases [%] at which *phased* activation starts; 0 is the start of the dwell at the long end."""
    duty_pct: Annotated[FiniteFloat, Field(gt=0, lt=100)] = 50.0
    """Duration of *phased* activation [% of the cycle]."""
    low_bar: NonNegative
    """Gauge pressure [bar] without activation."""
    long_muscle_ratio: Ratio
    """Muscle length over resting length at the long end, with the tendon just taut."""
    short_muscle_ratio: Ratio
    """Muscle length over resting length at the short end, with the tendon just taut."""
    acceleration_m_per_s2: Positive
    dwell_s: NonNegative
    """Dwell [s] at each end, in which the pressure changes."""
    cycles: Annotated[int, Field(ge=2, le=1000)] = 2
    """Number of cycles; the metrics are those of the last."""

    @model_validator(mode="after")
    def _check_consistency(self) -> Self:
        if ("phased" in self.activations) != bool(self.phases_pct):
            raise PydanticCustomError("protocol", "phases_pct and the activation 'phased' need each other")
        if self.short_muscle_ratio >= self.long_muscle_ratio:
            raise PydanticCustomError("protocol", "short_muscle_ratio must be less than long_muscle_ratio")
        return self

    def plan_trials(self, device: Device) -> list[TrialPlan]:
        """Return one trial per activation (and phase), velocity and pressure."""
        check_supply_pressure(device, [self.low_bar, *self.pressures_bar])
        if min(self.pressures_bar) <= self.low_bar:
            raise InputError(f"low_bar is {self.low_bar:g}; allowed: less than the lowest of pressures_bar")
        pulses: list[tuple[str, float, float]]
        pulses = [(name, ACTIVATION_PHASES_PCT[name], 50.0) for name in self.activations if name != "phased"]
        pulses += [(f"phased_{format_value(phase)}pct", phase, self.duty_pct) for phase in self.phases_pct]
        return [
            self._plan_trial(device, name, phase, duty, velocity, bar)
            for name, phase, duty in pulses
            for velocity in self.velocities_mm_per_s
            for bar in self.pressures_bar
        ]

    def _plan_trial(
        self, device: Device, name: str, phase: float, duty: float, velocity: float, pressure_bar: float
    ) -> TrialPlan:
        long, short = (unit_length(device, r, 0.0) for r in (self.long_muscle_ratio, self.short_muscle_ratio))
        speed, acceleration = 1e-3 * velocity, self.acceleration_m_per_s2
        check_reachable_speed(speed, long - short, acceleration)
        path = LengthTrajectory(long, self.rest_s)
        for _ in range(self.cycles):
            path.hold(self.dwell_s).move(short, speed, acceleration)
            path.hold(self.dwell_s).move(long, speed, acceleration)
        period = (path.end_time - self.rest_s) / self.cycles

        def command(time: Array) -> Array:
            time = np.minimum(time, path.end_time - 1e-6)  # the last sample belongs to the last cycle
            phase_fraction = ((time - self.rest_s + 1e-9) / period - 0.01 * phase) % 1.0
            # Before the first cycle, the command is that of the end of a cycle.
            phase_fraction = np.where(time < self.rest_s - 1e-9, (1.0 - 1e-9 - 0.01 * phase) % 1.0, phase_fraction)
            return np.asarray(BAR * np.where(phase_fraction < 0.01 * duty, pressure_bar, self.low_bar))

        return TrialPlan(
            name=f"{name}_{format_value(velocity)}mm_per_s_{format_value(pressure_bar)}bar",
            conditions={
                "pressure_bar": pressure_bar,
                "velocity_mm_per_s": velocity,
                "phase_pct": phase,
                "duty_pct": duty,
            },
            trajectory=path,
            command=command,
            event_times={"begin": path.end_time - period, "half": path.end_time - 0.5 * period, "end": path.end_time},
        )

    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Return the metrics of the last cycle; positive work is done by the device on the crosshead.

        ``overlap_pct`` is the part of the path during which the pressure equals the command. Less than 100 means that
        the dwell is too short for this supply or, with *phased* activation, that the pressure changes during the path.
        """
        begin, half, end = (plan.event_times[key] for key in ("begin", "half", "end"))
        cycle = select_closed_interval(recording, begin, end)
        distance = np.abs(np.diff(cycle["length_command"]))
        amplitude = plan.conditions["pressure_bar"] - self.low_bar
        is_tracking = np.abs(cycle["pressure"] - cycle["pressure_command"])[1:] <= PRESSURE_TOLERANCE * amplitude
        return {
            "work_j": compute_work(cycle),
            "work_shortening_j": compute_work(select_closed_interval(recording, begin, half)),
            "work_lengthening_j": compute_work(select_closed_interval(recording, half, end)),
            "mean_power_w": compute_work(cycle) / (end - begin),
            "force_max_n": float(cycle["force"].max()),
            "force_min_n": float(cycle["force"].min()),
            "overlap_pct": 100.0 * float(distance[is_tracking].sum() / distance.sum()),
            **{f"{channel.removesuffix('_power')}_work_j": integrate_power(cycle, channel) for channel in POWER_TERMS},
            "air_drawn_g": 1e3 * float(cycle["air_drawn"][-1] - cycle["air_drawn"][0]),
            "ledger_residual_j": compute_ledger_residual(cycle),
        }
