"""Gait phase of measured recordings without one, from the vertical ground reaction."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from klute_sim.comparison.alignment.resample import PHASE_CHANNEL, STRIDE_CHANNEL, TIME_CHANNEL
from klute_sim.comparison.remarks import Remarks
from klute_sim.comparison.runs import ComparedRun
from klute_sim.datasets import unit_conversion
from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD, VERTICAL_FORCE
from klute_sim.gait.contacts import find_contacts
from klute_sim.recording.recording import Recording

MIN_STRIDE_TIME, MAX_STRIDE_TIME = 0.6, 2.5
"""Stride times [s] of walking; a longer time contains a step on no plate."""


def add_gait_phase(run: ComparedRun, remarks: Remarks) -> ComparedRun:
    """Return ``run`` with a gait phase in every recording whose ground reaction shows strides."""
    parts = {}
    for part, recording in run.parts.items():
        parts[part] = recording
        phased = None if PHASE_CHANNEL in recording else _compute_phase(recording)
        if phased is not None:
            parts[part], n_strides = phased
            remarks.add(
                f"'{run.label}' has no gait_phase: its {n_strides} stride{'s' * (n_strides != 1)} start when "
                f"grf_vertical exceeds {CONTACT_FORCE_THRESHOLD:g} N."
            )
    return replace(run, parts=parts)


def _compute_phase(recording: Recording) -> tuple[Recording, int] | None:
    """Return the complete strides of ``recording`` with their phase, and their number; None without strides."""
    if VERTICAL_FORCE not in recording:
        return None
    factor = unit_conversion.get_conversion_factor(recording.units[VERTICAL_FORCE], "N")
    if factor is None:
        return None
    time = recording[TIME_CHANNEL]
    contacts = find_contacts(time, factor * recording[VERTICAL_FORCE])
    bounds = [
        (contact.foot_strike, following.foot_strike)
        for contact, following in pairwise(contacts)
        if contact.has_foot_strike and contact.has_toe_off and following.has_foot_strike
    ]
    strides = [(begin, end) for begin, end in bounds if MIN_STRIDE_TIME <= end - begin <= MAX_STRIDE_TIME]
    if not strides:
        return None
    number, phase = np.zeros(len(time)), np.zeros(len(time))
    for k, (begin, end) in enumerate(strides, 1):
        inside = (time >= begin) & (time < end)
        number[inside], phase[inside] = k, 100.0 * (time[inside] - begin) / (end - begin)
    channels = {name: samples for name, samples in recording.channels.items() if name != STRIDE_CHANNEL}
    units = {name: unit for name, unit in recording.units.items() if name != STRIDE_CHANNEL}
    phased = Recording(
        {**channels, STRIDE_CHANNEL: number, PHASE_CHANNEL: phase},
        {**units, STRIDE_CHANNEL: "1", PHASE_CHANNEL: "%"},
        recording.provenance,
    )
    return phased.select(number > 0.0), len(strides)
