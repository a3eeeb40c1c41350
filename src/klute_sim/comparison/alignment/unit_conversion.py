"""Channels of one quantity in one unit: that of the first recording which has it."""

from collections.abc import Sequence
from dataclasses import replace

from klute_sim.comparison.alignment import channels
from klute_sim.comparison.remarks import Remarks
from klute_sim.comparison.runs import ComparedRun
from klute_sim.datasets import quantity
from klute_sim.recording.recording import Recording


def unify_units(runs: Sequence[ComparedRun], remarks: Remarks) -> list[ComparedRun]:
    """``runs`` with every channel in the unit it first comes in; units of another kind stay, to be refused by name."""
    wanted: dict[str, str] = {}
    for run in runs:
        for recording in run.parts.values():
            wanted = {**recording.units, **wanted}
    wanted |= {name: wanted[own] for name in wanted if (own := channels.parse_reference_name(name)) in wanted}
    found = []
    for run in runs:
        parts = {part: _convert_units(recording, wanted, run.label, remarks) for part, recording in run.parts.items()}
        found.append(replace(run, parts=parts))
    return found


def _convert_units(recording: Recording, target_units: dict[str, str], label: str, remarks: Remarks) -> Recording:
    own, units = dict(recording.channels), dict(recording.units)
    for name, unit in recording.units.items():
        factor = None if unit == target_units[name] else quantity.get_conversion_factor(unit, target_units[name])
        if factor is not None:
            own[name], units[name] = factor * own[name], target_units[name]
            if not name.startswith(channels.REFERENCE_PREFIX):
                remarks.add(f"'{name}' of '{label}' is in '{unit}' and was brought to '{target_units[name]}'.")
    return Recording(own, units, recording.provenance)
