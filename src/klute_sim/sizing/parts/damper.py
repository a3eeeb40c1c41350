"""The damper of chapter 4: its bore (4.2), its two orifices (4.6), and what the oil does in them."""

import math
from dataclasses import dataclass

from klute_sim.errors import InputError
from klute_sim.laws import damper as law
from klute_sim.laws import hill
from klute_sim.laws.damper import Damper
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE
from klute_sim.sizing.choices import DesignChoices
from klute_sim.sizing.parts.limits import check_range
from klute_sim.sizing.target import MuscleTarget

DESIGN_DISCHARGE_COEFFICIENT = 1.0
"""Cd that orifices are sized with: the source's design."""


@dataclass(frozen=True)
class DamperDesignPoint:
    """What one orifice is sized for, and what the oil then does."""

    speed: float
    """Of the piston [m/s]."""
    design_force: float
    """Fd that it is sized to give [N]."""
    orifice_diameter: float
    """Diameter by (4.6) [m], rounded as in the file."""
    bore: float
    """[m]"""
    oil_density: float
    """Of the oil [kg/m3]."""
    discharge_coefficient: float
    """Cd that the orifice has as made [1]."""

    @property
    def damping_coefficient(self) -> float:
        """Force over speed squared [N s2/m2] as made: with the orifice's own discharge."""
        return law.orifice_coefficient(self.bore, self.orifice_diameter, self.oil_density, self.discharge_coefficient)

    @property
    def as_built_force(self) -> float:
        """Force at the speed as made [N]: ``damping``, up to the orifice's rounding, if Cd is as designed."""
        return self.damping_coefficient * self.speed * self.speed

    @property
    def pressure(self) -> float:
        """Gauge pressure [Pa] on the loaded side as made: braking over the piston, the other side at atmosphere."""
        return 4.0 * self.as_built_force / (math.pi * self.bore * self.bore)

    @property
    def jet_speed(self) -> float:
        """Of the jet where it is narrowest [m/s]: continuity, the jet's area Cd times the orifice's."""
        ratio = self.bore / self.orifice_diameter
        return self.speed * ratio * ratio / self.discharge_coefficient

    @property
    def cavitation_number(self) -> float:
        """Pressure behind the orifice, less the oil's vapour pressure, over the pressure drop [1].

        Assumed: the oil flows into a reservoir at atmosphere, and its vapour pressure is negligible. (4.6) itself puts
        the narrowest place of the jet at the pressure behind the orifice. Below 1, the oil there is a small share of
        the drop away from boiling.
        """
        return ATMOSPHERIC_PRESSURE / self.pressure

    @property
    def min_refill_diameter(self) -> float:
        """Least diameter [m] of the passage through which the unloaded side fills from a reservoir at atmosphere.

        (4.6) with the whole atmosphere as the drop: a narrower one leaves a vacuum behind the piston. Flow-control
        valves let oil in freely (assumed to be wider than this).
        """
        area = 0.25 * math.pi * self.bore * self.bore
        return law.required_orifice(
            ATMOSPHERIC_PRESSURE * area, self.speed, self.bore, self.oil_density, self.discharge_coefficient
        )


@dataclass(frozen=True)
class DamperDesign:
    """A damper with its two design points."""

    bore: float
    """[m]"""
    required_bore: float
    """By (4.2) [m]."""
    concentric: DamperDesignPoint
    eccentric: DamperDesignPoint

    def to_damper(self) -> Damper:
        """The damper as built: with the discharge that its orifices have."""
        return Damper(self.concentric.damping_coefficient, self.eccentric.damping_coefficient)

    @property
    def max_pressure(self) -> float:
        """Larger gauge pressure [Pa] of the two design points, as made."""
        return max(self.concentric.pressure, self.eccentric.pressure)


def concentric_damping_force(target: MuscleTarget, isometric_force: float) -> float:
    """Fd [N] at Vmax by (4.1), with F0 = ``force`` [N]; the muscle's own force there is 0 or what (2.4) leaves."""
    left = max(0.0, hill.concentric_force(target.hill, 1.0, 1.0))
    return law.desired_force(isometric_force, isometric_force * left)


def size_damper(target: MuscleTarget, isometric_force: float, choices: DesignChoices) -> DamperDesign:
    """The damper for actuators of F0 = ``force`` [N]: concentric at Vmax, eccentric at the fastest lengthening."""
    assumed = choices.assumptions
    fast = target.design_peak_velocity
    slow = assumed.eccentric_speed_fraction * fast if choices.eccentric_speed is None else choices.eccentric_speed
    shortening = concentric_damping_force(target, isometric_force)
    # (4.1) the other way: the muscle is to pull with s F0, the actuator with F0.
    lengthening = -law.desired_force(isometric_force, target.hill.saturation * isometric_force)
    if choices.eccentric_force is not None:
        lengthening = choices.eccentric_force
    needed = law.required_bore(max(shortening, lengthening), assumed.cylinder_pressure)
    bore = _round_bore_up(needed) if choices.bore is None else choices.bore
    check_range("bore", bore, 1.0, 200.0, "mm", 1e-3)

    def point(damping: float, speed: float) -> DamperDesignPoint:
        exact = law.required_orifice(damping, speed, bore, choices.oil_density, DESIGN_DISCHARGE_COEFFICIENT)
        orifice = round(exact, 6)
        if orifice > bore or orifice < 1e-3 * bore:
            raise InputError(
                f"the damper needs an orifice of {1e3 * exact:.3g} mm in a bore of {1e3 * bore:.3g} mm for "
                f"{damping:.3g} N at {1e3 * speed:.3g} mm/s; allowed: bore / 1000 to bore"
            )
        return DamperDesignPoint(speed, damping, orifice, bore, choices.oil_density, assumed.discharge_coefficient)

    return DamperDesign(bore, needed, point(shortening, fast), point(lengthening, slow))


def _round_bore_up(bore: float) -> float:
    """Rounded up to 0.01 mm, so that the designed force stays within the allowed pressure."""
    return math.ceil(1e5 * bore - 1e-9) / 1e5
