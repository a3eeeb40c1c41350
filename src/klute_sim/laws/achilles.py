"""The human Achilles tendon (dissertation chapter 5): the power law of its models, and public measurements.

``stress = E strain^n``. The constants of the source's five models (Tables 5.1 and 5.2) are on missing pages,
so the caller gives E and n. The measurements below are from the open literature and serve as the reference for an
artificial tendon until those pages are found.
"""

import math
from typing import NamedTuple


class PowerLaw(NamedTuple):
    """Constants of one tendon model."""

    modulus: float
    """E, stress at a strain of 1 [Pa], above 0; a modulus in the usual sense only where n is 1."""
    exponent: float
    """n [1], at least 1: a tendon stiffens as it is stretched."""


def stress(law: PowerLaw, strain: float) -> float:
    """Tensile stress [Pa] at ``strain`` [1], chapter 5: ``E strain^n``; both positive when pulled.

    Valid for strains of a few percent (walking: :data:`MAX_WALKING_STRAIN`); 0 for strains of 0 and below (assumed: a
    tendon does not push).
    """
    if strain <= 0.0:
        return 0.0
    return law.modulus * math.pow(strain, law.exponent)


def strain_at_stress(law: PowerLaw, stress: float) -> float:
    """Strain [1] under tensile ``stress`` [Pa]: the inverse of :func:`stress`; 0 for stresses of 0 and below."""
    if stress <= 0.0:
        return 0.0
    return math.pow(stress / law.modulus, 1.0 / law.exponent)


def tangent_modulus(law: PowerLaw, strain: float) -> float:
    """Slope of stress over strain [Pa] at ``strain`` [1]: ``n E strain^(n-1)``; 0 for strains of 0 and below.

    Chapter 5 plots it against stress; the strain follows from :func:`strain_at_stress`.
    """
    if strain <= 0.0:
        return 0.0
    return law.exponent * law.modulus * math.pow(strain, law.exponent - 1.0)


class Measurement(NamedTuple):
    """A published number."""

    value: float
    """Mean, in the SI unit that the constant's docstring names."""
    standard_error: float | None
    """Standard error of the mean, same unit; ``None``: not transcribed."""
    source: str
    """Citation."""


PELTONEN_2013 = "Peltonen et al. 2013, SpringerPlus 2:212, doi 10.1186/2193-1801-2-212"
KHARAZI_2021 = "Kharazi et al. 2021, Scientific Reports, doi 10.1038/s41598-021-84847-w"

STIFFNESS_FAST = Measurement(193e3, 18e3, PELTONEN_2013)
"""Stiffness [N/m] between 10 and 80 % of maximum voluntary contraction (MVC), loaded at 120 % of MVC per second."""
STIFFNESS_SLOW = Measurement(207e3, 22e3, PELTONEN_2013)
"""Stiffness [N/m] in the same range, loaded at 21 % of MVC per second; not significantly different."""
ELONGATION_FAST = Measurement(13.0e-3, 1.2e-3, PELTONEN_2013)
"""Elongation [m] at 80 % of MVC, loaded at 120 % of MVC per second."""
ELONGATION_SLOW = Measurement(14.3e-3, 0.9e-3, PELTONEN_2013)
"""Elongation [m] at 80 % of MVC, loaded at 21 % of MVC per second; not significantly different."""
HYSTERESIS_LOSS_FRACTION = Measurement(0.05, 0.02, PELTONEN_2013)
"""Fraction of the stored energy that is dissipated [1], fast loading."""
MAX_WALKING_FORCE = Measurement(1.99e3, None, KHARAZI_2021)
"""Largest force [N] in walking at 1.4 m/s."""
MAX_WALKING_STRAIN = Measurement(0.040, None, KHARAZI_2021)
"""Largest strain [1] in walking at 1.4 m/s."""
