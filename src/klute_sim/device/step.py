"""One step of the muscle-tendon unit (dissertation chapter 7): (McKibben || damper) in series with the tendon.

The junction is massless: ``F_McK(p, l) + F_damper(dl/dt) = F_tendon(l_mt - l)``. The damper's v|v| has no
Lipschitz inverse at rest, so an explicit step chatters. A backward-Euler step is one scalar equation,
bracketed by the muscle's lock length and its resting length and therefore always solvable.

The two ends of the bracket are stops. At resting length the stop is the source's (the muscle never exceeds
L0; rigid: assumed). At lock length it is ours (assumed): the braid cannot close further. Whatever force the
balance lacks at a stop is the stop's *reaction*.
"""

from typing import NamedTuple

from klute_sim.laws import damper as _damper
from klute_sim.laws import mckibben, pneumatics
from klute_sim.laws import tendon as _tendon
from klute_sim.laws.damper import Damper
from klute_sim.laws.mckibben import Muscle
from klute_sim.laws.pneumatics import Supply
from klute_sim.laws.tendon import Tendon

FORCE_TOLERANCE = 1e-10
"""Residual of the balance at which a step counts as solved, relative to 1 N + tendon tension."""
MOST_ITERATIONS = 200


class Parameters(NamedTuple):
    """Everything the law needs; SI, no names, no files."""

    muscle: Muscle
    damper: Damper
    tendon: Tendon
    supply: Supply


class State(NamedTuple):
    """What the device remembers from step to step."""

    pressure: float
    """Gauge pressure in the muscle [Pa]."""
    length: float
    """Muscle length [m]."""


def rest(parameters: Parameters) -> State:
    """The unpressurised device, its muscle at resting length."""
    return State(0.0, parameters.muscle.resting_length)


def taut(parameters: Parameters, unit_length: float, pressure: float) -> State:
    """The device with its tendon just taut at muscle-tendon length ``unit_length`` [m], as far as the muscle allows.

    ``pressure`` [Pa] is clipped to what the supply has.
    """
    shortest, longest = mckibben.lock_length(parameters.muscle), parameters.muscle.resting_length
    length = min(max(unit_length - parameters.tendon.slack_length, shortest), longest)
    return State(min(max(pressure, 0.0), parameters.supply.pressure), length)


def muscle_side(parameters: Parameters, pressure: float, length: float, rate: float) -> float:
    """Force [N] of muscle and damper together at ``length`` [m] moving at ``rate`` = dl/dt [m/s]."""
    return mckibben.force(parameters.muscle, pressure, length) + _damper.force(parameters.damper, rate)


def _imbalance(
    parameters: Parameters, pressure: float, start: float, unit_length: float, step: float, length: float
) -> float:
    """Muscle side minus tendon side [N] if the muscle went from ``start`` to ``length`` in ``step``."""
    pull = _tendon.force(parameters.tendon, unit_length - length - parameters.tendon.slack_length)
    return muscle_side(parameters, pressure, length, (length - start) / step) - pull


def balance(parameters: Parameters, pressure: float, start: float, unit_length: float, step: float) -> float:
    """Muscle length [m] that balances the junction after ``step`` [s], from muscle length ``start`` [m].

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
    near_low, near_high = max(low, start - reach), min(high, start + reach)
    f_low = _imbalance(parameters, pressure, start, unit_length, step, near_low)
    f_high = _imbalance(parameters, pressure, start, unit_length, step, near_high)
    if f_low < 0.0 and f_high > 0.0:
        low, high = near_low, near_high
    else:
        f_high = _imbalance(parameters, pressure, start, unit_length, step, high)
        if not f_high > 0.0:
            return high if f_high == f_high else f_high
        f_low = _imbalance(parameters, pressure, start, unit_length, step, low)
        if not f_low < 0.0:
            return low if f_low == f_low else f_low

    a, b, f_a, f_b = high, low, f_high, f_low
    c, f_c = a, f_a
    t = 0.5
    for _ in range(MOST_ITERATIONS):
        x = a + t * (b - a)
        f_x = _imbalance(parameters, pressure, start, unit_length, step, x)
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


def advance(parameters: Parameters, state: State, unit_length: float, command: float, step: float) -> State:
    """State one ``step`` [s] later, at muscle-tendon length ``unit_length`` [m] and pressure ``command`` [Pa]."""
    pressure = pneumatics.regulate(parameters.supply, state.pressure, command, step)
    return State(pressure, balance(parameters, pressure, state.length, unit_length, step))


def tension(parameters: Parameters, state: State, unit_length: float, rate: float) -> float:
    """Tension [N] the unit delivers at ``unit_length`` [m] with its muscle moving at ``rate`` = dl/dt [m/s].

    With a tendon this is the tendon's force and never negative. A rigid tie passes on what muscle and
    damper do, either way: a clamped muscle pushes when its bladder does.
    """
    if parameters.tendon.rigid:
        return muscle_side(parameters, state.pressure, state.length, rate)
    return _tendon.force(parameters.tendon, unit_length - state.length - parameters.tendon.slack_length)
