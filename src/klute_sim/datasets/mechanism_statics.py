"""Position at which a mechanism with one joint rests under pressures, which a slow motion follows."""

from collections.abc import Mapping
from itertools import product
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.datasets.mechanism import DatasetMechanism
from klute_sim.device.device import Device
from klute_sim.device.dynamics import compute_tension
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.errors import KluteSimError
from klute_sim.types import Array, Mask

N_STATIC_POSITIONS = 129
"""Number of positions between the stops."""
N_STATIC_PRESSURES = 7
"""Number of pressures from 0 to that of the supply."""


class Statics(NamedTuple):
    """Forces of a mechanism with one joint at rest."""

    positions: Array
    """Positions between the stops [rad or m]."""
    load: Array
    """Moment or force of gravity and springs at each position [N m or N]."""
    pressures: Mapping[str, Array]
    """Tendon -> pressures [Pa] from 0 to that of the supply; 0 alone where the device has no supply."""
    moments: Mapping[str, Array]
    """Tendon -> moment or force of its device at each of these pressures and positions [N m or N]."""
    inertia: float
    """Inertia of the joint [kg m2 or kg]."""

    def find_rest(self, pressures: Mapping[str, Array]) -> Array:
        """Return the stable position under each sample of the ``pressures`` (tendon -> Pa), a stop where none is."""
        total = self._compute_moments(pressures)
        is_stable, first = _find_stable(total)
        rows = np.arange(len(total))
        above, below = total[rows, first], total[rows, first + 1]
        step = np.where(above > below, above / np.where(above > below, above - below, 1.0), 0.0)
        inner = self.positions[first] + step * (self.positions[1] - self.positions[0])
        at_stop = np.where(total[:, 0] > 0.0, self.positions[-1], self.positions[0])
        rest: Array = np.where(is_stable, inner, at_stop)
        return rest

    def compute_reach(self) -> float:
        """Return the distance between the extreme positions of rest under pressures of no or full supply [rad or m]."""
        extremes = np.array([*product(*((levels[0], levels[-1]) for levels in self.pressures.values()))])
        rest = self.find_rest(dict(zip(self.pressures, extremes.T, strict=True)))
        return float(np.ptp(rest))

    def compute_natural_period(self, pressures: Mapping[str, Array]) -> float:
        """Return the period [s] of a free oscillation about the positions of rest under ``pressures`` (tendon -> Pa).

        Its stiffness is the median over all samples that rest between the stops; without one, the period is infinite.
        """
        total = self._compute_moments(pressures)
        is_stable, first = _find_stable(total)
        rows = np.flatnonzero(is_stable)
        if len(rows) == 0:
            return np.inf
        drops = total[rows, first[rows]] - total[rows, first[rows] + 1]
        stiffness = float(np.median(drops)) / float(self.positions[1] - self.positions[0])
        return 2.0 * np.pi * float(np.sqrt(self.inertia / stiffness))

    def _compute_moments(self, pressures: Mapping[str, Array]) -> Array:
        """Return the moments at each sample of the ``pressures`` and each position."""
        total = np.tile(self.load, (len(next(iter(pressures.values()))), 1))
        for tendon, values in pressures.items():
            levels, moments = self.pressures[tendon], self.moments[tendon]
            position = np.interp(values, levels, np.arange(float(len(levels))))
            low = position.astype(int)
            high = np.minimum(low + 1, len(levels) - 1)
            share = (position - low)[:, np.newaxis]
            total += (1.0 - share) * moments[low] + share * moments[high]
        return total


def _find_stable(total: Array) -> tuple[Mask, NDArray[np.intp]]:
    """Return whether each row of ``total`` moments has a stable position, and the index below the first of them."""
    crossings: Mask = (total[:, :-1] > 0.0) & (total[:, 1:] <= 0.0)
    is_stable: Mask = np.any(crossings, axis=1)
    return is_stable, np.argmax(crossings, axis=1)


def compute_statics(
    mechanism: DatasetMechanism, devices: Mapping[str, Device], numbers: Mapping[str, float]
) -> Statics | None:
    """Return the forces at rest of a ``mechanism`` with ``devices`` (by tendon) and changed ``numbers``.

    None unless the model has one joint, a hinge or a slide with stops, and the devices have forces at all positions.
    """
    model = mechanism.compile_model(numbers)
    scalar = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
    if model is None or model.njnt != 1 or int(model.jnt_type[0]) not in scalar or not model.jnt_limited[0]:
        return None
    positions = np.linspace(float(model.jnt_range[0, 0]), float(model.jnt_range[0, 1]), N_STATIC_POSITIONS)
    data = mujoco.MjData(model)
    loads, lengths, inertias = [], [], []
    for position in positions:
        data.qpos[0], data.qvel[0] = position, 0.0
        mujoco.mj_forward(model, data)
        loads.append(float(data.qfrc_smooth[0]))
        lengths.append(data.ten_length.copy())
        inertias.append(1.0 / _solve_inertia(model, data))
    pressures, moments = {}, {}
    for tendon, device in devices.items():
        path = np.array(lengths)[:, model.tendon(tendon).id]
        max_pressure = device.parameters.supply.max_pressure
        levels = np.linspace(0.0, max_pressure, N_STATIC_PRESSURES if max_pressure > 0.0 else 1)
        forces = _compute_forces(device, levels, path)
        if forces is None:
            return None
        pressures[tendon], moments[tendon] = levels, -forces * np.gradient(path, positions)
    return Statics(positions, np.array(loads), pressures, moments, float(np.mean(inertias)))


def _solve_inertia(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the acceleration of the only joint under a unit moment or force."""
    solution = np.zeros((1, 1))
    mujoco.mj_solveM(model, data, solution, np.ones((1, 1)))
    return float(solution[0, 0])


def compute_static_tension(device: Device, pressure: float, length: float) -> float:
    """Return the tension [N] of a unit at rest at ``pressure`` [Pa] and ``length`` [m]; NaN where its laws fail."""
    parameters = device.parameters
    try:
        state = compute_equilibrium_state(parameters, length, pressure)
        return max(compute_tension(parameters, state, length, 0.0), 0.0)
    except (KluteSimError, ArithmeticError, ValueError):  # the laws fail at lengths that no device has
        return np.nan


def _compute_forces(device: Device, pressures: Array, lengths: Array) -> Array | None:
    """Return the tension [N] at each pressure [Pa] and length [m] of a unit at rest; None where it has none."""
    forces = np.array(
        [
            [compute_static_tension(device, float(pressure), float(length)) for length in lengths]
            for pressure in pressures
        ]
    )
    return forces if np.isfinite(forces).all() else None
