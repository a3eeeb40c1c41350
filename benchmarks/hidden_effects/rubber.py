"""Tension and energy of the bladder's rubber in the benchmark: a thin bladder on the braid, and a thick wall.

SI units; ``L`` is the length of the muscle.
"""

import math
from typing import TYPE_CHECKING

from benchmarks.hidden_effects.compiled import cached_njit

if TYPE_CHECKING:
    from benchmarks.hidden_effects.law import Law

N_WALL_LAYERS = 8  # of the thick wall, for Simpson's rule


@cached_njit
def thin_bladder_tension(L: float, law: "Law") -> float:
    """Return the tension of one thin bladder that follows the braid: ``Vb dW/dL``."""
    stretch = L / law.resting_length
    a = stretch * stretch  # squares of the axial, hoop and radial stretches are a, u, 1/(a u)
    u = 1.0 + law.hoop_factor * (1.0 - a)
    da, du = 2.0 * stretch, -2.0 * law.hoop_factor * stretch
    d_volume = da * u + a * du
    d_i1 = da + du - d_volume / (a * u) ** 2
    d_i2 = -da / (a * a) - du / (u * u) + d_volume
    return law.bladder_gain * (law.c10 * d_i1 + law.c01 * d_i2)


@cached_njit
def rubber_energy(axial: float, hoop: float, law: "Law") -> float:
    """Return the energy density [J/m3] of incompressible rubber at two squared stretches."""
    radial = 1.0 / (axial * hoop)
    first = axial + hoop + radial - 3.0
    return law.c10 * first + law.c01 * (1.0 / axial + 1.0 / hoop + 1.0 / radial - 3.0)


@cached_njit
def bladder_energy_density(L: float, law: "Law") -> float:
    """Return the energy density [J/m3] of the thin bladder."""
    axial = (L / law.resting_length) ** 2
    return rubber_energy(axial, 1.0 + law.hoop_factor * (1.0 - axial), law)


@cached_njit
def wall_energy(stretch: float, law: "Law") -> float:
    """Return the energy per resting length [J/m] of a wall whose outside follows the braid (Simpson's rule over
    layers).

    The rubber volume between a layer and the outside is constant: the squared radius of the layer differs from that of
    the outside by the original difference divided by the stretch.
    """
    axial = stretch * stretch
    outside = law.outer_radius * law.outer_radius * (1.0 + law.hoop_factor * (1.0 - axial))
    step, total = (law.outer_radius - law.inner_radius) / N_WALL_LAYERS, 0.0
    for i in range(N_WALL_LAYERS + 1):
        radius = law.inner_radius + i * step
        hoop = (outside - (law.outer_radius * law.outer_radius - radius * radius) / stretch) / (radius * radius)
        weight = 1.0 if i in (0, N_WALL_LAYERS) else 4.0 if i % 2 == 1 else 2.0
        total += weight * 2.0 * math.pi * radius * rubber_energy(axial, max(hoop, 1e-3), law)
    return total * step / 3.0
