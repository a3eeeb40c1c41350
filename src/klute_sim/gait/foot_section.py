"""Put the numbers of a section [foot] into the model: the spring of the heel and the hinge of the keel.

The numbers are those of a bench test (:mod:`klute_sim.gait.foot_bench`), in which the ankle does not move. The
forefoot, at a distance ``L`` from the axis of the ankle, bends the hinge between ankle and forefoot, which the effects
`foot_stiffness` and `foot_hysteresis` soften further; the contact, at the distance ``l``, yields, too::

    1 / k_forefoot = L^2 (1 / k_hinge + 1 / (k_contact l^2))

The heel slides along the foot, tilted by ``a`` against the load, and its load bends the same hinge at the distance
``x`` from the axis::

    1 / k_heel = cos(a)^2 / k_slide + x^2 / k_hinge + 1 / k_contact

All stiffnesses are complex (:mod:`klute_sim.laws.loading_cycle`), so that the same equations hold for the losses.
"""

import math

import mujoco
import numpy as np

from klute_sim.device.schema.foot import FootSection
from klute_sim.effects.families.body import MIN_KEEL_TIME_CONSTANT
from klute_sim.errors import InputError
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.laws.foot import Foot
from klute_sim.laws.loading_cycle import (
    CyclicStiffness,
    compliance,
    part_of_compliance,
    part_of_spring_and_dashpot,
    spring_and_dashpot,
)

HEEL_TEST_ANGLE, FOREFOOT_TEST_ANGLE = math.radians(-15.0), math.radians(20.0)
"""Tilt of the foot against the plate in the tests of heel and forefoot [rad], plantarflexion positive (ISO 10328)."""
HEEL_CYCLE_TIME, KEEL_CYCLE_TIME = 0.25, 0.6
"""Duration of a loading cycle of heel and keel [s] (assumed: those of a walk, in which the heel is loaded in the first
quarter of the stride and the keel throughout the stance)."""
DEFAULT_KEEL_LEVER = 0.13
"""Distance of the load from the axis of the ankle in the test of the forefoot of ``models/ankle.xml`` [m]."""
MIN_HEEL_TIME_CONSTANT = 1e-3
"""Smallest time constant of the heel [s] (assumed: too short to show in a gait run)."""
HEEL_CONTACT, FOREFOOT_CONTACT = CyclicStiffness(1000e3, 0.03), CyclicStiffness(520e3, 0.06)
"""Contact of heel and forefoot between 60 and 300 N, measured in the bench test; it depends on the masses."""


def bend_keel(section: FootSection, foot: Foot) -> Foot:
    """Return ``foot`` with the keel of ``section``."""
    hinge = get_hinge(section)
    if hinge is None:
        return foot
    spring, dashpot = spring_and_dashpot(hinge, KEEL_CYCLE_TIME)
    return foot._replace(keel_compliance=1.0 / spring, keel_time_constant=max(dashpot / spring, MIN_KEEL_TIME_CONSTANT))


def get_hinge(section: FootSection) -> CyclicStiffness | None:
    """Return the hinge of the keel [N.m/rad]; None: a rigid keel."""
    forefoot = section.get_forefoot()
    if forefoot is None:
        return None
    stated = compliance(forefoot) / get_keel_lever(section) ** 2
    return part_of_compliance(_subtract(stated, compliance(FOREFOOT_CONTACT) / DEFAULT_KEEL_LEVER**2))


def _subtract(total: complex, known: complex) -> complex:
    """Return the rest of the compliance ``total`` beside ``known``; it does not return more energy than it takes."""
    rest = total - known
    return complex(rest.real, min(rest.imag, 0.0))


def get_keel_lever(section: FootSection) -> float:
    """Return the distance of the load from the axis of the ankle in the test of the forefoot [m]."""
    return section.get_si("keel_lever_mm") if section.keel_lever_mm is not None else DEFAULT_KEEL_LEVER


def apply_heel(spec: mujoco.MjSpec, section: FootSection) -> None:
    """Give the heel of ``spec``, whose keel is not split yet, the numbers of ``section``.

    Raises InputError when the keel alone yields more than heel and keel together may.
    """
    joint = spec.joint(PROSTHESIS_PREFIX + "heel")
    default = part_of_spring_and_dashpot(float(joint.stiffness[0]), float(joint.damping[0]), HEEL_CYCLE_TIME)
    heel, hinge = section.get_heel(default), get_hinge(section)
    others = compliance(HEEL_CONTACT)
    if hinge is not None:
        others += get_heel_lever(spec) ** 2 * compliance(hinge)
    slide = _subtract(compliance(heel), others) / math.cos(HEEL_TEST_ANGLE) ** 2
    if slide.real <= 0.0:
        raise InputError(
            f"[foot] has a heel of {1e-3 * heel.stiffness:.3g} N/mm, but keel and sole alone yield more, at "
            f"{1e-3 / abs(others):.3g} N/mm; allowed: a softer heel or a stiffer forefoot"
        )
    spring, dashpot = spring_and_dashpot(part_of_compliance(slide), HEEL_CYCLE_TIME)
    joint.stiffness = np.array([spring, 0.0, 0.0])  # coefficients of a polynomial
    joint.damping = np.array([max(dashpot, MIN_HEEL_TIME_CONSTANT * spring), 0.0, 0.0])


def get_heel_lever(spec: mujoco.MjSpec) -> float:
    """Return the distance of the load from the axis of the ankle in the test of the heel [m]."""
    x, _, z = spec.geom(PROSTHESIS_PREFIX + "heel").pos
    return abs(float(x) * math.cos(HEEL_TEST_ANGLE) + float(z) * math.sin(HEEL_TEST_ANGLE))
