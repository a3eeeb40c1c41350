"""The bladder has to be inflated to the braid before the gas pulls."""

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.laws.mckibben import Muscle


def constant(own: Numbers, memory: Numbers, pressure: float, muscle: Muscle, length: float) -> float:
    """Acting pressure [Pa]: ``max(0, P - Pth)``."""
    return max(0.0, pressure - own[0])


def rising(own: Numbers, memory: Numbers, pressure: float, muscle: Muscle, length: float) -> float:
    """Acting pressure [Pa]: ``max(0, P - Pth - rise (1 - L/L0))``."""
    return max(0.0, pressure - own[0] - own[1] * (1.0 - length / muscle.resting_length))


_SOURCE = "measured 10 mm muscles: no tension below 0.3-1.1 bar straight, 2.8-4.8 bar when shortened"
_THRESHOLD = Parameter(key="pressure_bar", neutral=0.0, low=0.0, high=3.0, typical=0.5, source=_SOURCE)

EFFECT = Effect(
    name="threshold_pressure",
    sentence="Below a threshold the pressure only inflates the bladder; it pulls with what is above.",
    kind="device",
    forms=(
        Form(
            name="constant",
            equation="P acts as max(0, P - Pth)",
            parameters=(_THRESHOLD,),
            laws={"acting_pressure": constant},
        ),
        Form(
            name="rising",
            equation="P acts as max(0, P - Pth - rise (1 - L/L0))",
            parameters=(
                _THRESHOLD,
                Parameter(key="rise_bar", neutral=0.0, low=0.0, high=60.0, typical=10.0, source=_SOURCE),
            ),
            laws={"acting_pressure": rising},
        ),
    ),
)
