"""States of a device in which nothing changes any more, or in which the tendon is just taut."""

import math

from klute_sim.device.dynamics import (
    ZERO_INTERNAL_STATE,
    DeviceParameters,
    DeviceState,
    apply_supply_effects,
    compute_pressure,
    effect_chain,
    get_gas_state,
    replace_gas_state,
    solve_length,
    step_internal_state,
    step_pressure,
)
from klute_sim.effects import catalogue
from klute_sim.effects.smoothing import EQUILIBRIUM_TIME_STEP
from klute_sim.laws import mckibben, pneumatic_step

SLIDING_FRACTION = 0.05
"""Distance that a device has slid where it begins with all its friction, over the muscle's resting length (assumed:
friction reverses within a few millimetres)."""
SLIDING_TIME = 1e-3 * EQUILIBRIUM_TIME_STEP
"""Time of this motion [s]: viscous and lagging elements are in equilibrium after it, and dry friction is held."""


def compute_taut_state(parameters: DeviceParameters, unit_length: float, command: float) -> DeviceState:
    """Return the state in which the tendon is just taut at unit length ``unit_length`` [m], within the muscle's range.

    The muscle has the pressure that a regulator holds under the pressure ``command`` [Pa]. A muscle whose commands are
    valve openings is vented. All internal states are in equilibrium, and a tank is full.
    """
    shortest, longest = mckibben.lock_length(parameters.muscle), parameters.muscle.resting_length
    length = min(max(unit_length - parameters.tendon.slack_length, shortest), longest)
    pressure = _compute_regulated_pressure(parameters, command)
    return DeviceState(pressure, length, _compute_steady_internal_state(parameters, pressure, length, unit_length))


def _compute_regulated_pressure(parameters: DeviceParameters, command: float) -> float:
    """Return the pressure [Pa] of a regulator with a full tank after a long time under ``command`` [Pa].

    The errors of the regulator shift it, within the range of the supply; it is 0 where commands are openings.
    """
    supply, effects = apply_supply_effects(parameters, ZERO_INTERNAL_STATE), parameters.effects
    if supply.command_is_opening != 0.0:
        return 0.0
    target = command
    if effects[0] != 0.0:
        target = effect_chain.pressure_target(effects, ZERO_INTERNAL_STATE, target)
    target = min(max(target, 0.0), supply.max_pressure)
    if effects[0] != 0.0:
        target = effect_chain.pressure_reached(effects, ZERO_INTERNAL_STATE, target, target, EQUILIBRIUM_TIME_STEP)
    return min(max(target, 0.0), pneumatic_step.supply_pressure(supply, 0.0))


def _compute_steady_internal_state(
    parameters: DeviceParameters, pressure: float, length: float, unit_length: float
) -> tuple[float, ...]:
    """Return the internal state after a long time at this pressure [Pa] and these lengths [m]."""
    internal_state = step_internal_state(
        parameters, ZERO_INTERNAL_STATE, pressure, 0.0, length, unit_length, EQUILIBRIUM_TIME_STEP
    )
    supply, muscle = apply_supply_effects(parameters, internal_state), parameters.muscle
    if pneumatic_step.is_ideal(supply):
        return internal_state
    volume, resting_volume = mckibben.gas_volume(muscle, length), mckibben.gas_volume(muscle, muscle.resting_length)
    return replace_gas_state(internal_state, pneumatic_step.equilibrium_gas(supply, pressure, volume, resting_volume))


def compute_equilibrium_state(
    parameters: DeviceParameters, unit_length: float, command: float, near_length: float | None = None
) -> DeviceState:
    """Return the equilibrium state at unit length ``unit_length`` [m] under the pressure ``command`` [Pa].

    All internal states are in equilibrium, too. The search begins at the muscle length ``near_length`` [m] (None: where
    the tendon is just taut); one close to the equilibrium takes fewer iterations.
    """
    state = compute_taut_state(parameters, unit_length, command)
    air = step_pressure(parameters, state, command, EQUILIBRIUM_TIME_STEP)
    pressure = compute_pressure(parameters, air, state.length)
    # From zero internal states, a step this long ends in the internal states of the equilibrium.
    length = solve_length(
        parameters,
        pneumatic_step.constant_pressure(pressure),
        DeviceState(pressure, state.length if near_length is None else near_length),
        unit_length,
        EQUILIBRIUM_TIME_STEP,
    )
    internal_state = _compute_steady_internal_state(parameters, pressure, length, unit_length)
    # Behind a restriction a leak keeps the muscle below the pressure of the regulator.
    gas = get_gas_state(DeviceState(pressure, length, internal_state))
    gas = pneumatic_step.add_disturbance(gas, pressure - air.pressure)
    return DeviceState(pressure, length, replace_gas_state(internal_state, gas))


def holds_friction(parameters: DeviceParameters) -> bool:
    """Return whether an active effect of the device holds a dry friction at rest."""
    active_slots = (slot for slot in catalogue.get_device_slots() if parameters.effects[slot.switch_index] != 0.0)
    return any(slot.form.holds_friction for slot in active_slots)


def compute_resting_state(
    parameters: DeviceParameters, unit_length: float, command: float, friction_fraction: float
) -> DeviceState:
    """Return the state at rest at unit length ``unit_length`` [m] under the pressure ``command`` [Pa] with friction.

    Dry friction holds a part of what an earlier motion left: all of a slow lengthening of the unit to its present
    length for a ``friction_fraction`` of 1, all of a shortening for -1, none for 0
    (:func:`compute_equilibrium_state`). Between them, length and internal states are interpolated, and the device
    settles from there.
    """
    relaxed = compute_equilibrium_state(parameters, unit_length, command)
    if friction_fraction == 0.0 or not holds_friction(parameters):
        return relaxed
    motion = math.copysign(SLIDING_FRACTION * parameters.muscle.resting_length, friction_fraction)
    before = compute_equilibrium_state(parameters, unit_length - motion, command)
    air = pneumatic_step.constant_pressure(relaxed.pressure)
    slid_length = solve_length(parameters, air, before, unit_length, SLIDING_TIME)
    slid_states = step_internal_state(
        parameters, before.internal_state, relaxed.pressure, 0.0, slid_length, unit_length, SLIDING_TIME
    )
    fraction = abs(friction_fraction)
    length = relaxed.length + fraction * (slid_length - relaxed.length)
    internal_state = list(_compute_steady_internal_state(parameters, relaxed.pressure, length, unit_length))
    for slot in catalogue.get_device_slots():
        if slot.form.holds_friction and parameters.effects[slot.switch_index] != 0.0:
            for k in range(slot.state_start, slot.state_start + slot.form.n_states):
                rest = relaxed.internal_state[k]
                internal_state[k] = rest + fraction * (slid_states[k] - rest)
    between = DeviceState(relaxed.pressure, length, tuple(internal_state))
    length = solve_length(parameters, air, between, unit_length, SLIDING_TIME)
    settled_states = step_internal_state(
        parameters, between.internal_state, relaxed.pressure, 0.0, length, unit_length, SLIDING_TIME
    )
    return DeviceState(relaxed.pressure, length, replace_gas_state(settled_states, get_gas_state(relaxed)))
