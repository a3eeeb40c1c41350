"""Thickness and strain softening of the bladder's wall."""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import MuscleParameters

GAUSS_NODES = (-0.8611363115940526, -0.3399810435848563, 0.3399810435848563, 0.8611363115940526)
"""Nodes of the four-point Gauss-Legendre rule [1]."""
GAUSS_WEIGHTS = (0.3478548451374538, 0.6521451548625461, 0.6521451548625461, 0.3478548451374538)
"""Weights of the four-point Gauss-Legendre rule [1]."""


def _thick_wall_force(muscle: MuscleParameters, length: float) -> float:
    """Return the tension [N] of all bladders with the rubber's energy integrated through the wall.

    The outer surface follows the braid. Incompressible rubber at the initial radius R moves to the radius
    ``r^2 = (R0 lambda_2)^2 - (R0^2 - R^2) / lambda_1``. The tension is ``F = int 2 pi R dW/dlambda_1 dR``.
    """
    outer, resting_length = muscle.bladder_radius, muscle.resting_length
    ratio = length / resting_length
    cot_braid_angle = resting_length / (2.0 * math.pi * muscle.braid_turns * outer)
    k, a = cot_braid_angle * cot_braid_angle, ratio * ratio
    q_outer = 1.0 + k * (1.0 - a)
    half_thickness, total = 0.5 * muscle.bladder_thickness, 0.0
    for k_node in range(len(GAUSS_NODES)):
        radius = outer - half_thickness + half_thickness * GAUSS_NODES[k_node]
        squares_difference = outer * outer - radius * radius
        q = max(1e-3, (outer * outer * q_outer - squares_difference / ratio) / (radius * radius))
        # Derivative with respect to lambda_1 of the squared hoop stretch q.
        q_slope = (-2.0 * k * ratio * outer * outer + squares_difference / a) / (radius * radius)
        i1 = (1.0 - 1.0 / (a * a * q)) * 2.0 * ratio + (1.0 - 1.0 / (a * q * q)) * q_slope
        i2 = (q - 1.0 / (a * a)) * 2.0 * ratio + (a - 1.0 / (q * q)) * q_slope
        total += GAUSS_WEIGHTS[k_node] * half_thickness * 2.0 * math.pi * radius * (muscle.c10 * i1 + muscle.c01 * i2)
    return muscle.n_actuators * total


def thick_wall_correction(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] plus ``p.share`` of the difference between a thick and a thin wall (3.3)."""
    return force + p.share * (_thick_wall_force(muscle, length) - mckibben.bladder_force(muscle, length))


MAX_WALL_SHARE = 1.25
"""Largest influence of a thick wall over that of the whole one (assumed: the rubber is known to a quarter)."""


def find_wall_flaw(p: Any) -> str:
    """Return why no wall has ``p.share`` of the difference between a thick and a thin one; '' if walls have it."""
    return f"would have {p.share:.2f} times the influence of the whole wall" if p.share > MAX_WALL_SHARE else ""


def _energy_density(muscle: MuscleParameters, length: float) -> float:
    """Return the strain energy density [J/m3] of the rubber, averaged over all bladders, eq. (3.3)."""
    return mckibben.bladder_energy(muscle, length) / (muscle.n_actuators * mckibben.bladder_volume(muscle))


def soften_bladder(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] with the bladder tension multiplied by ``1 - share tanh((W_max - W) / m)``.

    W_max is the greatest energy density so far (after Ogden and Roxburgh). On first loading W equals W_max, and the
    rubber is not softened.
    """
    energy_drop = max(0.0, state.max_energy_density - _energy_density(muscle, length))
    return force - p.share * math.tanh(energy_drop / p.energy_density) * mckibben.bladder_force(muscle, length)


def step_max_energy_density(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float]:
    """Return the greatest energy density [J/m3] so far."""
    return (max(state.max_energy_density, _energy_density(muscle, length)),)


THICK_WALL_BLADDER = Effect(
    name="thick_wall_bladder",
    description="The bladder's wall is thick: inner rubber is stretched more than the outer surface, which (3.3) uses.",
    kind="device",
    forms=(
        EffectForm(
            name="mooney_rivlin",
            equation="F += share (int 2 pi R dW/dlambda_1 dR - V_b dW/dL)",
            parameters=(
                EffectParameter(
                    key="share",
                    neutral=0.0,
                    lower=0.0,
                    upper=3.0,
                    typical=1.0,
                    source="the integral itself, with the device's rubber",
                ),
            ),
            laws={"muscle_force": thick_wall_correction},
            find_flaw=find_wall_flaw,
        ),
    ),
)

BLADDER_SOFTENING = Effect(
    name="bladder_softening",
    description="Rubber is softer after a larger preceding stretch than on first loading (Mullins effect).",
    kind="device",
    forms=(
        EffectForm(
            name="ogden_roxburgh",
            equation="bladder tension times 1 - share tanh((W_max - W)/m)",
            parameters=(
                EffectParameter(
                    key="share",
                    neutral=0.0,
                    lower=0.0,
                    upper=0.9,
                    typical=0.3,
                    source="assumed: gum rubber softens as much as filled rubber (Harwood 1965)",
                ),
                EffectParameter(
                    key="energy_density_kpa",
                    neutral=None,
                    lower=0.1,
                    upper=1000.0,
                    typical=10.0,
                    source="assumed: energy density of the latex at 10 % contraction",
                ),
            ),
            laws={"muscle_force": soften_bladder, "next_state": step_max_energy_density},
            states=("max_energy_density",),
        ),
    ),
)
