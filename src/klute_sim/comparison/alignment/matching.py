"""Selection of trials and channels that can be compared, with remarks on the others."""

from collections.abc import Sequence

from klute_sim.comparison.alignment import channels
from klute_sim.comparison.remarks import Remarks, format_names
from klute_sim.comparison.runs import ComparedRun
from klute_sim.comparison.source import NamedRecordings, SeriesSource
from klute_sim.errors import InputError


def match_parts(runs: Sequence[ComparedRun], remarks: Remarks) -> dict[str, dict[str, NamedRecordings]]:
    """Return trial -> label -> recordings, for trials of all labels; the trial is '' if each run is one recording."""
    labels = list(dict.fromkeys(run.label for run in runs))
    if all(len(run.parts) == 1 for run in runs):
        recordings = [(run.label, f"recording {run.path}", next(iter(run.parts.values()))) for run in runs]
        return {"": {label: [(name, r) for other, name, r in recordings if other == label] for label in labels}}
    trials = {label: {part for run in runs if run.label == label for part in run.parts} for label in labels}
    all_trials = dict.fromkeys(part for run in runs for part in run.parts)
    common = [part for part in all_trials if all(part in of_label for of_label in trials.values())]
    if not common:
        run = next(run for run in runs if len(run.parts) > 1)
        names = list(run.parts)
        raise InputError(
            f"the runs have no trial in common: {run.path} has {format_names(names)}; allowed are runs of the same "
            f"protocol, or the file of one trial, such as {run.path / names[0]}.parquet"
        )
    for label, of_label in trials.items():
        excluded = sorted(of_label - set(common))
        if excluded:
            remarks.add(f"Trials of '{label}' that the other runs lack are excluded: {format_names(excluded)}.")
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
    """Return the channels to compare with those of the first of ``sources``.

    An empty ``requested`` selects the main channels, ``["all"]`` all channels. Raises InputError for a requested
    channel that cannot be compared.
    """
    first, others = sources[0], sources[1:]
    available = list(dict.fromkeys(name for source in sources for name in source.units))
    is_by_name = bool(requested) and list(requested) != [channels.ALL_CHANNELS]
    candidates = list(dict.fromkeys(requested)) if is_by_name else channels.select_measured(available)
    if is_by_name:
        for name in candidates:
            _check_channel(name, sources, available)
    for other in others:
        _note_incomparable(first, other, candidates, remarks)
    if others:
        common = [name for name in candidates if any(_is_comparable(name, first, other) for other in others)]
    else:
        common = [name for name in candidates if name in first.units]
    if not common:
        raise InputError(
            f"'{first.label}' has no channel in common with another series in a compatible unit; it has "
            f"{format_names(channels.select_measured(first.units))}"
        )
    selected = common if requested else channels.select_defaults(common)
    if len(selected) < len(common):
        action = "common channels are compared" if others else "channels are shown"
        remarks.add(f"{len(selected)} of {len(common)} {action}; --channel all selects all.")
    return selected


def _is_comparable(name: str, first: SeriesSource, other: SeriesSource) -> bool:
    return name in first.units and first.units[name] == other.units.get(name)


def _check_channel(name: str, sources: Sequence[SeriesSource], available: Sequence[str]) -> None:
    """Raise InputError if the channel ``name`` cannot be compared."""
    first = sources[0]
    with_channel = [source for source in sources if name in source.units]
    if not with_channel:
        raise InputError(f"unknown channel '{name}'; allowed: {', '.join(available)}")
    if first not in with_channel:
        raise InputError(f"'{first.label}', the baseline of the comparison, has no channel '{name}'")
    if len(with_channel) == 1 and len(sources) > 1:
        raise InputError(f"only '{first.label}' has the channel '{name}': there is nothing to compare it with")
    if len(with_channel) > 1 and not any(_is_comparable(name, first, other) for other in with_channel[1:]):
        raise InputError(f"channel '{name}' is in {_format_units(name, with_channel)}; allowed: compatible units")


def _note_incomparable(first: SeriesSource, other: SeriesSource, requested: Sequence[str], remarks: Remarks) -> None:
    """Add remarks on the ``requested`` channels that cannot be compared between two series."""
    for name in requested:
        if name in first.units and name in other.units and not _is_comparable(name, first, other):
            remarks.add(f"Channel '{name}' is in {_format_units(name, [first, other])}: not compared.")
    for source, lacking in ((first, other), (other, first)):
        missing = [name for name in requested if name in source.units and name not in lacking.units]
        if lacking.is_reference:
            missing = channels.select_defaults(missing)  # most channels of a device cannot have a reference
            if missing:
                remarks.add(f"There is no human reference for: {format_names(missing)}.")
        elif missing and not source.is_reference:
            remarks.add(f"'{source.label}' has channels that '{lacking.label}' lacks: {format_names(missing)}.")


def _format_units(name: str, sources: Sequence[SeriesSource]) -> str:
    return " and in ".join(f"'{source.units[name]}' in '{source.label}'" for source in sources)
