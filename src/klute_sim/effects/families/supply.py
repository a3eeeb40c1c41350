"""Effects of regulator and line: pressure that is late, or not what was asked for."""

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence


def lag_pressure(p: FloatSequence, state: FloatSequence, target: float, pressure: float, dt: float) -> float:
    """Pressure [Pa] a step later: ``dP/dt = (target - P) / tau`` (backward Euler)."""
    if p[0] <= 0.0:
        return target
    return pressure + dt / (p[0] + dt) * (target - pressure)


def apply_gain(p: FloatSequence, state: FloatSequence, command: float) -> float:
    """Target [Pa]: ``gain * command``."""
    return p[0] * command


def apply_offset(p: FloatSequence, state: FloatSequence, command: float) -> float:
    """Target [Pa]: ``command + offset``."""
    return command + p[0]


PRESSURE_LAG = Effect(
    name="pressure_lag",
    description="Line and chamber take time to fill: the pressure follows the command with a lag.",
    kind="device",
    acts_in_supply=True,
    forms=(
        EffectForm(
            name="first_order",
            equation="dP/dt = (target - P)/tau, within the supply's rate",
            parameters=(
                EffectParameter(
                    key="time_constant_s",
                    neutral=0.0,
                    lower=0.0,
                    upper=0.5,
                    typical=0.05,
                    source="a valve of 1 dm3/(s bar) fills a 250 mm pair in about 0.2 s",
                ),
            ),
            laws={"pressure_reached": lag_pressure},
        ),
    ),
)

PRESSURE_DELAY = Effect(
    name="pressure_delay",
    description="The valve answers late: the command acts after a dead time.",
    kind="device",
    acts_in_supply=True,
    forms=(
        EffectForm(
            name="dead_time",
            equation="command(t - T)",
            parameters=(
                EffectParameter(
                    key="delay_s",
                    neutral=0.0,
                    lower=0.0,
                    upper=0.3,
                    typical=0.04,
                    source="a measured pneumatic-muscle leg: 45-70 ms",
                ),
            ),
        ),
    ),
)

REGULATOR_ERROR = Effect(
    name="regulator_error",
    description="The regulator holds another pressure than the one that was commanded.",
    kind="device",
    acts_in_supply=True,
    forms=(
        EffectForm(
            name="gain",
            equation="target = gain command",
            parameters=(
                EffectParameter(
                    key="gain",
                    neutral=1.0,
                    lower=0.7,
                    upper=1.3,
                    typical=0.95,
                    source="assumed: a few percent of span, as data sheets of regulators allow",
                ),
            ),
            laws={"pressure_target": apply_gain},
        ),
        EffectForm(
            name="offset",
            equation="target = command + offset",
            parameters=(
                EffectParameter(
                    key="offset_bar",
                    neutral=0.0,
                    lower=-0.5,
                    upper=0.5,
                    typical=0.1,
                    source="assumed: a few percent of span, as data sheets of regulators allow",
                ),
            ),
            laws={"pressure_target": apply_offset},
        ),
    ),
)
