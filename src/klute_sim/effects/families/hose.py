"""Effect of the hose between valve and muscle: its wall friction, its air and the travel of sound in it."""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.effects.families.air import MIN_RESISTANCE
from klute_sim.laws import valve
from klute_sim.laws.pneumatics import SupplyParameters, replace_supply_fields

ENTRANCE_LOSS = 0.5
"""Loss at the sharp-edged entrance of a tube over the dynamic pressure [1] (F. M. White, Fluid Mechanics, chapter 6;
quoted from memory)."""
MIN_LENGTH_IN_DIAMETERS = ENTRANCE_LOSS / valve.HOSE_FRICTION_FACTOR
"""Length over inner diameter below which a tube is a nozzle and no hose [1] (assumed): its wall takes f L/d of the
dynamic pressure, less than its entrance, which the law leaves to the fitting. Turbulent flow needs as long to form."""


def find_flaw(p: Any) -> str:
    """Return why no hose has ``p.length`` and ``p.inner_diameter`` [m]; '' if hoses have them."""
    if p.length >= MIN_LENGTH_IN_DIAMETERS * p.inner_diameter:
        return ""
    return f"would be {1e3 * p.length:.2g} mm long and {1e3 * p.inner_diameter:.2g} mm wide, a nozzle and no hose"


SHORTEST_LENGTH = 1e-9
"""Length [m] up to which there is no hose (assumed); a fit tries such lengths, whose resistance is zero in rounding."""


def attach_hose(p: Any, state: Any, supply: SupplyParameters) -> SupplyParameters:
    """Return the supply with a hose of ``p.length`` and ``p.inner_diameter`` [m] in series, whose air is dead volume.

    A regulator senses the pressure at the muscle (assumed) and fills it through the hose, but upstream of a restriction
    it senses the pressure there, and the hose lies downstream. The delay of the hose acts on
    the command (:func:`klute_sim.device.dynamics.get_dead_time`).
    """
    s = supply
    if p.length <= SHORTEST_LENGTH:
        return s
    friction = valve.hose_restriction(p.length, p.inner_diameter)
    hose = valve.Restriction(min(friction.conductance, 1.0 / MIN_RESISTANCE), friction.critical_ratio)
    fill, exhaust = hose, hose
    if s.fill_conductance > 0.0:
        fill = valve.combine_in_series(valve.Restriction(s.fill_conductance, s.fill_critical_ratio), hose)
        exhaust = valve.combine_in_series(valve.Restriction(s.exhaust_conductance, s.exhaust_critical_ratio), hose)
    return replace_supply_fields(
        s,
        fill.conductance,
        fill.critical_ratio,
        exhaust.conductance,
        exhaust.critical_ratio,
        s.polytropic_exponent,
        s.leak_conductance,
        s.tank_volume,
        s.tank_pressure,
        s.regulator_time_constant,
        s.dead_volume + 0.25 * math.pi * p.inner_diameter * p.inner_diameter * p.length,
        s.regulator_is_upstream,
    )


HOSE = Effect(
    name="hose",
    description="A hose feeds the muscle: it throttles the flow, holds air of its own and delays the command.",
    kind="device",
    acts_in_supply=True,
    forms=(
        EffectForm(
            name="tube",
            equation="m' = A sqrt((p1^2 - p2^2) d/(f L R T)), f = 0.02; V + A L; command(t - L/c)",
            parameters=(
                EffectParameter(
                    key="length_m",
                    neutral=0.0,
                    lower=0.0,
                    upper=20.0,
                    typical=2.0,
                    source="assumed: from a bench's valve to the muscle; resistance and volume of pneumatic tubes: "
                    "Math. Comput. Model. Dyn. Syst. 23:523, 2017 (abstract read); below 25 diameters it is a nozzle, "
                    "which a diagnosis does not name",
                ),
                EffectParameter(
                    key="inner_diameter_mm",
                    neutral=None,
                    lower=1.0,
                    upper=20.0,
                    typical=4.0,
                    source="assumed: a hose of 6 mm outer diameter",
                ),
            ),
            laws={"supply": attach_hose},
            find_flaw=find_flaw,
        ),
    ),
)
