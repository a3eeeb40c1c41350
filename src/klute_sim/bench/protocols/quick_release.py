"""Quick-release test (A. V. Hill): a small fast shortening that the series elasticity takes up first."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from klute_sim.bench.limits import check_supply_pressure, unit_length
from klute_sim.bench.metrics import interpolate_channel, select_closed_interval
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


class QuickReleaseProtocol(PressureProtocol):
    """Releases of several sizes; one trial per pressure and size."""

    summary: ClassVar[str] = "Quick releases: the remaining force and its recovery."

    kind: Literal["quick-release"] = "quick-release"
    muscle_ratio: Ratio
    """Muscle length over resting length before the release, under the pressure."""
    release_ratios: Annotated[list[Annotated[float, Field(gt=0, le=0.3)]], NonEmpty]
    """Shortening of the unit over the resting length of the muscle."""
    velocity_mm_per_s: Positive
    acceleration_m_per_s2: Positive
    hold_s: Positive
    """Time [s] after the release."""

    def plan_trials(self, device: Device) -> list[TrialPlan]:
        """Return one trial per pressure and release."""
        check_supply_pressure(device, self.pressures_bar)
        resting_length, plans = device.parameters.muscle.resting_length, []
        for bar in self.pressures_bar:
            for release in self.release_ratios:
                begin, pressure = unit_length(device, self.muscle_ratio, bar * BAR), bar * BAR
                path = LengthTrajectory(begin, self.rest_s)
                path.move(begin - release * resting_length, 1e-3 * self.velocity_mm_per_s, self.acceleration_m_per_s2)
                released = path.end_time
                plans.append(
                    TrialPlan(
                        name=f"{format_value(bar)}bar_{format_value(1e3 * release * resting_length)}mm",
                        conditions={"pressure_bar": bar, "release_mm": 1e3 * release * resting_length},
                        trajectory=path.hold(self.hold_s),
                        command=make_constant_command(pressure),
                        event_times={"released": released},
                    )
                )
        return plans

    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Return the force before, its minimum and its end; ``recovery_s`` is the time to 90 % of the recovery."""
        released = plan.event_times["released"]
        after = select_closed_interval(recording, self.rest_s, plan.trajectory.end_time)
        lowest = int(np.argmin(after["force"]))
        before, minimum, final = (
            interpolate_channel(recording, "force", self.rest_s - 0.01),
            after["force"][lowest],
            after["force"][-1],
        )
        recovery = after.select(slice(lowest, None))
        recovered = recovery["time"][np.argmax(recovery["force"] >= minimum + 0.9 * (final - minimum))]
        return {
            "force_before_n": before,
            "force_lowest_n": float(minimum),
            "force_after_n": float(final),
            "stiffness_n_per_mm": (before - float(minimum)) / plan.conditions["release_mm"],
            "recovery_s": float(max(0.0, recovered - released)),
        }
