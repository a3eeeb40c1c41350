"""Effects of valve, chamber, leak and tank; each changes the parameters of the supply.

The physics of the changed supply is in :mod:`klute_sim.laws.pneumatic_step`.
"""

from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws.pneumatics import SupplyParameters, replace_supply_fields

NOZZLE_CRITICAL_RATIO = 0.5
"""Critical pressure ratio of a short nozzle, assumed for a valve as wide as its ports [1]."""
MIN_RESISTANCE = 100.0
"""Resistance below which a valve does not restrict any flow [s Pa/m3]: a millionth of 1 s bar/dm3 (assumed)."""


def choke_symmetric(p: Any, state: Any, supply: SupplyParameters) -> SupplyParameters:
    """Return the supply behind a valve with the same resistance ``p.resistance`` in both directions."""
    return _with_valve(p.resistance, p.resistance, p.critical_ratio, 0.0, supply)


def choke_asymmetric(p: Any, state: Any, supply: SupplyParameters) -> SupplyParameters:
    """Return the supply behind a valve whose exhaust has ``p.exhaust_factor`` times the resistance of filling."""
    return _with_valve(p.fill_resistance, p.fill_resistance * p.exhaust_factor, p.critical_ratio, 0.0, supply)


def restrict_downstream(p: Any, state: Any, supply: SupplyParameters) -> SupplyParameters:
    """Return a regulator that feeds the muscle through a fixed restriction of ``p.resistance``, as a needle valve.

    The regulator follows the command upstream of the restriction, at most with the rate of the supply [Pa/s], and
    relieves a higher pressure into the room, so the flow ends where the muscle's pressure meets the command. Without
    resistance the muscle has the pressure of the regulator. A device whose commands are openings has no such regulator.
    """
    return _with_valve(p.resistance, p.resistance, p.critical_ratio, 1.0, supply)


def _with_valve(
    fill_resistance: float,
    exhaust_resistance: float,
    critical_ratio: float,
    regulator_is_upstream: float,
    supply: SupplyParameters,
) -> SupplyParameters:
    """Return ``supply`` with sonic conductances 1/resistance; resistances in s Pa/m3."""
    if fill_resistance <= 0.0:
        return supply
    s = supply
    return replace_supply_fields(
        s,
        1.0 / max(fill_resistance, MIN_RESISTANCE),
        critical_ratio,
        1.0 / max(exhaust_resistance, MIN_RESISTANCE),
        critical_ratio,
        s.polytropic_exponent,
        s.leak_conductance,
        s.tank_volume,
        s.tank_pressure,
        s.regulator_time_constant,
        s.dead_volume,
        regulator_is_upstream,
    )


def delay_volume_compensation(p: Any, state: Any, supply: SupplyParameters) -> SupplyParameters:
    """Return a regulator that compensates a change of the muscle's volume within ``p.recovery`` [s].

    Behind a choked valve the volume acts on the pressure anyway, so the regulator has nothing to compensate.
    """
    s = supply
    if p.recovery <= 0.0 or s.fill_conductance > 0.0:
        return s
    valve = s.fill_conductance, s.fill_critical_ratio, s.exhaust_conductance, s.exhaust_critical_ratio
    tank = s.tank_volume, s.tank_pressure
    upstream = s.regulator_is_upstream
    return replace_supply_fields(s, *valve, p.exponent, s.leak_conductance, *tank, p.recovery, s.dead_volume, upstream)


def add_leak(p: Any, state: Any, supply: SupplyParameters) -> SupplyParameters:
    """Return the supply of a muscle with a leak of sonic conductance ``p.conductance`` [m3/(s Pa)]."""
    s = supply
    if p.conductance <= 0.0:
        return s
    return replace_supply_fields(
        s,
        s.fill_conductance,
        s.fill_critical_ratio,
        s.exhaust_conductance,
        s.exhaust_critical_ratio,
        s.polytropic_exponent,
        p.conductance,
        s.tank_volume,
        s.tank_pressure,
        s.regulator_time_constant,
        s.dead_volume,
        s.regulator_is_upstream,
    )


def draw_from_tank(p: Any, state: Any, supply: SupplyParameters) -> SupplyParameters:
    """Return a supply from a tank of volume 1/``p.inverse_volume`` [m3].

    The tank starts at the supply's pressure, and no compressor refills it.
    """
    s = supply
    if p.inverse_volume <= 0.0:
        return s
    return replace_supply_fields(
        s,
        s.fill_conductance,
        s.fill_critical_ratio,
        s.exhaust_conductance,
        s.exhaust_critical_ratio,
        s.polytropic_exponent,
        s.leak_conductance,
        1.0 / p.inverse_volume,
        s.max_pressure,
        s.regulator_time_constant,
        s.dead_volume,
        s.regulator_is_upstream,
    )


def _make_resistance_parameter(key: str) -> EffectParameter:
    return EffectParameter(
        key=key,
        neutral=0.0,
        lower=0.0,
        upper=500.0,
        typical=4.0,
        source="1/C (ISO 6358); C = 1 dm3/(s bar) fills a 250 mm pair at 0.8 L0 in 0.18 s; assumed: a quarter of that; "
        "at most a needle valve that fills a thin muscle in seconds",
    )


_CRITICAL_RATIO = EffectParameter(
    key="critical_ratio",
    neutral=None,
    lower=0.01,
    upper=0.6,
    typical=NOZZLE_CRITICAL_RATIO,
    source="ISO 6358: b of about 0.5 for short nozzles, 0.2 to 0.5 for valves, towards 0 for long tubes and several "
    "restrictions in series (0.01 here: a fit uses the logarithm)",
    physical_limits=(0.01,),
)

CHOKED_VALVE = Effect(
    name="choked_valve",
    description="The valve chokes: the speed of sound limits the mass flow of filling and exhausting.",
    kind="device",
    acts_in_supply=True,
    forms=(
        EffectForm(
            name="symmetric",
            equation="m' = C rho0 p1 sqrt(T0/T) phi(p2/p1, b), C the same both ways; p V = m R T",
            parameters=(_make_resistance_parameter("resistance_s_bar_per_dm3"), _CRITICAL_RATIO),
            laws={"supply": choke_symmetric},
        ),
        EffectForm(
            name="asymmetric",
            equation="m' = C rho0 p1 sqrt(T0/T) phi(p2/p1, b), C to fill, C over the factor to exhaust; p V = m R T",
            parameters=(
                _make_resistance_parameter("fill_resistance_s_bar_per_dm3"),
                EffectParameter(
                    key="exhaust_factor",
                    neutral=None,
                    lower=0.1,
                    upper=10.0,
                    typical=2.0,
                    source="assumed: exhaust resistance over fill resistance; silencers and long exhaust lines",
                ),
                _CRITICAL_RATIO,
            ),
            laws={"supply": choke_asymmetric},
        ),
        EffectForm(
            name="downstream",
            equation="m' = C rho0 p1 sqrt(T0/T) phi(p2/p1, b), p1 the higher of r and p, p2 the lower; "
            "dr/dt = regulator; p V = m R T",
            parameters=(_make_resistance_parameter("resistance_s_bar_per_dm3"), _CRITICAL_RATIO),
            laws={"supply": restrict_downstream},
        ),
    ),
)

VOLUME_COUPLING = Effect(
    name="volume_coupling",
    description="Motion of the muscle changes its volume and pressure, and the regulator compensates with a delay.",
    kind="device",
    acts_in_supply=True,
    forms=(
        EffectForm(
            name="polytropic",
            equation="dp/dt = regulator - n p V'/V - (p - regulated)/tau",
            parameters=(
                EffectParameter(
                    key="recovery_s",
                    neutral=0.0,
                    lower=0.0,
                    upper=5.0,
                    typical=0.05,
                    source="assumed: equal to the lag of a regulator; sealed, V'/V is 10 to 22 1/s at 200 mm/s",
                ),
                EffectParameter(
                    key="exponent",
                    neutral=None,
                    lower=1.0,
                    upper=1.4,
                    typical=1.2,
                    source="between isothermal and adiabatic",
                    physical_limits=(1.0, 1.4),
                ),
            ),
            laws={"supply": delay_volume_compensation},
        ),
    ),
)

LEAK = Effect(
    name="leak",
    description="The muscle leaks: a regulator uses more air to compensate, and behind a valve the pressure drops.",
    kind="device",
    acts_in_supply=True,
    forms=(
        EffectForm(
            name="orifice",
            equation="m' = C rho0 p sqrt(T0/T) phi(p0/p, 0.5)",
            parameters=(
                EffectParameter(
                    key="conductance_dm3_per_s_bar",
                    neutral=0.0,
                    lower=0.0,
                    upper=1.0,
                    typical=0.02,
                    source="assumed: a sealed 3/4 in pair at 0.93 L0 loses half of its 5 bar in 3 s",
                ),
            ),
            laws={"supply": add_leak},
        ),
    ),
)

SUPPLY_DROOP = Effect(
    name="supply_droop",
    description="The supply is a tank without refill: its pressure falls as air is drawn.",
    kind="device",
    acts_in_supply=True,
    forms=(
        EffectForm(
            name="tank",
            equation="p <= p_supply - m_drawn R T/V",
            parameters=(
                EffectParameter(
                    key="inverse_volume_per_l",
                    neutral=0.0,
                    lower=0.0,
                    upper=20.0,
                    typical=4.0,
                    source="assumed: a small buffer of a quarter litre without compressor",
                ),
            ),
            laws={"supply": draw_from_tank},
        ),
    ),
)
