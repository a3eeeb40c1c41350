"""Every assumed number of a device, why it was assumed, and what it changes."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from klute_sim.dataset.override import overridden
from klute_sim.device.files import Device
from klute_sim.device.rollout import Trace, rollout
from klute_sim.device.step import Parameters, settled
from klute_sim.errors import InputError
from klute_sim.laws import mckibben, pneumatics
from klute_sim.laws import tendon as tendon_law
from klute_sim.reproduce.picture import Array

KELVIN = 10.0
"""By which a temperature is moved."""
SHARE = 0.1
"""Of an assumed number, by which it is moved to see what it changes; a whole number is moved by 1."""
RATIO = 0.96
"""Muscle length over resting length at which forces are read, as in Fig. 3.9."""
SHORTENING, LENGTHENING, CYCLE = 0.3, 0.15, 0.1
"""Speeds [m/s] at which forces are read, and of the work loop."""
TRAVEL = 0.008
"""To either side of where force is read [m]; less where a muscle has less room up to its resting length."""
STEP = 2.5e-4
"""[s]"""
HOLD = 0.6
"""Time at rest [s] for pressure to come and go."""

Outcomes = Callable[[Device], Mapping[str, float]]
"""Name with its unit -> value."""


class Assumption(NamedTuple):
    """A number that nobody printed."""

    key: str
    value: float
    why: str
    moved: float
    """The value it was tried with."""
    changes: dict[str, float]
    """Outcome -> relative change; for one that is 0 before, nothing."""


def changes(device: Device, outcomes: Outcomes, told: Callable[[float], None] = lambda share: None) -> list[Assumption]:
    """The assumed numbers of ``device`` in its file's order; ``outcomes`` says what is looked at."""
    before, numbers, assumed = outcomes(device), device.spec.numbers(), device.spec.assumed()
    found = []
    for count, (key, why) in enumerate(assumed.items(), start=1):
        other = _moved(device, key, numbers[key])
        after = outcomes(other)
        relative = {name: after[name] / before[name] - 1.0 for name in before if before[name]}
        reason = why.removeprefix("assumed").lstrip(": ")
        found.append(Assumption(key, numbers[key], reason, other.spec.numbers()[key], relative))
        told(count / len(assumed))
    return found


def _moved(device: Device, key: str, value: float) -> Device:
    """``device`` with number ``key`` a little larger; smaller where it cannot be larger."""
    by: float = 1 if isinstance(value, int) else SHARE * (abs(value) or 1.0)
    if key.endswith("_c"):
        by = KELVIN
    try:
        return overridden(device, {key: value + by}, "tried")
    except InputError:
        return overridden(device, {key: value - by}, "tried")


def on_bench(device: Device) -> Outcomes:
    """What a tensile tester would see of a device like ``device``: always at the lengths that suit that one."""
    nominal = device.parameters
    pressure, rest = nominal.supply.pressure, nominal.muscle.resting_length
    pull = max(0.0, mckibben.force(nominal.muscle, pressure, RATIO * rest))
    stretch = 0.0 if nominal.tendon.rigid else tendon_law.stretch_under(nominal.tendon, pull)
    there = nominal.tendon.slack_length + stretch + RATIO * rest
    travel = min(TRAVEL, 0.9 * (1.0 - RATIO) * rest)

    def outcomes(other: Device) -> Mapping[str, float]:
        return _outcomes(other.parameters, there, travel, pressure)

    return outcomes


def _outcomes(parameters: Parameters, there: float, travel: float, pressure: float) -> Mapping[str, float]:
    hold = round(HOLD / STEP)
    still = np.full(2 * hold, there)
    step = np.where(np.arange(2 * hold) < hold, 0.0, pressure)
    rise = _pulled(parameters, still, step)
    force = float(rise.tension[-1])
    after = rise.tension[hold:]
    reached = np.flatnonzero(after >= 0.9 * force)
    found = {
        "isometric force": force,
        "time to 90 % of force": STEP * float(reached[0] + 1) if force > 0.0 and len(reached) else 0.0,
        f"force shortening at {1e3 * SHORTENING:.0f} mm/s": _moving(parameters, there, travel, -SHORTENING, pressure),
        f"force lengthening at {1e3 * LENGTHENING:.0f} mm/s": _moving(parameters, there, travel, LENGTHENING, pressure),
        "net work of a cycle": _work(parameters, there, travel, pressure),
    }
    muscle, temperature = parameters.muscle, parameters.supply.temperature
    volume = mckibben.volume(muscle, float(rise.length[-1]))
    found["air in the muscle"] = pneumatics.air_mass(float(rise.pressure[-1]), volume, temperature)
    return found


def _pulled(parameters: Parameters, length: Array, command: Array) -> Trace:
    """From rest at the first ``length`` [m] and ``command`` [Pa] through all of them, one per :data:`STEP`."""
    start = settled(parameters, float(length[0]), float(command[0]))
    return rollout(parameters, length, command, STEP, start=start, threads=1)


def _moving(parameters: Parameters, there: float, travel: float, speed: float, pressure: float) -> float:
    """Force [N] in passing unit length ``there`` [m] at ``speed`` [m/s], lengthening positive; 0: at rest.

    The ramp begins and ends ``travel`` [m] from there.
    """
    if speed == 0.0:
        return float(_pulled(parameters, np.full(4, there), np.full(4, pressure)).tension[-1])
    count = round(2.0 * travel / abs(speed) / STEP)
    ramp = there + np.sign(speed) * travel * np.linspace(-1.0, 1.0, count + 1)
    found = _pulled(parameters, ramp, np.full(len(ramp), pressure))
    return float(np.interp(0.0, np.sign(speed) * (ramp - there), found.tension))


def _work(parameters: Parameters, there: float, travel: float, pressure: float) -> float:
    """Net work [J] of a cycle with pressure while shortening, which comes and goes while the crosshead stands."""
    hold, move = round(HOLD / STEP), round(2.0 * travel / CYCLE / STEP)
    down, up = np.linspace(travel, -travel, move), np.linspace(-travel, travel, move)
    length = there + np.concatenate([np.full(hold, travel), down, np.full(hold, -travel), up])
    command = np.concatenate([np.full(hold + move, pressure), np.zeros(hold + move)])
    found = _pulled(parameters, length, command)
    return float(-np.sum(0.5 * (found.tension[1:] + found.tension[:-1]) * np.diff(length)))
