"""Sizing of the damper of chapter 4: bore (4.2), two orifices (4.6) and the state of the oil in them."""

import math
from dataclasses import dataclass

from klute_sim.errors import InputError
from klute_sim.laws import damper as law
from klute_sim.laws import hill
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE
from klute_sim.sizing.choices import DesignChoices
from klute_sim.sizing.parts.limits import check_range
from klute_sim.sizing.target import MuscleTarget

DESIGN_DISCHARGE_COEFFICIENT = 1.0
"""Discharge coefficient Cd with which orifices are sized, as in the source."""


@dataclass(frozen=True)
class DamperDesignPoint:
    """Design point of one orifice and the resulting flow."""

    speed: float
    """Piston speed [m/s]."""
    design_force: float
    """Damping force Fd for which the orifice is sized [N]."""
    orifice_diameter: float
    """Orifice diameter by (4.6) [m], rounded as in the device file."""
    bore: float
    """Bore of the cylinder [m]."""
    oil_density: float
    """Density of the oil [kg/m3]."""
    discharge_coefficient: float
    """Actual discharge coefficient Cd of the orifice [1]."""

    @property
    def damping_coefficient(self) -> float:
        """Return the actual force over speed squared [N s2/m2]."""
        return law.orifice_coefficient(self.bore, self.orifice_diameter, self.oil_density, self.discharge_coefficient)

    @property
    def as_built_force(self) -> float:
        """Return the actual force at the design speed [N]; equals the design force, up to rounding, if Cd is as
        designed.
        """
        return self.damping_coefficient * self.speed * self.speed

    @property
    def pressure(self) -> float:
        """Return the actual gauge pressure on the loaded side [Pa], with the other side at atmosphere."""
        return 4.0 * self.as_built_force / (math.pi * self.bore * self.bore)

    @property
    def jet_speed(self) -> float:
        """Return the oil speed in the narrowest section of the jet [m/s]; its area is Cd times the orifice area."""
        ratio = self.bore / self.orifice_diameter
        return self.speed * ratio * ratio / self.discharge_coefficient

    @property
    def cavitation_number(self) -> float:
        """Return the pressure behind the orifice less the vapour pressure, over the pressure drop [1].

        Assumed: the oil flows into a reservoir at atmosphere, and its vapour pressure is negligible. (4.6) places the
        narrowest section of the jet at the pressure behind the orifice. Below 1, this pressure exceeds the vapour
        pressure by only a small fraction of the pressure drop.
        """
        return ATMOSPHERIC_PRESSURE / self.pressure

    @property
    def min_refill_diameter(self) -> float:
        """Return the smallest diameter [m] of the passage that refills the unloaded side from a reservoir at
        atmosphere.

        (4.6) with the atmospheric pressure as the drop: a narrower passage leaves a vacuum behind the piston.
        Flow-control valves admit oil freely (assumed to be wider).
        """
        area = 0.25 * math.pi * self.bore * self.bore
        return law.required_orifice(
            ATMOSPHERIC_PRESSURE * area, self.speed, self.bore, self.oil_density, self.discharge_coefficient
        )


@dataclass(frozen=True)
class DamperDesign:
    """A damper with its two design points."""

    bore: float
    """Bore of the cylinder [m]."""
    required_bore: float
    """Bore by (4.2) [m]."""
    concentric: DamperDesignPoint
    """Design point of shortening."""
    eccentric: DamperDesignPoint
    """Design point of lengthening."""

    def to_damper(self) -> DamperParameters:
        """Return the damper as built, with the actual discharge coefficients of its orifices."""
        area = 0.25 * math.pi * self.bore * self.bore
        return DamperParameters(self.concentric.damping_coefficient, self.eccentric.damping_coefficient, area)

    @property
    def max_pressure(self) -> float:
        """Return the larger actual gauge pressure of the two design points [Pa]."""
        return max(self.concentric.pressure, self.eccentric.pressure)


def compute_concentric_damping_force(target: MuscleTarget, isometric_force: float) -> float:
    """Return the damping force Fd at Vmax by (4.1) [N] for actuators of ``isometric_force`` F0 [N]."""
    remaining_fraction = max(0.0, hill.concentric_force(target.hill, 1.0, 1.0))
    return law.desired_force(isometric_force, isometric_force * remaining_fraction)


def size_damper(target: MuscleTarget, isometric_force: float, choices: DesignChoices) -> DamperDesign:
    """Size the damper for actuators of ``isometric_force`` F0 [N].

    The concentric design point is at Vmax, the eccentric one at the fastest lengthening. Raises InputError when the
    bore or an orifice is outside its range.
    """
    assumptions = choices.assumptions
    concentric_speed = target.design_peak_velocity
    eccentric_speed = (
        assumptions.eccentric_speed_fraction * concentric_speed
        if choices.eccentric_speed is None
        else choices.eccentric_speed
    )
    concentric_force = compute_concentric_damping_force(target, isometric_force)
    # (4.1) with opposite sign: the muscle pulls with s F0, the actuator with F0.
    eccentric_force = -law.desired_force(isometric_force, target.hill.saturation * isometric_force)
    if choices.eccentric_force is not None:
        eccentric_force = choices.eccentric_force
    required_bore = law.required_bore(max(concentric_force, eccentric_force), assumptions.cylinder_pressure)
    bore = _round_bore_up(required_bore) if choices.bore is None else choices.bore
    check_range("bore", bore, 1.0, 200.0, "mm", 1e-3)

    def build_point(force: float, speed: float) -> DamperDesignPoint:
        exact = law.required_orifice(force, speed, bore, choices.oil_density, DESIGN_DISCHARGE_COEFFICIENT)
        orifice = round(exact, 6)
        if orifice > bore or orifice < 1e-3 * bore:
            raise InputError(
                f"the damper needs an orifice of {1e3 * exact:.3g} mm in a bore of {1e3 * bore:.3g} mm for "
                f"{force:.3g} N at {1e3 * speed:.3g} mm/s; allowed: bore / 1000 to bore"
            )
        return DamperDesignPoint(speed, force, orifice, bore, choices.oil_density, assumptions.discharge_coefficient)

    return DamperDesign(
        bore,
        required_bore,
        build_point(concentric_force, concentric_speed),
        build_point(eccentric_force, eccentric_speed),
    )


def _round_bore_up(bore: float) -> float:
    """Return ``bore`` [m] rounded up to 0.01 mm, which keeps the design force within the allowed pressure."""
    return math.ceil(1e5 * bore - 1e-9) / 1e5
