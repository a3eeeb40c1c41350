"""Effects of valve, chamber, leak and tank: they change what the supply is (:mod:`klute_sim.laws.charging`)."""

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.laws.pneumatics import Supply, changed

WIDE = 0.5
"""Critical pressure ratio of a valve as wide as its ports (assumed: that of a short nozzle)."""


def throttled(own: Numbers, memory: Numbers, supply: Supply) -> Supply:
    """The supply behind a valve that fills and exhausts with the conductance ``1/own[0]``, and is else perfect."""
    return _behind(own[0], own[0], own[1], supply)


def throttled_both(own: Numbers, memory: Numbers, supply: Supply) -> Supply:
    """The same with ``1/own[0]`` to fill, and ``own[1]`` times the resistance to exhaust."""
    return _behind(own[0], own[0] * own[1], own[2], supply)


def _behind(fill: float, exhaust: float, ratio: float, supply: Supply) -> Supply:
    if fill <= 0.0:
        return supply
    s = supply
    return changed(s, 1.0 / fill, ratio, 1.0 / exhaust, ratio, s.exponent, s.leak, s.tank, s.tank_pressure, s.recovery)


def slow_to_recover(own: Numbers, memory: Numbers, supply: Supply) -> Supply:
    """A regulator that takes ``own[0]`` [s] to make up for a change of the muscle's volume, exponent ``own[1]``.

    Behind a choked valve the air feels the volume anyway, and there is nothing to recover.
    """
    s = supply
    if own[0] <= 0.0 or s.fill > 0.0:
        return s
    valve = s.fill, s.fill_ratio, s.exhaust, s.exhaust_ratio
    return changed(s, *valve, own[1], s.leak, s.tank, s.tank_pressure, own[0])


def leaking(own: Numbers, memory: Numbers, supply: Supply) -> Supply:
    """The supply of a muscle with a leak of conductance ``own[0]`` [m3/(s Pa)]."""
    s = supply
    if own[0] <= 0.0:
        return s
    return changed(
        s, s.fill, s.fill_ratio, s.exhaust, s.exhaust_ratio, s.exponent, own[0], s.tank, s.tank_pressure, s.recovery
    )


def from_tank(own: Numbers, memory: Numbers, supply: Supply) -> Supply:
    """The supply out of a tank of volume ``1/own[0]`` [m3], full at the supply's own pressure, and not refilled."""
    s = supply
    if own[0] <= 0.0:
        return s
    return changed(
        s, s.fill, s.fill_ratio, s.exhaust, s.exhaust_ratio, s.exponent, s.leak, 1.0 / own[0], s.pressure, s.recovery
    )


def _resistance(key: str) -> Parameter:
    return Parameter(
        key=key,
        neutral=0.0,
        low=0.0,
        high=50.0,
        typical=4.0,
        source="1/C (ISO 6358); C = 1 dm3/(s bar) fills a 250 mm pair in about 0.2 s; assumed: a quarter of that",
    )


_RATIO = Parameter(
    key="critical_ratio",
    neutral=None,
    low=0.1,
    high=0.6,
    typical=WIDE,
    source="ISO 6358: b of about 0.5 for short nozzles, 0.2 to 0.5 for valves",
)

CHOKED = Effect(
    name="choked_valve",
    sentence="A valve lets only so much air through: filling is limited by the speed of sound.",
    kind="device",
    supply=True,
    forms=(
        Form(
            name="symmetric",
            equation="m' = C rho0 p1 sqrt(T0/T) phi(p2/p1, b), C the same both ways; pV = mRT",
            parameters=(_resistance("resistance_s_bar_per_dm3"), _RATIO),
            laws={"supply": throttled},
        ),
        Form(
            name="asymmetric",
            equation="m' = C rho0 p1 sqrt(T0/T) phi(p2/p1, b), C to fill, C over the factor to exhaust; pV = mRT",
            parameters=(
                _resistance("fill_resistance_s_bar_per_dm3"),
                Parameter(
                    key="exhaust_factor",
                    neutral=None,
                    low=0.1,
                    high=10.0,
                    typical=2.0,
                    source="assumed: resistance to exhaust over that to fill; silencers and long ways out",
                ),
                _RATIO,
            ),
            laws={"supply": throttled_both},
        ),
    ),
)

COUPLING = Effect(
    name="volume_coupling",
    sentence="The muscle's own motion squeezes and thins its air, and the regulator takes time to make up for it.",
    kind="device",
    supply=True,
    forms=(
        Form(
            name="polytropic",
            equation="dp/dt = regulator - n p V'/V - (p - regulated)/tau",
            parameters=(
                Parameter(
                    key="recovery_s",
                    neutral=0.0,
                    low=0.0,
                    high=5.0,
                    typical=0.05,
                    source="assumed: as long as a regulator's lag; sealed, V'/V is 10 to 14 1/s at 200 mm/s",
                ),
                Parameter(
                    key="exponent",
                    neutral=None,
                    low=1.0,
                    high=1.4,
                    typical=1.2,
                    source="between isothermal and adiabatic",
                ),
            ),
            laws={"supply": slow_to_recover},
        ),
    ),
)

LEAK = Effect(
    name="leak",
    sentence="The muscle leaks: a regulator makes up for it at the cost of air, behind a valve the pressure sags.",
    kind="device",
    supply=True,
    forms=(
        Form(
            name="orifice",
            equation="m' = C rho0 p sqrt(T0/T) phi(p0/p, 0.5)",
            parameters=(
                Parameter(
                    key="conductance_dm3_per_s_bar",
                    neutral=0.0,
                    low=0.0,
                    high=1.0,
                    typical=0.02,
                    source="assumed: a sealed 3/4 in pair loses half of its 5 bar in 3 s",
                ),
            ),
            laws={"supply": leaking},
        ),
    ),
)

DROOP = Effect(
    name="supply_droop",
    sentence="The supply is a tank that is not refilled: its pressure sinks as air is taken.",
    kind="device",
    supply=True,
    forms=(
        Form(
            name="tank",
            equation="p <= p_supply - m_taken R T/V",
            parameters=(
                Parameter(
                    key="inverse_volume_per_l",
                    neutral=0.0,
                    low=0.0,
                    high=20.0,
                    typical=4.0,
                    source="assumed: a small buffer of a quarter litre, nothing behind it",
                ),
            ),
            laws={"supply": from_tank},
        ),
    ),
)
