"""Runs of every baseline at the reference speed, slower, faster, uphill and downhill, and their table."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from klute_sim.baselines.library import Baseline
from klute_sim.errors import InputError
from klute_sim.gait.rig.setup import build_gait_rig
from klute_sim.gait.subject import Subject
from klute_sim.laws.pneumatics import air_mass
from klute_sim.parameter_sweep.evaluate import CONTACT_LOST_COLUMN, TRIPS_COLUMN, UNTRACKED_COLUMN, CaseResult
from klute_sim.parameter_sweep.fingerprint import fingerprint_software
from klute_sim.parameter_sweep.plan import GaitCase
from klute_sim.units import BAR

SLOW_SPEED_RATIO, FAST_SPEED_RATIO, SLOPE_DEG = 0.8, 1.25, 5.0
"""Slow and fast speed relative to that of the subject, and the default ground slope in either direction [deg]."""
TANK_VOLUME_M3, TANK_PRESSURE_PA, MIN_TANK_PRESSURE_PA = 1e-3, 30.0 * BAR, 6.0 * BAR
"""Volume of a wearable air tank (assumed), its full gauge pressure, and the lowest usable one: supply plus 1 bar."""
TANK_TEMPERATURE_K = 293.15
"""Temperature of the air in the tank (assumed)."""


@dataclass(frozen=True)
class WalkingCondition:
    """A speed and a slope at which every baseline is simulated."""

    name: str
    """Name of the condition."""
    speed_ratio: float = 1.0
    """Walking speed relative to that of the subject on the level [1]."""
    slope_deg: float = 0.0
    """Ground slope [deg], uphill positive."""


def create_conditions(slope_deg: float = SLOPE_DEG) -> tuple[WalkingCondition, ...]:
    """Return the conditions with a ``slope_deg`` [deg] downhill and uphill.

    Raises InputError when it is out of range.
    """
    if not 0.0 < slope_deg <= 10.0:
        raise InputError(f"slope is {slope_deg:g}; allowed: above 0, up to 10 degrees, downhill and uphill")
    return (
        WalkingCondition("level"),
        WalkingCondition("slower", speed_ratio=SLOW_SPEED_RATIO),
        WalkingCondition("faster", speed_ratio=FAST_SPEED_RATIO),
        WalkingCondition("downhill", slope_deg=-slope_deg),
        WalkingCondition("uphill", slope_deg=slope_deg),
    )


@dataclass(frozen=True)
class BaselineRun:
    """A baseline in a walking condition, and the result of its simulation."""

    baseline: Baseline
    """Baseline that is simulated."""
    condition: WalkingCondition
    """Speed and slope."""
    case: GaitCase
    """Inputs of the simulation."""
    result: CaseResult | None = None
    """Result of the simulation; None before it, or when its process was killed in every attempt."""

    @property
    def metrics(self) -> dict[str, Any]:
        """Value by column; empty where there are no metrics."""
        return {} if self.result is None else dict(self.result.metrics)

    @property
    def remark(self) -> str | None:
        """Failure of the run, or a doubt about its metrics; None: neither."""
        doubts = {UNTRACKED_COLUMN: "load not tracked", CONTACT_LOST_COLUMN: "contact lost in stance"}
        return self.failure or ", ".join(text for column, text in doubts.items() if self.metrics.get(column)) or None

    @property
    def failure(self) -> str | None:
        """Reason why the simulation failed or the gait is unusable; None: neither."""
        if self.result is None:
            return "its process was killed"
        return self.result.failure or ("the toe catches in swing" if self.result.metrics[TRIPS_COLUMN] else None)


def plan_runs(
    baselines: Sequence[Baseline],
    subject: Subject,
    strides: int,
    dt: float,
    conditions: Iterable[WalkingCondition] = create_conditions(),
) -> list[BaselineRun]:
    """Return the runs of ``baselines`` with ``subject`` in ``conditions``: number of strides, time step ``dt`` [s].

    Speed and slope of the conditions replace those of the subject. Raises InputError when a value is out of range.
    """
    conditions, options = list(conditions), subject.build_options(strides, dt)
    nominal_speed: dict[str, float] = {}
    runs = []
    for baseline in baselines:
        digest = baseline.device.digest
        if digest not in nominal_speed:
            nominal_speed[digest] = build_gait_rig(baseline.device, options, dt).trajectory.speed
        for condition in conditions:
            is_nominal = condition.speed_ratio == 1.0
            speed = subject.speed if is_nominal else round(condition.speed_ratio * nominal_speed[digest], 6)
            case = GaitCase(
                device_name=baseline.device.name,
                device=baseline.device,
                controller_name=baseline.name,
                controller=baseline.controller,
                subject=replace(subject, speed=speed, slope_deg=condition.slope_deg),
                strides=strides,
                dt=dt,
                foot_stiffness=baseline.foot_stiffness,
            )
            runs.append(BaselineRun(baseline, condition, case))
    return runs


def describe_runs(runs: Sequence[BaselineRun], subject: Subject) -> dict[str, Any]:
    """Return the plan of ``runs`` with ``subject`` in JSON types, for the result folder."""
    return {
        **subject.describe(),
        "baselines": list(dict.fromkeys(run.baseline.name for run in runs)),
        "cases": [run.case.key for run in runs],
        "software": fingerprint_software(),
    }


def compute_strides_per_tank(air_g: float | None) -> float | None:
    """Return the number of strides of ``air_g`` grams that a tank holds; None for a foot that consumes no air."""
    if not air_g:
        return None
    usable_kg = air_mass(TANK_PRESSURE_PA, TANK_VOLUME_M3, TANK_TEMPERATURE_K) - air_mass(
        MIN_TANK_PRESSURE_PA, TANK_VOLUME_M3, TANK_TEMPERATURE_K
    )
    return math.floor(1e3 * usable_kg / air_g)


def build_rows(runs: Iterable[BaselineRun]) -> list[dict[str, Any]]:
    """Return one row per run in JSON types: baseline, condition, metrics, strides per tank, failure, remark."""
    return [
        {
            "baseline": run.baseline.name,
            "condition": run.condition.name,
            "speed_requested [m/s]": run.case.subject.speed,
            "slope [deg]": run.case.subject.slope_deg,
            **run.metrics,
            "strides_per_tank [1]": compute_strides_per_tank(run.metrics.get("air_per_stride [g]")),
            "failure": run.failure,
            "remark": run.remark,
        }
        for run in runs
    ]
