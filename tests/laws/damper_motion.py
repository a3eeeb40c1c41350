"""Prescribed motions of the damper's piston, for the tests of its chambers."""

import numpy as np

from klute_sim.laws import damper_chamber
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.damper_chamber import DamperState
from klute_sim.types import Array


def move_piston(damper: DamperParameters, x: Array, dt: float) -> Array:
    """Return the tension [N] at each position of ``x`` [m], ``dt`` [s] apart, from rest."""
    state = DamperState(0.0, 0.0, float(x[0]))
    force = [0.0]
    for position in x[1:].tolist():
        state = damper_chamber.step_chambers(damper, state, position, dt)
        force.append(state.force)
    return np.array(force)


def compute_work(force: Array, x: Array) -> float:
    """Return the work [J] done on the damper along ``x`` [m], by the trapezoidal rule."""
    return float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(x)))
