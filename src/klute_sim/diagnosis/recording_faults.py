"""Faults of a recording that no single sample shows: a copied command, a wrong unit, drifting repeats."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from klute_sim.datasets.trial import SensorLimits, TimeSeries, Trial
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.noise.repeats import AlignedRepeats, Residuals, align_repeats, list_channels
from klute_sim.effects.families.muscle.threshold_pressure import REFERENCE_DIAMETER
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE
from klute_sim.plausibility.units import MIN_DIFFERENCE, UNITS
from klute_sim.units import BAR

COMMAND_TOLERANCE = 1e-4
"""Difference between pressure and command, relative to the largest command, up to which they are the same number
(assumed: no gauge and no regulator agree with a command as closely, digits of a file do)."""
MIN_EQUAL_FRACTION = 0.99
"""Fraction of the samples of a pressure that equal the command where it is a copy; steps may fall between samples."""
MIN_COMMAND_CHANGE = 0.05
"""Smallest relative change of a command that a coarse gauge cannot follow to the digit (assumed)."""
MIN_COMMAND = 0.5e5
"""Largest command [Pa] below which a vented gauge equals its command by right (assumed)."""
ATMOSPHERE_TOLERANCE = 0.15
"""Largest deviation of a threshold from the pressure of the atmosphere, which other effects of the muscle bias, and of
the atmosphere from its usual pressure (assumed: laboratories up to 1300 m)."""
THRESHOLD_PRESSURE = "threshold_pressure"
"""Effect with the trace of absolute pressures."""
MIN_ZERO_FORCES = 10
"""Smallest number of forces that equal zero where a channel without negative ones ends there (assumed)."""
MIN_PUSH, MAX_BUCKLED_FORCE, MAX_MEAN_BUCKLED_FORCE = 2.0, 4.0, 0.5
"""Smallest push of the simulated muscle, largest reading of a buckled one and largest mean of these readings, in
standard deviations of the noise (assumed)."""
MIN_BUCKLED_FRACTION = 0.95
"""Among the samples in which the simulated muscle pushes, smallest fraction with no larger reading (assumed)."""
MAX_LIMITED_FRACTION = 0.9
"""Largest fraction of the samples of a force that may end at zero (assumed; more would leave too few for a fit)."""
MIN_WRONG_SCALE, MAX_WRONG_SCALE = 1.25, 6.0
"""Ratios of readings to simulated ones, or of these to readings, that a wrong unit may make (assumed: a smaller one is
a calibration, and the checks of the files refuse a larger one)."""
SCALE_TOLERANCE = 0.12
"""Largest relative deviation of a ratio from that of two units, or of two numbers of muscles (assumed: an imperfect
law is off by as much)."""
MAX_SCALED_MISFIT = 0.3
"""Largest misfit of readings in proportion to the simulated ones, over that without the ratio (assumed)."""
MAX_MUSCLES = 4
"""Largest number of parallel muscles that a wrong scale may be due to (assumed)."""
MIN_OFFSET_GROUPS = 3
"""Fewest groups of repeats whose constants tell anything (assumed)."""
MAX_ORDER_PROBABILITY = 0.02
"""Largest probability that exchangeable repeats have the observed order by chance (assumed)."""


def describe_uncompared_channels(trials: Sequence[Trial], experiments: Sequence[Experiment]) -> list[str]:
    """Return a sentence about each channel without samples at the compared times of some of ``trials``."""
    compared = {e.name: e.measured for e in experiments}
    names_by_channel: dict[str, list[str]] = defaultdict(list)
    for trial in trials:
        for channel in trial.measured:
            if channel not in compared[trial.name]:
                names_by_channel[channel].append(trial.name)
    return [
        f"'{channel}' is not used in {len(names)} of {len(trials)} trials, such as '{names[0]}': it has no samples at "
        "the times that are compared. Check the clock and the length of its file."
        for channel, names in names_by_channel.items()
    ]


def find_copied_pressures(trials: Sequence[Trial]) -> set[str]:
    """Return the names of the trials whose measured pressure is the command.

    A coarse gauge may equal a constant command by right, so such a trial counts only if those that vary the command are
    all copies.
    """
    copied = {trial.name for trial in trials if _is_pressure_copied(trial)}
    varying = {trial.name for trial in trials if "pressure" in trial.measured and _varies_command(trial)}
    return copied if varying and varying <= copied else copied & varying


def _varies_command(trial: Trial) -> bool:
    command = trial.prescribed["pressure_command"].value
    return bool(np.ptp(command) > MIN_COMMAND_CHANGE * np.abs(command).max())


def _is_pressure_copied(trial: Trial) -> bool:
    command, pressure = trial.prescribed["pressure_command"], trial.measured.get("pressure")
    if pressure is None or np.abs(command.value).max() < MIN_COMMAND:
        return False
    is_known = np.isfinite(pressure.value) & (pressure.time >= command.time[0]) & (pressure.time <= command.time[-1])
    if not is_known.any():
        return False
    expected = np.interp(pressure.time[is_known], command.time, command.value)
    difference = np.abs(pressure.value[is_known] - expected)
    is_equal = difference <= COMMAND_TOLERANCE * np.abs(command.value).max()
    return bool(np.mean(is_equal) >= MIN_EQUAL_FRACTION)


def limit_forces_at_zero(trials: Sequence[Trial], experiments: Sequence[Experiment]) -> tuple[list[Experiment], str]:
    """Return ``experiments`` whose force ends at zero if that of ``trials`` seems to, and a sentence; '' if not.

    Many recorders read no negative force, and a bare muscle that buckles has none. The simulated one pushes.
    """
    forces = [trial.measured["force"].value for trial in trials if "force" in trial.measured]
    if any("force" in trial.limits for trial in trials) or not forces:
        return list(experiments), ""
    values = np.concatenate(forces)
    n_zeros = int((values == 0.0).sum())
    if n_zeros < MIN_ZERO_FORCES or np.nanmin(values) < 0.0 or not np.nanmax(values) > 0.0:
        return list(experiments), ""
    limits = {"force": SensorLimits(0.0, math.inf)}
    sentence = (
        f"'force' equals 0 N in {n_zeros} samples and is never negative: the sensor seems to end there, so these "
        "samples say only that the force is not positive. State [limits] force if it ends elsewhere."
    )
    return [replace(e, limits={**e.limits, **limits}) for e in experiments], sentence


def limit_buckled_forces(
    experiments: Sequence[Experiment], examined: Sequence[Experiment], residuals: Residuals, noise_std: float
) -> tuple[list[Experiment], str]:
    """Return ``experiments`` with a lower limit of the force if a muscle of ``examined`` buckles, and a sentence.

    The sentence is '' if none buckles. A bare muscle between clamps buckles where the simulated one pushes. Its load
    cell reads only noise then, which other effects imitate. ``residuals`` are those of the declared device,
    ``noise_std`` [N] is from the repeats.
    """
    known = [(e, row["force"]) for e, row in zip(examined, residuals, strict=True) if "force" in e.measured]
    if not known or any("force" in e.limits for e in experiments):
        return list(experiments), ""
    limit = MAX_BUCKLED_FORCE * noise_std
    forces = np.concatenate([e.measured["force"].value for e, _ in known])
    pushes = forces - np.concatenate([residual for _, residual in known]) < -MIN_PUSH * noise_std
    n_pushed = int(pushes.sum())
    if n_pushed < MIN_ZERO_FORCES or np.mean(forces < limit) > MAX_LIMITED_FRACTION:
        return list(experiments), ""
    is_zero = abs(forces[pushes].mean()) <= MAX_MEAN_BUCKLED_FORCE * noise_std
    if not is_zero or np.mean(np.abs(forces[pushes]) <= limit) < MIN_BUCKLED_FRACTION:
        return list(experiments), ""
    limited = [e if "force" not in e.measured else _limit_force(e, SensorLimits(limit, math.inf)) for e in experiments]
    sentence = (
        f"In {n_pushed} samples the simulated muscle pushes and the load cell reads zero: the muscle buckles, or its "
        f"clamp is slack. So samples of 'force' below {limit:.3g} N are used as an upper limit of the force only. If "
        "the readings of the load cell end at another force, state it under [limits]."
    )
    return limited, sentence


def _limit_force(experiment: Experiment, limits: SensorLimits) -> Experiment:
    force = experiment.measured["force"]
    clipped = force._replace(value=np.clip(force.value, *limits))
    return replace(
        experiment,
        measured={**experiment.measured, "force": clipped},
        limits={**experiment.limits, "force": limits},
    )


def describe_copied_pressures(names: Sequence[str], n_trials: int) -> str:
    """Return the sentence about the trials ``names``, of ``n_trials`` that were examined."""
    place = "in all trials" if len(names) == n_trials else f"in {', '.join(names)}"
    return (
        f"'pressure' equals 'pressure_command' {place}: it is the command and not a measurement, so it is not used. "
        "Record a gauge at the device."
    )


def suspect_absolute_pressures(trials: Sequence[Trial], fit: Fit) -> str:
    """Return a sentence where a threshold that ``fit`` holds is the atmosphere of absolute pressures; '' elsewhere.

    Both pressures and their difference agree with the device then, and only the tension lacks the work of one
    atmosphere, exactly as with a constant threshold. The parameter of that effect is the threshold of a bladder of
    :data:`REFERENCE_DIAMETER`, so it is scaled to the diameter of the muscle.
    """
    thresholds = [
        value * REFERENCE_DIAMETER / _get_diameter(trials, fit, parameter.term_index)
        for parameter, value in zip(fit.hypothesis.parameters, fit.values, strict=True)
        if parameter.term_index is not None
        and fit.hypothesis.terms[parameter.term_index].effect == THRESHOLD_PRESSURE
        and parameter.name == "pressure_bar"
    ]
    pressures = [
        series for trial in trials for series in _list_pressures(trial.prescribed) or _list_pressures(trial.measured)
    ]
    lowest = min((float(np.nanpercentile(series.value, 2.0)) for series in pressures), default=0.0)
    if not thresholds or lowest < (1.0 - ATMOSPHERE_TOLERANCE) * ATMOSPHERIC_PRESSURE:
        return ""
    if abs(BAR * thresholds[0] / ATMOSPHERIC_PRESSURE - 1.0) > ATMOSPHERE_TOLERANCE:
        return ""
    return (
        f"The threshold is {thresholds[0]:.3g} bar for the diameter of these muscles, about the pressure of "
        "the atmosphere, and no recorded pressure is below it: the pressures may be absolute, and no effect missing. "
        "If they are, subtract 1.013 bar from them and diagnose again."
    )


def suspect_wrong_scales(experiments: Sequence[Experiment], fit: Fit) -> list[str]:
    """Return a sentence for each channel whose readings are those of ``fit`` times the ratio of two units.

    The files show no ratio as small as that of kgf and lbf, because a muscle may be twice as strong as another one. The
    number of parallel muscles changes the scale of a force, too. ``fit`` is without added effects.
    """
    sentences = []
    for channel in sorted({name for e in experiments for name in e.measured}):
        rows = [
            (e.measured[channel].value, fit.residuals[k][channel])
            for k, e in enumerate(experiments)
            if channel in e.measured
        ]
        readings, residuals = (np.concatenate(values) for values in zip(*rows, strict=True))
        simulated = readings - residuals
        power = float(simulated @ simulated)
        scale = float(readings @ simulated) / power if power > 0.0 else 0.0
        misfit = float(np.linalg.norm(readings - scale * simulated))
        if scale <= 0.0 or misfit > MAX_SCALED_MISFIT * float(np.linalg.norm(residuals)):
            continue
        causes = [*_list_exchanged_units(CHANNEL_UNITS[channel][0], scale), *_list_muscle_counts(channel, fit, scale)]
        if causes:
            sentences.append(
                f"The readings of '{channel}' are {scale:.3g} times the simulated ones. That may be "
                f"{' or '.join(causes)}: check this before anything else."
            )
    return sentences


def _list_exchanged_units(unit: str, scale: float) -> list[str]:
    """Return a description of each pair of units, of the dimension of ``unit``, that makes readings wrong by ``scale``.

    The description says which unit the numbers have, and which one is declared. Of units that hardly differ, the more
    common one stands for the others.
    """
    factors: dict[str, float] = {}
    for name, factor in next((units for units in UNITS.values() if unit in units), {}).items():
        if all(abs(math.log10(factor / other)) > MIN_DIFFERENCE for other in factors.values()):
            factors[name] = factor
    return [
        f"numbers in {written} that are declared as {declared} ({declared_factor / factor:.3g} times)"
        for written, factor in factors.items()
        for declared, declared_factor in factors.items()
        if _is_wrong_scale(scale, declared_factor / factor)
    ]


def _list_muscle_counts(channel: str, fit: Fit, scale: float) -> list[str]:
    """Return a description of each other number of muscles with which a force is ``scale`` times as large."""
    muscle = fit.hypothesis.device.spec.muscle
    if channel != "force" or muscle is None:
        return []
    counts = range(1, MAX_MUSCLES + 1)
    return [
        f"muscle.count = {count} instead of {muscle.count} ({count / muscle.count:.3g} times)"
        for count in counts
        if _is_wrong_scale(scale, count / muscle.count)
    ]


def _is_wrong_scale(scale: float, ratio: float) -> bool:
    is_wrong = MIN_WRONG_SCALE <= max(ratio, 1.0 / ratio) <= MAX_WRONG_SCALE
    return is_wrong and abs(math.log(scale / ratio)) <= SCALE_TOLERANCE


def _get_diameter(trials: Sequence[Trial], fit: Fit, term_index: int) -> float:
    """Return the outer diameter [m] of the bladder that has the term of ``fit`` at ``term_index``."""
    tendon = fit.hypothesis.terms[term_index].tendon
    device = trials[0].devices[tendon] if tendon else fit.hypothesis.device
    return 2.0 * device.parameters.muscle.bladder_radius


def _list_pressures(channels: Mapping[str, TimeSeries]) -> list[TimeSeries]:
    return [series for name, series in channels.items() if name.startswith("pressure")]


class RepeatDrift(NamedTuple):
    """Shift of one channel from the first to the last repeat, in the order of the dataset."""

    channel: str
    """Measured channel."""
    shift: float
    """Median shift over the groups [SI]."""
    noise: float
    """Median standard deviation of the noise within a repeat [SI]."""
    n_groups: int
    """Number of groups of repeats."""

    @property
    def sentence(self) -> str:
        """What was seen, and how to avoid it."""
        unit, si = CHANNEL_UNITS[self.channel]
        place = "the repeats" if self.n_groups == 1 else f"the repeats of all {self.n_groups} groups"
        return (
            f"From the first to the last of {place}, {self.channel.replace('_', ' ')} drifts by {self.shift / si:.3g} "
            f"{unit}, {abs(self.shift) / self.noise:.1f} times the noise: device or sensor warm up or creep. Run them "
            "in before you record, and record repeats in random order; until then this drift counts as noise."
        )


def _compute_noise_within_repeats(repeats: AlignedRepeats) -> float:
    """Return the standard deviation [SI] of ``repeats`` about their common course, without the mean of each."""
    return float(np.std(repeats.deviations - repeats.deviations.mean(axis=1, keepdims=True)))


def find_drifting_repeats(experiments: Sequence[Experiment], residuals: Residuals) -> list[RepeatDrift]:
    """Return the channels whose repeats shift from first to last, always in one direction and by more than their noise.

    A shift is that of the mean residual of a repeat. Exchangeable repeats of a group of n have one of the two monotonic
    orders with the probability ``2 / n!``, and those of all groups have the same one with ``2 / (n1! n2! ...)``: an
    exact permutation test, which :data:`MAX_ORDER_PROBABILITY` decides. It needs 5 repeats of one group, or 2 of each
    of seven groups.
    """
    drifts = []
    for channel in list_channels(experiments):
        shifts, noises, probability = [], [], 2.0
        directions = set()
        for repeats in align_repeats(experiments, residuals, channel):
            means = repeats.residuals.mean(axis=1)
            steps = np.diff(means)
            directions |= set(np.sign(steps).tolist())
            shifts.append(float(means[-1] - means[0]))
            noises.append(_compute_noise_within_repeats(repeats))
            probability /= math.factorial(len(means))
        is_ordered = len(directions) == 1 and probability <= MAX_ORDER_PROBABILITY
        if not is_ordered:
            continue
        shift, noise = float(np.median(shifts)), float(np.median(noises))
        if abs(shift) > noise > 0.0:
            drifts.append(RepeatDrift(channel, shift, noise, len(shifts)))
    return drifts


def describe_differing_repeats(experiments: Sequence[Experiment], residuals: Residuals) -> list[str]:
    """Return a sentence about each channel whose repeats drift, or differ mostly by a constant.

    They do the latter where the mean residuals of the repeats of :data:`MIN_OFFSET_GROUPS` groups or more scatter by
    more than the noise within a repeat. Strides, repeats in a walk, do so by nature.
    """
    drifts = find_drifting_repeats(experiments, residuals)
    drifting = {drift.channel for drift in drifts}
    sentences = [drift.sentence for drift in drifts]
    for channel in [] if experiments[0].has_body else list_channels(experiments):
        offsets, noises = [], []
        for repeats in align_repeats(experiments, residuals, channel):
            offsets.append(float(np.var(repeats.residuals.mean(axis=1), ddof=1)))
            noises.append(_compute_noise_within_repeats(repeats))
        if channel in drifting or len(offsets) < MIN_OFFSET_GROUPS:
            continue
        offset, noise = math.sqrt(float(np.mean(offsets))), float(np.median(noises))
        if offset > noise > 0.0:
            unit, si = CHANNEL_UNITS[channel]
            sentences.append(
                f"Repeats of '{channel}' differ mostly by a constant, {offset / si:.3g} {unit} rms, "
                f"{offset / noise:.1f} times the noise within a trial: a zero that is set anew, or a friction that "
                "earlier motion left. Set the zero before each trial, and reach the first point in the same way; until "
                "then the difference counts as noise."
            )
    return sentences
