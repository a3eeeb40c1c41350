"""What belongs together: trials of the same name, channels of the same name and unit; what does not is said."""

from collections.abc import Sequence

from klute_sim.comparison.alignment import channels
from klute_sim.comparison.remarks import Remarks, format_names
from klute_sim.comparison.runs import ComparedRun
from klute_sim.comparison.source import NamedRecordings, SeriesSource
from klute_sim.errors import InputError


def match_parts(runs: Sequence[ComparedRun], remarks: Remarks) -> dict[str, dict[str, NamedRecordings]]:
    """Trial -> label -> recordings, of the trials that every label has; '' where every run is one recording."""
    labels = list(dict.fromkeys(run.label for run in runs))
    if all(len(run.parts) == 1 for run in runs):
        whole = [(run.label, f"recording {run.path}", next(iter(run.parts.values()))) for run in runs]
        return {"": {label: [(where, r) for own, where, r in whole if own == label] for label in labels}}
    names = {label: {part for run in runs if run.label == label for part in run.parts} for label in labels}
    common = [
        part for part in dict.fromkeys(p for run in runs for p in run.parts) if all(part in n for n in names.values())
    ]
    if not common:
        several = next(run for run in runs if len(run.parts) > 1)
        trials = list(several.parts)
        raise InputError(
            f"no trial is in all runs: {several.path} has {format_names(trials)}; allowed are runs of the same protocol, or "
            f"the file of one trial, such as {several.path / trials[0]}.parquet"
        )
    for label, own in names.items():
        if own - set(common):
            remarks.add(
                f"Trials of '{label}' that not all have are left out: {format_names(sorted(own - set(common)))}."
            )
    return {
        part: {
            label: [
                (f"recording {run.path}, trial {part}", run.parts[part])
                for run in runs
                if run.label == label and part in run.parts
            ]
            for label in labels
        }
        for part in common
    }


def select_channels(sources: Sequence[SeriesSource], requested: Sequence[str], remarks: Remarks) -> list[str]:
    """The channels to compare with those of the first of ``sources``.

    ``asked`` empty: the main ones; ``["all"]``: every one; else these, and what is not there is refused.
    """
    first, others = sources[0], sources[1:]
    there = list(dict.fromkeys(name for source in sources for name in source.units))
    by_name = bool(requested) and list(requested) != [channels.ALL_CHANNELS]
    wanted = list(dict.fromkeys(requested)) if by_name else channels.select_measured(there)
    if by_name:
        for name in wanted:
            _check_channel(name, sources, there)
    for other in others:
        _note_incomparable(first, other, wanted, remarks)
    common = [
        n for n in wanted if (any(_is_comparable(n, first, other) for other in others) if others else n in first.units)
    ]
    if not common:
        raise InputError(
            f"no channel of '{first.label}' is in another series in a unit of the same kind; it has "
            f"{format_names(channels.select_measured(first.units))}"
        )
    found = common if requested else channels.select_defaults(common)
    if len(found) < len(common):
        which = "in common are compared" if others else "are shown"
        remarks.add(f"{len(found)} of {len(common)} channels {which}; --channel all takes every one.")
    return found


def _is_comparable(name: str, first: SeriesSource, other: SeriesSource) -> bool:
    return name in first.units and first.units[name] == other.units.get(name)


def _check_channel(name: str, sources: Sequence[SeriesSource], available: Sequence[str]) -> None:
    """Raise InputError where channel ``name`` cannot be compared at all."""
    first = sources[0]
    has = [source for source in sources if name in source.units]
    if not has:
        raise InputError(f"no channel '{name}'; there are {', '.join(available)}")
    if first not in has:
        raise InputError(f"'{first.label}' has no channel '{name}', and the others are compared with it")
    if len(has) == 1 and len(sources) > 1:
        raise InputError(f"channel '{name}' is in '{first.label}' alone: there is nothing to compare it with")
    if len(has) > 1 and not any(_is_comparable(name, first, other) for other in has[1:]):
        raise InputError(f"channel '{name}' is in {_format_units(name, has)}; allowed: units of one kind")


def _note_incomparable(first: SeriesSource, other: SeriesSource, requested: Sequence[str], remarks: Remarks) -> None:
    """Say which of the ``wanted`` channels cannot be compared between these two."""
    for name in requested:
        if name in first.units and name in other.units and not _is_comparable(name, first, other):
            remarks.add(f"Channel '{name}' is in {_format_units(name, [first, other])}: not compared.")
    for one, lacks in ((first, other), (other, first)):
        missing = [name for name in requested if name in one.units and name not in lacks.units]
        if lacks.is_reference:
            missing = channels.select_defaults(missing)  # nobody expects a reference for most of a device's
            if missing:
                remarks.add(f"There is no human reference for: {format_names(missing)}.")
        elif missing and not one.is_reference:
            remarks.add(f"'{one.label}' has channels that '{lacks.label}' lacks: {format_names(missing)}.")


def _format_units(name: str, sources: Sequence[SeriesSource]) -> str:
    return " and in ".join(f"'{source.units[name]}' in '{source.label}'" for source in sources)
