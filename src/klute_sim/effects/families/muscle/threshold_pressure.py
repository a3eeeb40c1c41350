"""Threshold pressure: the bladder must inflate to the braid before the gas pulls.

A tube of the same wall needs a pressure in inverse proportion to its diameter (Laplace's law, P = T/r with the line
tension T of the wall). The parameters are those of a bladder of :data:`REFERENCE_DIAMETER`, so that what was learnt on
one diameter holds for another.
"""

from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws.mckibben import MuscleParameters

REFERENCE_DIAMETER = 0.01
"""Outer diameter [m] of the bladder for which the parameters are stated: nominally that of the measured muscles."""


def _scale_to_diameter(muscle: MuscleParameters) -> float:
    """Return the threshold of ``muscle`` over that of a bladder of :data:`REFERENCE_DIAMETER` [1]."""
    return REFERENCE_DIAMETER / (2.0 * muscle.bladder_radius)


def constant_threshold(p: Any, state: Any, pressure: float, muscle: MuscleParameters, length: float) -> float:
    """Return the acting pressure [Pa] ``max(0, P - Pth D/d)``, d the diameter and D the one of reference."""
    return max(0.0, pressure - _scale_to_diameter(muscle) * p.pressure)


def rising_threshold(p: Any, state: Any, pressure: float, muscle: MuscleParameters, length: float) -> float:
    """Return the acting pressure [Pa] ``max(0, P - (Pth + rise (1 - L/L0)) D/d)``."""
    threshold = p.pressure + p.rise * (1.0 - length / muscle.resting_length)
    return max(0.0, pressure - _scale_to_diameter(muscle) * threshold)


_SOURCE = (
    "measured 10 mm muscles: no tension below 0.3-1.1 bar straight, 2.8-4.8 bar when shortened; upper ends assumed"
)
_THRESHOLD_PARAMETER = EffectParameter(
    key="pressure_bar", neutral=0.0, lower=0.0, upper=5.0, typical=0.5, source=_SOURCE
)

THRESHOLD_PRESSURE = Effect(
    name="threshold_pressure",
    description="Below a threshold the pressure only inflates the bladder; the excess pressure acts on the braid.",
    kind="device",
    forms=(
        EffectForm(
            name="constant",
            equation="P acts as max(0, P - P_th 10 mm/d), d = 2 R0",
            parameters=(_THRESHOLD_PARAMETER,),
            laws={"acting_pressure": constant_threshold},
        ),
        EffectForm(
            name="rising",
            equation="P acts as max(0, P - (P_th + rise (1 - L/L0)) 10 mm/d), d = 2 R0",
            parameters=(
                _THRESHOLD_PARAMETER,
                EffectParameter(key="rise_bar", neutral=0.0, lower=0.0, upper=60.0, typical=10.0, source=_SOURCE),
            ),
            laws={"acting_pressure": rising_threshold},
        ),
    ),
)
