"""Threads of the braid stretch under their tension: the muscle grows wider and pulls less."""

import math

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence
from klute_sim.laws.mckibben import Muscle


def stretch_braid(
    p: FloatSequence, state: FloatSequence, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: that of threads of length ``B = B0 / (1 - e P L/L0)`` instead of B0.

    All threads together carry ``P dV/dB = P B L / (2 pi N^2)``, by virtual work, so that linear ones have that length;
    e is their strain per pressure at resting length. The gas pulls with ``P (3 L^2 - B^2) / (4 pi N^2)``, as before.
    """
    braid, turns = muscle.braid_length, muscle.braid_turns
    longer = braid / (1.0 - p[0] * pressure * length / muscle.resting_length)
    return force - muscle.n_actuators * pressure * (longer * longer - braid * braid) / (4.0 * math.pi * turns * turns)


BRAID_EXTENSIBILITY = Effect(
    name="braid_extensibility",
    description="The braid's threads stretch under their tension: the muscle grows wider and pulls less.",
    kind="device",
    forms=(
        EffectForm(
            name="linear",
            equation="B = B0 / (1 - e P L/L0) in the gas's tension",
            parameters=(
                EffectParameter(
                    key="strain_per_bar",
                    neutral=0.0,
                    lower=0.0,
                    upper=0.03,
                    typical=0.003,
                    source="soft braid: up to 30 % in diameter (Actuators 2022, 11:219); typical size assumed",
                ),
            ),
            laws={"muscle_force": stretch_braid},
        ),
    ),
)
