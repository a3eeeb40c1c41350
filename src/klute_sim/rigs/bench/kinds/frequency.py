"""Sinusoids of the pressure command at a held length: gain and phase of pressure and force."""

from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from klute_sim.device.files import Device
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording
from klute_sim.rigs.bench.path import Array, Path
from klute_sim.rigs.bench.plan import Plan, Positive, Protocol, Ratio, Some, label
from klute_sim.rigs.bench.reach import refuse_beyond_supply, unit_length
from klute_sim.rigs.bench.reading import between
from klute_sim.units import BAR

LEAST_SAMPLES = 10
"""Per period of a sinusoid that is fitted."""


class Frequency(Protocol):
    """One trial per mean pressure (``pressures_bar``) and frequency."""

    about: ClassVar[str] = "Pressure sinusoids: gain and phase of pressure and force."

    kind: Literal["frequency"] = "frequency"
    frequencies_hz: Annotated[list[Positive], Some]
    amplitude_bar: Positive
    """Around each of ``pressures_bar``."""
    muscle_ratio: Ratio
    """Muscle length over resting length, at rest under the mean pressure."""
    settling_cycles: Annotated[int, Field(ge=0, le=1000)] = 2
    """Before the cycles that count."""
    cycles: Annotated[int, Field(ge=1, le=1000)] = 3
    """That are read."""

    def plans(self, device: Device) -> list[Plan]:
        """One trial per mean pressure and frequency."""
        refuse_beyond_supply(device, [bar + self.amplitude_bar for bar in self.pressures_bar])
        if min(self.pressures_bar) < self.amplitude_bar:
            raise InputError(f"amplitude_bar is {self.amplitude_bar:g}; allowed: up to the lowest of pressures_bar")
        return [
            self._plan(device, bar, frequency)
            for bar in self.pressures_bar
            for frequency in sorted(self.frequencies_hz)
        ]

    def _plan(self, device: Device, bar: float, frequency: float) -> Plan:
        begin = self.rest_s + self.settling_cycles / frequency
        end = begin + self.cycles / frequency

        def command(time: Array) -> Array:
            swing = np.sin(2.0 * np.pi * frequency * np.maximum(time - self.rest_s, 0.0))
            return np.asarray(BAR * (bar + self.amplitude_bar * swing))

        return Plan(
            name=f"{label(bar)}bar_{label(frequency)}Hz",
            setting={"pressure_bar": bar, "amplitude_bar": self.amplitude_bar, "frequency_hz": frequency},
            path=Path(unit_length(device, self.muscle_ratio, bar * BAR), end),
            command=command,
            marks={"begin": begin, "end": end},
        )

    def check_step(self, step: float) -> None:
        """Raise InputError where the fastest sinusoid has fewer than :data:`LEAST_SAMPLES` per period."""
        fastest = max(self.frequencies_hz)
        if step * fastest * LEAST_SAMPLES > 1.0 + 1e-9:
            raise InputError(
                f"step is {1e3 * step:g} ms, which is {1.0 / (step * fastest):.3g} samples per period at "
                f"{fastest:g} Hz; allowed: up to {1e3 / (LEAST_SAMPLES * fastest):.4g} ms ({LEAST_SAMPLES} samples)"
            )

    def readings(self, device: Device, plan: Plan, recording: Recording) -> dict[str, float]:
        """Gains and phases against the command; negative phase: late.

        ``coherence``: share of a signal's variance that is the fitted sinusoid.
        """
        part = between(recording, plan.marks["begin"], plan.marks["end"])
        frequency = plan.setting["frequency_hz"]
        asked = fit(part["time"], part["pressure_command"], frequency)
        found = {}
        for channel, unit in (("pressure", ""), ("force", "_n_per_bar")):
            got = fit(part["time"], part[channel], frequency)
            found[f"{channel}_gain{unit}"] = abs(got.phasor) / abs(asked.phasor)
            found[f"{channel}_phase_deg"] = float(np.degrees(np.angle(got.phasor / asked.phasor)))
            found[f"{channel}_coherence"] = got.share
        return found


class Sinusoid(NamedTuple):
    """The sinusoid in a signal."""

    phasor: complex
    """Amplitude and phase, against the sine from time 0."""
    share: float
    """Of the signal's variance around its line."""


def fit(time: Array, samples: Array, frequency: float) -> Sinusoid:
    """Least squares of a line and a sinusoid of ``frequency`` [Hz]."""
    angle = 2.0 * np.pi * frequency * time
    line = np.stack([np.ones(len(time)), time - time.mean()], axis=1)
    wave = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    both = np.hstack([line, wave])
    numbers = np.linalg.lstsq(both, samples)[0]
    left = float(((samples - both @ numbers) ** 2).sum())
    around = float(((samples - line @ np.linalg.lstsq(line, samples)[0]) ** 2).sum())
    return Sinusoid(complex(numbers[2], numbers[3]), 1.0 - left / around if around > 0.0 else float("nan"))
