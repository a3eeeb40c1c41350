"""Conversion of each channel to the unit of the first recording that contains it."""

from collections.abc import Sequence
from dataclasses import replace

from klute_sim.comparison.alignment import channels
from klute_sim.comparison.remarks import Remarks
from klute_sim.comparison.runs import ComparedRun
from klute_sim.datasets import unit_conversion
from klute_sim.recording.recording import Recording


def unify_units(runs: Sequence[ComparedRun], remarks: Remarks) -> list[ComparedRun]:
    """Return ``runs`` with each channel in the unit of its first occurrence; incompatible units remain."""
    target_units: dict[str, str] = {}
    for run in runs:
        for recording in run.parts.values():
            target_units = {**recording.units, **target_units}
    target_units |= {
        name: target_units[channel]
        for name in target_units
        if (channel := channels.parse_reference_name(name)) in target_units
    }
    converted_runs = []
    for run in runs:
        parts = {
            part: _convert_units(recording, target_units, run.label, remarks) for part, recording in run.parts.items()
        }
        converted_runs.append(replace(run, parts=parts))
    return converted_runs


def _convert_units(recording: Recording, target_units: dict[str, str], label: str, remarks: Remarks) -> Recording:
    samples, units = dict(recording.channels), dict(recording.units)
    for name, unit in recording.units.items():
        factor = None if unit == target_units[name] else unit_conversion.get_conversion_factor(unit, target_units[name])
        if factor is not None:
            samples[name], units[name] = factor * samples[name], target_units[name]
            if not name.startswith(channels.REFERENCE_PREFIX):
                remarks.add(f"'{name}' of '{label}' was converted from '{unit}' to '{target_units[name]}'.")
    return Recording(samples, units, recording.provenance)
