"""Every baseline at the reference's speed, slower and faster, uphill and downhill."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from klute_sim.baselines.library import Baseline
from klute_sim.gait.rig.setup import GaitOptions, build_gait_rig
from klute_sim.laws.pneumatics import air_mass
from klute_sim.parameter_sweep.evaluate import TRIPS_COLUMN, CaseResult
from klute_sim.parameter_sweep.fingerprint import fingerprint_software
from klute_sim.parameter_sweep.plan import GaitCase
from klute_sim.report.gait.table import MAX_GRF_TRACKING_RMS_BW
from klute_sim.units import BAR

SLOW_SPEED_RATIO, FAST_SPEED_RATIO, SLOPE_DEG = 0.8, 1.25, 5.0
"""Shares of the reference's speed, and the slope either way [degrees]."""
TANK_VOLUME_M3, TANK_PRESSURE_PA, MIN_TANK_PRESSURE_PA = 1e-3, 30.0 * BAR, 6.0 * BAR
"""Of a tank that could be worn (assumed) [m3], filled to [Pa, gauge], and no use below, a bar above the supply."""
TANK_TEMPERATURE_K = 293.15
"""Of the air in it (assumed) [K]."""


@dataclass(frozen=True)
class WalkingCondition:
    """How everybody walks."""

    name: str
    speed_ratio: float = 1.0
    """Of the reference's speed."""
    slope_deg: float = 0.0


CONDITIONS = (
    WalkingCondition("level"),
    WalkingCondition("slower", speed_ratio=SLOW_SPEED_RATIO),
    WalkingCondition("faster", speed_ratio=FAST_SPEED_RATIO),
    WalkingCondition("downhill", slope_deg=-SLOPE_DEG),
    WalkingCondition("uphill", slope_deg=SLOPE_DEG),
)


@dataclass(frozen=True)
class BaselineRun:
    """A baseline in a condition, and what became of it; None: its process was killed again and again."""

    baseline: Baseline
    condition: WalkingCondition
    case: GaitCase
    result: CaseResult | None = None

    @property
    def metrics(self) -> dict[str, Any]:
        """Heading -> value; empty where there are none."""
        return {} if self.result is None else dict(self.result.metrics)

    @property
    def remark(self) -> str | None:
        """What is not as it should be; None: nothing."""
        tracking = self.metrics.get("grf_vertical_tracking_rms [1]")
        return self.failure or (
            "the load was not followed" if tracking is not None and tracking > MAX_GRF_TRACKING_RMS_BW else None
        )

    @property
    def failure(self) -> str | None:
        """Why it does not walk, or walks badly; None: it walks."""
        if self.result is None:
            return "its process was killed"
        return self.result.failure or ("the toe catches in swing" if self.result.metrics[TRIPS_COLUMN] else None)


def plan_runs(
    baselines: Sequence[Baseline],
    mass: float,
    strides: int,
    dt: float,
    conditions: Iterable[WalkingCondition] = CONDITIONS,
) -> list[BaselineRun]:
    """What is to be walked by somebody of ``mass`` [kg], ``strides`` at ``step`` [s]; raises InputError."""
    conditions, usual, options = list(conditions), {}, GaitOptions(mass=mass, strides=strides, dt=dt)
    found = []
    for baseline in baselines:
        if baseline.device.digest not in usual:
            usual[baseline.device.digest] = build_gait_rig(baseline.device, options, dt).trajectory.speed
        own = usual[baseline.device.digest]
        for condition in conditions:
            combination = GaitCase(
                device_name=baseline.device.name,
                device=baseline.device,
                controller_name=baseline.name,
                controller=baseline.controller,
                speed=None if condition.speed_ratio == 1.0 else round(condition.speed_ratio * own, 6),
                slope_deg=condition.slope_deg,
                mass=mass,
                strides=strides,
                dt=dt,
                foot_stiffness=baseline.foot_stiffness,
            )
            found.append(BaselineRun(baseline, condition, combination))
    return found


def describe_runs(runs: Sequence[BaselineRun]) -> dict[str, Any]:
    """What is walked in JSON types, for the folder that keeps it."""
    return {"walks": [each.case.key for each in runs], "software": fingerprint_software()}


def compute_strides_per_tank(air_g: float | None) -> float | None:
    """How many strides the tank holds at ``air_g`` in each; None for a foot that takes none."""
    if not air_g:
        return None
    held = air_mass(TANK_PRESSURE_PA, TANK_VOLUME_M3, TANK_TEMPERATURE_K) - air_mass(
        MIN_TANK_PRESSURE_PA, TANK_VOLUME_M3, TANK_TEMPERATURE_K
    )
    return math.floor(1e3 * held / air_g)


def build_rows(runs: Iterable[BaselineRun]) -> list[dict[str, Any]]:
    """JSON types: baseline, condition, outcomes, strides per tank, failure."""
    return [
        {
            "baseline": each.baseline.name,
            "condition": each.condition.name,
            "speed_asked [m/s]": each.case.speed,
            "slope [deg]": each.condition.slope_deg,
            **each.metrics,
            "strides_per_tank [1]": compute_strides_per_tank(each.metrics.get("air_per_stride [g]")),
            "failure": each.failure,
            "remark": each.remark,
        }
        for each in runs
    ]
