"""Effects of valve, chamber, leak and tank: they change what the supply is (:mod:`klute_sim.laws.pneumatic_step`)."""

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence
from klute_sim.laws.pneumatics import Supply, replace_supply_fields

NOZZLE_CRITICAL_RATIO = 0.5
"""Critical pressure ratio of a valve as wide as its ports (assumed: that of a short nozzle)."""


def choke_symmetric(p: FloatSequence, state: FloatSequence, supply: Supply) -> Supply:
    """The supply behind a valve that fills and exhausts with the conductance ``1/own[0]``, and is else perfect."""
    return _with_valve(p[0], p[0], p[1], supply)


def choke_asymmetric(p: FloatSequence, state: FloatSequence, supply: Supply) -> Supply:
    """The same with ``1/own[0]`` to fill, and ``own[1]`` times the resistance to exhaust."""
    return _with_valve(p[0], p[0] * p[1], p[2], supply)


def _with_valve(fill_resistance: float, exhaust_resistance: float, critical_ratio: float, supply: Supply) -> Supply:
    if fill_resistance <= 0.0:
        return supply
    s = supply
    return replace_supply_fields(
        s,
        1.0 / fill_resistance,
        critical_ratio,
        1.0 / exhaust_resistance,
        critical_ratio,
        s.polytropic_exponent,
        s.leak_conductance,
        s.tank_volume,
        s.tank_pressure,
        s.regulator_time_constant,
    )


def delay_volume_compensation(p: FloatSequence, state: FloatSequence, supply: Supply) -> Supply:
    """A regulator that takes ``own[0]`` [s] to make up for a change of the muscle's volume, exponent ``own[1]``.

    Behind a choked valve the air feels the volume anyway, and there is nothing to recover.
    """
    s = supply
    if p[0] <= 0.0 or s.fill_conductance > 0.0:
        return s
    valve = s.fill_conductance, s.fill_critical_ratio, s.exhaust_conductance, s.exhaust_critical_ratio
    return replace_supply_fields(s, *valve, p[1], s.leak_conductance, s.tank_volume, s.tank_pressure, p[0])


def add_leak(p: FloatSequence, state: FloatSequence, supply: Supply) -> Supply:
    """The supply of a muscle with a leak of conductance ``own[0]`` [m3/(s Pa)]."""
    s = supply
    if p[0] <= 0.0:
        return s
    return replace_supply_fields(
        s,
        s.fill_conductance,
        s.fill_critical_ratio,
        s.exhaust_conductance,
        s.exhaust_critical_ratio,
        s.polytropic_exponent,
        p[0],
        s.tank_volume,
        s.tank_pressure,
        s.regulator_time_constant,
    )


def draw_from_tank(p: FloatSequence, state: FloatSequence, supply: Supply) -> Supply:
    """The supply out of a tank of volume ``1/own[0]`` [m3], full at the supply's own pressure, and not refilled."""
    s = supply
    if p[0] <= 0.0:
        return s
    return replace_supply_fields(
        s,
        s.fill_conductance,
        s.fill_critical_ratio,
        s.exhaust_conductance,
        s.exhaust_critical_ratio,
        s.polytropic_exponent,
        s.leak_conductance,
        1.0 / p[0],
        s.max_pressure,
        s.regulator_time_constant,
    )


def _resistance_parameter(key: str) -> EffectParameter:
    return EffectParameter(
        key=key,
        neutral=0.0,
        lower=0.0,
        upper=50.0,
        typical=4.0,
        source="1/C (ISO 6358); C = 1 dm3/(s bar) fills a 250 mm pair in about 0.2 s; assumed: a quarter of that",
    )


_CRITICAL_RATIO = EffectParameter(
    key="critical_ratio",
    neutral=None,
    lower=0.1,
    upper=0.6,
    typical=NOZZLE_CRITICAL_RATIO,
    source="ISO 6358: b of about 0.5 for short nozzles, 0.2 to 0.5 for valves",
)

CHOKED_VALVE = Effect(
    name="choked_valve",
    description="A valve lets only so much air through: filling is limited by the speed of sound.",
    kind="device",
    acts_in_supply=True,
    forms=(
        EffectForm(
            name="symmetric",
            equation="m' = C rho0 p1 sqrt(T0/T) phi(p2/p1, b), C the same both ways; pV = mRT",
            parameters=(_resistance_parameter("resistance_s_bar_per_dm3"), _CRITICAL_RATIO),
            laws={"supply": choke_symmetric},
        ),
        EffectForm(
            name="asymmetric",
            equation="m' = C rho0 p1 sqrt(T0/T) phi(p2/p1, b), C to fill, C over the factor to exhaust; pV = mRT",
            parameters=(
                _resistance_parameter("fill_resistance_s_bar_per_dm3"),
                EffectParameter(
                    key="exhaust_factor",
                    neutral=None,
                    lower=0.1,
                    upper=10.0,
                    typical=2.0,
                    source="assumed: resistance to exhaust over that to fill; silencers and long ways out",
                ),
                _CRITICAL_RATIO,
            ),
            laws={"supply": choke_asymmetric},
        ),
    ),
)

VOLUME_COUPLING = Effect(
    name="volume_coupling",
    description="The muscle's own motion squeezes and thins its air, and the regulator takes time to make up for it.",
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
                    source="assumed: as long as a regulator's lag; sealed, V'/V is 10 to 14 1/s at 200 mm/s",
                ),
                EffectParameter(
                    key="exponent",
                    neutral=None,
                    lower=1.0,
                    upper=1.4,
                    typical=1.2,
                    source="between isothermal and adiabatic",
                ),
            ),
            laws={"supply": delay_volume_compensation},
        ),
    ),
)

LEAK = Effect(
    name="leak",
    description="The muscle leaks: a regulator makes up for it at the cost of air, behind a valve the pressure sags.",
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
                    source="assumed: a sealed 3/4 in pair loses half of its 5 bar in 3 s",
                ),
            ),
            laws={"supply": add_leak},
        ),
    ),
)

SUPPLY_DROOP = Effect(
    name="supply_droop",
    description="The supply is a tank that is not refilled: its pressure sinks as air is taken.",
    kind="device",
    acts_in_supply=True,
    forms=(
        EffectForm(
            name="tank",
            equation="p <= p_supply - m_taken R T/V",
            parameters=(
                EffectParameter(
                    key="inverse_volume_per_l",
                    neutral=0.0,
                    lower=0.0,
                    upper=20.0,
                    typical=4.0,
                    source="assumed: a small buffer of a quarter litre, nothing behind it",
                ),
            ),
            laws={"supply": draw_from_tank},
        ),
    ),
)
