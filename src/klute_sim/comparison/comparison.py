"""Comparison of runs: mean curves of all series on a common axis, and their differences from the first series."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from klute_sim.comparison import source
from klute_sim.comparison.alignment import foot_strikes, matching, resample, unit_conversion
from klute_sim.comparison.curve import MeanCurve
from klute_sim.comparison.difference import Difference, compute_difference
from klute_sim.comparison.remarks import Remarks
from klute_sim.comparison.runs import ComparedRun
from klute_sim.comparison.source import NamedRecordings, SeriesSource
from klute_sim.datasets.channels import VERTICAL_FORCE
from klute_sim.errors import InputError
from klute_sim.types import Array

Domain = Literal["phase", "time"]
"""Axis of a comparison: gait phase of strides, or time of whole recordings."""


@dataclass(frozen=True, kw_only=True)
class ComparisonOptions:
    """Options of a comparison."""

    domain: Domain | None = None
    """Axis; None selects phase if every recording has strides, otherwise time."""
    channels: tuple[str, ...] = ()
    """Channels to compare; empty for the main channels, ``("all",)`` for all channels."""
    include_reference: bool = False
    """Whether the human reference of the first run is added as a series."""
    baseline: str | None = None
    """Label of the series that the others are compared with; None selects the first run's."""
    skip_strides: int | None = None
    """Number of strides skipped at the start of each recording; None skips one of a simulated gait with several strides
    and none of a measured one."""


@dataclass(frozen=True, eq=False)
class ComparisonSeries:
    """Mean curves over the repeats of one label."""

    label: str
    """Label of the series."""
    curves: Mapping[str, MeanCurve]
    """Channel -> mean curve."""
    n_repeats: int
    """Number of strides over phase, or of recordings over time; 0 for the human reference (unknown)."""
    has_simulated_repeats: bool = False
    """Whether the repeats are strides of one simulation, which repeat almost exactly."""

    @property
    def is_reference(self) -> bool:
        """Whether the series is the human reference."""
        return self.n_repeats == 0


@dataclass(frozen=True, eq=False)
class ComparisonPart:
    """One trial of bench runs; gait runs and single recordings have one part."""

    name: str
    """Name of the trial; '' if there is one part only."""
    axis: Array
    """Gait phase [%] or time [s] of every point (n,)."""
    series: tuple[ComparisonSeries, ...]
    """Series; the first is the baseline of the comparison."""
    units: Mapping[str, str]
    """Compared channel -> unit."""
    differences: Mapping[str, Mapping[str, Difference]]
    """Channel -> label of another series -> its difference from the first."""

    @property
    def normalization_series(self) -> ComparisonSeries:
        """Series whose standard deviations normalise the rms: the reference if present, otherwise the first."""
        return _find_normalization_series(self.series)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Result of a comparison."""

    domain: Domain
    """Axis of the comparison."""
    runs: tuple[ComparedRun, ...]
    """Runs with unified units."""
    parts: tuple[ComparisonPart, ...]
    """Compared trials."""
    remarks: tuple[str, ...]
    """Remarks for the user, one sentence each."""

    @property
    def is_single(self) -> bool:
        """Whether there is only one series."""
        return len(self.parts[0].series) == 1


def compare(runs: Sequence[ComparedRun], options: ComparisonOptions | None = None) -> Comparison:
    """Compare ``runs``; a single run with several strides or repeats is summarised with its band.

    Raises InputError if there is nothing to compare, or if ``options`` do not fit the runs.
    """
    options = options or ComparisonOptions()
    _check_labels(runs, options)
    remarks = Remarks(remark for run in runs for remark in run.remarks)
    runs = unit_conversion.unify_units(runs, remarks)
    runs, domain = _select_domain(runs, options, remarks)
    _note_walker_differences(runs, options, remarks)
    parts = tuple(
        _compare_part(name, recordings, domain, options, remarks)
        for name, recordings in matching.match_parts(runs, remarks).items()
    )
    if all(len(part.series) == 1 and part.series[0].n_repeats == 1 for part in parts):
        _raise_nothing_to_compare(runs[0].label, domain)
    return Comparison(domain, tuple(runs), parts, remarks.sentences)


def _check_labels(runs: Sequence[ComparedRun], options: ComparisonOptions) -> None:
    labels = list(dict.fromkeys(run.label for run in runs))
    if options.include_reference:
        reference = source.name_reference(next(iter(runs[0].parts.values())))
        if reference in labels:
            raise InputError(
                f"'{reference}' is the label of the reference; give the run another label, as in LABEL=RUN"
            )
        labels.append(reference)
    if options.baseline is not None and options.baseline not in labels:
        raise InputError(f"unknown baseline '{options.baseline}'; allowed labels: {', '.join(labels)}")


def _raise_nothing_to_compare(label: str, domain: Domain) -> None:
    repeat = "stride" if domain == "phase" else "recording"
    raise InputError(
        f"'{label}' has only one {repeat}: there is nothing to compare it with, and no band; add a run with another "
        "label, a repeat with the same label, or --reference for the human reference of a gait"
    )


def _select_domain(
    runs: Sequence[ComparedRun], options: ComparisonOptions, remarks: Remarks
) -> tuple[Sequence[ComparedRun], Domain]:
    """Return the runs, with a gait phase if they are compared over phase, and the axis of the comparison."""
    phase_remarks = Remarks()
    phased_runs = (
        runs if options.domain == "time" else [foot_strikes.add_gait_phase(run, phase_remarks) for run in runs]
    )
    all_have_phase = all(resample.PHASE_CHANNEL in recording for run in phased_runs for recording in run.parts.values())
    domain = options.domain or ("phase" if all_have_phase else "time")
    if options.domain is None and domain == "time":
        _note_missing_strides(phased_runs, remarks)
    if domain == "phase":
        runs = phased_runs
        for remark in phase_remarks.sentences:
            remarks.add(remark)
    if domain == "time" and (options.include_reference or options.skip_strides is not None):
        option = "--reference" if options.include_reference else "--skip"
        reason = "as --over says" if options.domain else "because not all of them have strides of tracked gait"
        raise InputError(
            f"{option} requires a comparison over phase; these recordings are compared over time, {reason}: leave out "
            f"{option}"
        )
    return runs, domain


def _note_missing_strides(runs: Sequence[ComparedRun], remarks: Remarks) -> None:
    """Add a remark on the runs of gait that are compared over time because no stride is known in them."""
    recordings = [(run.label, recording) for run in runs for recording in run.parts.values()]
    if not any(resample.PHASE_CHANNEL in recording for _, recording in recordings):
        return
    for label, recording in recordings:
        if resample.PHASE_CHANNEL not in recording:
            load = "no grf_vertical"
            if VERTICAL_FORCE in recording:
                load = f"a grf_vertical [{recording.units[VERTICAL_FORCE]}] that shows no stride (up is positive)"
            remarks.add(f"Compared over time, because '{label}' has neither gait_phase nor strides: it has {load}.")


def _note_walker_differences(runs: Sequence[ComparedRun], options: ComparisonOptions, remarks: Remarks) -> None:
    """Add remarks on different body masses, speeds and references, as no channel is normalised by body mass."""
    recordings = [recording for run in runs for recording in run.parts.values()]
    gait_options = [r.provenance.get("options") or {} for r in recordings if r.provenance.get("rig") == "gait"]
    for key, quantity, unit in (("mass_kg", "body mass", "kg"), ("speed_m_per_s", "speed", "m/s")):
        numbers = {f"{entry[key]:.3g}" for entry in gait_options if isinstance(entry.get(key), float | int)}
        values = sorted(numbers, key=float)
        if len(values) > 1:
            remarks.add(f"The subjects differ in {quantity} ({', '.join(values)} {unit}); no channel is normalised.")
    references = {str(r.provenance.get("reference")) for r in recordings}
    if options.include_reference and len(references) > 1:
        remarks.add(f"The runs have different references; the reference of '{runs[0].label}' is shown.")


def _compare_part(
    name: str, recordings: Mapping[str, NamedRecordings], domain: Domain, options: ComparisonOptions, remarks: Remarks
) -> ComparisonPart:
    if domain == "phase":
        axis = resample.PHASE_GRID
        sources = [
            source.make_phase_source(label, of_label, options.skip_strides, remarks)
            for label, of_label in recordings.items()
        ]
    else:
        axis = resample.make_common_time([named for of_label in recordings.values() for named in of_label])
        sources = [source.make_time_source(label, of_label, axis) for label, of_label in recordings.items()]
    if options.include_reference:
        sources.append(source.make_reference_source(sources[0], recordings[sources[0].label], remarks))
    baseline = options.baseline or sources[0].label
    sources.sort(key=lambda series: series.label != baseline)  # a stable sort keeps the order of the others
    channels = matching.select_channels(sources, options.channels, remarks)
    units = {channel: sources[0].units[channel] for channel in channels}
    series = tuple(_make_series(series_source, units) for series_source in sources)
    normalization = _find_normalization_series(series)
    deviations = (
        {}
        if normalization.has_simulated_repeats
        else {channel: curve.sd for channel, curve in normalization.curves.items()}
    )
    differences = {
        channel: {
            other.label: compute_difference(
                series[0].curves[channel], other.curves[channel], axis, deviations.get(channel)
            )
            for other in series[1:]
            if channel in other.curves
        }
        for channel in channels
    }
    return ComparisonPart(name, axis, series, units, differences)


def _make_series(series_source: SeriesSource, units: Mapping[str, str]) -> ComparisonSeries:
    """Return the curves of the channels that ``series_source`` has in the same unit."""
    curves = {
        channel: series_source.get_curve(channel)
        for channel, unit in units.items()
        if series_source.units.get(channel) == unit
    }
    return ComparisonSeries(series_source.label, curves, series_source.n_repeats, series_source.has_simulated_repeats)


def _find_normalization_series(series: Sequence[ComparisonSeries]) -> ComparisonSeries:
    return next((candidate for candidate in series if candidate.is_reference), series[0])
