"""Isometric test: force at a held length and pressure (dissertation Figs 3.4, 3.5)."""

from typing import Annotated, ClassVar, Literal

from klute_sim.bench.limits import check_supply_pressure, unit_length
from klute_sim.bench.protocols.protocol import (
    NonEmpty,
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


class IsometricProtocol(PressureProtocol):
    """Force over length; one trial per pressure and length, each held for ``rest_s``."""

    summary: ClassVar[str] = "Force at held lengths, per pressure."

    kind: Literal["isometric"] = "isometric"
    muscle_ratios: Annotated[list[Ratio], NonEmpty]
    """Muscle lengths over resting length."""

    def plan_trials(self, device: Device) -> list[TrialPlan]:
        """Return one trial per pressure and length."""
        check_supply_pressure(device, self.pressures_bar)
        plans = []
        for bar in self.pressures_bar:
            for ratio in self.muscle_ratios:
                pressure = bar * BAR
                plans.append(
                    TrialPlan(
                        name=f"{format_value(bar)}bar_{format_value(ratio)}",
                        conditions={"pressure_bar": bar, "muscle_ratio": ratio},
                        trajectory=LengthTrajectory(unit_length(device, ratio, pressure), self.rest_s),
                        command=make_constant_command(pressure),
                        event_times={},
                    )
                )
        return plans

    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Return the metrics at the end of the hold."""
        resting_length = 1e3 * device.parameters.muscle.resting_length
        return {
            "force_n": float(recording["force"][-1]),
            "unit_length_mm": float(recording["length"][-1]),
            "muscle_ratio_reached": float(recording["muscle_length"][-1]) / resting_length,
        }
