"""Effects of regulator and line: the pressure follows the command late or inaccurately."""

from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws.mckibben import MuscleParameters


def lag_pressure(p: Any, state: Any, target: float, pressure: float, dt: float) -> float:
    """Return the pressure [Pa] after the step: ``dP/dt = (target - P) / tau`` (backward Euler)."""
    if p.time_constant <= 0.0:
        return target
    return pressure + dt / (p.time_constant + dt) * (target - pressure)


def lag_pressure_second_order(p: Any, state: Any, target: float, pressure: float, dt: float) -> float:
    """Return the pressure [Pa] after the step: ``tau^2 P'' + 2 zeta tau P' + P = target`` (backward Euler)."""
    if p.time_constant <= 0.0:
        return target
    steps = dt / p.time_constant
    change = dt * state.rate + steps * steps * (target - pressure)
    return pressure + change / (1.0 + steps * (2.0 * p.damping_ratio + steps))


def step_pressure_rate(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float]:
    """Return the rate [Pa/s] at which the supply changed the pressure in the step; its limits reduce it."""
    return (pressure_change / dt,)


def apply_gain(p: Any, state: Any, command: float) -> float:
    """Return the target [Pa] ``gain * command``."""
    return p.gain * command


def apply_offset(p: Any, state: Any, command: float) -> float:
    """Return the target [Pa] ``command + offset``."""
    return command + p.offset


PRESSURE_LAG = Effect(
    name="pressure_lag",
    description="Regulator, line and chamber respond slowly: the pressure follows the command with a lag.",
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
                    upper=5.0,
                    typical=0.05,
                    source="a valve of 1 dm3/(s bar) fills a 250 mm pair in about 0.2 s, a needle valve in seconds",
                ),
            ),
            laws={"pressure_reached": lag_pressure},
        ),
        EffectForm(
            name="second_order",
            equation="dP/dt = R, tau^2 dR/dt = target - P - 2 zeta tau R, within the supply's rate",
            parameters=(
                EffectParameter(
                    key="time_constant_s",
                    neutral=0.0,
                    lower=0.0,
                    upper=1.0,
                    typical=0.02,
                    source="assumed: the bandwidth of electronic pressure regulators is 5 to 20 Hz",
                ),
                EffectParameter(
                    key="damping_ratio",
                    neutral=None,
                    lower=0.2,
                    upper=3.0,
                    typical=0.7,
                    source="assumed: with 0.7 a step overshoots by 5 per cent, as regulators are tuned",
                ),
            ),
            laws={"pressure_reached": lag_pressure_second_order, "next_state": step_pressure_rate},
            states=("rate",),
        ),
    ),
)

PRESSURE_DELAY = Effect(
    name="pressure_delay",
    description="The valve responds late: the command acts after a dead time.",
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
    description="The regulator holds a pressure that differs from the command.",
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
