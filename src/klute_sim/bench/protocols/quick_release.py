"""Let go by a little, as fast as the tester can: what is in series gives way first (A. V. Hill's quick release)."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from klute_sim.bench.limits import check_supply_pressure, unit_length
from klute_sim.bench.metrics import interpolate_channel, select_closed_interval
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


class QuickReleaseProtocol(BenchProtocol):
    """Releases of several sizes, one trial per pressure and size."""

    summary: ClassVar[str] = "Quick releases: the force that is left, and how it comes back."

    kind: Literal["quick-release"] = "quick-release"
    muscle_ratio: Ratio
    """Muscle length over resting length before the release, under the pressure."""
    release_ratios: Annotated[list[Annotated[float, Field(gt=0, le=0.3)]], NonEmpty]
    """Releases of the unit over the muscle's resting length."""
    velocity_mm_per_s: Positive
    acceleration_m_per_s2: Positive
    hold_s: Positive
    """After the release."""

    def plan_trials(self, device: Device) -> list[TrialPlan]:
        """One trial per pressure and release."""
        check_supply_pressure(device, self.pressures_bar)
        rest, found = device.parameters.muscle.resting_length, []
        for bar in self.pressures_bar:
            for release in self.release_ratios:
                begin, pressure = unit_length(device, self.muscle_ratio, bar * BAR), bar * BAR
                path = LengthTrajectory(begin, self.rest_s)
                path.move(begin - release * rest, 1e-3 * self.velocity_mm_per_s, self.acceleration_m_per_s2)
                released = path.end_time
                found.append(
                    TrialPlan(
                        name=f"{format_value(bar)}bar_{format_value(1e3 * release * rest)}mm",
                        conditions={"pressure_bar": bar, "release_mm": 1e3 * release * rest},
                        trajectory=path.hold(self.hold_s),
                        command=make_constant_command(pressure),
                        event_times={"released": released},
                    )
                )
        return found

    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Before, at the lowest, and at the end; ``recovery_s``: until 90 % of the force has come back."""
        released = plan.event_times["released"]
        after = select_closed_interval(recording, self.rest_s, plan.trajectory.end_time)
        lowest = int(np.argmin(after["force"]))
        before, low, last = (
            interpolate_channel(recording, "force", self.rest_s - 0.01),
            after["force"][lowest],
            after["force"][-1],
        )
        back = after.select(slice(lowest, None))
        reached = back["time"][np.argmax(back["force"] >= low + 0.9 * (last - low))]
        return {
            "force_before_n": before,
            "force_lowest_n": float(low),
            "force_after_n": float(last),
            "stiffness_n_per_mm": (before - float(low)) / plan.conditions["release_mm"],
            "recovery_s": float(max(0.0, reached - released)),
        }
