"""The subject of a tuning: standard deviations for every distance, goals of the own ankle, and what is assumed."""

from dataclasses import replace

import numpy as np

from klute_sim.gait.assumed_deviations import CURVE_OF_DEVIATION, assume_standard_deviations
from klute_sim.gait.reference import Reference, load_default_reference
from klute_sim.gait.subject import Subject
from klute_sim.tuning.objective import HUMAN_GOALS, Goals

CHANNEL_NAMES = dict(zip(CURVE_OF_DEVIATION, ("angle", "moment", "power"), strict=True))
"""Name of the ankle channel by the column of its standard deviation."""


def prepare_subject(subject: Subject) -> Subject:
    """Return ``subject`` with a reference that has every standard deviation that the objective needs."""
    is_measured_condition = subject.speed is None and subject.slope_deg == 0.0
    reference = assume_standard_deviations(subject.reference, everywhere=not is_measured_condition)
    return replace(subject, reference=reference)


def describe_assumptions(subject: Subject) -> list[str]:
    """Return a sentence for each assumption that :func:`prepare_subject` makes about ``subject``."""
    sentences = []
    names = [name for column, name in CHANNEL_NAMES.items() if not subject.reference.has_column(column)]
    if names:
        sentences.append(
            f"Assumed: the standard deviations of {', '.join(names)} are those of able-bodied adults, times the ratio "
            "of the ranges of the curves, because the reference states none."
        )
    conditions = [
        *([] if subject.speed is None else [f"at {subject.speed:g} m/s"]),
        *([] if subject.slope_deg == 0.0 else [f"on a slope of {subject.slope_deg:g} degrees"]),
    ]
    if conditions:
        sentences.append(
            f"Assumed: {' and '.join(conditions)}, the ankle should follow the curves of the reference over the gait "
            "cycle with the same standard deviations, although they were measured elsewhere."
        )
    return sentences


def make_human_goals(reference: Reference) -> Goals:
    """Return the goals of ``--goal-human`` for the ankle of ``reference``.

    The goals of able-bodied adults scale with peak power, net work and peak plantarflexion; the distance of the moment
    is in standard deviations and stays.
    """
    person_values, default_values = _measure_ankle(reference), _measure_ankle(load_default_reference())
    goals = (HUMAN_GOALS.power_w_per_kg, HUMAN_GOALS.work_j_per_kg, HUMAN_GOALS.plantarflexion_deg)
    power, work, plantarflexion = (
        None if goal is None else goal * (a / b)
        for goal, a, b in zip(goals, person_values, default_values, strict=True)
    )
    return Goals(
        moment_sd=HUMAN_GOALS.moment_sd, power_w_per_kg=power, work_j_per_kg=work, plantarflexion_deg=plantarflexion
    )


def _measure_ankle(reference: Reference) -> tuple[float, float, float]:
    """Return peak power [W/kg], net work [J/kg] and peak plantarflexion [deg] of the ankle of ``reference``."""
    phase = np.arange(1000) / 1000.0
    angle, moment = (
        reference(column, phase) for column in ("ankle_dorsiflexion_deg", "ankle_plantarflexor_moment_nm_per_kg")
    )
    work = -moment * np.gradient(np.radians(angle))
    return float(reference("ankle_power_w_per_kg", phase).max()), float(work.sum()), float(-angle.min())
