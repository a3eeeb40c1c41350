"""Conical ends of the muscle: near its caps it is not a cylinder, so it pulls less."""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import MuscleParameters


def compute_braid_radius(muscle: MuscleParameters, length: float) -> float:
    """Return the radius [m] of the cylinder of the braid at muscle ``length`` [m]: ``sqrt(B^2 - L^2) / (2 pi N)``."""
    squared = muscle.braid_length * muscle.braid_length - length * length
    return math.sqrt(max(0.0, squared)) / (2.0 * math.pi * muscle.braid_turns)


def cone_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] minus ``n P k L (R - R0) / (pi N^2)``.

    The caps hold the radius R0 of the muscle at rest, the cylinder between them has the radius R. Two cones of length
    ``k (R - R0)``, k = ``p.cone_ratio``, join them: their angle is constant, and they grow with the contraction. Each
    is a frustum, so both lack the volume ``2 pi k (R - R0)^2 (2 R + R0) / 3`` of the cylinder. The gas pulls with
    ``-P dV/dL``, where ``dR/dL = -L / (4 pi^2 N^2 R)``. At rest there is no cone and nothing is lost.

    The geometry is derived here. For the same tapered ends Tondu and Lopez (IEEE Control Syst. Mag. 20(2):15, 2000)
    multiply the contraction by a fitted factor.
    """
    turns = muscle.braid_turns
    growth = compute_braid_radius(muscle, length) - compute_braid_radius(muscle, muscle.resting_length)
    return force - muscle.n_actuators * pressure * p.cone_ratio * length * growth / (math.pi * turns * turns)


def strain_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] with the gas tension times ``1 - q (1 - L/L0)``."""
    return force - p.factor * (1.0 - length / muscle.resting_length) * mckibben.gas_force(muscle, pressure, length)


END_TAPER = Effect(
    name="end_taper",
    description="The ends of the muscle taper towards their caps and pull less than a cylinder.",
    kind="device",
    forms=(
        EffectForm(
            name="cone",
            equation="F -= n P k L (R - R0) / (pi N^2): cones of length k (R - R0) between caps and cylinder",
            parameters=(
                EffectParameter(
                    key="cone_ratio",
                    neutral=0.0,
                    lower=0.0,
                    upper=5.0,
                    typical=1.0,
                    source="assumed: cones of 45 degrees",
                ),
            ),
            laws={"muscle_force": cone_force},
        ),
        EffectForm(
            name="strain",
            equation="gas tension times 1 - q (1 - L/L0)",
            parameters=(
                EffectParameter(
                    key="factor",
                    neutral=0.0,
                    lower=0.0,
                    upper=5.0,
                    typical=1.0,
                    source="assumed: 10 % less tension at 10 % contraction",
                ),
            ),
            laws={"muscle_force": strain_force},
        ),
    ),
)
