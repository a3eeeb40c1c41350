"""Threshold pressure: the bladder must inflate to the braid before the gas pulls."""

from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws.mckibben import MuscleParameters


def constant_threshold(p: Any, state: Any, pressure: float, muscle: MuscleParameters, length: float) -> float:
    """Return the acting pressure [Pa] ``max(0, P - Pth)``."""
    return max(0.0, pressure - p.pressure)


def rising_threshold(p: Any, state: Any, pressure: float, muscle: MuscleParameters, length: float) -> float:
    """Return the acting pressure [Pa] ``max(0, P - Pth - rise (1 - L/L0))``."""
    return max(0.0, pressure - p.pressure - p.rise * (1.0 - length / muscle.resting_length))


_SOURCE = "measured 10 mm muscles: no tension below 0.3-1.1 bar straight, 2.8-4.8 bar when shortened"
_THRESHOLD_PARAMETER = EffectParameter(
    key="pressure_bar", neutral=0.0, lower=0.0, upper=3.0, typical=0.5, source=_SOURCE
)

THRESHOLD_PRESSURE = Effect(
    name="threshold_pressure",
    description="Below a threshold the pressure only inflates the bladder; the excess pressure acts on the braid.",
    kind="device",
    forms=(
        EffectForm(
            name="constant",
            equation="P acts as max(0, P - Pth)",
            parameters=(_THRESHOLD_PARAMETER,),
            laws={"acting_pressure": constant_threshold},
        ),
        EffectForm(
            name="rising",
            equation="P acts as max(0, P - Pth - rise (1 - L/L0))",
            parameters=(
                _THRESHOLD_PARAMETER,
                EffectParameter(key="rise_bar", neutral=0.0, lower=0.0, upper=60.0, typical=10.0, source=_SOURCE),
            ),
            laws={"acting_pressure": rising_threshold},
        ),
    ),
)
