"""Effects of regulator and line: pressure that is late, or not what was asked for."""

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter


def lagged(own: Numbers, memory: Numbers, target: float, pressure: float, step: float) -> float:
    """Pressure [Pa] a step later: ``dP/dt = (target - P) / tau`` (backward Euler)."""
    if own[0] <= 0.0:
        return target
    return pressure + step / (own[0] + step) * (target - pressure)


def amplified(own: Numbers, memory: Numbers, command: float) -> float:
    """Target [Pa]: ``gain * command``."""
    return own[0] * command


def shifted(own: Numbers, memory: Numbers, command: float) -> float:
    """Target [Pa]: ``command + offset``."""
    return command + own[0]


LAG = Effect(
    name="pressure_lag",
    sentence="Line and chamber take time to fill: the pressure follows the command with a lag.",
    kind="device",
    supply=True,
    forms=(
        Form(
            name="first_order",
            equation="dP/dt = (target - P)/tau, within the supply's rate",
            parameters=(
                Parameter(
                    key="time_constant_s",
                    neutral=0.0,
                    low=0.0,
                    high=0.5,
                    typical=0.05,
                    source="a valve of 1 dm3/(s bar) fills a 250 mm pair in about 0.2 s",
                ),
            ),
            laws={"pressure_reached": lagged},
        ),
    ),
)

DELAY = Effect(
    name="pressure_delay",
    sentence="The valve answers late: the command acts after a dead time.",
    kind="device",
    supply=True,
    forms=(
        Form(
            name="dead_time",
            equation="command(t - T)",
            parameters=(
                Parameter(
                    key="delay_s",
                    neutral=0.0,
                    low=0.0,
                    high=0.3,
                    typical=0.04,
                    source="a measured pneumatic-muscle leg: 45-70 ms",
                ),
            ),
        ),
    ),
)

ERROR = Effect(
    name="regulator_error",
    sentence="The regulator holds another pressure than the one that was commanded.",
    kind="device",
    supply=True,
    forms=(
        Form(
            name="gain",
            equation="target = gain command",
            parameters=(
                Parameter(
                    key="gain",
                    neutral=1.0,
                    low=0.7,
                    high=1.3,
                    typical=0.95,
                    source="assumed: a few percent of span, as data sheets of regulators allow",
                ),
            ),
            laws={"pressure_target": amplified},
        ),
        Form(
            name="offset",
            equation="target = command + offset",
            parameters=(
                Parameter(
                    key="offset_bar",
                    neutral=0.0,
                    low=-0.5,
                    high=0.5,
                    typical=0.1,
                    source="assumed: a few percent of span, as data sheets of regulators allow",
                ),
            ),
            laws={"pressure_target": shifted},
        ),
    ),
)
