"""Passive tension: rubber, braid and buckling take tension that no pressure gives back.

The cross-section of a tube's wall is in proportion to its diameter, where walls are equally thick (assumed: makers
thicken them somewhat), so the tension is, too, and with it the tension that a threshold pressure takes. The parameters
are those of a bladder of :data:`~klute_sim.effects.families.muscle.threshold_pressure.REFERENCE_DIAMETER`.
"""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.effects.families.muscle.threshold_pressure import REFERENCE_DIAMETER
from klute_sim.laws.mckibben import MuscleParameters

SWITCH_PRESSURE = 1e4
"""Pressure P1 [Pa] over which the part that exists at rest is switched on, ``s = 1 - exp(-P/P1)``: 0.1 bar (assumed:
below the threshold pressures of measured muscles). Without pressure no bladder presses against the braid."""


def _reduce_tension(muscle: MuscleParameters, force: float, offset: float, rise: float, pressure: float) -> float:
    """Return the tension [N] minus ``n (s(P) offset + rise) d/D``, but not below zero.

    d is the diameter of the bladder and D the one of reference.

    A muscle that the other terms already make push keeps its force: the passive part pulls no muscle and pushes none.
    At constant pressure the tension is a function of the length, so a closed path returns all work.
    """
    switch = 1.0 - math.exp(-pressure / SWITCH_PRESSURE)
    size = 2.0 * muscle.bladder_radius / REFERENCE_DIAMETER
    return max(force - muscle.n_actuators * size * (switch * offset + rise), min(force, 0.0))


def exponential_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] minus ``n (b0 s(P) + b1 (1 - exp(-e/e1))) d/D``, not below zero; e is the contraction.

    Measured clamped muscles of 10 mm are linear in pressure within 1 %, ``F = a P - b``, and b rises within the first
    percents of contraction (docs/real-data.md). With e1 at its lower bound this is a step.
    """
    contraction = max(0.0, 1.0 - length / muscle.resting_length)
    rise = p.rise * (1.0 - math.exp(-contraction / p.contraction_scale))
    return _reduce_tension(muscle, force, p.offset, rise, pressure)


def power_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] minus ``n (b0 s(P) + b1 e^(2/3)) d/D``, not below zero; e is the contraction."""
    contraction = max(0.0, 1.0 - length / muscle.resting_length)
    return _reduce_tension(muscle, force, p.offset, p.rise * math.pow(contraction, 2.0 / 3.0), pressure)


_OFFSET_PARAMETER = EffectParameter(
    key="offset_n",
    neutral=0.0,
    lower=0.0,
    upper=500.0,
    typical=25.0,
    source="measured 10 mm muscles: 20-40 N per actuator (docs/real-data.md)",
    physical_limits=(0.0,),
)

PASSIVE_TENSION = Effect(
    name="passive_tension",
    description="Rubber and braid resist contraction: they take tension, most of it in the first percents.",
    kind="device",
    forms=(
        EffectForm(
            name="exponential",
            equation="F -= n d/D (b0 s(P) + b1 (1 - exp(-e/e1))), F is reduced to 0 at most; e = 1 - L/L0, "
            "s = 1 - exp(-P/0.1 bar), D = 10 mm",
            parameters=(
                EffectParameter(
                    key="rise_n",
                    neutral=0.0,
                    lower=0.0,
                    upper=3000.0,
                    typical=150.0,
                    source="measured 10 mm muscles: 110-170 N per actuator (docs/real-data.md); forces beside "
                    "that of the gas: Martens and Boblan, Actuators 6:33, 2017 (abstract read)",
                ),
                _OFFSET_PARAMETER,
                EffectParameter(
                    key="contraction_scale",
                    neutral=None,
                    lower=0.002,
                    upper=0.3,
                    typical=0.037,
                    source="measured 10 mm muscles: 0.03-0.04 (docs/real-data.md)",
                ),
            ),
            laws={"muscle_force": exponential_force},
        ),
        EffectForm(
            name="power",
            equation="F -= n d/D (b0 s(P) + b1 e^(2/3)), F is reduced to 0 at most; e = 1 - L/L0, "
            "s = 1 - exp(-P/0.1 bar), D = 10 mm",
            parameters=(
                EffectParameter(
                    key="rise_n",
                    neutral=0.0,
                    lower=0.0,
                    upper=10000.0,
                    typical=550.0,
                    source="measured 10 mm muscles: 490-790 N per actuator (docs/real-data.md); exponent: "
                    "Hildebrandt et al., Am. Control Conf. 2005 (not checked against the paper)",
                ),
                _OFFSET_PARAMETER,
            ),
            laws={"muscle_force": power_force},
        ),
    ),
)
