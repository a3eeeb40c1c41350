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
from klute_sim.effects.smooth import LONG
from klute_sim.laws import charging, mckibben
from klute_sim.laws import damper as _damper
from klute_sim.laws import tendon as _tendon
from klute_sim.laws.charging import Charge, Gas
from klute_sim.laws.damper import Damper
from klute_sim.laws.mckibben import Muscle
from klute_sim.laws.pneumatics import Supply
from klute_sim.laws.tendon import Tendon

FORCE_TOLERANCE = 1e-10
"""Residual of the balance at which a step counts as solved, relative to 1 N + tendon tension."""
MOST_ITERATIONS = 200


hooks: Any = catalogue.assembled()
"""Where effects act: :mod:`klute_sim.effects.effect`."""
VALUES, EFFECTS_MEMORY = catalogue.sizes()
MEMORY = EFFECTS_MEMORY + charging.REMEMBERED
"""Numbers that a device remembers beside its states: those of its effects, then those of its supply."""
NO_EFFECTS = (0.0,) * VALUES
NO_MEMORY = (0.0,) * MEMORY
DEAD_TIME = catalogue.slot("pressure_delay", "dead_time").at + 1
"""Where the dead time is among the values of the effects."""


class Parameters(NamedTuple):
    """Everything the law needs; SI, no names, no files."""

    muscle: Muscle
    damper: Damper
    tendon: Tendon
    supply: Supply
    effects: Sequence[float] = NO_EFFECTS
    """Of :func:`klute_sim.effects.catalogue.values`; the first is how many are active."""


class State(NamedTuple):
    """What the device remembers from step to step."""

    pressure: float
    """Gauge pressure in the muscle [Pa]."""
    length: float
    """Muscle length [m]."""
    memory: tuple[float, ...] = NO_MEMORY
    """What the effects remember, then the supply."""


def remembers(parameters: Parameters) -> bool:
    """Whether an active effect of the device, or its supply, remembers anything."""
    acting = (slot for slot in catalogue.device_slots() if parameters.effects[slot.at] != 0.0)
    return not charging.plain(supplied(parameters, NO_MEMORY)) or any(slot.form.memory for slot in acting)


def supplied(parameters: Parameters, memory: tuple[float, ...]) -> Supply:
    """The supply as its effects leave it."""
    if parameters.effects[0] == 0.0:
        return parameters.supply
    found: Supply = hooks.supply(parameters.effects, memory, parameters.supply)
    return found


def gas(state: State) -> Gas:
    """What the supply remembers."""
    own = state.memory[EFFECTS_MEMORY:]
    return Gas(own[0], own[1], own[2], own[3], own[4], own[5])


def with_gas(memory: tuple[float, ...], own: Gas) -> tuple[float, ...]:
    """``memory`` with what the supply remembers replaced."""
    kept = memory[:EFFECTS_MEMORY]
    return kept + (  # noqa: RUF005, numba unpacks no tuples
        own.surplus,
        own.drawn,
        own.phase,
        own.disturbance,
        own.leaked,
        own.duty,
    )


def dead_time(parameters: Parameters) -> float:
    """By how much commands act late [s]; the rig that gives them has to see to it."""
    return float(parameters.effects[DEAD_TIME])


def rest(parameters: Parameters) -> State:
    """The unpressurised device, its muscle at resting length."""
    return State(0.0, parameters.muscle.resting_length, NO_MEMORY)


def taut(parameters: Parameters, unit_length: float, pressure: float) -> State:
    """The device with its tendon just taut at muscle-tendon length ``unit_length`` [m], as far as the muscle allows.

    ``pressure`` [Pa] is clipped to what the supply has; a muscle whose supply takes openings is vented. Whatever is
    remembered has come to rest there, and a tank is full.
    """
    shortest, longest = mckibben.lock_length(parameters.muscle), parameters.muscle.resting_length
    length = min(max(unit_length - parameters.tendon.slack_length, shortest), longest)
    supply = supplied(parameters, NO_MEMORY)
    pressure = min(max(pressure, 0.0), charging.upstream(supply, 0.0)) if supply.opens == 0.0 else 0.0
    return State(pressure, length, _rested(parameters, pressure, length, unit_length))


def _rested(parameters: Parameters, pressure: float, length: float, unit_length: float) -> tuple[float, ...]:
    """What is remembered after a long time here: sliders have let go, followers have arrived."""
    memory = remembered(parameters, NO_MEMORY, pressure, length, unit_length, LONG)
    supply, muscle = supplied(parameters, memory), parameters.muscle
    if charging.plain(supply):
        return memory
    volume, most = mckibben.volume(muscle, length), mckibben.volume(muscle, muscle.resting_length)
    return with_gas(memory, charging.rested(supply, pressure, volume, most))


def settled(parameters: Parameters, unit_length: float, command: float) -> State:
    """The device at rest at muscle-tendon length ``unit_length`` [m] under pressure ``command`` [Pa].

    Whatever is remembered has come to rest there, too.
    """
    state = taut(parameters, unit_length, command)
    pressure = charged(parameters, state, command, LONG).pressure
    # Remembering nothing, a step this long ends in what is remembered at its end.
    length = balance(parameters, charging.still(pressure), State(pressure, state.length), unit_length, LONG)
    return State(pressure, length, _rested(parameters, pressure, length, unit_length))


def muscle_side(
    parameters: Parameters, memory: tuple[float, ...], pressure: float, length: float, rate: float
) -> float:
    """Force [N] of muscle and damper together at ``length`` [m] moving at ``rate`` = dl/dt [m/s]."""
    pull, damping = mckibben.force(parameters.muscle, pressure, length), _damper.force(parameters.damper, rate)
    effects = parameters.effects
    if effects[0] != 0.0:
        muscle = parameters.muscle
        acting = hooks.acting_pressure(effects, memory, pressure, muscle, length)
        pull = hooks.muscle_force(effects, memory, mckibben.force(muscle, acting, length), muscle, acting, length, rate)
        damping = hooks.damper_force(effects, memory, damping, rate)
    return pull + damping


def tendon_side(parameters: Parameters, memory: tuple[float, ...], length: float, unit_length: float) -> float:
    """Tension [N] of a tendon that is no rigid tie, with the muscle at ``length`` [m]."""
    effects, stretch = parameters.effects, unit_length - length - parameters.tendon.slack_length
    if effects[0] == 0.0:
        return _tendon.force(parameters.tendon, stretch)
    stretch = hooks.tendon_stretch(effects, memory, stretch)
    pull: float = hooks.tendon_force(effects, memory, _tendon.force(parameters.tendon, stretch), stretch)
    return max(0.0, pull)


def remembered(
    parameters: Parameters,
    memory: tuple[float, ...],
    pressure: float,
    length: float,
    unit_length: float,
    step: float,
) -> tuple[float, ...]:
    """What the effects remember after a ``step`` [s] that ended at this pressure [Pa] and these lengths [m].

    What the supply remembers stays as it was.
    """
    effects = parameters.effects
    if effects[0] == 0.0:
        return memory
    acting = hooks.acting_pressure(effects, memory, pressure, parameters.muscle, length)
    stretch = hooks.tendon_stretch(effects, memory, unit_length - length - parameters.tendon.slack_length)
    found: tuple[float, ...] = hooks.remember(effects, memory, parameters.muscle, acting, length, stretch, step)
    return found + memory[EFFECTS_MEMORY:]


def pressure_at(parameters: Parameters, air: Charge, length: float) -> float:
    """Gauge pressure [Pa] of the muscle's ``air`` at muscle ``length`` [m]."""
    if air.kept == 0.0:
        return air.pressure
    return charging.felt(air, mckibben.volume(parameters.muscle, length))


def _imbalance(
    parameters: Parameters, air: Charge, start: State, unit_length: float, step: float, length: float
) -> float:
    """Muscle side minus tendon side [N] if the muscle went from ``start`` to ``length`` in ``step``."""
    pressure = pressure_at(parameters, air, length)
    memory = remembered(parameters, start.memory, pressure, length, unit_length, step)
    pull = tendon_side(parameters, memory, length, unit_length)
    return muscle_side(parameters, memory, pressure, length, (length - start.length) / step) - pull


def balance(parameters: Parameters, air: Charge, start: State, unit_length: float, step: float) -> float:
    """Muscle length [m] that balances the junction after ``step`` [s] with this ``air`` in it, from state ``start``.

    ``unit_length`` [m] is the whole muscle-tendon unit. The root is found with Chandrupatla's bracketed
    method (Adv. Eng. Software 28:145, 1997) to :data:`FORCE_TOLERANCE`, or to the last bit of the length. NaN
    goes in, NaN comes out.
    """
    low = mckibben.lock_length(parameters.muscle)
    high = parameters.muscle.resting_length
    if parameters.tendon.rigid:
        return min(max(unit_length - parameters.tendon.slack_length, low), high)

    # The muscle has hardly moved since the last step: a narrow bracket around where it was is mostly enough.
    reach = 0.4 * step
    near_low, near_high = max(low, start.length - reach), min(high, start.length + reach)
    f_low = _imbalance(parameters, air, start, unit_length, step, near_low)
    f_high = _imbalance(parameters, air, start, unit_length, step, near_high)
    if f_low < 0.0 and f_high > 0.0:
        low, high = near_low, near_high
    else:
        f_high = _imbalance(parameters, air, start, unit_length, step, high)
        if not f_high > 0.0:
            return high if f_high == f_high else f_high
        f_low = _imbalance(parameters, air, start, unit_length, step, low)
        if not f_low < 0.0:
            return low if f_low == f_low else f_low

    a, b, f_a, f_b = high, low, f_high, f_low
    c, f_c = a, f_a
    t = 0.5
    for _ in range(MOST_ITERATIONS):
        x = a + t * (b - a)
        f_x = _imbalance(parameters, air, start, unit_length, step, x)
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


def charged(parameters: Parameters, state: State, command: float, step: float) -> Charge:
    """The muscle's air a ``step`` [s] after ``state`` under ``command`` (a pressure [Pa] or an opening [1]).

    What the muscle's own motion does to it in this step is still to come: :func:`pressure_at`.
    """
    supply, effects, muscle = supplied(parameters, state.memory), parameters.effects, parameters.muscle
    target = command
    if supply.opens == 0.0:
        if effects[0] != 0.0:
            target = hooks.pressure_target(effects, state.memory, target)
        target = min(max(target, 0.0), supply.pressure)
        if effects[0] != 0.0:
            # What the muscle's own motion does to its air is no part of what the regulator is late with.
            own = state.pressure - gas(state).disturbance
            target = hooks.pressure_reached(effects, state.memory, target, own, step)
    if charging.plain(supply):
        return charging.regulated(supply, state.pressure, target, step)
    volume, most = mckibben.volume(muscle, state.length), mckibben.volume(muscle, muscle.resting_length)
    return charging.charge(supply, gas(state), state.pressure, target, volume, most, step)


def advance(parameters: Parameters, state: State, unit_length: float, command: float, step: float) -> State:
    """State one ``step`` [s] later, at muscle-tendon length ``unit_length`` [m] under ``command``.

    The command is a gauge pressure [Pa], or the opening of its valve [1] if that is what the supply takes.
    """
    air = charged(parameters, state, command, step)
    length = balance(parameters, air, state, unit_length, step)
    pressure = pressure_at(parameters, air, length)
    memory = remembered(parameters, state.memory, pressure, length, unit_length, step)
    supply, muscle = supplied(parameters, memory), parameters.muscle
    if not charging.plain(supply):
        volume, most = mckibben.volume(muscle, length), mckibben.volume(muscle, muscle.resting_length)
        memory = with_gas(memory, charging.booked(supply, gas(state), air, pressure, volume, most))
    return State(pressure, length, memory)


def tension(parameters: Parameters, state: State, unit_length: float, rate: float) -> float:
    """Tension [N] the unit delivers at ``unit_length`` [m] with its muscle moving at ``rate`` = dl/dt [m/s].

    With a tendon this is the tendon's force and never negative. A rigid tie passes on what muscle and
    damper do, either way: a clamped muscle pushes when its bladder does.
    """
    if parameters.tendon.rigid:
        return muscle_side(parameters, state.memory, state.pressure, state.length, rate)
    return tendon_side(parameters, state.memory, state.length, unit_length)
