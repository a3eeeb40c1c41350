"""Base class of all bench protocols, and the plan of one trial."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from klute_sim.bench.trajectory import LengthTrajectory
from klute_sim.device.device import Device
from klute_sim.recording.recording import Recording
from klute_sim.types import Array

Positive = Annotated[FiniteFloat, Field(gt=0)]
NonNegative = Annotated[FiniteFloat, Field(ge=0)]
Ratio = Annotated[FiniteFloat, Field(gt=0, le=1)]
NonEmpty = Field(min_length=1, max_length=64)
"""Constraint of lists that need at least one entry; each entry makes trials, together with those of other lists."""


def format_value(value: float) -> str:
    """Return ``value`` as part of a name; values that differ by more than rounding get different names."""
    return f"{value:.12g}"


def make_constant_command(pressure: float) -> Callable[[Array], Array]:
    """Return a command that stays at ``pressure`` [Pa]."""
    return lambda time: np.full(len(time), pressure)


class TrialPlan(NamedTuple):
    """Plan of one trial."""

    name: str
    """Unique name of the trial, usable as a file name."""
    conditions: Mapping[str, float]
    """Set values by keys with units."""
    trajectory: LengthTrajectory
    """Commanded length of the unit."""
    command: Callable[[Array], Array]
    """Commanded gauge pressure [Pa] as a function of time [s]."""
    event_times: Mapping[str, float]
    """Times [s] of the events that the metrics refer to."""


class BenchProtocol(BaseModel):
    """Content of a protocol file: what is done, at which values, and the sources of the values."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    summary: ClassVar[str]
    """One sentence that says what this kind of test does."""

    kind: str
    """Kind of test, a key of :data:`klute_sim.bench.protocols.library.PROTOCOL_TYPES`."""
    name: Annotated[str, Field(min_length=1)]
    """Name of the protocol."""
    description: str = ""
    """One sentence that says what this protocol does."""
    rest_s: Positive = 0.5
    """Time at rest [s] at the start; the trial starts in equilibrium."""
    sources: dict[str, str] = {}
    """Source of each key's numbers; starts with 'assumed' where no source prints them."""

    @abstractmethod
    def plan_trials(self, device: Device) -> Sequence[TrialPlan]:
        """Return the plans of the trials for ``device``; raise InputError when the device cannot run them."""

    def check_time_step(self, dt: float) -> None:
        """Raise InputError when the time step ``dt`` [s] is too long for the metrics."""

    @abstractmethod
    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """Return the metrics of a ``recording`` at its full rate, by keys with units; NaN where there is no value."""

    def numeric_keys(self) -> list[str]:
        """Return the keys whose values are numbers or lists of numbers."""
        return [
            key
            for key, value in self.model_dump().items()
            if isinstance(value, int | float)
            or (isinstance(value, list) and not any(isinstance(item, str) for item in value))
        ]

    def list_assumptions(self) -> dict[str, str]:
        """Return the keys with assumed numbers, and the reason for each number."""
        return {key: source for key, source in self.sources.items() if source.startswith("assumed")}


class PressureProtocol(BenchProtocol):
    """Content of a protocol file of a test at set pressures."""

    pressures_bar: Annotated[list[NonNegative], NonEmpty]
    """Gauge pressures [bar]."""
