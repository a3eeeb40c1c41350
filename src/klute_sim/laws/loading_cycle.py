"""Stiffness and energy loss of a viscoelastic part in a loading cycle, from no load to a peak and back.

The load is ``F = F0 (1 - cos(w t)) / 2`` with ``w = 2 pi / T``. In the steady state of a linear part the deflection
follows with the amplitude ``X`` and the lag ``phi``. A test of a foot reports two numbers: the *stiffness*
``K = F0 / (2 X)``, the range of the load over that of the deflection, and the *loss*, the area of the loop over the
area under the loading curve::

    loop = pi K X^2 sin(phi)        loading curve = 2 K X^2 + loop / 2
    loss = pi sin(phi) / (2 + (pi / 2) sin(phi))

A spring ``K cos(phi)`` with a dashpot ``K sin(phi) / w`` beside it has both at this duration ``T``. Its loss is nearly
proportional to ``1 / T``, whereas that of rubber and laminates hardly depends on it: away from ``T`` it is an
approximation.
"""

import math
from typing import NamedTuple

MAX_LOSS = math.pi / (2.0 + 0.5 * math.pi)
"""Loss of a pure dashpot [1]; no linear part loses more in a steady cycle."""


class CyclicStiffness(NamedTuple):
    """A part as a loading cycle shows it."""

    stiffness: float
    """Range of the load over the range of the deflection [N/m or N.m/rad]."""
    loss: float
    """Energy lost per cycle over the energy put in [1]; 0 to below :data:`MAX_LOSS`."""


def loss_of_lag(lag: float) -> float:
    """Return the loss [1] of a part whose deflection lags by ``lag`` [rad], 0 to a quarter turn."""
    return math.pi * math.sin(lag) / (2.0 + 0.5 * math.pi * math.sin(lag))


def lag_of_loss(loss: float) -> float:
    """Return the lag [rad] of a part with the ``loss`` [1]; the inverse of :func:`loss_of_lag`."""
    return math.asin(min(1.0, 4.0 * loss / (math.pi * (2.0 - loss))))


def compliance(part: CyclicStiffness) -> complex:
    """Return deflection over load as a complex number: one over the stiffness, late by the lag."""
    lag = lag_of_loss(part.loss)
    return complex(math.cos(lag), -math.sin(lag)) / part.stiffness


def part_of_compliance(value: complex) -> CyclicStiffness:
    """Return the part with the complex compliance ``value``; the inverse of :func:`compliance`."""
    return CyclicStiffness(1.0 / abs(value), loss_of_lag(math.atan2(-value.imag, value.real)))


def in_series(first: CyclicStiffness, second: CyclicStiffness) -> CyclicStiffness:
    """Return two parts that carry the same load: their compliances add."""
    return part_of_compliance(compliance(first) + compliance(second))


def spring_and_dashpot(part: CyclicStiffness, cycle_time: float) -> tuple[float, float]:
    """Return the spring and, beside it, the dashpot that behave as ``part`` in cycles of ``cycle_time`` [s].

    Units: those of the stiffness, and the same times seconds.
    """
    lag = lag_of_loss(part.loss)
    return part.stiffness * math.cos(lag), part.stiffness * math.sin(lag) * cycle_time / (2.0 * math.pi)


def part_of_spring_and_dashpot(spring: float, dashpot: float, cycle_time: float) -> CyclicStiffness:
    """Return ``spring`` beside ``dashpot`` as cycles of ``cycle_time`` [s] show them."""
    slope = 2.0 * math.pi / cycle_time * dashpot
    return CyclicStiffness(math.hypot(spring, slope), loss_of_lag(math.atan2(slope, spring)))
