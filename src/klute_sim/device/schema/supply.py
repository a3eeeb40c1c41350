"""Sections of the supply and the air: regulator, valve, line, chamber, tank and leak."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, FiniteFloat, model_validator
from pydantic_core import PydanticCustomError

from klute_sim.device.schema.section import DeviceFileSection, NonNegative
from klute_sim.laws import valve as valve_law
from klute_sim.laws.pneumatics import ZERO_CELSIUS, SupplyParameters
from klute_sim.laws.valve import Restriction

ROOM_TEMPERATURE = 20.0 + ZERO_CELSIUS
"""Temperature of the air of a device without a supply [K] (assumed; the air is at rest and does nothing)."""

CriticalRatio = Annotated[FiniteFloat, Field(ge=0.0, lt=0.99)]


class Supply(DeviceFileSection):
    """The pressure regulator."""

    pressure_bar: Annotated[FiniteFloat, Field(ge=1e-3, le=20)]
    """Maximum gauge pressure."""
    rate_bar_per_s: Annotated[FiniteFloat, Field(ge=1e-3, le=1e7)]
    """Maximum rate of pressure change in both directions, without a [valve]."""
    gas_temperature_c: Annotated[FiniteFloat, Field(ge=-60, le=200)]
    """Temperature of the supplied air."""
    dead_volume_cm3: Annotated[FiniteFloat, Field(ge=0, le=1e4)] = 0.0
    """Air in fittings and hose that the muscle does not displace, without a [line]; left out: none."""


class Valve(DeviceFileSection):
    """A valve with limited flow (ISO 6358) from the supply to the muscle and from the muscle to the room."""

    fill_dm3_per_s_bar: Annotated[FiniteFloat, Field(ge=1e-4, le=1e3)]
    """Sonic conductance C from supply to muscle, fully open."""
    fill_critical_ratio: CriticalRatio
    """Critical pressure ratio b from supply to muscle."""
    exhaust_dm3_per_s_bar: Annotated[FiniteFloat, Field(ge=1e-4, le=1e3)]
    """Sonic conductance C from muscle to room, fully open."""
    exhaust_critical_ratio: CriticalRatio
    """Critical pressure ratio b from muscle to room."""
    command: Literal["pressure", "opening"] = "pressure"
    """Kind of command: a pressure that the valve controls, or an opening from -1 (exhaust) to 1 (fill)."""
    gain_per_bar: Annotated[FiniteFloat, Field(ge=1e-4, le=1e4)] | None = None
    """Opening per bar of pressure error; required for pressure commands, not allowed for openings."""
    drive: Literal["proportional", "on-off"] = "proportional"
    """Kind of valve: a continuous opening, or pulses whose width is the opening (pulse-width modulation)."""
    pwm_period_s: Annotated[FiniteFloat, Field(ge=1e-3, le=1.0)] | None = None
    """Period of the pulse-width modulation; required for an on-off valve, not allowed otherwise."""
    min_pulse_s: NonNegative | None = None
    """Shortest pulse of the valve; required for an on-off valve, not allowed otherwise."""

    @model_validator(mode="after")
    def _check_options(self) -> Self:
        if self.command == "pressure" and self.gain_per_bar is None:
            raise PydanticCustomError("valve", "command = 'pressure' (the default) needs gain_per_bar")
        if self.command == "opening" and self.gain_per_bar is not None:
            raise PydanticCustomError("valve", "gain_per_bar is not allowed with command = 'opening'; remove it")
        pulse_keys = self.pwm_period_s, self.min_pulse_s
        if self.drive == "on-off" and None in pulse_keys:
            raise PydanticCustomError("valve", "drive = 'on-off' needs pwm_period_s and min_pulse_s")
        if self.drive == "proportional" and pulse_keys != (None, None):
            raise PydanticCustomError("valve", "pwm_period_s and min_pulse_s need drive = 'on-off'")
        if self.pwm_period_s is not None and 2.0 * (self.min_pulse_s or 0.0) > self.pwm_period_s:
            raise PydanticCustomError("valve", "min_pulse_s must be at most half of pwm_period_s")
        return self


class Line(DeviceFileSection):
    """The tube between valve and muscle, which throttles the flow and adds dead volume."""

    length_m: Annotated[FiniteFloat, Field(gt=0, le=100)]
    """Length of the tube."""
    inner_diameter_mm: Annotated[FiniteFloat, Field(ge=0.5, le=50)]
    """Inner diameter of the tube."""

    def to_restriction(self) -> Restriction:
        """Return the flow restriction of the tube."""
        return valve_law.tube_restriction(self.length_m, self.get_si("inner_diameter_mm"))

    def compute_volume(self) -> float:
        """Return the volume of the tube [m3]."""
        return 0.25 * math.pi * self.get_si("inner_diameter_mm") ** 2 * self.length_m


class Chamber(DeviceFileSection):
    """The air in the muscle."""

    exponent: Annotated[FiniteFloat, Field(ge=1.0, le=1.67)]
    """Polytropic exponent: 1 isothermal, 1.4 adiabatic."""
    thermal_time_constant_s: Annotated[FiniteFloat, Field(ge=0, le=1e4)]
    """Time constant with which the air approaches the wall temperature; 0: never."""


class Tank(DeviceFileSection):
    """A tank that is not refilled."""

    volume_l: Annotated[FiniteFloat, Field(ge=1e-3, le=1e4)]
    """Volume of the tank."""
    pressure_bar: Annotated[FiniteFloat, Field(ge=1e-3, le=500)]
    """Gauge pressure of the full tank."""


class Leak(DeviceFileSection):
    """A leak of the muscle into the room."""

    conductance_dm3_per_s_bar: Annotated[FiniteFloat, Field(ge=0, le=10)]
    """Sonic conductance of the leak."""


def build_supply(
    supply: Supply | None,
    valve: Valve | None,
    line: Line | None,
    chamber: Chamber | None,
    tank: Tank | None,
    leak: Leak | None,
) -> SupplyParameters:
    """Return the parameters of the supply in SI units; without a ``supply``, everything is vented."""
    if supply is None:
        return SupplyParameters(max_pressure=0.0, max_pressure_rate=0.0, temperature=ROOM_TEMPERATURE)
    parameters = SupplyParameters(
        max_pressure=supply.get_si("pressure_bar"),
        max_pressure_rate=supply.get_si("rate_bar_per_s"),
        temperature=supply.gas_temperature_c + ZERO_CELSIUS,
        dead_volume=supply.get_si("dead_volume_cm3"),
    )
    if tank is not None:
        parameters = parameters._replace(tank_volume=tank.get_si("volume_l"), tank_pressure=tank.get_si("pressure_bar"))
    if leak is not None:
        parameters = parameters._replace(leak_conductance=leak.get_si("conductance_dm3_per_s_bar"))
    if valve is None:
        return parameters
    fill = Restriction(valve.get_si("fill_dm3_per_s_bar"), valve.fill_critical_ratio)
    exhaust = Restriction(valve.get_si("exhaust_dm3_per_s_bar"), valve.exhaust_critical_ratio)
    if line is not None:
        fill, exhaust = (valve_law.combine_in_series(path, line.to_restriction()) for path in (fill, exhaust))
        parameters = parameters._replace(dead_volume=parameters.dead_volume + line.compute_volume())
    if chamber is not None:
        parameters = parameters._replace(
            polytropic_exponent=chamber.exponent, thermal_time_constant=chamber.thermal_time_constant_s
        )
    return parameters._replace(
        fill_conductance=fill.conductance,
        fill_critical_ratio=fill.critical_ratio,
        exhaust_conductance=exhaust.conductance,
        exhaust_critical_ratio=exhaust.critical_ratio,
        valve_gain=valve.get_si("gain_per_bar") if valve.gain_per_bar is not None else 0.0,
        command_is_opening=float(valve.command == "opening"),
        pwm_period=valve.pwm_period_s or 0.0,
        min_pulse=valve.min_pulse_s or 0.0,
    )
