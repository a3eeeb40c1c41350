"""Section ``[muscle]`` of a device file."""

import math
from typing import Annotated, Self

from pydantic import Field, FiniteFloat, model_validator
from pydantic_core import PydanticCustomError

from klute_sim.device.schema.section import DeviceFileSection, Positive
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import MuscleParameters

MAX_RADIUS_MISMATCH = 0.05
"""Maximum relative difference of the radius that braid and turns imply from the bladder radius (Table 3.1: 2.6 %)."""

MIN_GAS_FRACTION = 0.01
"""Minimum share of gas in the braid's volume at rest, where it is smallest (assumed: a bore of a tenth the width)."""

RubberConstant = Annotated[FiniteFloat, Field(ge=0, le=1e5)]
"""Mooney-Rivlin constant [kPa]; rubber has tens to thousands, and 1e5 is stiffer than any."""


class Muscle(DeviceFileSection):
    """``count`` equal McKibben actuators side by side."""

    count: Annotated[int, Field(ge=1, le=100)] = 1
    """Number of actuators in parallel."""
    resting_length_mm: Annotated[FiniteFloat, Field(ge=20, le=2000)]
    """Resting length L0 of the actuator."""
    braid_length_ratio: Annotated[FiniteFloat, Field(ge=1.001, lt=math.sqrt(3.0))]
    """Braid length over resting length, B/L0; at 1 the braid cannot wind, at sqrt(3) it is locked at rest."""
    turns_per_m: Positive
    """Turns of a braid thread per metre of resting length, N/L0."""
    bladder_radius_mm: Annotated[FiniteFloat, Field(ge=0.05, le=500)]
    """Outer bladder radius R0 at rest."""
    bladder_thickness_mm: Annotated[FiniteFloat, Field(ge=0.01, le=500)]
    """Bladder wall thickness t0 at rest; the rubber takes its volume from the air."""
    c10_kpa: RubberConstant
    """First Mooney-Rivlin constant of the bladder."""
    c01_kpa: RubberConstant
    """Second Mooney-Rivlin constant of the bladder."""
    friction_slope_n_per_bar: Annotated[FiniteFloat, Field(ge=-1e4, le=1e4)]
    """Slope m of the friction offset over pressure, per actuator."""
    friction_offset_n: Annotated[FiniteFloat, Field(ge=-1e5, le=1e5)]
    """Friction offset b at zero pressure, per actuator, with the sign of the dissertation."""
    bladder: bool = True
    """Whether the bladder term acts; False gives the geometric model."""
    friction: bool = True
    """Whether the friction offset acts."""

    @model_validator(mode="after")
    def _check_bladder_fits_braid(self) -> Self:
        if self.bladder_thickness_mm >= self.bladder_radius_mm:
            raise PydanticCustomError(
                "wall",
                "bladder_thickness_mm is {t} but must be less than bladder_radius_mm, {r}",
                {"t": self.bladder_thickness_mm, "r": self.bladder_radius_mm},
            )
        ratio = self.braid_length_ratio
        braid_radius = 1e3 * mckibben.compute_braid_radius(ratio, 1.0, self.turns_per_m)
        if abs(braid_radius / self.bladder_radius_mm - 1.0) > MAX_RADIUS_MISMATCH:
            matching_turns = self.turns_per_m * braid_radius / self.bladder_radius_mm  # the radius is as 1 / N
            raise PydanticCustomError(
                "radius",
                "bladder_radius_mm is {r} but braid_length_ratio and turns_per_m imply a radius of "
                "{b} mm; the two must agree within 5 %: with this braid_length_ratio, turns_per_m = {n} fits "
                "the bladder",
                {"r": self.bladder_radius_mm, "b": f"{braid_radius:.2f}", "n": f"{matching_turns:.4g}"},
            )
        inner_radius = self.bladder_radius_mm - self.bladder_thickness_mm
        rubber_fraction = (self.bladder_radius_mm**2 - inner_radius**2) / braid_radius**2
        if 1.0 - rubber_fraction < MIN_GAS_FRACTION:
            max_thickness = self.bladder_radius_mm - math.sqrt(
                max(self.bladder_radius_mm**2 - (1.0 - MIN_GAS_FRACTION) * braid_radius**2, 0.0)
            )
            raise PydanticCustomError(
                "wall",
                "bladder_thickness_mm is {t}, so that rubber fills the braid at resting length and leaves no room for "
                "air; allowed: at most {max} mm with this braid and bladder_radius_mm",
                {"t": self.bladder_thickness_mm, "max": f"{math.floor(1e3 * max_thickness) / 1e3:g}"},
            )
        return self

    @property
    def has_rubber(self) -> bool:
        """Whether the rubber of the bladder resists its deformation."""
        return self.bladder and (self.c10_kpa > 0.0 or self.c01_kpa > 0.0)

    def to_parameters(self) -> MuscleParameters:
        """Return the parameters of the law in SI units."""
        length = self.get_si("resting_length_mm")
        return MuscleParameters(
            n_actuators=float(self.count),
            resting_length=length,
            braid_length=self.braid_length_ratio * length,
            braid_turns=self.turns_per_m * length,
            bladder_radius=self.get_si("bladder_radius_mm"),
            bladder_thickness=self.get_si("bladder_thickness_mm"),
            c10=self.get_si("c10_kpa") if self.bladder else 0.0,
            c01=self.get_si("c01_kpa") if self.bladder else 0.0,
            friction_slope=self.get_si("friction_slope_n_per_bar") if self.friction else 0.0,
            friction_offset=self.get_si("friction_offset_n") if self.friction else 0.0,
        )
