"""The device file on air: a regulator, and between it and the muscle a valve, a line, the chamber, a tank, a leak."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, FiniteFloat, model_validator
from pydantic_core import PydanticCustomError

from klute_sim.device.schema.section import DeviceFileSection, NonNegative, Positive
from klute_sim.laws import valve as valve_law
from klute_sim.laws.pneumatics import ZERO_CELSIUS, Supply
from klute_sim.laws.valve import Restriction

CriticalRatio = Annotated[FiniteFloat, Field(ge=0.0, lt=0.99)]


class SupplySection(DeviceFileSection):
    """What the pressure regulator can do."""

    pressure_bar: Annotated[FiniteFloat, Field(gt=0, le=20)]
    """Highest gauge pressure."""
    rate_bar_per_s: Positive
    """Fastest change either way; of a regulator without a [valve]."""
    gas_temperature_c: Annotated[FiniteFloat, Field(ge=-60, le=200)]


class ValveSection(DeviceFileSection):
    """A valve with a limited flow (ISO 6358) between supply and muscle, and between muscle and room."""

    fill_dm3_per_s_bar: Annotated[FiniteFloat, Field(ge=1e-4, le=1e3)]
    """Sonic conductance C towards the muscle, fully open."""
    fill_critical_ratio: CriticalRatio
    """Critical pressure ratio b."""
    exhaust_dm3_per_s_bar: Annotated[FiniteFloat, Field(ge=1e-4, le=1e3)]
    exhaust_critical_ratio: CriticalRatio
    takes: Literal["pressure", "opening"] = "pressure"
    """What a command is: a pressure, which the valve's own loop follows, or an opening, -1 (exhaust) to 1 (fill)."""
    gain_per_bar: Annotated[FiniteFloat, Field(gt=0, le=1e4)] | None = None
    """Opening per bar that is missing; only, and always, where commands are pressures."""
    drive: Literal["proportional", "on-off"] = "proportional"
    """Whether the valve opens in proportion, or in pulses as wide as the opening."""
    period_s: Annotated[FiniteFloat, Field(ge=1e-3, le=1.0)] | None = None
    """Of the pulses; only, and always, of an on-off valve."""
    shortest_pulse_s: NonNegative | None = None
    """That the valve can still make; likewise."""

    @model_validator(mode="after")
    def _check_options(self) -> Self:
        if self.takes == "pressure" and self.gain_per_bar is None:
            raise PydanticCustomError("valve", "takes = 'pressure' (also when left out) needs gain_per_bar")
        if self.takes == "opening" and self.gain_per_bar is not None:
            raise PydanticCustomError("valve", "gain_per_bar is of no use to takes = 'opening': leave it out")
        pulses = self.period_s, self.shortest_pulse_s
        if self.drive == "on-off" and None in pulses:
            raise PydanticCustomError("valve", "drive = 'on-off' needs period_s and shortest_pulse_s")
        if self.drive == "proportional" and pulses != (None, None):
            raise PydanticCustomError("valve", "period_s and shortest_pulse_s need drive = 'on-off'")
        if self.period_s is not None and 2.0 * (self.shortest_pulse_s or 0.0) > self.period_s:
            raise PydanticCustomError("valve", "shortest_pulse_s must be at most half of period_s")
        return self


class LineSection(DeviceFileSection):
    """The tube between valve and muscle: it throttles, and it has to be filled, too."""

    length_m: Annotated[FiniteFloat, Field(gt=0, le=100)]
    inner_diameter_mm: Annotated[FiniteFloat, Field(ge=0.5, le=50)]

    def to_restriction(self) -> Restriction:
        """Its flow."""
        return valve_law.tube_restriction(self.length_m, self.get_si("inner_diameter_mm"))

    def compute_volume(self) -> float:
        """Its volume [m3]."""
        return 0.25 * math.pi * self.get_si("inner_diameter_mm") ** 2 * self.length_m


class ChamberSection(DeviceFileSection):
    """The air in the muscle."""

    dead_volume_cm3: Annotated[FiniteFloat, Field(ge=0, le=1e4)]
    """Of fittings, without the line."""
    exponent: Annotated[FiniteFloat, Field(ge=1.0, le=1.67)]
    """Polytropic: 1 isothermal, 1.4 adiabatic."""
    warming_s: Annotated[FiniteFloat, Field(ge=0, le=1e4)]
    """Time in which the air takes the walls' temperature all the same; 0: never."""


class TankSection(DeviceFileSection):
    """A tank that is not refilled."""

    volume_l: Annotated[FiniteFloat, Field(ge=1e-3, le=1e4)]
    pressure_bar: Annotated[FiniteFloat, Field(gt=0, le=500)]
    """When full, gauge."""


class LeakSection(DeviceFileSection):
    """A leak of the muscle into the room."""

    conductance_dm3_per_s_bar: Annotated[FiniteFloat, Field(ge=0, le=10)]


def build_supply(
    supply: SupplySection,
    valve: ValveSection | None,
    line: LineSection | None,
    chamber: ChamberSection | None,
    tank: TankSection | None,
    leak: LeakSection | None,
) -> Supply:
    """The law's parameters, SI."""
    found = Supply(
        max_pressure=supply.get_si("pressure_bar"),
        max_pressure_rate=supply.get_si("rate_bar_per_s"),
        temperature=supply.gas_temperature_c + ZERO_CELSIUS,
    )
    if tank is not None:
        found = found._replace(tank_volume=tank.get_si("volume_l"), tank_pressure=tank.get_si("pressure_bar"))
    if leak is not None:
        found = found._replace(leak_conductance=leak.get_si("conductance_dm3_per_s_bar"))
    if valve is None:
        return found
    fill = Restriction(valve.get_si("fill_dm3_per_s_bar"), valve.fill_critical_ratio)
    exhaust = Restriction(valve.get_si("exhaust_dm3_per_s_bar"), valve.exhaust_critical_ratio)
    if line is not None:
        fill, exhaust = (valve_law.combine_in_series(way, line.to_restriction()) for way in (fill, exhaust))
        found = found._replace(dead_volume=line.compute_volume())
    if chamber is not None:
        found = found._replace(
            dead_volume=found.dead_volume + chamber.get_si("dead_volume_cm3"),
            polytropic_exponent=chamber.exponent,
            thermal_time_constant=chamber.warming_s,
        )
    return found._replace(
        fill_conductance=fill.conductance,
        fill_critical_ratio=fill.critical_ratio,
        exhaust_conductance=exhaust.conductance,
        exhaust_critical_ratio=exhaust.critical_ratio,
        valve_gain=valve.get_si("gain_per_bar") if valve.gain_per_bar is not None else 0.0,
        command_is_opening=float(valve.takes == "opening"),
        pwm_period=valve.period_s or 0.0,
        min_pulse=valve.shortest_pulse_s or 0.0,
    )
