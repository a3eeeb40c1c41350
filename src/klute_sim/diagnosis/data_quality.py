"""Data quality: which channels and samples are usable, and whether the data suffice for a diagnosis."""

from collections.abc import Container, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from klute_sim.datasets.dataset import Dataset
from klute_sim.datasets.remarks import MAX_LISTED_TRIALS
from klute_sim.datasets.trial import MIN_SAMPLES
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, MAX_WARM_UP_TIME, Experiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import (
    MIN_COMMON_SAMPLES,
    Residuals,
    align_repeats,
    estimate_noise_from_repeats,
    find_inconsistent_repeats,
    group_repeats,
    list_channels,
)
from klute_sim.diagnosis.recording_faults import (
    describe_copied_pressures,
    describe_differing_repeats,
    describe_uncompared_channels,
    find_copied_pressures,
    limit_buckled_forces,
    limit_forces_at_zero,
)
from klute_sim.types import Array
from klute_sim.units import BAR

MIN_TOTAL_TIME = 2.0
"""Shortest total duration of the fitted trials [s] (assumed)."""
MIN_PRESSURE_RANGE, MIN_LENGTH_RANGE = 0.5e5, 1e-3
"""Smallest ranges of the inputs [Pa, m]; below both, the device does not move (assumed)."""
MIN_RELATIVE_RANGE = 1e-9
"""Smallest relative range of a working channel (assumed)."""
SATURATION_COUNT_RATIO, MIN_SATURATED_SAMPLES = 5, 10
"""Samples at the highest or lowest value of a saturated channel: their ratio to those at any other value, and their
smallest number. Coarsely digitized or vented channels repeat other values, too."""
NO_USABLE_CHANNEL = "No channel is usable. Check cables and columns."
USUAL_RATE_HZ = 100.0
"""Samples a second that show how a bench moves (assumed)."""


class UsableData(NamedTuple):
    """Experiments with their usable channels."""

    experiments: list[Experiment]
    """All experiments."""
    fit_experiments: list[Experiment]
    """Experiments for the fit that have a usable channel."""
    remarks: list[str]
    """Sentences about excluded data and about effects that the data cannot show."""
    blocking_problems: list[str]
    """Reasons why no diagnosis is possible, with the fix; empty if one is possible."""


class CleanData(NamedTuple):
    """Experiments without the channels and samples that cannot be compared."""

    experiments: list[Experiment]
    """All experiments, with their usable channels only."""
    examined: list[Experiment]
    """Experiments that were compared with their repeats, without the channels that contradict these."""
    residuals: Residuals
    """Residuals of the nominal device in the examined experiments."""
    remarks: list[str]
    """Sentences about excluded data."""
    blocking_problems: list[str]
    """Reasons why no diagnosis is possible, with the fix."""


def select_usable_data(dataset: Dataset, experiments: Sequence[Experiment], simulator: Simulator) -> UsableData:
    """Remove dead channels, copied commands, saturated samples, inconsistent repeats and channels without repeats.

    Test trials lose the channels that are excluded everywhere and are not examined otherwise.
    """
    usable, examined, residuals, remarks, problems = clean_data(dataset, experiments, simulator)
    if not examined:
        return UsableData(usable, [], remarks, problems)
    remarks += describe_differing_repeats(examined, residuals)
    unrepeated = find_unrepeated_channels([e for e in usable if e.use == "fit"])
    usable = remove_channels(usable, pair_trials_with_channels(usable, unrepeated))
    remarks += [f"{reason}; it is not used." for reason in unrepeated.values()]
    fit_experiments = [e for e in usable if e.use == "fit" and e.measured]
    if not fit_experiments:
        return UsableData(usable, [], remarks, [*problems, NO_USABLE_CHANNEL])
    return UsableData(
        usable,
        fit_experiments,
        [*remarks, *find_limitations(fit_experiments, [e for e in usable if e.use != "fit" and e.measured])],
        [*problems, *find_blocking_problems(fit_experiments, judges_supply=is_supply_only(experiments))],
    )


def clean_data(
    dataset: Dataset, experiments: Sequence[Experiment], simulator: Simulator, *, may_diverge: bool = False
) -> CleanData:
    """Remove dead channels, copied commands, saturated samples and inconsistent repeats.

    No experiment is examined where no channel of the trials to fit is usable. A simulation that diverges raises
    SimulationError; with ``may_diverge`` its trial is not compared with its repeats instead.
    """
    seen = {e.name for e in experiments if e.use != "test"}
    uncompared = describe_uncompared_channels(dataset.trials, experiments)
    experiments, zero_limit = limit_forces_at_zero([t for t in dataset.trials if t.name in seen], experiments)
    for_fit = [e for e in experiments if e.use == "fit"]
    dead, saturated = find_faulty_channels(for_fit)
    usable = remove_channels(
        remove_saturated_samples(experiments, for_fit), pair_trials_with_channels(experiments, dead)
    )
    remarks = [f"{reason}; it is not used." for reason in dead.values()] + [f"{remark}." for remark in saturated]
    remarks += [*uncompared, *filter(None, [zero_limit])]
    copied, copied_remarks = _find_copied_channels(dataset, usable)
    usable, remarks = remove_channels(usable, copied), remarks + copied_remarks

    examined = [e for e in usable if e.use != "test" and e.measured]
    if not any(e.use == "fit" for e in examined):
        return CleanData(usable, [], [], remarks, [_describe_few_samples(for_fit) or NO_USABLE_CHANNEL])
    nominal = Hypothesis(dataset.device, (), ())
    data = WeightedData(simulator, examined, {})
    rows = data.compute_residuals(nominal, [nominal.initial_point()], may_diverge=may_diverge)[0]
    is_finite = [all(np.isfinite(values).all() for values in row.values()) for row in rows]
    examined = [e for e, keep in zip(examined, is_finite, strict=True) if keep]
    residuals = [row for row, keep in zip(rows, is_finite, strict=True) if keep]
    contradicted, problems = find_contradicted_channels(examined, residuals)
    usable = remove_channels(usable, contradicted)
    remarks += dict.fromkeys(contradicted.values())
    examined = remove_channels(examined, contradicted)  # what contradicts its repeats would count as noise
    noise = estimate_noise_from_repeats(examined, residuals)
    if "force" in noise:
        usable, buckling = limit_buckled_forces(usable, examined, residuals, noise["force"].std)
        remarks += filter(None, [buckling])
    return CleanData(usable, examined, residuals, remarks, problems)


def _find_copied_channels(
    dataset: Dataset, experiments: Sequence[Experiment]
) -> tuple[set[tuple[str, str]], list[str]]:
    """Return (trial, channel) of each pressure that is the command, and a remark; test trials follow if all are so."""
    names = {e.name for e in experiments if e.use != "test" and "pressure" in e.measured}
    copied = find_copied_pressures([trial for trial in dataset.trials if trial.name in names])
    if not copied:
        return set(), []
    removed = {e.name for e in experiments} if copied == names else copied
    remark = describe_copied_pressures(sorted(copied), len(names))
    return {(name, "pressure") for name in removed}, [remark]


def _describe_few_samples(experiments: Sequence[Experiment]) -> str:
    """Return that no channel has enough samples after the warm-up, and what is needed; '' where one has."""
    n_samples = max((len(series.value) for e in experiments for series in e.measured.values()), default=0)
    if n_samples > MIN_COMMON_SAMPLES:
        return ""
    return (
        f"The recordings are too short or too slow: a channel has at most {n_samples} samples after the beginning of a "
        f"trial, which is not compared (up to {MAX_WARM_UP_TIME:g} s), and needs more than {MIN_COMMON_SAMPLES}. "
        f"Record each trial for several seconds with about {USUAL_RATE_HZ:g} samples a second."
    )


def find_blocking_problems(experiments: Sequence[Experiment], *, judges_supply: bool = False) -> list[str]:
    """Return the reasons why fits to ``experiments`` cannot diagnose the device, with the fix; empty if they can.

    Where ``judges_supply``, nothing but the pressure was ever measured, and the supply alone is to be judged.
    """
    problems = []
    informative = experiments[0].informative_channels
    if not set(informative) & set(list_channels(experiments)) and not judges_supply:
        names = [f"'{channel}'" for channel in informative]
        lead = f"Neither {', '.join(names[:-1])} nor {names[-1]} is" if len(names) > 1 else f"{names[0]} is not"
        problems.append(
            f"{lead} usable, so the data contain no information about muscle, damper and tendon. Record {names[0]}."
        )
    problems += filter(None, [_describe_few_samples(experiments)])
    time = sum(e.duration for e in experiments)
    if time < MIN_TOTAL_TIME:
        problems.append(
            f"The trials to fit last {time:.1f} s in total. Record at least {MIN_TOTAL_TIME:g} s, better 20 s, with "
            "varying pressure and length."
        )
    pressure_range, length_range = _compute_pressure_range(experiments), _compute_length_range(experiments)
    if pressure_range < MIN_PRESSURE_RANGE and length_range is not None and length_range < MIN_LENGTH_RANGE:
        problems.append(
            f"The device does not move: within a trial, pressure changes by {pressure_range / BAR:.2f} bar and length "
            f"by {1e3 * length_range:.2f} mm. Step the pressure and move the crosshead in both directions, at several "
            "speeds."
        )
    return problems


def _compute_pressure_range(experiments: Sequence[Experiment]) -> float:
    """Return the largest range of the command, or of the pressure where that alone was measured, within a trial [Pa].

    A filling begins with a vented muscle under a constant command.
    """
    ranges = [e.pressure_range for e in experiments]
    if is_supply_only(experiments):
        ranges += [float(np.ptp(e.measured["pressure"].value)) for e in experiments]
    return max(ranges)


def _compute_length_range(experiments: Sequence[Experiment]) -> float | None:
    """Return the largest range of the length within a trial [m]; None if it is unknown in one of them."""
    ranges = [e.length_range for e in experiments]
    known = [value for value in ranges if value is not None]
    return max(known) if len(known) == len(ranges) else None


def is_supply_only(experiments: Sequence[Experiment]) -> bool:
    """Return whether the pressure is the only measured channel, so that the supply alone can be judged."""
    return list_channels(experiments) == ["pressure"]


def has_repeats(experiments: Sequence[Experiment]) -> bool:
    """Return whether any channel was measured more than once under the same input, with enough common samples."""
    return bool(_find_repeated_channels(experiments))


def find_unrepeated_channels(experiments: Sequence[Experiment]) -> dict[str, str]:
    """Return channel -> reason for channels without repeats, if other channels have repeats."""
    repeated = _find_repeated_channels(experiments)
    return {
        channel: f"'{channel}' was never recorded twice under the same input with more than {MIN_COMMON_SAMPLES} "
        "samples at the same time, so its noise is unknown"
        for channel in list_channels(experiments)
        if repeated and channel not in repeated
    }


def _find_repeated_channels(experiments: Sequence[Experiment]) -> set[str]:
    values = [{channel: series.value for channel, series in e.measured.items()} for e in experiments]
    return {
        channel
        for channel in list_channels(experiments)
        if next(align_repeats(experiments, values, channel), None) is not None
    }


def find_contradicted_channels(
    experiments: Sequence[Experiment], residuals: Residuals
) -> tuple[dict[tuple[str, str], str], list[str]]:
    """Return (trial, channel) -> reason for channels that contradict their repeats, and reasons to stop."""
    contradicted, problems = {}, []
    for (group, channel), (deviation, others) in find_inconsistent_repeats(experiments, residuals).items():
        unit, si = CHANNEL_UNITS[channel]
        repeats = [e for e in experiments if e.group == group and channel in e.measured]
        constant = [e for e in repeats if np.ptp(e.measured[channel].value) == 0.0]
        sentence = (
            f"Repeats of '{group}' differ in {channel} by {deviation / si:.3g} {unit}, those of other groups by "
            f"{others / si:.3g} {unit}"
        )
        if constant and len(constant) < len(repeats):
            names = ", ".join(e.name for e in constant)
            value = constant[0].measured[channel].value[0] / si
            wrong = constant
            sentence += f": it is constant at {value:g} {unit} in {names}"
        else:
            wrong = repeats
            sentence += " (wrong unit, loose cable or a file of another trial?)"
        contradicted.update({(e.name, channel): f"{sentence}; it is not used there." for e in wrong})
    for channel, noise in estimate_noise_from_repeats(experiments, residuals).items():
        if noise.std == 0.0:
            problems.append(
                f"Repeats of '{channel}' agree to the last digit: they are copies, or have too few digits to resolve "
                "the noise. Record every input again, with more digits."
            )
        else:
            contradicted.update(_find_copies(experiments, channel))
    return contradicted, problems


def _find_copies(experiments: Sequence[Experiment], channel: str) -> dict[tuple[str, str], str]:
    """Return (trial, channel) -> reason for trials whose samples of ``channel`` are those of an earlier repeat."""
    copies = {}
    for group, members in group_repeats(experiments).items():
        first_names: dict[bytes, str] = {}
        for e in (experiments[k] for k in members if channel in experiments[k].measured):
            first = first_names.setdefault(e.measured[channel].value.tobytes(), e.name)
            if first != e.name:
                copies[e.name, channel] = (
                    f"Repeats {first} and {e.name} of '{group}' agree in {channel} to the last digit: one is a copy, "
                    f"or has too few digits to show the noise; {channel} is not used in {e.name}."
                )
    return copies


def find_moving_trials(experiments: Sequence[Experiment]) -> list[str]:
    """Return the names of the trials in which the length changes enough to show effects of motion."""
    return [e.name for e in experiments if (e.length_range or 0.0) >= MIN_LENGTH_RANGE]


def find_limitations(experiments: Sequence[Experiment], others: Sequence[Experiment] = ()) -> list[str]:
    """Return sentences about effects that ``experiments``, which are fitted, cannot show beside the ``others``."""
    pressure_range, length_range = _compute_pressure_range(experiments), _compute_length_range(experiments)
    limitations = []
    if is_supply_only(experiments):
        limitations.append(
            "Only the pressure was measured: the supply is judged; muscle, damper and tendon are not. Record the force "
            "to judge them."
        )
    if length_range is not None and length_range < MIN_LENGTH_RANGE:
        limitations.append(
            f"The length changes by at most {1e3 * length_range:.2f} mm within a fitted trial: effects that depend on "
            f"speed are hardly visible.{_describe_moving_trials(others)}"
        )
    if pressure_range < MIN_PRESSURE_RANGE and any(e.device.spec.supply is not None for e in experiments):
        limitations.append(
            f"The pressure changes by at most {pressure_range / BAR:.2f} bar within a fitted trial: effects of the "
            "supply are hardly visible."
        )
    if not has_repeats(experiments):
        limitations.append(
            "No trial is repeated, so noise and misfit cannot be separated: only large effects can be identified, and "
            "remaining misfit cannot be detected. Record every input at least twice and give the repeats the same "
            "group."
        )
    return limitations


def _describe_moving_trials(experiments: Sequence[Experiment]) -> str:
    names = [repr(name) for name in find_moving_trials(experiments)]
    if not names:
        return ""
    listed = ", ".join(names[:MAX_LISTED_TRIALS]) + (", ..." if len(names) > MAX_LISTED_TRIALS else "")
    return f" Not fitted, but moving: {listed}. Set use = 'fit' for some of them."


def find_faulty_channels(experiments: Sequence[Experiment]) -> tuple[dict[str, str], list[str]]:
    """Return channel -> reason for dead channels, and remarks on saturated ones."""
    dead, remarks = {}, []
    for channel in list_channels(experiments):
        samples = np.concatenate([e.measured[channel].value for e in experiments if channel in e.measured])
        unit, si = CHANNEL_UNITS[channel]
        if np.ptp(samples) <= MIN_RELATIVE_RANGE * max(1.0, float(np.abs(samples).max())):
            dead[channel] = f"'{channel}' is constant at {samples[0] / si:g} {unit}: the channel is dead"
            continue
        if any(channel in e.limits for e in experiments):  # such samples are compared with the limit
            continue
        for value in _find_saturation_values(samples):
            count = int((samples == value).sum())
            remarks.append(
                f"'{channel}' equals {value / si:g} {unit} in {count} of {len(samples)} samples: it may be saturated, "
                "and those samples are not compared"
            )
    return dead, remarks


def _find_saturation_values(samples: Array) -> list[float]:
    """Return the highest or the lowest of ``samples`` where the channel is saturated.

    A vented or slack sensor reads 0 by right. Where the highest and the lowest value, neither of them 0, are both far
    more frequent than any other, the channel rests at two levels, whose digits are coarse.
    """
    values, counts = np.unique(samples, return_counts=True)
    other_counts = counts[1:-1][values[1:-1] != 0.0]
    min_count = max(MIN_SATURATED_SAMPLES, SATURATION_COUNT_RATIO * int(other_counts.max(initial=0)))
    frequent = [float(values[k]) for k in (-1, 0) if values[k] != 0.0 and counts[k] >= min_count]
    return frequent if len(frequent) < 2 else []


def remove_channels(experiments: Sequence[Experiment], excluded: Container[tuple[str, str]]) -> list[Experiment]:
    """Return ``experiments`` without the ``excluded`` channels, each given as (trial, channel)."""
    return [
        replace(e, measured={c: series for c, series in e.measured.items() if (e.name, c) not in excluded})
        for e in experiments
    ]


def pair_trials_with_channels(experiments: Sequence[Experiment], channels: Iterable[str]) -> set[tuple[str, str]]:
    """Return (trial, channel) for each of ``experiments`` and ``channels``."""
    return {(e.name, channel) for e in experiments for channel in channels}


def remove_saturated_samples(
    experiments: Sequence[Experiment], fit_experiments: Sequence[Experiment]
) -> list[Experiment]:
    """Return ``experiments`` without the samples at which a channel of ``fit_experiments`` is saturated.

    A channel with fewer than :data:`~klute_sim.datasets.trial.MIN_SAMPLES` remaining samples is removed from its trial.
    """
    saturation_values: dict[str, list[float]] = {}
    for channel in list_channels(fit_experiments):
        samples = np.concatenate([e.measured[channel].value for e in fit_experiments if channel in e.measured])
        has_limits = any(channel in e.limits for e in fit_experiments)
        saturation_values[channel] = [] if has_limits else _find_saturation_values(samples)
    unsaturated = []
    for e in experiments:
        measured = {}
        for channel, series in e.measured.items():
            is_valid = ~np.isin(series.value, saturation_values.get(channel, []))
            if is_valid.sum() >= MIN_SAMPLES:
                measured[channel] = type(series)(series.time[is_valid], series.value[is_valid])
        unsaturated.append(replace(e, measured=measured))
    return unsaturated
