"""Damper and tendon: orifices with viscous clearances, a seal that oil pressure presses on, and a bilinear spring."""

import math

from benchmarks.hidden_effects.adversary.compiled import compile_cached
from benchmarks.hidden_effects.adversary.rig import BAR, Rig

SEAL_EXPONENT = 0.4
"""Exponent of a seal's friction over 1 bar plus its pressure: 1.7 times as much at 7 bar as at 1 bar."""


@compile_cached
def orifice_coefficient(orifice: float, rig: Rig) -> float:
    """Return F/v² of an ideal orifice [N s²/m²]: eq. (4.6) solved for the force, with Cd = 1."""
    area = 0.25 * math.pi * rig.bore * rig.bore
    return 0.5 * area * rig.oil_density * ((rig.bore / orifice) ** 4 - 1.0)


@compile_cached
def oil_tension(velocity: float, rig: Rig) -> float:
    """Return the tension of the damper's oil [N] at a lengthening ``velocity`` [m/s]."""
    orifice = rig.orifice_eccentric if velocity > 0.0 else rig.orifice_concentric
    return orifice_coefficient(orifice, rig) * velocity * abs(velocity) + rig.viscous_clearance * velocity


@compile_cached
def seal_friction_level(oil: float, rig: Rig) -> float:
    """Return the friction of the seal [N] under the pressure that the tension ``oil`` of the damper means."""
    pressure = abs(oil) / (0.25 * math.pi * rig.bore * rig.bore)
    return rig.seal_friction * (1.0 + pressure / BAR) ** SEAL_EXPONENT


@compile_cached
def spring_tension(stretch: float, rig: Rig) -> float:
    """Return the tension of the tendon's springs [N]; the second comes in over a toe of ``toe_length``."""
    stretch -= rig.dead_stretch
    if stretch <= 0.0:
        return 0.0
    beyond = stretch - rig.engagement
    if rig.toe_length > 0.0:
        beyond = rig.toe_length * math.log1p(math.exp(min(beyond / rig.toe_length, 500.0)))
        beyond -= rig.toe_length * math.log1p(math.exp(-rig.engagement / rig.toe_length))
    return rig.stiffness_1 * stretch + rig.stiffness_2 * max(beyond, 0.0)
