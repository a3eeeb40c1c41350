"""The gait phase of a measured walk that has none: from each rise of its ground reaction to the next."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from klute_sim.comparison.alignment.resample import PHASE_CHANNEL, STRIDE_CHANNEL, TIME_CHANNEL
from klute_sim.comparison.remarks import Remarks
from klute_sim.comparison.runs import ComparedRun
from klute_sim.datasets import quantity
from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD, VERTICAL_FORCE
from klute_sim.gait import contacts
from klute_sim.recording.recording import Recording

MIN_STRIDE_TIME, MAX_STRIDE_TIME = 0.6, 2.5
"""Stride times [s] of walking; longer, a step was on no plate."""


def add_gait_phase(run: ComparedRun, remarks: Remarks) -> ComparedRun:
    """``run`` with a phase in every recording that can be given one."""
    parts = {}
    for part, recording in run.parts.items():
        parts[part] = recording
        found = None if PHASE_CHANNEL in recording else _compute_phase(recording)
        if found is not None:
            parts[part], count = found
            remarks.add(
                f"'{run.label}' has no gait_phase: its {count} stride{'s' * (count != 1)} go from one rise of its "
                f"grf_vertical above {CONTACT_FORCE_THRESHOLD:g} N to the next."
            )
    return replace(run, parts=parts)


def _compute_phase(recording: Recording) -> tuple[Recording, int] | None:
    """The whole strides of ``recording`` with their phase, and how many; None where its load shows none."""
    factor = (
        quantity.get_conversion_factor(recording.units[VERTICAL_FORCE], "N") if VERTICAL_FORCE in recording else None
    )
    if factor is None:
        return None
    time = recording[TIME_CHANNEL]
    struck = [
        c.foot_strike for c in contacts.find_contacts(time, factor * recording[VERTICAL_FORCE]) if c.has_foot_strike
    ]
    whole = [(a, b) for a, b in pairwise(struck) if MIN_STRIDE_TIME <= b - a <= MAX_STRIDE_TIME]
    if not whole:
        return None
    number, phase = np.zeros(len(time)), np.zeros(len(time))
    for k, (begin, end) in enumerate(whole, 1):
        inside = (time >= begin) & (time < end)
        number[inside], phase[inside] = k, 100.0 * (time[inside] - begin) / (end - begin)
    own = {name: samples for name, samples in recording.channels.items() if name != STRIDE_CHANNEL}
    units = {name: unit for name, unit in recording.units.items() if name != STRIDE_CHANNEL}
    told = Recording(
        {**own, STRIDE_CHANNEL: number, PHASE_CHANNEL: phase},
        {**units, STRIDE_CHANNEL: "1", PHASE_CHANNEL: "%"},
        recording.provenance,
    )
    return told.select(number > 0.0), len(whole)
