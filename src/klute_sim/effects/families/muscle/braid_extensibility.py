"""Elastic extension of the braid's threads: the muscle becomes wider and pulls less."""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws.mckibben import MuscleParameters

MIN_BRAID_RATIO = 0.2
"""Smallest 1 - e P L/L0 of the linear law [1]: the threads are at most five times as long as without tension
(assumed)."""


def stretch_braid(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] with threads of length ``B = B0 / (1 - e P L/L0)`` instead of B0.

    By virtual work all threads together carry ``P dV/dB = P B L / (2 pi N^2)``, so linear threads have that length;
    e is their strain per pressure at resting length. The gas pulls with ``P (3 L^2 - B^2) / (4 pi N^2)`` as before.
    """
    braid, turns = muscle.braid_length, muscle.braid_turns
    stretched_braid = braid / max(1.0 - p.strain * pressure * length / muscle.resting_length, MIN_BRAID_RATIO)
    return force - muscle.n_actuators * pressure * (stretched_braid * stretched_braid - braid * braid) / (
        4.0 * math.pi * turns * turns
    )


BRAID_EXTENSIBILITY = Effect(
    name="braid_extensibility",
    description="The braid's threads stretch under tension: the muscle becomes wider and pulls less.",
    kind="device",
    forms=(
        EffectForm(
            name="linear",
            equation="B = B0 / (1 - e P L/L0) in the gas tension",
            parameters=(
                EffectParameter(
                    key="strain_per_bar",
                    neutral=0.0,
                    lower=0.0,
                    upper=0.03,
                    typical=0.003,
                    source="soft braid: up to 30 % in diameter (Actuators 2022, 11:219); typical value assumed",
                ),
            ),
            laws={"muscle_force": stretch_braid},
        ),
    ),
)
