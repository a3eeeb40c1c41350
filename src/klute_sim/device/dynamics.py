"""One step of the muscle-tendon unit (dissertation chapter 7): (McKibben || damper) in series with the tendon.

The junction is massless: ``F_McK(p, l) + F_damper(dl/dt) = F_tendon(l_mt - l)``. The damper's v|v| has no
Lipschitz inverse at rest, so an explicit step chatters. A backward-Euler step is one scalar equation,
bracketed by the muscle's lock length and its resting length and therefore always solvable.

The two ends of the bracket are stops. At resting length the stop is the source's (the muscle never exceeds
L0; rigid: assumed). At lock length it is ours (assumed): the braid cannot close further. Whatever force the
balance lacks at a stop is the stop's *reaction*.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from klute_sim.effects import catalogue
from klute_sim.effects.smoothing import EQUILIBRIUM_TIME_STEP
from klute_sim.laws import damper as _damper
from klute_sim.laws import mckibben, pneumatic_step
from klute_sim.laws import tendon as _tendon
from klute_sim.laws.damper import Damper
from klute_sim.laws.mckibben import Muscle
from klute_sim.laws.pneumatic_step import AirCharge, GasState
from klute_sim.laws.pneumatics import Supply
from klute_sim.laws.tendon import Tendon

FORCE_TOLERANCE = 1e-10
"""Residual of the balance at which a step counts as solved, relative to 1 N + tendon tension."""
MAX_ITERATIONS = 200


effect_chain: Any = catalogue.chain_device_effects()
"""Where effects act: :mod:`klute_sim.effects.effect`."""
N_EFFECT_VALUES, N_EFFECT_STATES = catalogue.count_values_and_states()
N_INTERNAL_STATES = N_EFFECT_STATES + pneumatic_step.N_GAS_STATES
"""Numbers that a device remembers beside its states: those of its effects, then those of its supply."""
NO_EFFECTS = (0.0,) * N_EFFECT_VALUES
ZERO_INTERNAL_STATE = (0.0,) * N_INTERNAL_STATES
DEAD_TIME_INDEX = catalogue.find_slot("pressure_delay", "dead_time").switch_index + 1
"""Where the dead time is among the values of the effects."""


class DeviceParameters(NamedTuple):
    """Everything the law needs; SI, no names, no files."""

    muscle: Muscle
    damper: Damper
    tendon: Tendon
    supply: Supply
    effects: Sequence[float] = NO_EFFECTS
    """Of :func:`klute_sim.effects.catalogue.values`; the first is how many are active."""


class DeviceState(NamedTuple):
    """What the device remembers from step to step."""

    pressure: float
    """Gauge pressure in the muscle [Pa]."""
    length: float
    """Muscle length [m]."""
    internal_state: tuple[float, ...] = ZERO_INTERNAL_STATE
    """What the effects remember, then the supply."""


def has_internal_state(parameters: DeviceParameters) -> bool:
    """Whether an active effect of the device, or its supply, remembers anything."""
    acting = (slot for slot in catalogue.get_device_slots() if parameters.effects[slot.switch_index] != 0.0)
    return not pneumatic_step.is_ideal(apply_supply_effects(parameters, ZERO_INTERNAL_STATE)) or any(
        slot.form.n_states for slot in acting
    )


def apply_supply_effects(parameters: DeviceParameters, internal_state: tuple[float, ...]) -> Supply:
    """The supply as its effects leave it."""
    if parameters.effects[0] == 0.0:
        return parameters.supply
    found: Supply = effect_chain.supply(parameters.effects, internal_state, parameters.supply)
    return found


def get_gas_state(state: DeviceState) -> GasState:
    """What the supply remembers."""
    own = state.internal_state[N_EFFECT_STATES:]
    return GasState(own[0], own[1], own[2], own[3], own[4], own[5])


def replace_gas_state(internal_state: tuple[float, ...], gas_state: GasState) -> tuple[float, ...]:
    """``memory`` with what the supply remembers replaced."""
    kept = internal_state[:N_EFFECT_STATES]
    return kept + (  # noqa: RUF005, numba unpacks no tuples
        gas_state.surplus_mass,
        gas_state.drawn_mass,
        gas_state.pwm_phase,
        gas_state.pressure_disturbance,
        gas_state.leaked_mass,
        gas_state.pwm_duty,
    )


def get_dead_time(parameters: DeviceParameters) -> float:
    """By how much commands act late [s]; the rig that gives them has to see to it."""
    return float(parameters.effects[DEAD_TIME_INDEX])


def compute_rest_state(parameters: DeviceParameters) -> DeviceState:
    """The unpressurised device, its muscle at resting length."""
    return DeviceState(0.0, parameters.muscle.resting_length, ZERO_INTERNAL_STATE)


def compute_taut_state(parameters: DeviceParameters, unit_length: float, pressure: float) -> DeviceState:
    """The device with its tendon just taut at muscle-tendon length ``unit_length`` [m], as far as the muscle allows.

    ``pressure`` [Pa] is clipped to what the supply has; a muscle whose supply takes openings is vented. Whatever is
    remembered has come to rest there, and a tank is full.
    """
    shortest, longest = mckibben.lock_length(parameters.muscle), parameters.muscle.resting_length
    length = min(max(unit_length - parameters.tendon.slack_length, shortest), longest)
    supply = apply_supply_effects(parameters, ZERO_INTERNAL_STATE)
    pressure = (
        min(max(pressure, 0.0), pneumatic_step.supply_pressure(supply, 0.0))
        if supply.command_is_opening == 0.0
        else 0.0
    )
    return DeviceState(pressure, length, _compute_steady_internal_state(parameters, pressure, length, unit_length))


def _compute_steady_internal_state(
    parameters: DeviceParameters, pressure: float, length: float, unit_length: float
) -> tuple[float, ...]:
    """What is remembered after a long time here: sliders have let go, followers have arrived."""
    memory = step_internal_state(parameters, ZERO_INTERNAL_STATE, pressure, length, unit_length, EQUILIBRIUM_TIME_STEP)
    supply, muscle = apply_supply_effects(parameters, memory), parameters.muscle
    if pneumatic_step.is_ideal(supply):
        return memory
    volume, most = mckibben.volume(muscle, length), mckibben.volume(muscle, muscle.resting_length)
    return replace_gas_state(memory, pneumatic_step.equilibrium_gas(supply, pressure, volume, most))


def compute_equilibrium_state(parameters: DeviceParameters, unit_length: float, command: float) -> DeviceState:
    """The device at rest at muscle-tendon length ``unit_length`` [m] under pressure ``command`` [Pa].

    Whatever is remembered has come to rest there, too.
    """
    state = compute_taut_state(parameters, unit_length, command)
    pressure = step_pressure(parameters, state, command, EQUILIBRIUM_TIME_STEP).pressure
    # Remembering nothing, a step this long ends in what is remembered at its end.
    length = solve_length(
        parameters,
        pneumatic_step.constant_pressure(pressure),
        DeviceState(pressure, state.length),
        unit_length,
        EQUILIBRIUM_TIME_STEP,
    )
    return DeviceState(pressure, length, _compute_steady_internal_state(parameters, pressure, length, unit_length))


def compute_muscle_damper_force(
    parameters: DeviceParameters, internal_state: tuple[float, ...], pressure: float, length: float, velocity: float
) -> float:
    """Force [N] of muscle and damper together at ``length`` [m] moving at ``rate`` = dl/dt [m/s]."""
    pull, damping = mckibben.force(parameters.muscle, pressure, length), _damper.force(parameters.damper, velocity)
    effects = parameters.effects
    if effects[0] != 0.0:
        muscle = parameters.muscle
        acting = effect_chain.acting_pressure(effects, internal_state, pressure, muscle, length)
        pull = effect_chain.muscle_force(
            effects, internal_state, mckibben.force(muscle, acting, length), muscle, acting, length, velocity
        )
        damping = effect_chain.damper_force(effects, internal_state, damping, velocity)
    return pull + damping


def compute_tendon_force(
    parameters: DeviceParameters, internal_state: tuple[float, ...], length: float, unit_length: float
) -> float:
    """Tension [N] of a tendon that is no rigid tie, with the muscle at ``length`` [m]."""
    effects, stretch = parameters.effects, unit_length - length - parameters.tendon.slack_length
    if effects[0] == 0.0:
        return _tendon.force(parameters.tendon, stretch)
    stretch = effect_chain.tendon_stretch(effects, internal_state, stretch)
    pull: float = effect_chain.tendon_force(effects, internal_state, _tendon.force(parameters.tendon, stretch), stretch)
    return max(0.0, pull)


def step_internal_state(
    parameters: DeviceParameters,
    internal_state: tuple[float, ...],
    pressure: float,
    length: float,
    unit_length: float,
    dt: float,
) -> tuple[float, ...]:
    """What the effects remember after a ``step`` [s] that ended at this pressure [Pa] and these lengths [m].

    What the supply remembers stays as it was.
    """
    effects = parameters.effects
    if effects[0] == 0.0:
        return internal_state
    acting = effect_chain.acting_pressure(effects, internal_state, pressure, parameters.muscle, length)
    stretch = effect_chain.tendon_stretch(
        effects, internal_state, unit_length - length - parameters.tendon.slack_length
    )
    found: tuple[float, ...] = effect_chain.remember(
        effects, internal_state, parameters.muscle, acting, length, stretch, dt
    )
    return found + internal_state[N_EFFECT_STATES:]


def compute_pressure(parameters: DeviceParameters, air: AirCharge, length: float) -> float:
    """Gauge pressure [Pa] of the muscle's ``air`` at muscle ``length`` [m]."""
    if air.disturbance_fraction == 0.0:
        return air.pressure
    return pneumatic_step.pressure_after_motion(air, mckibben.volume(parameters.muscle, length))


def _compute_force_residual(
    parameters: DeviceParameters, air: AirCharge, state: DeviceState, unit_length: float, dt: float, length: float
) -> float:
    """Muscle side minus tendon side [N] if the muscle went from ``start`` to ``length`` in ``step``."""
    pressure = compute_pressure(parameters, air, length)
    memory = step_internal_state(parameters, state.internal_state, pressure, length, unit_length, dt)
    pull = compute_tendon_force(parameters, memory, length, unit_length)
    return compute_muscle_damper_force(parameters, memory, pressure, length, (length - state.length) / dt) - pull


def solve_length(
    parameters: DeviceParameters, air: AirCharge, state: DeviceState, unit_length: float, dt: float
) -> float:
    """Muscle length [m] that balances the junction after ``step`` [s] with this ``air`` in it, from state ``start``.

    ``unit_length`` [m] is the whole muscle-tendon unit. The root is found with Chandrupatla's bracketed
    method (Adv. Eng. Software 28:145, 1997) to :data:`FORCE_TOLERANCE`, or to the last bit of the length. NaN
    goes in, NaN comes out.
    """
    low = mckibben.lock_length(parameters.muscle)
    high = parameters.muscle.resting_length
    if parameters.tendon.is_rigid:
        return min(max(unit_length - parameters.tendon.slack_length, low), high)

    # The muscle has hardly moved since the last step: a narrow bracket around where it was is mostly enough.
    reach = 0.4 * dt
    near_low, near_high = max(low, state.length - reach), min(high, state.length + reach)
    f_low = _compute_force_residual(parameters, air, state, unit_length, dt, near_low)
    f_high = _compute_force_residual(parameters, air, state, unit_length, dt, near_high)
    if f_low < 0.0 and f_high > 0.0:
        low, high = near_low, near_high
    else:
        f_high = _compute_force_residual(parameters, air, state, unit_length, dt, high)
        if not f_high > 0.0:
            return high if f_high == f_high else f_high
        f_low = _compute_force_residual(parameters, air, state, unit_length, dt, low)
        if not f_low < 0.0:
            return low if f_low == f_low else f_low

    a, b, f_a, f_b = high, low, f_high, f_low
    c, f_c = a, f_a
    t = 0.5
    for _ in range(MAX_ITERATIONS):
        x = a + t * (b - a)
        f_x = _compute_force_residual(parameters, air, state, unit_length, dt, x)
        if (f_x > 0.0) == (f_a > 0.0):
            c, f_c = a, f_a
        else:
            c, b, f_c, f_b = b, a, f_b, f_a
        a, f_a = x, f_x
        best, f_best = (a, f_a) if abs(f_a) < abs(f_b) else (b, f_b)
        scale = 1.0 + _tendon.force(parameters.tendon, unit_length - best - parameters.tendon.slack_length)
        width = abs(b - a)
        if abs(f_best) <= FORCE_TOLERANCE * scale or width <= 2.3e-16 * abs(best):
            return best
        # inverse quadratic interpolation where Chandrupatla's test says it is safe, else bisection
        xi, phi = (a - b) / (c - b), (f_a - f_b) / (f_c - f_b)
        if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi:
            t = f_a / (f_b - f_a) * f_c / (f_b - f_c) + (c - a) / (b - a) * f_a / (f_c - f_a) * f_b / (f_c - f_b)
        else:
            t = 0.5
        margin = 1.1e-16 * abs(best) / width
        t = min(max(t, margin), 1.0 - margin)
    return best


def step_pressure(parameters: DeviceParameters, state: DeviceState, command: float, dt: float) -> AirCharge:
    """The muscle's air a ``step`` [s] after ``state`` under ``command`` (a pressure [Pa] or an opening [1]).

    What the muscle's own motion does to it in this step is still to come: :func:`pressure_at`.
    """
    supply, effects, muscle = (
        apply_supply_effects(parameters, state.internal_state),
        parameters.effects,
        parameters.muscle,
    )
    target = command
    if supply.command_is_opening == 0.0:
        if effects[0] != 0.0:
            target = effect_chain.pressure_target(effects, state.internal_state, target)
        target = min(max(target, 0.0), supply.max_pressure)
        if effects[0] != 0.0:
            # What the muscle's own motion does to its air is no part of what the regulator is late with.
            own = state.pressure - get_gas_state(state).pressure_disturbance
            target = effect_chain.pressure_reached(effects, state.internal_state, target, own, dt)
    if pneumatic_step.is_ideal(supply):
        return pneumatic_step.charge_ideal(supply, state.pressure, target, dt)
    volume, most = mckibben.volume(muscle, state.length), mckibben.volume(muscle, muscle.resting_length)
    return pneumatic_step.charge(supply, get_gas_state(state), state.pressure, target, volume, most, dt)


def advance_state(
    parameters: DeviceParameters, state: DeviceState, unit_length: float, command: float, dt: float
) -> DeviceState:
    """State one ``step`` [s] later, at muscle-tendon length ``unit_length`` [m] under ``command``.

    The command is a gauge pressure [Pa], or the opening of its valve [1] if that is what the supply takes.
    """
    air = step_pressure(parameters, state, command, dt)
    length = solve_length(parameters, air, state, unit_length, dt)
    pressure = compute_pressure(parameters, air, length)
    memory = step_internal_state(parameters, state.internal_state, pressure, length, unit_length, dt)
    supply, muscle = apply_supply_effects(parameters, memory), parameters.muscle
    if not pneumatic_step.is_ideal(supply):
        volume, most = mckibben.volume(muscle, length), mckibben.volume(muscle, muscle.resting_length)
        memory = replace_gas_state(
            memory, pneumatic_step.update_gas(supply, get_gas_state(state), air, pressure, volume, most)
        )
    return DeviceState(pressure, length, memory)


def compute_tension(parameters: DeviceParameters, state: DeviceState, unit_length: float, velocity: float) -> float:
    """Tension [N] the unit delivers at ``unit_length`` [m] with its muscle moving at ``rate`` = dl/dt [m/s].

    With a tendon this is the tendon's force and never negative. A rigid tie passes on what muscle and
    damper do, either way: a clamped muscle pushes when its bladder does.
    """
    if parameters.tendon.is_rigid:
        return compute_muscle_damper_force(parameters, state.internal_state, state.pressure, state.length, velocity)
    return compute_tendon_force(parameters, state.internal_state, state.length, unit_length)
