"""The bladder's wall: as thick as it is, and softened by what it has been through."""

import math

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import Muscle

GAUSS_NODES = (-0.8611363115940526, -0.3399810435848563, 0.3399810435848563, 0.8611363115940526)
GAUSS_WEIGHTS = (0.3478548451374538, 0.6521451548625461, 0.6521451548625461, 0.3478548451374538)
"""Of Gauss and Legendre's rule, four points."""


def _thick_wall_force(muscle: Muscle, length: float) -> float:
    """Tension [N] of all bladders, with the rubber's energy integrated through the wall.

    Outside the rubber follows the braid; inside, rubber that keeps its volume has the radius
    ``r^2 = (R0 lambda_2)^2 - (R0^2 - R^2) / lambda_1`` where it had R. So ``F = int 2 pi R dW/dlambda_1 dR``.
    """
    outer, rest = muscle.bladder_radius, muscle.resting_length
    ratio = length / rest
    grip = rest / (2.0 * math.pi * muscle.braid_turns * outer)
    k, a = grip * grip, ratio * ratio
    q_outer = 1.0 + k * (1.0 - a)
    half, total = 0.5 * muscle.bladder_thickness, 0.0
    for k_node in range(len(GAUSS_NODES)):
        radius = outer - half + half * GAUSS_NODES[k_node]
        inside = outer * outer - radius * radius
        q = max(1e-3, (outer * outer * q_outer - inside / ratio) / (radius * radius))
        # Change of q, the squared hoop stretch, and of a with lambda_1.
        q_slope = (-2.0 * k * ratio * outer * outer + inside / a) / (radius * radius)
        i1 = (1.0 - 1.0 / (a * a * q)) * 2.0 * ratio + (1.0 - 1.0 / (a * q * q)) * q_slope
        i2 = (q - 1.0 / (a * a)) * 2.0 * ratio + (a - 1.0 / (q * q)) * q_slope
        total += GAUSS_WEIGHTS[k_node] * half * 2.0 * math.pi * radius * (muscle.c10 * i1 + muscle.c01 * i2)
    return muscle.n_actuators * total


def thick_wall_correction(
    p: FloatSequence, state: FloatSequence, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ share`` of what a thick wall has beyond the thin one of (3.3)."""
    return force + p[0] * (_thick_wall_force(muscle, length) - mckibben.bladder_force(muscle, length))


def _energy_density(muscle: Muscle, length: float) -> float:
    """Of the rubber [J/m3], over all bladders, eq. (3.3)."""
    return mckibben.bladder_energy(muscle, length) / (muscle.n_actuators * mckibben.bladder_volume(muscle))


def soften_bladder(
    p: FloatSequence, state: FloatSequence, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: the bladder's times ``1 - share tanh((W_most - W) / m)`` (after Ogden and Roxburgh).

    W_most is the greatest energy density there has been. Going deeper it is W itself, and nothing is softer.
    """
    depth = max(0.0, state[0] - _energy_density(muscle, length))
    return force - p[0] * math.tanh(depth / p[1]) * mckibben.bladder_force(muscle, length)


def step_max_energy_density(
    p: FloatSequence, state: FloatSequence, muscle: Muscle, pressure: float, length: float, stretch: float, dt: float
) -> tuple[float]:
    """The greatest energy density so far."""
    return (max(state[0], _energy_density(muscle, length)),)


THICK_WALL_BLADDER = Effect(
    name="thick_wall_bladder",
    description="The bladder's wall is thick: its inside is stretched more than its outside, which (3.3) takes for all.",
    kind="device",
    forms=(
        EffectForm(
            name="mooney_rivlin",
            equation="F += share (int 2 pi R dW/dlambda_1 dR - Vb dW/dL)",
            parameters=(
                EffectParameter(
                    key="share",
                    neutral=0.0,
                    lower=0.0,
                    upper=3.0,
                    typical=1.0,
                    source="the integral itself, with the device's own rubber",
                ),
            ),
            laws={"muscle_force": thick_wall_correction},
        ),
    ),
)

BLADDER_SOFTENING = Effect(
    name="bladder_softening",
    description="Rubber that has been stretched further before is softer than on its first way there (Mullins).",
    kind="device",
    forms=(
        EffectForm(
            name="ogden_roxburgh",
            equation="bladder tension times 1 - share tanh((W_most - W)/m)",
            parameters=(
                EffectParameter(
                    key="share",
                    neutral=0.0,
                    lower=0.0,
                    upper=0.9,
                    typical=0.3,
                    source="assumed: gum rubber softens as much as filled one (Harwood 1965)",
                ),
                EffectParameter(
                    key="energy_density_kpa",
                    neutral=None,
                    lower=0.1,
                    upper=1000.0,
                    typical=10.0,
                    source="assumed: that of the latex at a tenth of contraction",
                ),
            ),
            laws={"muscle_force": soften_bladder, "remember": step_max_energy_density},
            n_states=1,
        ),
    ),
)
