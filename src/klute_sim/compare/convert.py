"""Channels of one quantity in one unit: that of the first recording which has it."""

from collections.abc import Sequence
from dataclasses import replace

from klute_sim.compare import channels
from klute_sim.compare.remarks import Remarks
from klute_sim.compare.runs import Run
from klute_sim.dataset import quantity
from klute_sim.recording.recording import Recording


def alike(runs: Sequence[Run], remarks: Remarks) -> list[Run]:
    """``runs`` with every channel in the unit it first comes in; units of another kind stay, to be refused by name."""
    wanted: dict[str, str] = {}
    for run in runs:
        for recording in run.parts.values():
            wanted = {**recording.units, **wanted}
    wanted |= {name: wanted[own] for name in wanted if (own := channels.compared_with(name)) in wanted}
    found = []
    for run in runs:
        parts = {part: _converted(recording, wanted, run.label, remarks) for part, recording in run.parts.items()}
        found.append(replace(run, parts=parts))
    return found


def _converted(recording: Recording, wanted: dict[str, str], label: str, remarks: Remarks) -> Recording:
    own, units = dict(recording.channels), dict(recording.units)
    for name, unit in recording.units.items():
        factor = None if unit == wanted[name] else quantity.between(unit, wanted[name])
        if factor is not None:
            own[name], units[name] = factor * own[name], wanted[name]
            if not name.startswith(channels.REFERENCE):
                remarks.add(f"'{name}' of '{label}' is in '{unit}' and was brought to '{wanted[name]}'.")
    return Recording(own, units, recording.provenance)
