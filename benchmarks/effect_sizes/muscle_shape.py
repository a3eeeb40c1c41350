"""Sizes of what takes tension from the muscle: its ends, rubber and braid."""

import math
from collections.abc import Mapping
from functools import partial

import numpy as np
from benchmarks.effect_sizes.size import EffectSize, compute_work, make_clamped_muscle, make_device, simulate

from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.units import BAR

PRESSURE_BAR = 3.0
"""Gauge pressure of the measurements [bar]."""


def measure_lost_volume(effect: str, form: str, parameters: Mapping[str, float], contraction: float) -> float:
    """Return the volume [cm3] per muscle that the gas does not fill after a ``contraction`` [1] from rest.

    It is the work that a slow contraction at constant pressure lacks, over the pressure.
    """
    bare = make_clamped_muscle()
    rest = bare.muscle.resting_length
    path = np.linspace(rest, (1.0 - contraction) * rest, 2001)
    works = []
    for device in (bare, make_device(effect, form, parameters, bare)):
        start = compute_taut_state(device, rest, PRESSURE_BAR * BAR)
        works.append(compute_work(path, simulate(device, path, PRESSURE_BAR * BAR, 0.01, start).tension))
    return 1e6 * (works[1] - works[0]) / (PRESSURE_BAR * BAR * bare.muscle.n_actuators)


def state_cone_volume(cone_ratio: float, contraction: float) -> float:
    """Return the volume [cm3] between the cylinder and two truncated cones, from the radii of the drawing."""
    muscle = make_clamped_muscle().muscle
    radii = []
    for length in (muscle.resting_length, (1.0 - contraction) * muscle.resting_length):
        # A thread of length B winds N times around the cylinder: B^2 = L^2 + (2 pi N R)^2.
        radii.append(math.sqrt(muscle.braid_length**2 - length**2) / (2.0 * math.pi * muscle.braid_turns))
    cap, cylinder = radii
    height = cone_ratio * (cylinder - cap)
    cone = math.pi * height * (cap**2 + cap * cylinder + cylinder**2) / 3.0
    return 1e6 * 2.0 * (math.pi * cylinder**2 * height - cone)


def measure_lost_tension(effect: str, form: str, parameters: Mapping[str, float], contraction: float) -> float:
    """Return the tension [N] that an effect takes at a ``contraction`` [1]."""
    bare = make_clamped_muscle()
    path, pressure = np.full(2, (1.0 - contraction) * bare.muscle.resting_length), PRESSURE_BAR * BAR
    tension, reduced = (
        simulate(device, path, pressure, 0.01, compute_taut_state(device, float(path[0]), pressure)).tension[-1]
        for device in (bare, make_device(effect, form, parameters, bare))
    )
    return float(tension - reduced)


def state_gas_tension(contraction: float) -> float:
    """Return the tension of the gas [N], ``P pi R^2 (2/tan^2(a) - 1)`` with the braid angle a."""
    muscle = make_clamped_muscle().muscle
    length = (1.0 - contraction) * muscle.resting_length
    circumference = math.sqrt(muscle.braid_length**2 - length**2) / muscle.braid_turns
    section, tangent = circumference**2 / (4.0 * math.pi), muscle.braid_turns * circumference / length
    return muscle.n_actuators * PRESSURE_BAR * BAR * section * (2.0 / tangent**2 - 1.0)


def state_end_tension(diameters: float, contraction: float) -> float:
    """Return the tension of the gas [N] in the part of the resting length that both ends hold back."""
    muscle = make_clamped_muscle().muscle
    return diameters * 2.0 * muscle.bladder_radius / muscle.resting_length * state_gas_tension(contraction)


def state_passive_tension(parameters: Mapping[str, float], contraction: float) -> float:
    """Return the passive tension [N] of all actuators; at this pressure, that of a muscle at rest is complete."""
    rise = 1.0 - math.exp(-contraction / parameters["contraction_scale"])
    muscle = make_clamped_muscle().muscle
    diameter_ratio = 2.0 * muscle.bladder_radius / 0.01
    return muscle.n_actuators * diameter_ratio * (parameters["offset_n"] + parameters["rise_n"] * rise)


CONE_ROWS = tuple(
    EffectSize(
        effect="end_taper",
        form="cone",
        parameters={"cone_ratio": cone_ratio},
        quantity=f"volume without gas at {100.0 * contraction:g} % contraction [cm3]",
        stated=state_cone_volume(cone_ratio, contraction),
        measure=partial(measure_lost_volume, "end_taper", "cone", {"cone_ratio": cone_ratio}, contraction),
    )
    for cone_ratio, contraction in ((1.0, 0.1), (1.0, 0.2), (2.0, 0.2))
)
"""Volumes of the cones."""


def make_lost_tension_row(
    effect: str, form: str, parameters: Mapping[str, float], contraction: float, stated: float
) -> EffectSize:
    """Return the row of an effect that takes ``stated`` [N] at a ``contraction`` [1]."""
    return EffectSize(
        effect=effect,
        form=form,
        parameters=parameters,
        quantity=f"tension lost at {PRESSURE_BAR:g} bar and {100.0 * contraction:g} % contraction [N]",
        stated=stated,
        measure=partial(measure_lost_tension, effect, form, parameters, contraction),
    )


STRAIN_ROWS = tuple(
    make_lost_tension_row(
        "end_taper", "strain", {"factor": factor}, contraction, factor * contraction * state_gas_tension(contraction)
    )
    for factor, contraction in ((1.0, 0.1), (1.0, 0.2), (2.0, 0.2))
)
"""Tension of muscles whose ends weaken with the strain."""
END_LENGTH_ROWS = tuple(
    make_lost_tension_row(
        "end_taper",
        "length",
        {"diameters": diameters},
        contraction,
        state_end_tension(diameters, contraction),
    )
    for diameters, contraction in ((2.0, 0.0), (2.0, 0.1), (4.0, 0.1))
)
"""Tension of muscles with a part that does not pull."""
CONTRACTION_ROWS = tuple(
    make_lost_tension_row(
        "end_taper",
        "contraction",
        {"factor": factor, "low_pressure_factor": 0.0},
        contraction,
        state_gas_tension(contraction) - state_gas_tension(factor * contraction),
    )
    for factor, contraction in ((1.25, 0.1), (1.25, 0.2), (1.5, 0.1))
)
"""Tension of muscles whose middle contracts more than the whole."""
PASSIVE_ROWS = tuple(
    make_lost_tension_row(
        "passive_tension", "exponential", parameters, contraction, state_passive_tension(parameters, contraction)
    )
    for rise, contraction in ((150.0, 0.0), (150.0, 0.05), (300.0, 0.05))
    for parameters in ({"rise_n": rise, "offset_n": 25.0, "contraction_scale": 0.037},)
)
"""Tension that rubber and braid take."""
ROWS = (*CONE_ROWS, *STRAIN_ROWS, *END_LENGTH_ROWS, *CONTRACTION_ROWS, *PASSIVE_ROWS)
"""All rows."""
