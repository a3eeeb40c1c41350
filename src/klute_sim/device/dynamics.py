"""Implicit time step of the muscle-tendon unit: (McKibben || damper) in series with the tendon (chapter 7).

The junction is massless: ``F_McK(p, l) + F_damper(dl/dt) = F_tendon(l_mt - l)``. The v|v| law of the damper has no
Lipschitz inverse at rest, so an explicit step chatters. A backward-Euler step is one scalar equation. The lock length
and the resting length of the muscle bracket its root, so the equation always has a solution.

The two ends of the bracket are stops. The dissertation gives the stop at resting length (the muscle never exceeds L0;
rigid: assumed). The stop at lock length is assumed: the braid cannot close further. The force that the balance lacks
at a stop is the *reaction* of the stop.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from klute_sim.effects import catalogue
from klute_sim.effects.smoothing import EQUILIBRIUM_TIME_STEP
from klute_sim.laws import damper as _damper
from klute_sim.laws import damper_chamber, mckibben, pneumatic_step, pneumatics
from klute_sim.laws import tendon as _tendon
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.damper_chamber import DamperState
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.laws.pneumatic_step import AirCharge, GasState
from klute_sim.laws.pneumatics import SupplyParameters
from klute_sim.laws.tendon import TendonParameters

FORCE_TOLERANCE = 1e-10
"""Force residual at which a step counts as solved, relative to 1 N + tendon tension."""
MAX_NEAR_SPEED = 0.4
"""Speed of the muscle [m/s] up to which the length is first searched near the last one."""
MAX_SECANT_STEPS = 6
"""Maximum number of Newton's and secant steps before Chandrupatla's method; friction with a sharp edge needs it."""
MAX_ITERATIONS = 200
"""Maximum number of root-finding iterations of one step."""

effect_chain: Any = catalogue.chain_device_effects()
"""Functions at which effects act on the device (:mod:`klute_sim.effects.effect`)."""
N_EFFECT_VALUES, N_EFFECT_STATES = catalogue.count_values_and_states()
DAMPER_STATE_START = N_EFFECT_STATES + pneumatic_step.N_GAS_STATES
"""Index of the first internal state of the damper."""
N_INTERNAL_STATES = DAMPER_STATE_START + len(DamperState._fields)
"""Number of internal states of a device: those of its effects, of its supply, and of its damper."""
NO_EFFECTS = (0.0,) * N_EFFECT_VALUES
ZERO_INTERNAL_STATE = (0.0,) * N_INTERNAL_STATES
HOSE_LENGTH_INDEX = catalogue.find_parameter_index("hose", "tube", "length_m")
DEAD_TIME_INDEX = catalogue.find_parameter_index("pressure_delay", "dead_time", "delay_s")
UNKNOWN_DEAD_TIME_INDEX = catalogue.find_parameter_index("unknown_pressure", "sparse", "delay_s")
"""Indices of the length of the hose, and of the dead times of the command, among the values of the effects."""


class DeviceParameters(NamedTuple):
    """Physical parameters of a device in SI units, without names and files."""

    muscle: MuscleParameters
    damper: DamperParameters
    tendon: TendonParameters
    supply: SupplyParameters
    effects: Sequence[float] = NO_EFFECTS
    """Counts of the active effects, then the values of all effects (:mod:`klute_sim.effects.chain`)."""


class DeviceState(NamedTuple):
    """State of a device between two time steps."""

    pressure: float
    """Gauge pressure in the muscle [Pa]."""
    length: float
    """Muscle length [m]."""
    internal_state: tuple[float, ...] = ZERO_INTERNAL_STATE
    """Internal states of the effects, of the supply, then of the damper."""


def has_internal_state(parameters: DeviceParameters) -> bool:
    """Return whether the supply, the damper or an active effect of the device has internal states."""
    active_slots = (slot for slot in catalogue.get_device_slots() if parameters.effects[slot.switch_index] != 0.0)
    return (
        not pneumatic_step.is_ideal(apply_supply_effects(parameters, ZERO_INTERNAL_STATE))
        or damper_chamber.has_elastic_chambers(apply_damper_effects(parameters, ZERO_INTERNAL_STATE))
        or any(slot.form.n_states for slot in active_slots)
    )


def get_dead_time(parameters: DeviceParameters) -> float:
    """Return the dead time of the commands [s]: of ``pressure_delay``, a data-driven term, and sound in a ``hose``.

    The caller applies it (:class:`klute_sim.device.delay.DelayLine`).
    """
    delay = parameters.effects[DEAD_TIME_INDEX] + parameters.effects[UNKNOWN_DEAD_TIME_INDEX]
    hose_length = parameters.effects[HOSE_LENGTH_INDEX]
    if hose_length == 0.0:
        return float(delay)
    return float(delay + hose_length / pneumatics.speed_of_sound(parameters.supply.temperature))


def apply_supply_effects(parameters: DeviceParameters, internal_state: tuple[float, ...]) -> SupplyParameters:
    """Return the supply with its active effects applied."""
    if parameters.effects[0] == 0.0:
        return parameters.supply
    supply: SupplyParameters = effect_chain.supply(parameters.effects, internal_state, parameters.supply)
    return supply


def apply_damper_effects(parameters: DeviceParameters, internal_state: tuple[float, ...]) -> DamperParameters:
    """Return the damper with its active effects applied."""
    if parameters.effects[0] == 0.0:
        return parameters.damper
    damper: DamperParameters = effect_chain.damper(parameters.effects, internal_state, parameters.damper)
    return damper


def get_damper_state(internal_state: tuple[float, ...]) -> DamperState:
    """Return the internal state of the damper."""
    states = internal_state[DAMPER_STATE_START:]
    return DamperState(states[0], states[1], states[2])


def get_gas_state(state: DeviceState) -> GasState:
    """Return the internal state of the supply."""
    values = state.internal_state[N_EFFECT_STATES:]
    return GasState(values[0], values[1], values[2], values[3], values[4], values[5])


def replace_gas_state(internal_state: tuple[float, ...], gas_state: GasState) -> tuple[float, ...]:
    """Return ``internal_state`` with the part of the supply replaced by ``gas_state``."""
    gas_states = (
        gas_state.surplus_mass,
        gas_state.drawn_mass,
        gas_state.pwm_phase,
        gas_state.pressure_disturbance,
        gas_state.leaked_mass,
        gas_state.pwm_duty,
    )
    return internal_state[:N_EFFECT_STATES] + gas_states + internal_state[DAMPER_STATE_START:]


def compute_muscle_force(
    parameters: DeviceParameters, internal_state: tuple[float, ...], pressure: float, length: float, velocity: float
) -> float:
    """Return the force [N] of muscle and damper at gauge ``pressure`` [Pa], ``length`` [m] and ``velocity`` [m/s]."""
    damper, effects = apply_damper_effects(parameters, internal_state), parameters.effects
    damping = (
        get_damper_state(internal_state).force
        if damper_chamber.has_elastic_chambers(damper)
        else _damper.force(damper, velocity)
    )
    muscle = parameters.muscle
    if effects[0] == 0.0:
        return mckibben.force(muscle, pressure, length) + damping
    contact = mckibben.contact_pressure(pressure)
    acting_pressure = effect_chain.acting_pressure(effects, internal_state, contact, muscle, length)
    pull: float = effect_chain.muscle_force(
        effects,
        internal_state,
        mckibben.force(muscle, acting_pressure, length),
        muscle,
        acting_pressure,
        length,
        velocity,
    )
    resistance: float = effect_chain.damper_force(effects, internal_state, damping, velocity)
    return pull + resistance


def compute_tendon_force(
    parameters: DeviceParameters, internal_state: tuple[float, ...], length: float, unit_length: float
) -> float:
    """Return the tension [N] of an elastic tendon at muscle ``length`` and ``unit_length`` [m]."""
    effects, tendon = parameters.effects, parameters.tendon
    stretch = unit_length - length - tendon.slack_length
    if effects[0] == 0.0:
        return _tendon.force(tendon, stretch)
    stretch = effect_chain.tendon_stretch(effects, internal_state, stretch)
    pull: float = effect_chain.tendon_force(effects, internal_state, _tendon.force(tendon, stretch), stretch, tendon)
    return max(0.0, pull)


def step_internal_state(
    parameters: DeviceParameters,
    internal_state: tuple[float, ...],
    pressure: float,
    pressure_change: float,
    length: float,
    unit_length: float,
    dt: float,
) -> tuple[float, ...]:
    """Return the internal state after a time step ``dt`` [s] that ended at this pressure [Pa] and these lengths [m].

    ``pressure_change`` [Pa] is that which the supply causes in the step; no force depends on it. The internal state of
    the supply does not change.
    """
    effects = parameters.effects
    if effects[0] == 0.0:
        return internal_state
    contact = mckibben.contact_pressure(pressure)
    acting_pressure = effect_chain.acting_pressure(effects, internal_state, contact, parameters.muscle, length)
    stretch = effect_chain.tendon_stretch(
        effects, internal_state, unit_length - length - parameters.tendon.slack_length
    )
    effect_states: tuple[float, ...] = effect_chain.next_state(
        effects, internal_state, parameters.muscle, acting_pressure, pressure_change, length, stretch, dt
    )
    damper = apply_damper_effects(parameters, internal_state)
    if not damper_chamber.has_elastic_chambers(damper):
        return effect_states + internal_state[N_EFFECT_STATES:]
    x = length - parameters.muscle.resting_length
    damper_state = damper_chamber.step_chambers(damper, get_damper_state(internal_state), x, dt)
    damper_states = (damper_state.force, damper_state.void, damper_state.length)
    return effect_states + internal_state[N_EFFECT_STATES:DAMPER_STATE_START] + damper_states


def compute_pressure(parameters: DeviceParameters, air: AirCharge, length: float) -> float:
    """Return the gauge pressure [Pa] of ``air`` in the muscle at muscle ``length`` [m]."""
    if air.disturbance_fraction == 0.0 and air.max_pressure_volume == math.inf:
        return air.pressure
    return pneumatic_step.pressure_after_motion(air, mckibben.gas_volume(parameters.muscle, length))


def _compute_force_residual(
    parameters: DeviceParameters, air: AirCharge, state: DeviceState, unit_length: float, dt: float, length: float
) -> float:
    """Return muscle force minus tendon force [N] if the muscle moves from ``state`` to ``length`` [m] in ``dt`` [s]."""
    pressure = compute_pressure(parameters, air, length)
    internal_state = step_internal_state(parameters, state.internal_state, pressure, 0.0, length, unit_length, dt)
    pull = compute_tendon_force(parameters, internal_state, length, unit_length)
    return compute_muscle_force(parameters, internal_state, pressure, length, (length - state.length) / dt) - pull


def _predict_length(
    parameters: DeviceParameters,
    state: DeviceState,
    dt: float,
    length: float,
    f_length: float,
    end: float,
    f_end: float,
) -> tuple[float, float]:
    """Return where the force residual is predicted to be zero [m], and its slope there [N/m].

    Between ``length`` and ``end``, where the residual is ``f_length`` and ``f_end`` [N] of different signs, it is taken
    as linear, but for the quadratic force of the damper.
    """
    motion = end - length
    quadratic = _damper.force(apply_damper_effects(parameters, state.internal_state), motion / dt)
    linear = f_end - f_length - quadratic
    root = math.sqrt(max(0.0, linear * linear - 4.0 * quadratic * f_length))
    denominator = linear + root if f_length < 0.0 else linear - root
    fraction = -2.0 * f_length / denominator if denominator != 0.0 else 0.5
    return length + fraction * motion, (linear + 2.0 * quadratic * fraction) / motion


def solve_length(
    parameters: DeviceParameters, air: AirCharge, state: DeviceState, unit_length: float, dt: float
) -> float:
    """Return the muscle length [m] that balances the junction a time step ``dt`` [s] after ``state``.

    ``air`` is the air in the muscle and ``unit_length`` the length [m] of the muscle-tendon unit. The force residual
    grows with the length. Newton's step from a predicted root and secant steps find its root in a bracket, in most
    steps with four or five residuals. Where they do not, Chandrupatla's method (Adv. Eng. Software 28:145, 1997) does.
    The root is found to :data:`FORCE_TOLERANCE` or to the last bit of the length. A NaN in the input gives NaN.
    """
    low = mckibben.lock_length(parameters.muscle)
    high = parameters.muscle.resting_length
    if parameters.tendon.is_rigid:
        return min(max(unit_length - parameters.tendon.slack_length, low), high)

    a = min(max(state.length, low), high)
    f_a = _compute_force_residual(parameters, air, state, unit_length, dt, a)
    if abs(f_a) <= _compute_force_tolerance(parameters, unit_length, a):
        return a
    # At speeds up to 0.4 m/s a narrow bracket beside the last length suffices.
    limit = low if f_a > 0.0 else high
    b = max(low, a - MAX_NEAR_SPEED * dt) if f_a > 0.0 else min(high, a + MAX_NEAR_SPEED * dt)
    f_b = f_a
    for end in (b, limit):
        if (f_b > 0.0) == (f_a > 0.0):
            b, f_b = end, _compute_force_residual(parameters, air, state, unit_length, dt, end)
    if (f_b > 0.0) == (f_a > 0.0) or f_b != f_b:
        return limit if f_a == f_a and f_b == f_b else math.nan

    c, f_c = a, f_a
    x, slope = _predict_length(parameters, state, dt, a, f_a, b, f_b)
    if not min(a, b) < x < max(a, b):
        x = 0.5 * (a + b)
    best = x
    for k in range(MAX_ITERATIONS):
        last, f_last = a, f_a
        f_x = _compute_force_residual(parameters, air, state, unit_length, dt, x)
        if (f_x > 0.0) == (f_a > 0.0):
            c, f_c = a, f_a
        else:
            c, b, f_c, f_b = b, a, f_b, f_a
        a, f_a = x, f_x
        best, f_best = (a, f_a) if abs(f_a) < abs(f_b) else (b, f_b)
        width = abs(b - a)
        if abs(f_best) <= _compute_force_tolerance(parameters, unit_length, best) or width <= 2.3e-16 * abs(best):
            return best
        if k < MAX_SECANT_STEPS:
            if k > 0:
                slope = (f_a - f_last) / (a - last) if a != last else 0.0
            x = a - f_a / slope if slope > 0.0 else b
            if min(a, b) < x < max(a, b):
                continue
        # Inverse quadratic interpolation where Chandrupatla's test finds it safe, else bisection.
        xi, phi = (a - b) / (c - b), (f_a - f_b) / (f_c - f_b)
        if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi:
            t = f_a / (f_b - f_a) * f_c / (f_b - f_c) + (c - a) / (b - a) * f_a / (f_c - f_a) * f_b / (f_c - f_b)
        else:
            t = 0.5
        margin = 1.1e-16 * abs(best) / width
        x = a + min(max(t, margin), 1.0 - margin) * (b - a)
    return best


def _compute_force_tolerance(parameters: DeviceParameters, unit_length: float, length: float) -> float:
    """Return the force residual [N] at which a step counts as solved at muscle ``length`` [m]."""
    stretch = unit_length - length - parameters.tendon.slack_length
    return FORCE_TOLERANCE * (1.0 + _tendon.force(parameters.tendon, stretch))


def step_pressure(parameters: DeviceParameters, state: DeviceState, command: float, dt: float) -> AirCharge:
    """Return the air in the muscle a time step ``dt`` [s] after ``state`` under ``command``.

    The command is a gauge pressure [Pa] or a valve opening [1]. :func:`compute_pressure` adds the change of pressure
    that the motion of the muscle causes in this step.
    """
    supply = apply_supply_effects(parameters, state.internal_state)
    effects, muscle = parameters.effects, parameters.muscle
    if dt >= EQUILIBRIUM_TIME_STEP:
        supply = pneumatics.assume_steady_supply(supply)
    target = command
    if supply.command_is_opening == 0.0:
        if effects[0] != 0.0:
            target = effect_chain.pressure_target(effects, state.internal_state, target)
        target = min(max(target, 0.0), supply.max_pressure)
        if effects[0] != 0.0:
            # The lag of the regulator does not act on the change of pressure that the motion of the muscle causes.
            regulated = state.pressure - get_gas_state(state).pressure_disturbance
            target = effect_chain.pressure_reached(effects, state.internal_state, target, regulated, dt)
    if pneumatic_step.is_ideal(supply):
        return pneumatic_step.charge_ideal(supply, state.pressure, target, dt)
    volume, resting_volume = (
        mckibben.gas_volume(muscle, state.length),
        mckibben.gas_volume(muscle, muscle.resting_length),
    )
    return pneumatic_step.charge(supply, get_gas_state(state), state.pressure, target, volume, resting_volume, dt)


def _predict_motion(parameters: DeviceParameters, state: DeviceState, unit_length: float, dt: float) -> DeviceState:
    """Return ``state`` after its muscle has moved for a step ``dt`` [s] with its air enclosed, if it has a valve.

    The flow through the valve then meets the pressure and the volume of the end of the step. A flow at those of its
    start would lag behind the motion by a step and would halve the accuracy of the gas's work.
    """
    supply, muscle = apply_supply_effects(parameters, state.internal_state), parameters.muscle
    if supply.fill_conductance == 0.0:
        return state
    air = pneumatic_step.enclosed_air(supply, state.pressure, mckibben.gas_volume(muscle, state.length))
    length = solve_length(parameters, air, state, unit_length, dt)
    pressure, internal_state = compute_pressure(parameters, air, length), state.internal_state
    if pneumatics.has_regulator_upstream(supply):
        gas = pneumatic_step.add_disturbance(get_gas_state(state), pressure - state.pressure)
        internal_state = replace_gas_state(internal_state, gas)
    return DeviceState(pressure, length, internal_state)


def advance_state(
    parameters: DeviceParameters, state: DeviceState, unit_length: float, command: float, dt: float
) -> DeviceState:
    """Return the state a time step ``dt`` [s] later, at unit length ``unit_length`` [m] under ``command``.

    The command is a gauge pressure [Pa], or a valve opening [1] where ``supply.command_is_opening`` is 1.
    """
    before = _predict_motion(parameters, state, unit_length, dt)
    air = step_pressure(parameters, before, command, dt)
    pressure_change = air.pressure - (before.pressure - get_gas_state(before).pressure_disturbance)
    length = solve_length(parameters, air, state, unit_length, dt)
    pressure = compute_pressure(parameters, air, length)
    internal_state = step_internal_state(
        parameters, state.internal_state, pressure, pressure_change, length, unit_length, dt
    )
    supply, muscle = apply_supply_effects(parameters, internal_state), parameters.muscle
    if not pneumatic_step.is_ideal(supply):
        volume, resting_volume = mckibben.gas_volume(muscle, length), mckibben.gas_volume(muscle, muscle.resting_length)
        gas = pneumatic_step.update_gas(supply, get_gas_state(state), air, pressure, volume, resting_volume)
        internal_state = replace_gas_state(internal_state, gas)
    return DeviceState(pressure, length, internal_state)


def compute_tension(parameters: DeviceParameters, state: DeviceState, unit_length: float, velocity: float) -> float:
    """Return the tension [N] of the unit at ``unit_length`` [m] with muscle ``velocity`` dl/dt [m/s].

    With a tendon, this is the tendon force, which is never negative. A rigid tie transmits the force of muscle and
    damper in both directions: a clamped muscle pushes when its bladder does.
    """
    if parameters.tendon.is_rigid:
        return compute_muscle_force(parameters, state.internal_state, state.pressure, state.length, velocity)
    return compute_tendon_force(parameters, state.internal_state, state.length, unit_length)
