"""Every assumed number of a device, why it was assumed, and what it changes."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from klute_sim.device.changes import apply_changes
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceParameters, compute_equilibrium_state
from klute_sim.device.rollout import RolloutTrace, simulate_rollouts
from klute_sim.errors import InputError
from klute_sim.laws import mckibben, pneumatics
from klute_sim.laws import tendon as tendon_law
from klute_sim.reproduction.curves import Array

TEMPERATURE_CHANGE_K = 10.0
"""By which a temperature is moved."""
RELATIVE_CHANGE = 0.1
"""Of an assumed number, by which it is moved to see what it changes; a whole number is moved by 1."""
LENGTH_RATIO = 0.96
"""Muscle length over resting length at which forces are read, as in Fig. 3.9."""
SHORTENING_SPEED, LENGTHENING_SPEED, WORK_LOOP_SPEED = 0.3, 0.15, 0.1
"""Speeds [m/s] at which forces are read, and of the work loop."""
MAX_HALF_STROKE = 0.008
"""To either side of where force is read [m]; less where a muscle has less room up to its resting length."""
TIME_STEP = 2.5e-4
"""[s]"""
HOLD_DURATION = 0.6
"""Time at rest [s] for pressure to come and go."""

MetricsFunction = Callable[[Device], Mapping[str, float]]
"""Name with its unit -> value."""


class AssumptionEffect(NamedTuple):
    """A number that nobody printed."""

    key: str
    value: float
    reason: str
    perturbed_value: float
    """The value it was tried with."""
    relative_changes: dict[str, float]
    """Outcome -> relative change; for one that is 0 before, nothing."""


def perturb_assumptions(
    device: Device, compute_metrics: MetricsFunction, progress: Callable[[float], None] = lambda share: None
) -> list[AssumptionEffect]:
    """The assumed numbers of ``device`` in its file's order; ``outcomes`` says what is looked at."""
    before, numbers, assumed = compute_metrics(device), device.spec.collect_values(), device.spec.collect_assumptions()
    found = []
    for count, (key, why) in enumerate(assumed.items(), start=1):
        other = _perturb(device, key, numbers[key])
        after = compute_metrics(other)
        relative = {name: after[name] / before[name] - 1.0 for name in before if before[name]}
        reason = why.removeprefix("assumed").lstrip(": ")
        found.append(AssumptionEffect(key, numbers[key], reason, other.spec.collect_values()[key], relative))
        progress(count / len(assumed))
    return found


def _perturb(device: Device, key: str, value: float) -> Device:
    """``device`` with number ``key`` a little larger; smaller where it cannot be larger."""
    by: float = 1 if isinstance(value, int) else RELATIVE_CHANGE * (abs(value) or 1.0)
    if key.endswith("_c"):
        by = TEMPERATURE_CHANGE_K
    try:
        return apply_changes(device, {key: value + by}, "tried")
    except InputError:
        return apply_changes(device, {key: value - by}, "tried")


def make_bench_metrics(device: Device) -> MetricsFunction:
    """What a tensile tester would see of a device like ``device``: always at the lengths that suit that one."""
    nominal = device.parameters
    pressure, rest = nominal.supply.max_pressure, nominal.muscle.resting_length
    pull = max(0.0, mckibben.force(nominal.muscle, pressure, LENGTH_RATIO * rest))
    stretch = 0.0 if nominal.tendon.is_rigid else tendon_law.stretch_at_tension(nominal.tendon, pull)
    there = nominal.tendon.slack_length + stretch + LENGTH_RATIO * rest
    travel = min(MAX_HALF_STROKE, 0.9 * (1.0 - LENGTH_RATIO) * rest)

    def outcomes(other: Device) -> Mapping[str, float]:
        return _compute_bench_metrics(other.parameters, there, travel, pressure)

    return outcomes


def _compute_bench_metrics(
    parameters: DeviceParameters, unit_length: float, half_stroke: float, pressure: float
) -> Mapping[str, float]:
    hold = round(HOLD_DURATION / TIME_STEP)
    still = np.full(2 * hold, unit_length)
    step = np.where(np.arange(2 * hold) < hold, 0.0, pressure)
    rise = _simulate(parameters, still, step)
    force = float(rise.tension[-1])
    after = rise.tension[hold:]
    reached = np.flatnonzero(after >= 0.9 * force)
    found = {
        "isometric force": force,
        "time to 90 % of force": TIME_STEP * float(reached[0] + 1) if force > 0.0 and len(reached) else 0.0,
        f"force shortening at {1e3 * SHORTENING_SPEED:.0f} mm/s": _force_at_speed(
            parameters, unit_length, half_stroke, -SHORTENING_SPEED, pressure
        ),
        f"force lengthening at {1e3 * LENGTHENING_SPEED:.0f} mm/s": _force_at_speed(
            parameters, unit_length, half_stroke, LENGTHENING_SPEED, pressure
        ),
        "net work of a cycle": _net_work(parameters, unit_length, half_stroke, pressure),
    }
    muscle, temperature = parameters.muscle, parameters.supply.temperature
    volume = mckibben.volume(muscle, float(rise.length[-1]))
    found["air in the muscle"] = pneumatics.air_mass(float(rise.pressure[-1]), volume, temperature)
    return found


def _simulate(parameters: DeviceParameters, length: Array, command: Array) -> RolloutTrace:
    """From rest at the first ``length`` [m] and ``command`` [Pa] through all of them, one per :data:`STEP`."""
    start = compute_equilibrium_state(parameters, float(length[0]), float(command[0]))
    return simulate_rollouts(parameters, length, command, TIME_STEP, initial_state=start, n_jobs=1)


def _force_at_speed(
    parameters: DeviceParameters, unit_length: float, half_stroke: float, speed: float, pressure: float
) -> float:
    """Force [N] in passing unit length ``there`` [m] at ``speed`` [m/s], lengthening positive; 0: at rest.

    The ramp begins and ends ``travel`` [m] from there.
    """
    if speed == 0.0:
        return float(_simulate(parameters, np.full(4, unit_length), np.full(4, pressure)).tension[-1])
    count = round(2.0 * half_stroke / abs(speed) / TIME_STEP)
    ramp = unit_length + np.sign(speed) * half_stroke * np.linspace(-1.0, 1.0, count + 1)
    found = _simulate(parameters, ramp, np.full(len(ramp), pressure))
    return float(np.interp(0.0, np.sign(speed) * (ramp - unit_length), found.tension))


def _net_work(parameters: DeviceParameters, unit_length: float, half_stroke: float, pressure: float) -> float:
    """Net work [J] of a cycle with pressure while shortening, which comes and goes while the crosshead stands."""
    hold, move = round(HOLD_DURATION / TIME_STEP), round(2.0 * half_stroke / WORK_LOOP_SPEED / TIME_STEP)
    down, up = np.linspace(half_stroke, -half_stroke, move), np.linspace(-half_stroke, half_stroke, move)
    length = unit_length + np.concatenate([np.full(hold, half_stroke), down, np.full(hold, -half_stroke), up])
    command = np.concatenate([np.full(hold + move, pressure), np.zeros(hold + move)])
    found = _simulate(parameters, length, command)
    return float(-np.sum(0.5 * (found.tension[1:] + found.tension[:-1]) * np.diff(length)))
