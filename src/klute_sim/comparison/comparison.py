"""Recordings compared: every series on one axis, every channel of the others against the first's."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from klute_sim.comparison import difference, source
from klute_sim.comparison.alignment import foot_strikes, matching, resample, unit_conversion
from klute_sim.comparison.curve import MeanCurve
from klute_sim.comparison.difference import Difference
from klute_sim.comparison.remarks import Remarks
from klute_sim.comparison.runs import ComparedRun
from klute_sim.comparison.source import REFERENCE_LABEL, NamedRecordings, SeriesSource
from klute_sim.errors import InputError
from klute_sim.recording.recording import Array

Domain = Literal["phase", "time"]


@dataclass(frozen=True, kw_only=True)
class ComparisonOptions:
    """What to compare, and how."""

    domain: Domain | None = None
    """None: over phase if every recording has one, else over time."""
    channels: tuple[str, ...] = ()
    """Channels; none: the main ones; ``("all",)``: every one."""
    include_reference: bool = False
    """Put the first run's human reference beside, as a series of its own."""
    baseline: str | None = None
    """Label of the series that the others are compared with; None: the first run's."""
    skip_strides: int | None = None
    """Strides left out at the start of every recording; None: one of a simulated walk of several strides, none of a
    measured one."""


@dataclass(frozen=True, eq=False)
class ComparisonSeries:
    """One line in the pictures: the mean over the repeats of one label."""

    label: str
    curves: Mapping[str, MeanCurve]
    """By channel."""
    n_repeats: int
    """Strides over phase, recordings over time; 0 of the human reference: not known."""

    @property
    def is_reference(self) -> bool:
        """Whether it is the human reference."""
        return self.n_repeats == 0


@dataclass(frozen=True, eq=False)
class ComparisonPart:
    """One trial of bench runs; walks and single recordings have one part."""

    name: str
    """Of the trial; '' where there is one part alone."""
    axis: Array
    """Phase [%] or time [s] of every point."""
    series: tuple[ComparisonSeries, ...]
    """The first is the one that the others are compared with."""
    units: Mapping[str, str]
    """Of every compared channel."""
    differences: Mapping[str, Mapping[str, Difference]]
    """Channel -> label of another series -> how it differs from the first."""

    @property
    def normalization_series(self) -> ComparisonSeries:
        """The series in whose standard deviations every rms is told: the reference if it is there, else the first."""
        return _find_normalization_series(self.series)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Everything that was compared."""

    domain: Domain
    runs: tuple[ComparedRun, ...]
    parts: tuple[ComparisonPart, ...]
    remarks: tuple[str, ...]
    """What the user should know, one sentence each."""

    @property
    def is_single(self) -> bool:
        """Whether there is one series, with nothing to compare it with."""
        return len(self.parts[0].series) == 1


def compare(runs: Sequence[ComparedRun], options: ComparisonOptions | None = None) -> Comparison:
    """Compare ``runs``; one alone with several strides or repeats is shown with its band.

    Raises InputError where there is nothing to compare, or not what ``options`` ask for.
    """
    options = options or ComparisonOptions()
    _check_labels(runs, options)
    remarks = Remarks(remark for run in runs for remark in run.remarks)
    runs = unit_conversion.unify_units(runs, remarks)
    runs, over = _select_domain(runs, options, remarks)
    _note_walker_differences(runs, options, remarks)
    parts = matching.match_parts(runs, remarks).items()
    found = tuple(_compare_part(name, members, over, options, remarks) for name, members in parts)
    if all(len(part.series) == 1 and part.series[0].n_repeats == 1 for part in found):
        _raise_nothing_to_compare(runs[0].label, over)
    return Comparison(over, tuple(runs), found, remarks.sentences)


def _check_labels(runs: Sequence[ComparedRun], options: ComparisonOptions) -> None:
    labels = list(dict.fromkeys(run.label for run in runs))
    if options.include_reference and REFERENCE_LABEL in labels:
        raise InputError(
            f"'{REFERENCE_LABEL}' is the label of the reference; give the run another one, as in LABEL=RUN"
        )
    if options.include_reference:
        labels.append(REFERENCE_LABEL)
    if options.baseline is not None and options.baseline not in labels:
        raise InputError(f"no series is called '{options.baseline}'; allowed: {', '.join(labels)}")


def _raise_nothing_to_compare(label: str, domain: Domain) -> None:
    what = "stride" if domain == "phase" else "recording"
    raise InputError(
        f"there is nothing to compare '{label}' with, and a single {what} has no band of its own; name a run with "
        "another label, a repeat with the same one, or --reference for the human reference of a walk"
    )


def _select_domain(
    runs: Sequence[ComparedRun], options: ComparisonOptions, remarks: Remarks
) -> tuple[Sequence[ComparedRun], Domain]:
    """Over what is compared; and ``runs``, over phase with one in every recording that can be given one."""
    told = Remarks()
    phased = runs if options.domain == "time" else [foot_strikes.add_gait_phase(run, told) for run in runs]
    all_have = all(resample.PHASE_CHANNEL in recording for run in phased for recording in run.parts.values())
    over = options.domain or ("phase" if all_have else "time")
    if over == "phase":
        runs = phased
        for remark in told.sentences:
            remarks.add(remark)
    if over == "time" and (options.include_reference or options.skip_strides is not None):
        raise InputError(
            f"{'--reference' if options.include_reference else '--skip'} is for strides; these are over time"
        )
    return runs, over


def _note_walker_differences(runs: Sequence[ComparedRun], options: ComparisonOptions, remarks: Remarks) -> None:
    """Say what makes walks differ beside what is walked on: nothing here is divided by body mass."""
    recordings = [recording for run in runs for recording in run.parts.values()]
    walks = [r.provenance.get("options") or {} for r in recordings if r.provenance.get("rig") == "gait"]
    for key, what, unit in (("mass_kg", "body mass", "kg"), ("speed_m_per_s", "speed", "m/s")):
        values = sorted({f"{walk[key]:.3g}" for walk in walks if isinstance(walk.get(key), float | int)}, key=float)
        if len(values) > 1:
            remarks.add(f"The walkers differ in {what} ({', '.join(values)} {unit}); nothing here is scaled by it.")
    references = {str(r.provenance.get("reference")) for r in recordings}
    if options.include_reference and len(references) > 1:
        remarks.add(f"The runs have different references: the one shown is that of '{runs[0].label}'.")


def _compare_part(
    name: str, recordings: Mapping[str, NamedRecordings], domain: Domain, options: ComparisonOptions, remarks: Remarks
) -> ComparisonPart:
    if domain == "phase":
        axis = resample.PHASE_GRID
        sources = [
            source.make_phase_source(label, own, options.skip_strides, remarks) for label, own in recordings.items()
        ]
    else:
        axis = resample.make_common_time([one for own in recordings.values() for one in own])
        sources = [source.make_time_source(label, own, axis) for label, own in recordings.items()]
    if options.include_reference:
        sources.append(source.make_reference_source(sources[0], recordings[sources[0].label], remarks))
    to = options.baseline or sources[0].label
    sources.sort(key=lambda one: one.label != to)  # which keeps the order of the others
    names = matching.select_channels(sources, options.channels, remarks)
    units = {channel: sources[0].units[channel] for channel in names}
    series = tuple(_make_series(one, units) for one in sources)
    deviations = {name: own.sd for name, own in _find_normalization_series(series).curves.items()}
    differences = {
        channel: {
            other.label: difference.compute_difference(
                series[0].curves[channel], other.curves[channel], axis, deviations.get(channel)
            )
            for other in series[1:]
            if channel in other.curves
        }
        for channel in names
    }
    return ComparisonPart(name, axis, series, units, differences)


def _make_series(series_source: SeriesSource, units: Mapping[str, str]) -> ComparisonSeries:
    """The curves of those channels that ``one`` has in the same unit."""
    curves = {
        name: series_source.get_curve(name) for name, unit in units.items() if series_source.units.get(name) == unit
    }
    return ComparisonSeries(series_source.label, curves, series_source.n_repeats)


def _find_normalization_series(series: Sequence[ComparisonSeries]) -> ComparisonSeries:
    return next((one for one in series if one.is_reference), series[0])
