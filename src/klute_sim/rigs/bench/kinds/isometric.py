"""Held at one length under one pressure (dissertation Figs 3.4, 3.5)."""

from typing import Annotated, ClassVar, Literal

from klute_sim.device.files import Device
from klute_sim.recording.recording import Recording
from klute_sim.rigs.bench.path import Path
from klute_sim.rigs.bench.plan import Plan, Protocol, Ratio, Some, constant, label
from klute_sim.rigs.bench.reach import refuse_beyond_supply, unit_length
from klute_sim.units import BAR


class Isometric(Protocol):
    """Force over length, one trial per pressure and length; ``rest_s`` is how long each is held."""

    about: ClassVar[str] = "Force at held lengths, per pressure."

    kind: Literal["isometric"] = "isometric"
    muscle_ratios: Annotated[list[Ratio], Some]
    """Muscle lengths over resting length."""

    def plans(self, device: Device) -> list[Plan]:
        """One trial per pressure and length."""
        refuse_beyond_supply(device, self.pressures_bar)
        found = []
        for bar in self.pressures_bar:
            for ratio in self.muscle_ratios:
                pressure = bar * BAR
                found.append(
                    Plan(
                        name=f"{label(bar)}bar_{label(ratio)}",
                        setting={"pressure_bar": bar, "muscle_ratio": ratio},
                        path=Path(unit_length(device, ratio, pressure), self.rest_s),
                        command=constant(pressure),
                        marks={},
                    )
                )
        return found

    def readings(self, device: Device, plan: Plan, recording: Recording) -> dict[str, float]:
        """At the end of the hold."""
        rest = 1e3 * device.parameters.muscle.resting_length
        return {
            "force_n": float(recording["force"][-1]),
            "unit_length_mm": float(recording["length"][-1]),
            "muscle_ratio_reached": float(recording["muscle_length"][-1]) / rest,
        }
