"""Biological skeletal muscle (dissertation chapter 2): the behaviour that the artificial muscle imitates.

Three elements, each with its printed fit: parallel (2.1), series (2.2) and contractile (2.3), whose force
depends on speed by Hill's hyperbola (2.4) while shortening and by an inverted one while lengthening.

Everything is dimensionless: force over F0 (largest isometric force), length over l0 (the length at which it is
reached) and velocity over Vmax. **Velocity is positive concentric (shortening), as in chapter 2**, opposite to the
``dL/dt`` of the other laws. Tension is positive. No function raises an error inside the range that it
states. The ranges of the fits are in :mod:`klute_sim.laws.hill_tables`; the functions do not check them.
"""

import math
from typing import NamedTuple

ECCENTRIC_SATURATION = 1.3
"""Eccentric force at great speed over isometric force [1]: Hatze, and the design envelope (2.5)."""


class ParallelElement(NamedTuple):
    """Constants of the parallel element (2.1): connective tissue that pulls when the muscle is long."""

    k1: float
    """Force over F0 at l0 [1]."""
    k2: float
    """Exponent of length [1]."""


class SeriesElement(NamedTuple):
    """Constants of the series element (2.2): the elastic part that force stretches."""

    k3: float
    """Elongation over l0 per natural logarithm of force [1]."""
    k4: float
    """Elongation over l0 at F0 [1]."""


class ContractileElement(NamedTuple):
    """Constants of the contractile element's isometric parabola (2.3)."""

    k5: float
    """Quadratic coefficient [1], negative."""
    k6: float
    """Linear coefficient [1]."""
    k7: float
    """Constant coefficient [1]."""


class HillCurve(NamedTuple):
    """Constants of force against velocity: Hill's hyperbola (2.4) and the saturation of its inversion."""

    a: float
    """a/F0 [1], above 0."""
    b: float
    """b/Vmax [1], above 0."""
    saturation: float = ECCENTRIC_SATURATION
    """Eccentric force at great speed over isometric force [1], at least 1; the source also shows 1.2 and 1.8."""


class ClosedInterval(NamedTuple):
    """A closed interval."""

    lower: float
    """Smallest value in the interval."""
    upper: float
    """Largest value in the interval."""


class DesignEnvelope(NamedTuple):
    """Bounds on the constants of a muscle that counts as muscle-like."""

    k5: ClosedInterval
    """Bounds on k5 of (2.3) [1]."""
    k6: ClosedInterval
    """Bounds on k6 of (2.3) [1]."""
    k7: ClosedInterval
    """Bounds on k7 of (2.3) [1]."""
    a: ClosedInterval
    """Bounds on a/F0 of (2.4) [1]."""
    b: ClosedInterval
    """Bounds on b/Vmax of (2.4) [1]."""
    saturation: ClosedInterval
    """Bounds on eccentric force at great speed over isometric force [1]."""


DESIGN_ENVELOPE = DesignEnvelope(
    k5=ClosedInterval(-13.5, -4.5),
    k6=ClosedInterval(9.0, 28.2),
    k7=ClosedInterval(-14.0, -3.45),
    a=ClosedInterval(0.12, 0.41),
    b=ClosedInterval(0.12, 0.41),
    saturation=ClosedInterval(ECCENTRIC_SATURATION, ECCENTRIC_SATURATION),
)
"""The design envelope as printed, eq. (2.5). The bounds of k6 are rounded: see :func:`is_in_envelope`."""


def parallel_force(parallel: ParallelElement, length: float) -> float:
    """Tension [F0] of the parallel element at ``length`` [l0], eq. (2.1): ``k1 (l/l0)^k2``.

    Valid for lengths above 0 to 1.6, the range of Fig. 2.2; 0 for lengths of 0 and below, where the power is not
    defined. As printed, it is k1 at l0 and not 0.
    """
    if length <= 0.0:
        return 0.0
    return parallel.k1 * math.pow(length, parallel.k2)


def series_slack_force(series: SeriesElement) -> float:
    """Force [F0] below which (2.2) is negative and is clipped to 0: ``exp(-k4/k3)``. Valid for k3 above 0."""
    return math.exp(-series.k4 / series.k3)


def series_elongation(series: SeriesElement, force: float) -> float:
    """Elongation [l0] of the series element under ``force`` [F0], eq. (2.2): ``k3 ln(F/F0) + k4``.

    It is clipped to 0 below :func:`series_slack_force` (0.030 to 0.054 F0 for the printed constants). Fig. 2.3 shows
    0.5 to 1 F0.
    """
    if force <= 0.0:
        return 0.0
    elongation = series.k3 * math.log(force) + series.k4
    if elongation < 0.0:
        return 0.0
    return elongation


def isometric_force(contractile: ContractileElement, length: float) -> float:
    """Tension [F0] of the contractile element at rest at ``length`` x [l0], eq. (2.3): ``k5 x^2 + k6 x + k7``.

    Valid in the range printed with each row. It is not clipped: beyond the parabola's roots it is negative, which is
    outside the fit and not a muscle force.
    """
    return contractile.k5 * (length * length) + contractile.k6 * length + contractile.k7


def unloaded_velocity(hill: HillCurve, isometric: float) -> float:
    """Velocity [Vmax] at which (2.4) has no force left: ``(F(l)/F0) (b/Vmax) / (a/F0)``; shortening is positive.

    ``isometric`` is F(l) [F0], valid from 0. It is 1 at F0 only where a/F0 equals b/Vmax.
    """
    return isometric * hill.b / hill.a


def concentric_force(hill: HillCurve, isometric: float, velocity: float) -> float:
    """Tension [F0] while shortening at ``velocity`` [Vmax], Hill's eq. (2.4): ``(F + a)(V + b) = (F(l) + a) b``.

    ``isometric`` is F(l) [F0]: length enters through it alone, with a and b as at l0. Valid for velocities of 0
    and above (shortening is positive). It is not clipped: it is negative beyond :func:`unloaded_velocity`.
    """
    # Equal to (F(l) + a) b / (V + b) - a, but exactly F(l) at rest.
    return isometric - (isometric + hill.a) * velocity / (velocity + hill.b)


def eccentric_force(hill: HillCurve, isometric: float, velocity: float) -> float:
    """Tension [F0] while lengthening at ``velocity`` [Vmax]: an inverted Hill hyperbola.

    ``(s F(l) - F)(c - V) = (s - 1) F(l) c`` with ``c = (s - 1) F(l) b / (F(l) + a)`` and s the saturation: F(l) at
    rest, with the slope of (2.4) there, and s F(l) at great speed. Valid for velocities of 0 and below (lengthening
    is negative) and F(l) of 0 and above; it is F(l) where the force cannot rise (s = 1 or F(l) = 0).

    **Assumed.** The source prints only "inverted Hill saturating at 1.3 F0". That the hyperbola joins (2.4) without
    a kink is assumed (living muscle is often steeper on this side, after Katz 1939), and so is the saturation
    at s times F(l) rather than F0: Fig. 2.6 divides by F(l). The two are the same at l0.
    """
    max_rise = (hill.saturation - 1.0) * isometric
    if max_rise <= 0.0:
        return isometric
    # The rise with the slope of (2.4) at rest; the order of operations keeps the result below saturation.
    linear_rise = -velocity * (isometric + hill.a) / hill.b
    return isometric + max_rise * (linear_rise / (max_rise + linear_rise))


def force_velocity(hill: HillCurve, isometric: float, velocity: float) -> float:
    """Tension [F0] at ``velocity`` [Vmax], shortening positive: :func:`concentric_force` or :func:`eccentric_force`.

    ``isometric`` is F(l) [F0], valid from 0. Continuous in value and slope where the branches meet; falls with
    velocity throughout.
    """
    if velocity >= 0.0:
        return concentric_force(hill, isometric, velocity)
    return eccentric_force(hill, isometric, velocity)


def contractile_force(contractile: ContractileElement, hill: HillCurve, length: float, velocity: float) -> float:
    """Tension [F0] of the contractile element at ``length`` [l0] and ``velocity`` [Vmax]: the surface of Fig. 2.8.

    It inserts (2.3) into (2.4) or its inversion; shortening is positive. Valid in the range printed for (2.3) and at
    any velocity. It is clipped to 0 (assumed: a muscle does not push) where the parabola is negative and where
    shortening is faster than :func:`unloaded_velocity`; the functions above are the printed formulas.
    """
    # Where the parabola is negative both branches are too, so one comparison clips both.
    force = force_velocity(hill, isometric_force(contractile, length), velocity)
    if force < 0.0:
        return 0.0
    return force


def is_in_interval(interval: ClosedInterval, value: float) -> bool:
    """Whether ``value`` lies in ``interval``, ends included; NaN never does."""
    return interval.lower <= value <= interval.upper


def is_in_envelope(envelope: DesignEnvelope, contractile: ContractileElement, hill: HillCurve) -> bool:
    """Whether all constants lie in ``envelope``, eq. (2.5), ends included; valid for any numbers.

    As printed, (2.5) excludes two of the muscles from which it was derived, because their k6 was rounded: the rat's
    8.95 (bound 9.0) and the human's 28.23 (bound 28.2).
    """
    return (
        is_in_interval(envelope.k5, contractile.k5)
        and is_in_interval(envelope.k6, contractile.k6)
        and is_in_interval(envelope.k7, contractile.k7)
        and is_in_interval(envelope.a, hill.a)
        and is_in_interval(envelope.b, hill.b)
        and is_in_interval(envelope.saturation, hill.saturation)
    )
