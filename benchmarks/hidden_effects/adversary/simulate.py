"""Motion of the unit: a diagonally implicit Runge-Kutta method of second order for the muscle's length.

The balance of the junction, muscle and damper against tendon, is solved for the velocity in both stages (Alexander
1977, L-stable). States of friction and creep are advanced exactly for the mean velocity of a stage.
"""

import math
from typing import NamedTuple

import numpy as np
from benchmarks.hidden_effects.adversary.compiled import compile_cached
from benchmarks.hidden_effects.adversary.friction import deflect
from benchmarks.hidden_effects.adversary.muscle import (
    air_volume,
    braid_area,
    braid_friction_level,
    gas_tension,
    rubber_damping_tension,
    rubber_tension,
)
from benchmarks.hidden_effects.adversary.rig import Rig
from benchmarks.hidden_effects.adversary.series import oil_tension, seal_friction_level, spring_tension
from benchmarks.hidden_effects.adversary.supply import rest_air, step_air

STEP = 0.25e-3
"""Step of the integration [s]."""
GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
STOP_STIFFNESS = 5e7
"""Stiffness of the stop at the resting length [N/m] (assumed: rigid)."""
CREEP_TIMES = np.logspace(-2.0, 3.0, 11)
"""Relaxation times, two per decade [s]: a flat spectrum, whose relaxation is logarithmic (Fung)."""
CREEP_BRANCHES_PER_DECADE = 2.0
TENDON_REACH = 0.4e-3
"""Stretch over which the friction of the tendon builds up [m] (assumed)."""
STRIBECK_EXCESS = 0.25
"""Excess of dry friction at rest over that in motion (assumed)."""
MAX_VELOCITY = 5.0
VELOCITY_TOLERANCE = 1e-9
FORCE_TOLERANCE = 1e-5


class Motion(NamedTuple):
    """What happened, at every step."""

    force: np.ndarray
    """Tension of the unit [N]."""
    pressure: np.ndarray
    """Gauge pressure in the muscle [Pa]."""
    muscle_length: np.ndarray
    """Length of the muscle [m]."""


class Stage(NamedTuple):
    """One stage of the balance of the junction."""

    base: float
    """Length of the muscle at zero velocity [m]."""
    span: float
    """Change of the length over the velocity [s]."""
    duration: float
    """Time since the beginning of the step [s]."""
    unit: float
    """Length of the unit [m]."""
    pressure: float
    """Gauge pressure [Pa]."""
    start: float
    """Length of the muscle at the beginning of the step [m]."""
    stretch: float
    """Stretch of the tendon at the beginning of the step [m]."""
    braid_level: float
    """Friction of the braid [N]."""
    braid: float
    """Relative deflection of the braid's bristles at the beginning of the step."""
    seal: float
    tendon: float
    creep_tension: float
    """Tension of all creep branches, decayed to this stage, without the change of length since the step began [N]."""
    creep_weight: float
    """Tension of the branches over a change of the elastic tension."""
    elastic: float
    """Elastic tension of the bladder at the beginning of the step [N]."""


@compile_cached
def measure_imbalance(velocity: float, stage: Stage, rig: Rig) -> float:
    """Return the tension of muscle and damper less that of the tendon [N], which grows with the velocity."""
    length = stage.base + stage.span * velocity
    travel = length - stage.start
    elastic = rubber_tension(length, rig)
    tension = gas_tension(stage.pressure, length, rig) + elastic
    tension += stage.creep_tension + stage.creep_weight * (elastic - stage.elastic)
    oil = oil_tension(velocity, rig)
    tension += oil
    if rig.rubber_damping > 0.0:
        tension += rubber_damping_tension(velocity, rig)
    if rig.braid_friction > 0.0:
        tension += stage.braid_level * deflect(stage.braid, travel, stage.duration, rig.braid_reach, STRIBECK_EXCESS)
    if rig.seal_friction > 0.0:
        bristle = deflect(stage.seal, travel, stage.duration, rig.seal_reach, STRIBECK_EXCESS)
        tension += seal_friction_level(oil, rig) * bristle
    if length > rig.resting_length:
        tension += STOP_STIFFNESS * (length - rig.resting_length)
    return tension - pull_tendon(stage.unit - length, stage, rig)


@compile_cached
def pull_tendon(tendon_length: float, stage: Stage, rig: Rig) -> float:
    """Return the tension of the tendon [N], whose fibres rub on each other."""
    stretch = tendon_length - rig.slack_length
    spring = spring_tension(stretch, rig)
    if rig.tendon_loss > 0.0:
        spring *= 1.0 + rig.tendon_loss * deflect(
            stage.tendon, stretch - stage.stretch, stage.duration, TENDON_REACH, 0.0
        )
    return spring


@compile_cached
def solve_velocity(guess: float, stage: Stage, rig: Rig) -> float:
    """Return the velocity [m/s] at which the junction is in balance: a bracketed secant method (Illinois)."""
    low = high = guess
    f_low = f_high = measure_imbalance(guess, stage, rig)
    width = 1e-5
    while f_low > 0.0 and low > -MAX_VELOCITY:
        high, f_high = low, f_low
        low -= width
        width *= 4.0
        f_low = measure_imbalance(low, stage, rig)
    while f_high < 0.0 and high < MAX_VELOCITY:
        low, f_low = high, f_high
        high += width
        width *= 4.0
        f_high = measure_imbalance(high, stage, rig)
    if f_low >= 0.0:
        return low
    if f_high <= 0.0:
        return high
    side = 0
    for _ in range(80):
        middle = (f_low * high - f_high * low) / (f_low - f_high)
        value = measure_imbalance(middle, stage, rig)
        if abs(value) < FORCE_TOLERANCE or high - low < VELOCITY_TOLERANCE:
            return middle
        if value > 0.0:
            high, f_high = middle, value
            if side == 1:
                f_low *= 0.5
            side = 1
        else:
            low, f_low = middle, value
            if side == -1:
                f_high *= 0.5
            side = -1
    return 0.5 * (low + high)


@compile_cached
def find_rest_length(unit: float, pressure: float, rig: Rig) -> float:
    """Return the length of the muscle at rest without friction and creep [m], by bisection."""
    low, high = 0.55 * rig.resting_length, 1.001 * rig.resting_length
    for _ in range(60):
        length = 0.5 * (low + high)
        balance = gas_tension(pressure, length, rig) + rubber_tension(length, rig)
        balance += STOP_STIFFNESS * max(length - rig.resting_length, 0.0)
        if balance > spring_tension(unit - length - rig.slack_length, rig):
            high = length
        else:
            low = length
    return 0.5 * (low + high)


@compile_cached
def move_unit(
    unit: np.ndarray, command: np.ndarray, rig: Rig, step: float, creep_times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return force, pressure and muscle length of a unit that begins at rest, at every ``step``."""
    n = len(unit)
    force, pressures, lengths = np.empty(n), np.empty(n), np.empty(n)
    pressure = min(rig.regulator_gain * command[0], rig.supply_pressure)
    length = find_rest_length(unit[0], pressure, rig)
    air = rest_air(pressure, air_volume(length, pressure, rig), rig)
    creep = np.zeros(len(creep_times))
    weight = rig.creep_per_decade / CREEP_BRANCHES_PER_DECADE
    total_weight = weight * len(creep_times)
    braid = seal = tendon = velocity = 0.0
    for k in range(n):
        previous = unit[max(k - 1, 0)]
        rate = 0.0
        if rig.has_valve or rig.flow_droop > 0.0:
            rate = rig.count * braid_area(length, pressure, rig) * velocity
        step_air(air, command[k], air_volume(length, pressure, rig), rate, step, rig)
        pressure = air[4]
        level = braid_friction_level(pressure, length, rig)
        elastic = rubber_tension(length, rig)
        stretch = previous - length - rig.slack_length
        decayed = weight * np.sum(creep * np.exp(-GAMMA * step / creep_times)) if weight > 0.0 else 0.0
        stage = Stage(
            length, GAMMA * step, GAMMA * step, previous + GAMMA * (unit[k] - previous), pressure, length, stretch,
            level, braid, seal, tendon, decayed, total_weight, elastic,
        )  # fmt: skip
        first = solve_velocity(velocity, stage, rig)
        if weight > 0.0:
            creep *= np.exp(-step / creep_times)
            decayed = weight * np.sum(creep)
        stage = Stage(
            length + (1.0 - GAMMA) * step * first, GAMMA * step, step, unit[k], pressure, length, stretch,
            level, braid, seal, tendon, decayed, total_weight, elastic,
        )  # fmt: skip
        second = solve_velocity(first, stage, rig)
        end = stage.base + stage.span * second
        force[k] = pull_tendon(unit[k] - end, stage, rig)
        travel = end - length
        velocity = travel / step
        if rig.braid_friction > 0.0:
            braid = deflect(braid, travel, step, rig.braid_reach, STRIBECK_EXCESS)
        if rig.seal_friction > 0.0:
            seal = deflect(seal, travel, step, rig.seal_reach, STRIBECK_EXCESS)
        if rig.tendon_loss > 0.0:
            tendon = deflect(tendon, unit[k] - end - rig.slack_length - stretch, step, TENDON_REACH, 0.0)
        if weight > 0.0:
            creep += rubber_tension(end, rig) - elastic
        length = end
        lengths[k], pressures[k] = length, pressure
    return force, pressures, lengths


def simulate(unit: np.ndarray, command: np.ndarray, rig: Rig, step: float = STEP) -> Motion:
    """Return the motion of ``rig`` under a length of the unit [m] and a pressure command [Pa] at every ``step``.

    The unit begins at rest, with the pressure of the first command. Raises ValueError for inputs of unequal length.
    """
    if len(unit) != len(command):
        raise ValueError(f"{len(unit)} lengths, but {len(command)} commands: give one command for every length")
    return Motion(*move_unit(unit, command, rig, step, CREEP_TIMES))
