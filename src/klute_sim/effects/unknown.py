"""Terms without a name: what an equation of the device lacks, in functions of what acts there.

A diagnosis that no effect explains finds some of these coefficients by sparse regression
(:mod:`klute_sim.diagnose.fallback`), and a device file carries them. They are no physics: nothing keeps them from
giving energy, and beyond the data they were fitted to they mean little. So every function is bounded,
whatever its arguments.
"""

import math
from collections.abc import Mapping

from klute_sim import units
from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.effects.smooth import dragged, sign
from klute_sim.laws.mckibben import Muscle
from klute_sim.units import BAR

FULL = 5.0 * BAR
"""Pressure that pressures are divided by [Pa]."""
HALF = 0.5 * BAR
"""Pressure at which half of what begins with pressure is there [Pa]."""
SHORTENED = 0.25
"""Contraction that contractions are divided by: about the most that a muscle does [1]."""
FAST = 0.1
"""Speed [m/s] up to which what depends on speed grows."""
STRETCHED = 10e-3
"""Stretch that stretches are divided by [m]."""
TOE = 1e-3
"""Stretch [m] at which half of what begins with stretch is there."""
MOST = 2.0
"""Dimensionless pressure, contraction and stretch beyond which nothing changes any more."""
SLOWEST = 1.0
"""Time constant [s] of a pressure, at most."""


def pulled(
    own: Numbers, memory: Numbers, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: plus a combination of functions of pressure, contraction and speed."""
    p = min(max(pressure / FULL, 0.0), MOST)
    b = max(pressure, 0.0) / (max(pressure, 0.0) + HALF)
    e = min(max((1.0 - length / muscle.resting_length) / SHORTENED, 0.0), MOST)
    d, s = sign(rate), rate / math.sqrt(rate * rate + FAST * FAST)
    still = (
        p * (own[0] + own[1] * p) + b * (own[2] + own[3] * e) + e * (own[4] + own[5] * e + p * (own[6] + own[7] * e))
    )
    return force + (still + d * (own[8] + own[9] * p + own[10] * e) + s * (own[11] + own[12] * p + own[13] * abs(s)))


def tied(own: Numbers, memory: Numbers, force: float, stretch: float) -> float:
    """Tension [N]: plus a combination of functions of the tendon's stretch, nothing while it is slack."""
    x, t = min(max(stretch / STRETCHED, 0.0), MOST), max(stretch, 0.0) / (max(stretch, 0.0) + TOE)
    return force + (x * (own[0] + own[1] * x) + own[2] * t)


def held(own: Numbers, memory: Numbers, target: float, pressure: float, step: float) -> float:
    """Pressure [Pa] a step later: another target, a dead band around it, and a lag (backward Euler)."""
    c = min(target / FULL, MOST)
    wanted = max(dragged(pressure, target + (own[0] + c * (own[1] + c * own[2])), own[3], 0.0), 0.0)
    slow = own[4] + own[5] * c + (own[6] if wanted < pressure else 0.0)
    if slow <= 0.0:
        return wanted
    slow = min(slow, SLOWEST)
    return pressure + step / (slow + step) * (wanted - pressure)


_SOURCE = "assumed: no physics; range and size are those of a force worth looking for"


def _number(key: str, high: float, typical: float, *, signed: bool = True) -> Parameter:
    low = -high if signed else 0.0
    return Parameter(key=key, neutral=0.0, low=low, high=high, typical=typical, source=_SOURCE)


def _force(key: str, typical: float = 10.0, *, signed: bool = True) -> Parameter:
    return _number(key, 1000.0, typical, signed=signed)


FORCE = Effect(
    name="unknown_force",
    sentence="Muscle and damper pull otherwise than any known effect explains: a combination fitted to data.",
    kind="device",
    data_driven=True,
    forms=(
        Form(
            name="sparse",
            equation="F += sum of coefficient times function: p, p^2, b, b e, e, e^2, p e, p e^2, d, p d, e d, s, p s, "
            "s |s|; p = P/(5 bar), b = P/(P + 0.5 bar), e = (1 - L/L0)/0.25, d = v/sqrt(v^2 + (1 mm/s)^2), "
            "s = v/sqrt(v^2 + (100 mm/s)^2); p and e up to 2",
            parameters=(
                _force("pressure_n"),
                _force("pressure_squared_n"),
                _force("begin_n"),
                _force("begin_contraction_n"),
                _force("contraction_n"),
                _force("contraction_squared_n"),
                _force("pressure_contraction_n"),
                _force("pressure_contraction_squared_n"),
                # Dry friction that pushes has no solution at rest.
                _force("friction_n", signed=False),
                _force("pressure_friction_n", signed=False),
                _force("contraction_friction_n", signed=False),
                _force("speed_n"),
                _force("pressure_speed_n"),
                _force("speed_squared_n"),
            ),
            laws={"muscle_force": pulled},
        ),
    ),
)

TENDON = Effect(
    name="unknown_tendon_force",
    sentence="The tendon pulls otherwise than any known effect explains: a combination fitted to data.",
    kind="device",
    data_driven=True,
    forms=(
        Form(
            name="sparse",
            equation="F += sum of coefficient times function: x, x^2, t; x = stretch/(10 mm), up to 2, "
            "t = stretch/(stretch + 1 mm)",
            parameters=(_force("stretch_n", 40.0), _force("stretch_squared_n", 40.0), _force("toe_n", 40.0)),
            laws={"tendon_force": tied},
        ),
    ),
)

PRESSURE = Effect(
    name="unknown_pressure",
    sentence="The pressure follows its command otherwise than any known effect explains: a combination fitted to data.",
    kind="device",
    supply=True,
    data_driven=True,
    forms=(
        Form(
            name="sparse",
            equation="dP/dt = (target - P)/tau, target = command + sum of coefficient times function: 1, c, c^2, and a "
            "dead band z around it; tau = sum of coefficient times function: 1, c, f; c = command/(5 bar), up to 2, "
            "f = 1 while P falls",
            parameters=(
                _number("offset_bar", 2.0, 0.1),
                _number("command_bar", 2.0, 0.1),
                _number("command_squared_bar", 2.0, 0.1),
                _number("dead_band_bar", 1.0, 0.1, signed=False),
                _number("lag_s", SLOWEST, 0.02, signed=False),
                _number("command_lag_s", SLOWEST, 0.02),
                _number("falling_lag_s", SLOWEST, 0.02),
            ),
            laws={"pressure_reached": held},
        ),
    ),
)

_FUNCTIONS = {
    FORCE.name: ("p", "p^2", "b", "b e", "e", "e^2", "p e", "p e^2", "d", "p d", "e d", "s", "p s", "s |s|"),
    TENDON.name: ("x", "x^2", "t"),
    PRESSURE.name: ("", "c", "c^2", "", "", "c", "f"),
}
"""Effect -> what each of its parameters is the coefficient of; '': of 1."""
_SUMS = {"dead_band_bar": "dead band =", "N": "F +=", "bar": "target = command", "s": "dP/dt = (target - P)/tau, tau ="}
"""Parameter, or else its unit -> what it is part of."""
_SYMBOLS = {
    "p": "P/(5 bar)",
    "b": "P/(P + 0.5 bar)",
    "e": "(1 - L/L0)/0.25",
    "d": "v/sqrt(v^2 + (1 mm/s)^2)",
    "s": "v/sqrt(v^2 + (100 mm/s)^2)",
    "x": "stretch/(10 mm)",
    "t": "stretch/(stretch + 1 mm)",
    "c": "command/(5 bar)",
    "f": "1 while P falls",
}


def formula(effect: Effect, values: Mapping[str, float]) -> str:
    """The ``effect``, one of this module, with ``values`` of its parameters (in the units of their keys), in a line."""
    sums: dict[str, str] = {}
    used = ""
    for parameter, function in zip(effect.forms[0].parameters, _FUNCTIONS[effect.name], strict=True):
        value, unit = values.get(parameter.key, 0.0), units.split(parameter.key)[1]
        if value != 0.0:
            whole = _SUMS.get(parameter.key) or _SUMS[unit]
            part = f" {'-' if value < 0.0 else '+'} {abs(value):.3g} {unit} {function}"
            sums[whole] = sums.get(whole, whole) + part.rstrip()
            used += function
    lines = [line.replace("= + ", "= ") for line in sums.values()]
    return "; ".join([*lines, *(f"{symbol} = {meaning}" for symbol, meaning in _SYMBOLS.items() if symbol in used)])
