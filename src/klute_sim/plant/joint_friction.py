"""Friction of a joint with a presliding displacement, in MuJoCo's terms, the same for both backends.

MuJoCo's ``frictionloss`` has one level and no presliding displacement. An actuator at the joint gives such friction
beside the devices: its state (``data.act``) is the stretch of the bristle [rad or m], which the step advances exactly
for a constant speed, and its force is that of the stretched bristle. A ``row`` (``actuator_user``) holds the numbers.

A spring of constant stiffness under that stretch is passive for any level of the friction. The bristle also has
internal damping, without which a held joint would ring; its force is limited so that it takes no more than the sliding
bristle dissipates, which keeps the friction passive at any speed (the condition ``s_1 |w| < 4 g(w)`` makes the
dissipation of a LuGre model a positive form in stretch and stretching).

MuJoCo's integrators take that force at the start of a step. A bristle of stiffness k and damping tau k on an inertia m
is stable for ``k (dt^2 + 2 tau dt) < 4 m``, and a stiffer one would shake the joint loose. Its stiffness is therefore
at most a quarter of that (:func:`limit_stiffness`), so that three bristles at a joint are stable together: a limit of
the simulation, which lets a light joint yield over more than its presliding displacement before it slides.
"""

import math
from collections.abc import Sequence

from klute_sim.effects.smoothing import step_bouc_wen
from klute_sim.laws.joint import BristleFriction, bristle_level, bristle_stiffness

FRICTION_LAYOUT_ID = 7206.0
"""First number of a row, by which the callbacks recognise it."""
FRICTION_ROW_SIZE = 5
"""Number of values in a row."""
N_FRICTION_STATES = 1
"""Number of states."""
BRISTLE_TIME_CONSTANT = 1e-3
"""Damping of the bristle over its stiffness [s] (assumed: a third of that of the simulations of Canudas de Wit et al.).
"""
MAX_DAMPING_FRACTION = 2.0
"""Largest damping times speed over the level of the friction; below 4 the friction is passive."""


def pack_friction(friction: BristleFriction) -> tuple[float, ...]:
    """Return the row of ``friction``."""
    return FRICTION_LAYOUT_ID, *friction


def unpack_friction(row: Sequence[float]) -> BristleFriction:
    """Return the friction of ``row``."""
    return BristleFriction(row[1], row[2], row[3], row[4])


def limit_stiffness(friction: BristleFriction, inverse_inertia: float, dt: float) -> float:
    """Return the stiffness of the bristle [N m/rad] in steps ``dt`` [s]: at most ``m/(dt^2 + 2 tau dt)``.

    m is the inertia [kg m2] that the joint has while all others are free, 1/``inverse_inertia``, and tau =
    :data:`BRISTLE_TIME_CONSTANT`. The step ``dw = -(dt/m) k (z + (dt + tau) w)``, ``dz = dt w`` is stable up to four
    times as much (criterion of Jury).
    """
    stiffness, largest = bristle_stiffness(friction), 1.0 / (dt * (dt + 2.0 * BRISTLE_TIME_CONSTANT))
    return largest / inverse_inertia if stiffness * inverse_inertia > largest else stiffness


def compute_stretch_rate(
    row: Sequence[float], stretch: float, velocity: float, inverse_inertia: float, dt: float
) -> float:
    """Return the rate [rad/s] that leads from ``stretch`` [rad] to that after ``dt`` [s] at ``velocity`` [rad/s].

    ``inverse_inertia`` [1/(kg m2)] is that of the joint while all others are free.
    """
    friction = unpack_friction(row)
    max_stretch = bristle_level(friction, velocity) / limit_stiffness(friction, inverse_inertia, dt)
    return (step_bouc_wen(stretch, dt * velocity, max_stretch, 0.0, dt) - stretch) / dt


def compute_friction_force(
    row: Sequence[float], stretch: float, rate: float, velocity: float, inverse_inertia: float, dt: float
) -> float:
    """Return the moment [N m] on the joint after a step ``dt`` [s] from ``stretch`` [rad] with ``rate`` [rad/s].

    ``velocity`` [rad/s] and ``inverse_inertia`` [1/(kg m2)] are those of :func:`compute_stretch_rate`.
    """
    friction = unpack_friction(row)
    stiffness, speed = limit_stiffness(friction, inverse_inertia, dt), abs(velocity)
    damping = stiffness * BRISTLE_TIME_CONSTANT
    limit = MAX_DAMPING_FRACTION * bristle_level(friction, velocity)
    if damping * speed > limit:
        damping = limit / speed
    force = stiffness * (stretch + dt * rate) + damping * rate
    return -force if math.isfinite(force) else 0.0
