"""Towards its end caps the muscle is a cone, not a cylinder, and pulls less: the more so the shorter it is."""

import math

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import Muscle


def cone(
    own: Numbers, memory: Numbers, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``- n P 2 c L / (4 pi N^2)``, with ``c = 4/3 tip``.

    A cone holds a third of its cylinder: ``V = (L - c) (B^2 - L^2) / (4 pi N^2)`` with two cones of length ``tip``,
    and the gas pulls with ``-P dV/dL``. The constant part of dV/dL is the cylinder's.
    """
    reach, turns = 4.0 / 3.0 * own[0], muscle.turns
    return force - muscle.actuators * pressure * 2.0 * reach * length / (4.0 * math.pi * turns * turns)


def strain(
    own: Numbers, memory: Numbers, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: the gas's times ``1 - q (1 - L/L0)``."""
    return force - own[0] * (1.0 - length / muscle.resting_length) * mckibben.gas_force(muscle, pressure, length)


EFFECT = Effect(
    name="end_taper",
    sentence="The ends of the muscle taper to their caps and pull less than a cylinder would.",
    kind="device",
    forms=(
        Form(
            name="cone",
            equation="gas tension n P (3 L^2 - 2 c L - B^2) / (4 pi N^2), c = 4/3 tip",
            parameters=(
                Parameter(
                    key="tip_length_mm",
                    neutral=0.0,
                    low=0.0,
                    high=40.0,
                    typical=8.0,
                    source="assumed: about the diameter of the inflated muscle",
                ),
            ),
            laws={"muscle_force": cone},
        ),
        Form(
            name="strain",
            equation="gas tension times 1 - q (1 - L/L0)",
            parameters=(
                Parameter(
                    key="factor",
                    neutral=0.0,
                    low=0.0,
                    high=5.0,
                    typical=1.0,
                    source="assumed: a tenth less tension at a tenth of contraction",
                ),
            ),
            laws={"muscle_force": strain},
        ),
    ),
)
