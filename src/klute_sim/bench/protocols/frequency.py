"""Frequency response: gain and phase of pressure and force for sinusoidal pressure commands at a held length."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from klute_sim.bench.limits import check_supply_pressure, unit_length
from klute_sim.bench.metrics import select_half_open_interval
from klute_sim.bench.protocols.protocol import NonEmpty, Positive, PressureProtocol, Ratio, TrialPlan, format_value
from klute_sim.bench.trajectory import LengthTrajectory
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording
from klute_sim.recording.sinusoid import fit_sinusoid
from klute_sim.types import Array
from klute_sim.units import BAR

MIN_SAMPLES_PER_PERIOD = 10
"""Minimum number of samples per period of a fitted sinusoid."""


class FrequencyResponseProtocol(PressureProtocol):
    """One trial per mean pressure (``pressures_bar``) and frequency."""

    summary: ClassVar[str] = "Pressure sinusoids: gain and phase of pressure and force."

    kind: Literal["frequency"] = "frequency"
    frequencies_hz: Annotated[list[Positive], NonEmpty]
    amplitude_bar: Positive
    """Amplitude [bar] around each of ``pressures_bar``."""
    muscle_ratio: Ratio
    """Muscle length over resting length, at rest under the mean pressure."""
    settling_cycles: Annotated[int, Field(ge=0, le=1000)] = 2
    """Number of periods before the fitted ones."""
    cycles: Annotated[int, Field(ge=1, le=1000)] = 3
    """Number of fitted periods."""

    def plan_trials(self, device: Device) -> list[TrialPlan]:
        """Return one trial per mean pressure and frequency."""
        check_supply_pressure(device, [bar + self.amplitude_bar for bar in self.pressures_bar])
        if min(self.pressures_bar) < self.amplitude_bar:
            raise InputError(f"amplitude_bar is {self.amplitude_bar:g}; allowed: up to the lowest of pressures_bar")
        return [
            self._plan_trial(device, bar, frequency)
            for bar in self.pressures_bar
            for frequency in sorted(self.frequencies_hz)
        ]

    def _plan_trial(self, device: Device, pressure_bar: float, frequency: float) -> TrialPlan:
        begin = self.rest_s + self.settling_cycles / frequency
        end = begin + self.cycles / frequency

        def command(time: Array) -> Array:
            swing = np.sin(2.0 * np.pi * frequency * np.maximum(time - self.rest_s, 0.0))
            return np.asarray(BAR * (pressure_bar + self.amplitude_bar * swing))

        return TrialPlan(
            name=f"{format_value(pressure_bar)}bar_{format_value(frequency)}Hz",
            conditions={"pressure_bar": pressure_bar, "amplitude_bar": self.amplitude_bar, "frequency_hz": frequency},
            trajectory=LengthTrajectory(unit_length(device, self.muscle_ratio, pressure_bar * BAR), end),
            command=command,
            event_times={"begin": begin, "end": end},
        )

    def check_time_step(self, dt: float) -> None:
        """Raise InputError where the fastest sinusoid has fewer than :data:`LEAST_SAMPLES` per period."""
        fastest = max(self.frequencies_hz)
        if dt * fastest * MIN_SAMPLES_PER_PERIOD > 1.0 + 1e-9:
            raise InputError(
                f"the time step is {1e3 * dt:g} ms, which is {1.0 / (dt * fastest):.3g} samples per period at "
                f"{fastest:g} Hz; allowed: up to {1e3 / (MIN_SAMPLES_PER_PERIOD * fastest):.4g} ms "
                f"({MIN_SAMPLES_PER_PERIOD} samples)"
            )

    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Return gains and phases relative to the command; the phase of a lag is negative.

        ``coherence`` is the fraction of a signal's variance that the fitted sinusoid explains.
        """
        part = select_half_open_interval(recording, plan.event_times["begin"], plan.event_times["end"])
        frequency = plan.conditions["frequency_hz"]
        reference = fit_sinusoid(part["time"], part["pressure_command"], frequency)
        metrics = {}
        for channel, unit in (("pressure", ""), ("force", "_n_per_bar")):
            response = fit_sinusoid(part["time"], part[channel], frequency)
            metrics[f"{channel}_gain{unit}"] = abs(response.phasor) / abs(reference.phasor)
            metrics[f"{channel}_phase_deg"] = float(np.degrees(np.angle(response.phasor / reference.phasor)))
            metrics[f"{channel}_coherence"] = response.coherence
        return metrics
