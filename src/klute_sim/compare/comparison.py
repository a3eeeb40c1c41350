"""Recordings compared: every series on one axis, every channel of the others against the first's."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from klute_sim.compare import convert, difference, matching, resample, source, strikes
from klute_sim.compare.curve import Curve
from klute_sim.compare.difference import Difference
from klute_sim.compare.remarks import Remarks
from klute_sim.compare.runs import Run
from klute_sim.compare.source import HUMAN, Members, Source
from klute_sim.errors import InputError
from klute_sim.recording.recording import Samples

Over = Literal["phase", "time"]


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to compare, and how."""

    over: Over | None = None
    """None: over phase if every recording has one, else over time."""
    names: tuple[str, ...] = ()
    """Channels; none: the main ones; ``("all",)``: every one."""
    reference: bool = False
    """Put the first run's human reference beside, as a series of its own."""
    to: str | None = None
    """Label of the series that the others are compared with; None: the first run's."""
    skip: int | None = None
    """Strides left out at the start of every recording; None: one of a simulated walk of several strides, none of a
    measured one."""


@dataclass(frozen=True, eq=False)
class Series:
    """One line in the pictures: the mean over the repeats of one label."""

    label: str
    curves: Mapping[str, Curve]
    """By channel."""
    repeats: int
    """Strides over phase, recordings over time; 0 of the human reference: not known."""

    @property
    def reference(self) -> bool:
        """Whether it is the human reference."""
        return self.repeats == 0


@dataclass(frozen=True, eq=False)
class Part:
    """One trial of bench runs; walks and single recordings have one part."""

    name: str
    """Of the trial; '' where there is one part alone."""
    axis: Samples
    """Phase [%] or time [s] of every point."""
    series: tuple[Series, ...]
    """The first is the one that the others are compared with."""
    units: Mapping[str, str]
    """Of every compared channel."""
    differences: Mapping[str, Mapping[str, Difference]]
    """Channel -> label of another series -> how it differs from the first."""

    @property
    def yardstick(self) -> Series:
        """The series in whose standard deviations every rms is told: the reference if it is there, else the first."""
        return _yardstick(self.series)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Everything that was compared."""

    over: Over
    runs: tuple[Run, ...]
    parts: tuple[Part, ...]
    remarks: tuple[str, ...]
    """What the user should know, one sentence each."""

    @property
    def alone(self) -> bool:
        """Whether there is one series, with nothing to compare it with."""
        return len(self.parts[0].series) == 1


def compare(runs: Sequence[Run], options: Options | None = None) -> Comparison:
    """Compare ``runs``; one alone with several strides or repeats is shown with its band.

    Raises InputError where there is nothing to compare, or not what ``options`` ask for.
    """
    options = options or Options()
    _check(runs, options)
    remarks = Remarks(remark for run in runs for remark in run.remarks)
    runs = convert.alike(runs, remarks)
    runs, over = _over(runs, options, remarks)
    _note_walkers(runs, options, remarks)
    parts = matching.parts(runs, remarks).items()
    found = tuple(_part(name, members, over, options, remarks) for name, members in parts)
    if all(len(part.series) == 1 and part.series[0].repeats == 1 for part in found):
        _refuse_alone(runs[0].label, over)
    return Comparison(over, tuple(runs), found, remarks.said)


def _check(runs: Sequence[Run], options: Options) -> None:
    labels = list(dict.fromkeys(run.label for run in runs))
    if options.reference and HUMAN in labels:
        raise InputError(f"'{HUMAN}' is the label of the reference; give the run another one, as in LABEL=RUN")
    if options.reference:
        labels.append(HUMAN)
    if options.to is not None and options.to not in labels:
        raise InputError(f"no series is called '{options.to}'; allowed: {', '.join(labels)}")


def _refuse_alone(label: str, over: Over) -> None:
    what = "stride" if over == "phase" else "recording"
    raise InputError(
        f"there is nothing to compare '{label}' with, and a single {what} has no band of its own; name a run with "
        "another label, a repeat with the same one, or --reference for the human reference of a walk"
    )


def _over(runs: Sequence[Run], options: Options, remarks: Remarks) -> tuple[Sequence[Run], Over]:
    """Over what is compared; and ``runs``, over phase with one in every recording that can be given one."""
    told = Remarks()
    phased = runs if options.over == "time" else [strikes.phased(run, told) for run in runs]
    all_have = all(resample.PHASE in recording for run in phased for recording in run.parts.values())
    over = options.over or ("phase" if all_have else "time")
    if over == "phase":
        runs = phased
        for remark in told.said:
            remarks.add(remark)
    if over == "time" and (options.reference or options.skip is not None):
        raise InputError(f"{'--reference' if options.reference else '--skip'} is for strides; these are over time")
    return runs, over


def _note_walkers(runs: Sequence[Run], options: Options, remarks: Remarks) -> None:
    """Say what makes walks differ beside what is walked on: nothing here is divided by body mass."""
    recordings = [recording for run in runs for recording in run.parts.values()]
    walks = [r.provenance.get("options") or {} for r in recordings if r.provenance.get("rig") == "gait"]
    for key, what, unit in (("mass_kg", "body mass", "kg"), ("speed_m_per_s", "speed", "m/s")):
        values = sorted({f"{walk[key]:.3g}" for walk in walks if isinstance(walk.get(key), float | int)}, key=float)
        if len(values) > 1:
            remarks.add(f"The walkers differ in {what} ({', '.join(values)} {unit}); nothing here is scaled by it.")
    references = {str(r.provenance.get("reference")) for r in recordings}
    if options.reference and len(references) > 1:
        remarks.add(f"The runs have different references: the one shown is that of '{runs[0].label}'.")


def _part(name: str, members: Mapping[str, Members], over: Over, options: Options, remarks: Remarks) -> Part:
    if over == "phase":
        axis = resample.PHASE_GRID
        sources = [source.over_phase(label, own, options.skip, remarks) for label, own in members.items()]
    else:
        axis = resample.common_time([one for own in members.values() for one in own])
        sources = [source.over_time(label, own, axis) for label, own in members.items()]
    if options.reference:
        sources.append(source.human(sources[0], members[sources[0].label], remarks))
    to = options.to or sources[0].label
    sources.sort(key=lambda one: one.label != to)  # which keeps the order of the others
    names = matching.names(sources, options.names, remarks)
    units = {channel: sources[0].units[channel] for channel in names}
    series = tuple(_made(one, units) for one in sources)
    deviations = {name: own.sd for name, own in _yardstick(series).curves.items()}
    differences = {
        channel: {
            other.label: difference.between(
                series[0].curves[channel], other.curves[channel], axis, deviations.get(channel)
            )
            for other in series[1:]
            if channel in other.curves
        }
        for channel in names
    }
    return Part(name, axis, series, units, differences)


def _made(one: Source, units: Mapping[str, str]) -> Series:
    """The curves of those channels that ``one`` has in the same unit."""
    curves = {name: one.curve(name) for name, unit in units.items() if one.units.get(name) == unit}
    return Series(one.label, curves, one.repeats)


def _yardstick(series: Sequence[Series]) -> Series:
    return next((one for one in series if one.reference), series[0])
