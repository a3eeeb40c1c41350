"""The gait phase of a measured walk that has none: from each rise of its ground reaction to the next."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from klute_sim.compare.remarks import Remarks
from klute_sim.compare.resample import PHASE, STRIDE, TIME
from klute_sim.compare.runs import Run
from klute_sim.dataset import events, quantity
from klute_sim.dataset.channels import LOADED, VERTICAL
from klute_sim.recording.recording import Recording

SHORTEST, LONGEST = 0.6, 2.5
"""Stride times [s] of walking; longer, a step was on no plate."""


def phased(run: Run, remarks: Remarks) -> Run:
    """``run`` with a phase in every recording that can be given one."""
    parts = {}
    for part, recording in run.parts.items():
        parts[part] = recording
        found = None if PHASE in recording else _strides(recording)
        if found is not None:
            parts[part], count = found
            remarks.add(
                f"'{run.label}' has no gait_phase: its {count} stride{'s' * (count != 1)} go from one rise of its "
                f"grf_vertical above {LOADED:g} N to the next."
            )
    return replace(run, parts=parts)


def _strides(recording: Recording) -> tuple[Recording, int] | None:
    """The whole strides of ``recording`` with their phase, and how many; None where its load shows none."""
    factor = quantity.between(recording.units[VERTICAL], "N") if VERTICAL in recording else None
    if factor is None:
        return None
    time = recording[TIME]
    struck = [c.strike for c in events.contacts(time, factor * recording[VERTICAL]) if c.begun]
    whole = [(a, b) for a, b in pairwise(struck) if SHORTEST <= b - a <= LONGEST]
    if not whole:
        return None
    number, phase = np.zeros(len(time)), np.zeros(len(time))
    for k, (begin, end) in enumerate(whole, 1):
        inside = (time >= begin) & (time < end)
        number[inside], phase[inside] = k, 100.0 * (time[inside] - begin) / (end - begin)
    own = {name: samples for name, samples in recording.channels.items() if name != STRIDE}
    units = {name: unit for name, unit in recording.units.items() if name != STRIDE}
    told = Recording({**own, STRIDE: number, PHASE: phase}, {**units, STRIDE: "1", PHASE: "%"}, recording.provenance)
    return told.select(number > 0.0), len(whole)
