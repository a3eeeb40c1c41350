"""The McKibben pneumatic muscle (dissertation chapter 3): gas, bladder and friction offset.

``F = -P dV/dL + Vb dW/dL - Ff``: each term is a separate function that returns it with its sign, so the
muscle tension is their sum. ``lambda_1 = L/L0``; the muscle never exceeds L0 (the device, which solves for the length,
enforces this stop).

Several equal actuators in parallel are one :class:`MuscleParameters` with ``n_actuators`` > 1.
"""

import math
from typing import NamedTuple

FRICTION_FADE_PRESSURE = 2.0e5
"""Gauge pressure [Pa] below which the friction offset is faded out (assumed; fitted data start at 2 bar)."""


class MuscleParameters(NamedTuple):
    """Parameters of ``n_actuators`` equal McKibben actuators in parallel."""

    n_actuators: float
    """Number of actuators [1]; 0 without a muscle (:func:`make_absent_muscle`)."""
    resting_length: float
    """L0, unloaded and unpressurised length [m]; the muscle's longest length."""
    braid_length: float
    """B, length of one braid thread [m]."""
    braid_turns: float
    """N, turns of a thread around the muscle [1]."""
    bladder_radius: float
    """R0, outer radius of the bladder at rest [m]."""
    bladder_thickness: float
    """t0, wall thickness of the bladder at rest [m]."""
    c10: float
    """First Mooney-Rivlin constant [Pa]; 0 disables the bladder term."""
    c01: float
    """Second Mooney-Rivlin constant [Pa]; 0 disables the bladder term."""
    friction_slope: float
    """m, friction offset per pressure, per actuator [N/Pa]."""
    friction_offset: float
    """b, friction offset at zero pressure, per actuator, signed as printed [N]."""


def make_absent_muscle(longest: float, shortest: float) -> MuscleParameters:
    """Return the parameters of a device without a muscle, whose moving end has stops at two lengths [m].

    No actuators pull with no force and hold no gas. ``longest`` is the stop at resting length, ``shortest`` that at
    lock length; both are 0 where nothing moves.
    """
    return MuscleParameters(
        n_actuators=0.0,
        resting_length=longest,
        braid_length=math.sqrt(3.0) * shortest,
        braid_turns=1.0,
        bladder_radius=0.0,
        bladder_thickness=0.0,
        c10=0.0,
        c01=0.0,
        friction_slope=0.0,
        friction_offset=0.0,
    )


def lock_length(muscle: MuscleParameters) -> float:
    """Length [m] at which gas pressure no longer pulls: ``B / sqrt(3)`` (braid angle 54.7 degrees)."""
    return muscle.braid_length / math.sqrt(3.0)


def compute_braid_radius(braid_length: float, length: float, braid_turns: float) -> float:
    """Radius [m] of the cylinder that a braid forms at ``length`` [m]: ``sqrt(B^2 - L^2) / (2 pi N)``.

    An unrolled thread is the hypotenuse B of a triangle with the sides L and ``2 pi N R`` (Chou & Hannaford 1996).
    0 for a length beyond that of a thread.
    """
    squared = braid_length * braid_length - length * length
    return math.sqrt(max(0.0, squared)) / (2.0 * math.pi * braid_turns)


def braid_volume(muscle: MuscleParameters, length: float) -> float:
    """Volume [m3] inside the braids of all actuators at ``length`` [m]: ``V = L (B^2 - L^2) / (4 pi N^2)``.

    Chou & Hannaford 1996: the cylinder inside a braid of inextensible threads. The rubber of the bladder fills a part
    of it; the gas has the rest (:func:`gas_volume`).
    """
    b, n = muscle.braid_length, muscle.braid_turns
    return muscle.n_actuators * length * (b * b - length * length) / (4.0 * math.pi * n * n)


def gas_volume(muscle: MuscleParameters, length: float) -> float:
    """Gas volume [m3] of all actuators at ``length`` [m]: :func:`braid_volume` less the bladders, without dead volume.

    Rubber is incompressible (eq. 3.3 assumes it, too), so that its volume does not change with the length, and the
    virtual work of the gas, ``P dV/dL``, is that of the braid's volume.
    """
    return braid_volume(muscle, length) - muscle.n_actuators * bladder_volume(muscle)


def contact_pressure(pressure: float) -> float:
    """Pressure [Pa] with which the bladder presses against the braid at gauge ``pressure`` P [Pa]: ``max(P, 0)``.

    Assumed: a braid carries load only where the bladder presses against it from inside. Below room pressure the
    bladder leaves it, at once and everywhere, and collapses as a tube does (its area follows a "tube law", A. H.
    Shapiro, J. Biomech. Eng. 99:126, 1977, abstract read). The gas then neither pulls nor pushes, and nothing rubs.
    Neglected are the pull of the room on the end fittings, at most ``-P`` times the bore, and the volume that the
    collapse takes from the air.
    """
    # A comparison that is false for NaN, which then stays NaN.
    return 0.0 if pressure < 0.0 else pressure


def gas_force(muscle: MuscleParameters, pressure: float, length: float) -> float:
    """Tension [N] from gauge ``pressure`` [Pa] at ``length`` [m]: ``-P dV/dL = P (3 L^2 - B^2) / (4 pi N^2)``.

    Gaylord 1958, Schulte 1961; the geometric model of dissertation chapter 3. Negative below the lock
    length; 0 below room pressure (:func:`contact_pressure`).
    """
    b, n = muscle.braid_length, muscle.braid_turns
    return muscle.n_actuators * contact_pressure(pressure) * (3.0 * length * length - b * b) / (4.0 * math.pi * n * n)


def bladder_volume(muscle: MuscleParameters) -> float:
    """Rubber volume [m3] of one bladder: ``pi L0 (R0^2 - (R0 - t0)^2)``, with R0 the outer radius (3.3)."""
    inner = muscle.bladder_radius - muscle.bladder_thickness
    outer = muscle.bladder_radius
    return math.pi * muscle.resting_length * (outer * outer - inner * inner)


def _bladder_stretches(muscle: MuscleParameters, length: float) -> tuple[float, float, float]:
    """Squared stretches ``lambda_1^2``, ``lambda_2^2`` and ``k`` with ``lambda_2^2 = 1 + k (1 - lambda_1^2)``."""
    ratio = length / muscle.resting_length
    a = ratio * ratio
    cot_braid_angle = muscle.resting_length / (2.0 * math.pi * muscle.braid_turns * muscle.bladder_radius)
    k = cot_braid_angle * cot_braid_angle
    return a, 1.0 + k * (1.0 - a), k


def bladder_energy(muscle: MuscleParameters, length: float) -> float:
    """Elastic energy [J] of all bladders at ``length`` [m]: ``Vb (C10 (I1 - 3) + C01 (I2 - 3))``, eq. (3.3).

    Incompressible Mooney-Rivlin rubber that follows the braid; zero at L0.
    """
    if muscle.n_actuators == 0.0:
        return 0.0
    a, q, _ = _bladder_stretches(muscle, length)
    i1 = a + q + 1.0 / (a * q)
    i2 = a * q + 1.0 / a + 1.0 / q
    density = muscle.c10 * (i1 - 3.0) + muscle.c01 * (i2 - 3.0)
    return muscle.n_actuators * bladder_volume(muscle) * density


def bladder_force(muscle: MuscleParameters, length: float) -> float:
    """Tension [N] from the bladders at ``length`` [m]: ``Vb dW/dL``, eq. (3.3).

    Zero at L0 and negative below it: the bladder resists contraction and re-extends a slack muscle. It
    derives from a potential and is therefore never clipped.
    """
    if muscle.n_actuators == 0.0:
        return 0.0
    a, q, k = _bladder_stretches(muscle, length)
    # dI/d(lambda_1^2) at fixed lambda_2, and dI/d(lambda_2^2) at fixed lambda_1
    i1_a = 1.0 - 1.0 / (a * a * q)
    i1_q = 1.0 - 1.0 / (a * q * q)
    i2_a = q - 1.0 / (a * a)
    i2_q = a - 1.0 / (q * q)
    slope = muscle.c10 * (i1_a - k * i1_q) + muscle.c01 * (i2_a - k * i2_q)
    ratio = length / muscle.resting_length
    dw_dlambda = 2.0 * ratio * slope
    return muscle.n_actuators * bladder_volume(muscle) * dw_dlambda / muscle.resting_length


def friction_force(muscle: MuscleParameters, pressure: float) -> float:
    """Tension [N] of the printed friction at gauge ``pressure`` [Pa]: ``-(m P + b) min(1, P / 2 bar)``.

    Table 3.1 fits ``Ff = m P + b`` to data at 2-5 bar. As printed it is an *offset*: it has no sign of
    velocity, so with pressure changing over a cycle it can create energy, and with ``b`` < 0 it adds
    tension at low pressure. The fade below 2 bar is assumed: zero at zero pressure, continuous; and below
    (:func:`contact_pressure`).
    """
    pressure = contact_pressure(pressure)
    fade = min(1.0, pressure / FRICTION_FADE_PRESSURE)
    return -muscle.n_actuators * (muscle.friction_slope * pressure + muscle.friction_offset) * fade


def force(muscle: MuscleParameters, pressure: float, length: float) -> float:
    """Tension [N] of the whole muscle at gauge ``pressure`` [Pa] and ``length`` [m]; may be negative."""
    return gas_force(muscle, pressure, length) + bladder_force(muscle, length) + friction_force(muscle, pressure)
