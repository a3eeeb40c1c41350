"""Identification protocol: one trial with an excitation that reveals effects, for ``klute-sim plan`` and proposals."""

from typing import ClassVar, Literal, NamedTuple

from pydantic import Field

from klute_sim.bench.metrics import compute_work
from klute_sim.bench.protocols.excitation import EXCITATIONS, Excitation, compute_limits
from klute_sim.bench.protocols.protocol import BenchProtocol, TrialPlan
from klute_sim.bench.trajectory import sample_staircase
from klute_sim.datasets.trial import Use
from klute_sim.device.device import Device, check_accepts_pressure
from klute_sim.device.schema.parts import explain_missing_part
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording
from klute_sim.types import Array

SAMPLE_INTERVAL = 5e-3
"""Time between the samples of the commands [s]; a pressure step takes one sample."""


class Program(NamedTuple):
    """Commands of a trial with one sample every :data:`SAMPLE_INTERVAL`."""

    time: Array
    """Time from 0 [s]."""
    unit_length: Array
    """Length of the muscle-tendon unit [m]."""
    command: Array
    """Gauge pressure [Pa]."""


class IdentificationProtocol(BenchProtocol):
    """One trial with an excitation whose lengths and pressures follow from the limits of the device."""

    summary: ClassVar[str] = "An excitation that reveals effects of the device: force, pressure and length over time."

    kind: Literal["identification"] = "identification"
    excitation: Literal["steps", "ramps", "sines", "release", "hold", "slack", "mixed"]
    """Excitation signal, a key of :data:`klute_sim.bench.protocols.excitation.EXCITATIONS`."""
    use: Use
    """Use of the trials in a dataset that holds all identification protocols."""
    revealed_effects: list[str] = Field(default=[])
    """Effects of the catalogue that the protocol reveals or distinguishes best."""
    description_without_muscle: str = ""
    """Description for a device without a muscle; '': as for a muscle."""

    def describe_for(self, device: Device) -> str:
        """Return what the protocol does with ``device``."""
        return self.description if device.spec.muscle else self.description_without_muscle or self.description

    def list_revealed_effects(self, device: Device) -> list[str]:
        """Return those of the revealed effects that act on a part of ``device``."""
        sections = device.spec.list_sections()
        return [name for name in self.revealed_effects if not explain_missing_part(name, sections)]

    def explain_uselessness(self, device: Device) -> str:
        """Return why the protocol reveals nothing of ``device``, or ''."""
        spec = device.spec
        if self.excitation == "steps" and spec.supply is None:
            return f"steps the pressure, but '{device.name}' has no [supply]"
        if self.excitation == "slack" and spec.muscle is None and spec.tendon is None:
            return f"slackens a muscle or a tendon, but '{device.name}' has neither"
        return ""

    def build_program(self, device: Device) -> Program:
        """Return the sampled commands for ``device``; raise InputError when the protocol cannot test it."""
        excitation = self._create_excitation(device)
        time, length = excitation.trajectory.sample(SAMPLE_INTERVAL)
        return Program(time, length, sample_staircase(time, excitation.pressure_steps))

    def _create_excitation(self, device: Device) -> Excitation:
        uselessness = self.explain_uselessness(device)
        if uselessness:
            raise InputError(f"protocol '{self.name}' {uselessness}; allowed: the other protocols")
        return EXCITATIONS[self.excitation](compute_limits(device), self.rest_s)

    def plan_trials(self, device: Device) -> list[TrialPlan]:
        """Return the only trial."""
        check_accepts_pressure(device, "the protocol")
        excitation = self._create_excitation(device)
        return [
            TrialPlan(
                name=self.name,
                conditions={"duration_s": excitation.trajectory.end_time},
                trajectory=excitation.trajectory,
                command=lambda time: sample_staircase(time, excitation.pressure_steps),
                event_times={},
            )
        ]

    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Return the extremes of force and pressure, and the net work of the device."""
        return {
            "force_min_n": float(recording["force"].min()),
            "force_max_n": float(recording["force"].max()),
            "pressure_max_bar": float(recording["pressure"].max()),
            "work_j": compute_work(recording),
        }
