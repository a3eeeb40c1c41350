"""Elements that several effects share: smooth sign, slider, Bouc-Wen friction and first-order follower."""

import math

SIGN_TRANSITION_SPEED = 5e-5
"""Speed over which dry friction changes its sign [m/s].

Assumed: a twentieth of the dissertation's slowest test (1 mm/s), at which the sign is 0.999. A held muscle with such
friction creeps at about this speed; the forms with an internal state hold it.
"""
EQUILIBRIUM_TIME_STEP = 1e9
"""Time step after which followers have reached their targets and relaxing sliders have relaxed [s] (assumed)."""
MIN_BOUC_WEN_STRETCH = 1e-100
"""Largest stretch of a Bouc-Wen friction below which there is none [m]: the pressure of a vented muscle decays to the
smallest number that a computer represents, whose reciprocal is infinite."""
FRICTION_FRACTIONS = (1.0 / 6.0, 2.0 / 6.0, 3.0 / 6.0)
"""Fractions of the friction carried by three Maxwell-slip elements (assumed); their stiffnesses are equal."""


def smooth_sign(velocity: float) -> float:
    """Return ``v / sqrt(v^2 + SIGN_TRANSITION_SPEED^2)``: a smooth, increasing sign of ``velocity`` [m/s]."""
    return velocity / math.sqrt(velocity * velocity + SIGN_TRANSITION_SPEED * SIGN_TRANSITION_SPEED)


def step_slider(slider_position: float, position: float, max_distance: float, dt: float) -> float:
    """Return the position of a slider after a time step ``dt`` [s].

    The slider stays within ``max_distance`` >= 0 of ``position`` and moves only when pulled. After
    :data:`EQUILIBRIUM_TIME_STEP` it has relaxed to ``position``.
    """
    return position if dt >= EQUILIBRIUM_TIME_STEP else pull_slider(slider_position, position, max_distance)


def pull_slider(slider_position: float, position: float, max_distance: float) -> float:
    """Return the position of a slider that never relaxes and stays within ``max_distance`` >= 0 of ``position``."""
    return min(max(slider_position, position - max_distance), position + max_distance)


def step_bouc_wen(stretch: float, displacement: float, max_stretch: float, gamma_ratio: float, dt: float) -> float:
    """Return the hysteretic stretch u [m] after a ``displacement`` [m], exact for a displacement of any size.

    Bouc-Wen model with an exponent of 1 (Wen, J. Eng. Mech. Div. 102:249, 1976)::

        du/dx = 1 - |u| (beta sign(u dx) + gamma),    beta + gamma = 1 / max_stretch

    ``gamma_ratio`` = gamma / beta in [0, 1]. With 0 it is Dahl's model, ``du/dx = 1 - u sign(dx) / max_stretch`` (Dahl,
    Aerospace Corp. TOR-0158(3107-18)-1, 1968); with 1 it unloads along a straight line. A spring of constant
    stiffness k under the stretch u dissipates ``k u^2 (beta + gamma sign(u dx)) |dx|``, so it is passive for any
    history of ``max_stretch`` >= 0. Where this falls, as under a falling pressure, the friction slips: ``|u|`` never
    exceeds it. After :data:`EQUILIBRIUM_TIME_STEP` it has relaxed, and up to :data:`MIN_BOUC_WEN_STRETCH` there is
    none.
    """
    if dt >= EQUILIBRIUM_TIME_STEP or max_stretch <= MIN_BOUC_WEN_STRETCH:
        return 0.0
    path, size = abs(displacement), min(abs(stretch), max_stretch)
    if displacement == 0.0:
        return math.copysign(size, stretch)
    if stretch < 0.0 < displacement or displacement < 0.0 < stretch:  # their product could underflow
        # Unloading: d|u| = -(1 + (beta - gamma) |u|) |dx| until u = 0.
        rate = (1.0 - gamma_ratio) / ((1.0 + gamma_ratio) * max_stretch)
        unloading_path = math.log(1.0 + rate * size) / rate if rate > 0.0 else size
        if path < unloading_path:
            remaining = (size + 1.0 / rate) * math.exp(-rate * path) - 1.0 / rate if rate > 0.0 else size - path
            return math.copysign(remaining, stretch)
        path, size = path - unloading_path, 0.0
    # Loading: d|u| = (1 - |u| / max_stretch) |dx|.
    return math.copysign(max_stretch + (size - max_stretch) * math.exp(-path / max_stretch), displacement)


def step_follower(value: float, target: float, time_constant: float, dt: float) -> float:
    """Return a first-order follower of ``target`` after a time step ``dt`` [s] (backward Euler).

    ``time_constant`` is positive [s].
    """
    fraction = dt / (time_constant + dt)
    return value + fraction * (target - value)
