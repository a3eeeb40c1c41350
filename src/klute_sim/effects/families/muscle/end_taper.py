"""Conical ends of the muscle: near its caps it is not a cylinder, so it pulls less."""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import MuscleParameters


def cone_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] minus ``n P 2 c L / (4 pi N^2)``, with ``c = 4/3 p.tip_length``.

    A cone encloses a third of its cylinder: ``V = (L - c) (B^2 - L^2) / (4 pi N^2)`` with two cones of length
    ``p.tip_length``, and the gas pulls with ``-P dV/dL``. The constant part of dV/dL is that of the cylinder.
    """
    cone_length, turns = 4.0 / 3.0 * p.tip_length, muscle.braid_turns
    return force - muscle.n_actuators * pressure * 2.0 * cone_length * length / (4.0 * math.pi * turns * turns)


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
            equation="gas tension n P (3 L^2 - 2 c L - B^2) / (4 pi N^2), c = 4/3 tip",
            parameters=(
                EffectParameter(
                    key="tip_length_mm",
                    neutral=0.0,
                    lower=0.0,
                    upper=40.0,
                    typical=8.0,
                    source="assumed: about the diameter of the inflated muscle",
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
