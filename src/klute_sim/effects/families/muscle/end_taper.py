"""Ends of the muscle: near its caps it is not a cylinder, so it pulls less.

The parameters are ratios, so that what was learnt on one muscle holds for one of another length or diameter.
"""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.units import BAR


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
    braid, turns = muscle.braid_length, muscle.braid_turns
    radius_at_rest = mckibben.compute_braid_radius(braid, muscle.resting_length, turns)
    growth = mckibben.compute_braid_radius(braid, length, turns) - radius_at_rest
    return force - muscle.n_actuators * pressure * p.cone_ratio * length * growth / (math.pi * turns * turns)


def strain_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] with the gas tension times ``1 - q (1 - L/L0)``."""
    return force - p.factor * (1.0 - length / muscle.resting_length) * mckibben.gas_force(muscle, pressure, length)


def length_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] with the gas tension times ``1 - c/L0``, ``c = p.diameters * 2 R0``.

    The ends hold a fixed part of the muscle back, whatever its length: a short muscle pulls less than a long one. Of
    similar muscles that part is proportional to the diameter 2 R0 of the bladder. Derived here; Chou and Hannaford
    (IEEE Trans. Robot. Autom. 12:90, 1996) describe muscles whose ends are not cylindrical (quoted from memory).
    """
    end_fraction = min(1.0, p.diameters * 2.0 * muscle.bladder_radius / muscle.resting_length)
    return force - end_fraction * mckibben.gas_force(muscle, pressure, length)


def contraction_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] with the gas tension at the contraction ``k e`` instead of e, ``k = b + a exp(-P/1 bar)``.

    Tondu and Lopez (IEEE Control Syst. Mag. 20(2):15, 2000; equation quoted from memory): the middle of a muscle with
    tapered ends contracts more than the whole. The largest contraction without rubber, ``1 - B/(sqrt(3) L0)``, shrinks
    by k, so the largest contraction of a specimen, by which Hunt, Graber-Tilton and Quinn (ASME IDETC, V05AT08A008,
    2017) normalise the contraction, gives its k.
    """
    excess = (p.factor - 1.0) + p.low_pressure_factor * math.exp(-pressure / BAR)
    middle_length = max(0.0, length - excess * (muscle.resting_length - length))
    return force - (mckibben.gas_force(muscle, pressure, length) - mckibben.gas_force(muscle, pressure, middle_length))


END_TAPER = Effect(
    name="end_taper",
    description="The ends of the muscle taper towards their caps and pull less than a cylinder.",
    kind="device",
    forms=(
        EffectForm(
            name="cone",
            equation="F -= n P k L (R - R0) / (pi N^2); cones of length k (R - R0) between caps and cylinder",
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
                    upper=8.0,
                    typical=1.0,
                    source="assumed: 10 % less tension at 10 % contraction",
                ),
            ),
            laws={"muscle_force": strain_force},
        ),
        EffectForm(
            name="length",
            equation="gas tension times 1 - c/L0, c = diameters 2 R0",
            parameters=(
                EffectParameter(
                    key="diameters",
                    neutral=0.0,
                    lower=0.0,
                    upper=10.0,
                    typical=2.0,
                    source="measured 10 mm muscles of 83 to 382 mm: c = 21 mm, one diameter at each end "
                    "(docs/real-data.md)",
                ),
            ),
            laws={"muscle_force": length_force},
        ),
        EffectForm(
            name="contraction",
            equation="gas tension at the contraction k e, k = b + a exp(-P/1 bar), e = 1 - L/L0",
            parameters=(
                EffectParameter(
                    key="factor",
                    neutral=1.0,
                    lower=0.5,
                    upper=3.0,
                    typical=1.25,
                    source="Tondu and Lopez 2000: b (quoted from memory); 10 mm muscles contract by up to 0.157 to "
                    "0.178 at 620 kPa, which would be 2.0 to 2.3 with B = 1.1 L0 and no passive tension",
                ),
                EffectParameter(
                    key="low_pressure_factor",
                    neutral=0.0,
                    lower=0.0,
                    upper=20.0,
                    typical=4.0,
                    source="Tondu and Lopez 2000: a (quoted from memory)",
                    physical_limits=(0.0,),
                ),
            ),
            laws={"muscle_force": contraction_force},
        ),
    ),
)
