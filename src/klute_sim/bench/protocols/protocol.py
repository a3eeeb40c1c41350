"""What one trial of a protocol commands, and the base of all protocols."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from klute_sim.bench.trajectory import Array, LengthTrajectory
from klute_sim.device.device import Device
from klute_sim.recording.recording import Recording

Positive = Annotated[FiniteFloat, Field(gt=0)]
NonNegative = Annotated[FiniteFloat, Field(ge=0)]
Ratio = Annotated[FiniteFloat, Field(gt=0, le=1)]
NonEmpty = Field(min_length=1)
"""At least one of a list."""


def format_value(value: float) -> str:
    """``value`` for a name: what is different by more than rounding reads differently."""
    return f"{value:.12g}"


def make_constant_command(pressure: float) -> Callable[[Array], Array]:
    """A command that stays at ``pressure`` [Pa]."""
    return lambda time: np.full(len(time), pressure)


class TrialPlan(NamedTuple):
    """One trial."""

    name: str
    """Fit for a file's name, and of this trial alone."""
    conditions: Mapping[str, float]
    """What was set, keys with units."""
    trajectory: LengthTrajectory
    """Of the unit's length."""
    command: Callable[[Array], Array]
    """Time [s] -> gauge pressure [Pa]."""
    event_times: Mapping[str, float]
    """Instants [s] and lengths [m] that the readings go by."""


class BenchProtocol(BaseModel):
    """A protocol file: what is done, at what, and where its numbers are from."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    summary: ClassVar[str]
    """One sentence: what this kind of test does."""

    kind: str
    name: Annotated[str, Field(min_length=1)]
    description: str = ""
    pressures_bar: Annotated[list[NonNegative], NonEmpty]
    """Gauge pressures."""
    rest_s: Positive = 0.5
    """At rest before anything happens; the trial begins in equilibrium."""
    sources: dict[str, str] = {}
    """Key -> where its numbers are from; begins with 'assumed' if nobody printed them."""

    @abstractmethod
    def plan_trials(self, device: Device) -> Sequence[TrialPlan]:
        """The trials for ``device``; raises InputError for what it cannot do."""

    def check_time_step(self, dt: float) -> None:
        """Raise InputError for a time ``step`` [s] that is too long for what is read."""

    @abstractmethod
    def compute_metrics(self, device: Device, plan: TrialPlan, recording: Recording) -> dict[str, float]:
        """What is read off a ``recording`` at its full rate, keys with units; NaN where there is nothing to read."""

    def numeric_keys(self) -> list[str]:
        """The keys that hold numbers."""
        return [key for key, value in self.model_dump().items() if isinstance(value, int | float | list)]

    def list_assumptions(self) -> dict[str, str]:
        """The keys whose numbers nobody printed -> why."""
        return {key: source for key, source in self.sources.items() if source.startswith("assumed")}
