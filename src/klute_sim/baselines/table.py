"""Every baseline at the reference's speed, slower and faster, uphill and downhill."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from klute_sim.baselines.library import Baseline
from klute_sim.laws.pneumatics import air_mass
from klute_sim.report.table import FOLLOWED
from klute_sim.rigs.gait.assembly import GaitOptions, assemble
from klute_sim.sweep.plan import Combination
from klute_sim.sweep.software import software
from klute_sim.sweep.walk import TRIPS, Walked
from klute_sim.units import BAR

SLOWER, FASTER, SLOPE = 0.8, 1.25, 5.0
"""Shares of the reference's speed, and the slope either way [degrees]."""
TANK_VOLUME, TANK_PRESSURE, TANK_LEFT = 1e-3, 30.0 * BAR, 6.0 * BAR
"""Of a tank that could be worn (assumed) [m3], filled to [Pa, gauge], and no use below, a bar above the supply."""
TEMPERATURE = 293.15
"""Of the air in it (assumed) [K]."""


@dataclass(frozen=True)
class Condition:
    """How everybody walks."""

    name: str
    share: float = 1.0
    """Of the reference's speed."""
    slope_deg: float = 0.0


CONDITIONS = (
    Condition("level"),
    Condition("slower", share=SLOWER),
    Condition("faster", share=FASTER),
    Condition("downhill", slope_deg=-SLOPE),
    Condition("uphill", slope_deg=SLOPE),
)


@dataclass(frozen=True)
class Entry:
    """A baseline in a condition, and what became of it; None: its process was killed again and again."""

    baseline: Baseline
    condition: Condition
    combination: Combination
    walked: Walked | None = None

    @property
    def outcomes(self) -> dict[str, Any]:
        """Heading -> value; empty where there are none."""
        return {} if self.walked is None else dict(self.walked.outcomes)

    @property
    def remark(self) -> str | None:
        """What is not as it should be; None: nothing."""
        tracking = self.outcomes.get("grf_vertical_tracking_rms [1]")
        return self.failure or ("the load was not followed" if tracking is not None and tracking > FOLLOWED else None)

    @property
    def failure(self) -> str | None:
        """Why it does not walk, or walks badly; None: it walks."""
        if self.walked is None:
            return "its process was killed"
        return self.walked.failure or ("the toe catches in swing" if self.walked.outcomes[TRIPS] else None)


def entries(
    baselines: Sequence[Baseline], mass: float, strides: int, step: float, conditions: Iterable[Condition] = CONDITIONS
) -> list[Entry]:
    """What is to be walked by somebody of ``mass`` [kg], ``strides`` at ``step`` [s]; raises InputError."""
    conditions, usual, options = list(conditions), {}, GaitOptions(mass=mass, strides=strides, step=step)
    found = []
    for baseline in baselines:
        if baseline.device.digest not in usual:
            usual[baseline.device.digest] = assemble(baseline.device, options, step).plan.speed
        own = usual[baseline.device.digest]
        for condition in conditions:
            combination = Combination(
                device_word=baseline.device.name,
                device=baseline.device,
                controller_word=baseline.name,
                controller=baseline.controller,
                speed=None if condition.share == 1.0 else round(condition.share * own, 6),
                slope_deg=condition.slope_deg,
                mass=mass,
                strides=strides,
                step=step,
                foot=baseline.foot,
            )
            found.append(Entry(baseline, condition, combination))
    return found


def described(planned: Sequence[Entry]) -> dict[str, Any]:
    """What is walked in JSON types, for the folder that keeps it."""
    return {"walks": [each.combination.key for each in planned], "software": software()}


def strides_per_tank(air_g: float | None) -> float | None:
    """How many strides the tank holds at ``air_g`` in each; None for a foot that takes none."""
    if not air_g:
        return None
    held = air_mass(TANK_PRESSURE, TANK_VOLUME, TEMPERATURE) - air_mass(TANK_LEFT, TANK_VOLUME, TEMPERATURE)
    return math.floor(1e3 * held / air_g)


def rows(found: Iterable[Entry]) -> list[dict[str, Any]]:
    """JSON types: baseline, condition, outcomes, strides per tank, failure."""
    return [
        {
            "baseline": each.baseline.name,
            "condition": each.condition.name,
            "speed_asked [m/s]": each.combination.speed,
            "slope [deg]": each.condition.slope_deg,
            **each.outcomes,
            "strides_per_tank [1]": strides_per_tank(each.outcomes.get("air_per_stride [g]")),
            "failure": each.failure,
            "remark": each.remark,
        }
        for each in found
    ]
