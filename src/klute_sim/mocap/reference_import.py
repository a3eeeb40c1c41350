"""Import of a gait reference: the mean stride with standard deviations, per body mass, from one or more trials."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.errors import InputError
from klute_sim.gait import reference
from klute_sim.mocap.checks import estimate_stature, find_mass_findings
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics.leg import LEG_UNITS, Leg
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import sources
from klute_sim.mocap.parsing.channel_names import EVENT_LABELS, SIDES, Side
from klute_sim.mocap.parsing.checks import find_source_findings
from klute_sim.mocap.parsing.missing_columns import describe_unused_columns
from klute_sim.mocap.parsing.single_stride import unroll_single_strides
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.mocap.strides.listed_events import use_listed_events
from klute_sim.mocap.strides.strides import PHASE_GRID, Stride, segment_strides, select_regular_strides
from klute_sim.mocap.trial import extract_legs
from klute_sim.types import Array, ProgressCallback

MIN_STRIDES_FOR_SD = 3
"""Smallest number of strides for standard deviations."""
MAX_MASS_DEVIATION = 0.02
"""Largest relative difference between the given mass and that from the impulse that is not reported."""
MAX_EVENT_DEVIATION = 0.03
"""Largest median difference [s] between listed and detected events that is not reported."""
EVENT_TOLERANCE, IMPULSE_TOLERANCE = 5e-3, 0.01
"""Largest differences of event times [s] and, relatively, of impulses between two versions of one trial (assumed)."""
PEAK_MOMENT_RANGE = (0.6, 2.2)
"""Plausible peak ankle moments of walking [N.m/kg]; published means range from 1.32 to 1.63."""

REFERENCE_COLUMNS = {
    "hip_flexion_deg": "hip_angle",
    "knee_flexion_deg": "knee_angle",
    "ankle_dorsiflexion_deg": "ankle_angle",
    "shank_forward_deg": "shank_angle",
    "ankle_plantarflexor_moment_nm_per_kg": "ankle_moment",
    "ankle_power_w_per_kg": "ankle_power",
    "grf_vertical_n_per_kg": "grf_vertical",
    "grf_forward_n_per_kg": "grf_forward",
}
"""Column of a reference -> channel of a leg."""
SD_COLUMNS = {
    "ankle_dorsiflexion_sd_deg": "ankle_angle",
    "ankle_moment_sd_nm_per_kg": "ankle_moment",
    "ankle_power_sd_w_per_kg": "ankle_power",
}
"""Standard deviation column of a reference -> channel of a leg."""


@dataclass(frozen=True, eq=False)
class ImportedReference:
    """Gait reference and the strides it is the mean of."""

    log: ImportLog
    """Log of the import."""
    options: ImportOptions
    """Options of the import."""
    strides: dict[Side, list[Stride]]
    """Regular strides of each leg."""
    side: Side
    """Leg of the reference."""
    mass: float
    """Body mass [kg], given or estimated from the impulse."""
    impulse_mass: float | None
    """Body mass estimated from the impulse of the ground reaction [kg]."""
    walking_speed: float | None
    """Walking speed [m/s], if known."""
    table: dict[str, Array]
    """Columns of the reference, including ``gait_pct``."""

    @property
    def stride_time(self) -> float:
        """Mean stride time of the reference leg [s]."""
        return float(np.mean([stride.duration for stride in self.strides[self.side]]))

    @property
    def toe_off(self) -> float:
        """Mean gait phase of toe-off of the reference leg [%]."""
        return 100.0 * float(np.mean([stride.toe_off for stride in self.strides[self.side]]))

    def to_csv(self) -> str:
        """Return the reference as text that ``klute-sim gait --reference`` reads."""
        rows = [",".join(self.table)]
        rows += [",".join(f"{value:.7g}" for value in row) for row in zip(*self.table.values(), strict=True)]
        return "\n".join(rows) + "\n"


def import_reference(
    files: Sequence[str | Path], options: ImportOptions, progress: ProgressCallback | None = None
) -> ImportedReference:
    """Import the trials in ``files`` as a gait reference.

    Raises InputError for files that are invalid, contradictory or without a complete stride.
    """
    log = ImportLog()
    source_files = read_files(files, options, log, progress, last_fraction=0.6)
    source_files = unroll_single_strides(source_files, options.stride_time, log)
    if all(source.is_single_stride for source in source_files):
        options = replace(options, motion_cutoff=0.0, load_cutoff=0.0)
    legs: list[tuple[Leg, list[Stride]]] = []
    trials = sources.group_into_trials(source_files, options.mapping)
    for number, trial in enumerate(trials):
        for leg in extract_legs(trial, options, log):
            duplicate = next((other for other, _ in legs if _is_same_trial(leg, other)), None)
            if duplicate is None:
                legs.append((leg, _segment_leg(leg, trial, options, log)))
            else:
                log.add_warning(
                    f"{leg.trial}: contacts and impulses of the {leg.side} foot equal those of {duplicate.trial}: the "
                    "same trial in another form; its strides were excluded, so that they do not count twice"
                )
        _compare_events(trial, [leg for leg, _ in legs], log)
        if progress is not None:
            progress(0.6 + 0.4 * (number + 1) / len(trials), "segmenting strides")
    return _build_reference(legs, source_files, options, log)


def _segment_leg(leg: Leg, trial: Sequence[SourceFile], options: ImportOptions, log: ImportLog) -> list[Stride]:
    """Return the strides of ``leg``; of a file with one stride, which is repeated in ``leg``, only one."""
    if any(source.is_single_stride for source in trial):
        return segment_strides(use_listed_events(leg, trial, ImportLog()), log)[:1]
    return segment_strides(use_listed_events(leg, trial, log) if options.use_listed_events else leg, log)


def _is_same_trial(leg: Leg, other: Leg) -> bool:
    """Return whether two legs have the same contacts and impulses."""
    events, other_events = (
        [(c.foot_strike, c.toe_off) for c in one.contacts if c.has_foot_strike and c.has_toe_off]
        for one in (leg, other)
    )
    if leg.side != other.side or not events or len(events) != len(other_events):
        return False
    if len(leg.impulses) != len(other.impulses):
        return False
    max_difference = np.abs(np.subtract(events, other_events)).max()
    return bool(max_difference < EVENT_TOLERANCE and np.allclose(leg.impulses, other.impulses, rtol=IMPULSE_TOLERANCE))


def read_files(
    files: Sequence[str | Path],
    options: ImportOptions,
    log: ImportLog,
    progress: ProgressCallback | None = None,
    last_fraction: float = 1.0,
) -> list[SourceFile]:
    """Read and log all ``files``; ``progress`` ends at ``last_fraction``.

    Raises InputError for unreadable files and duplicates.
    """
    paths, clock_offsets = [Path(file) for file in files], options.mapping.clock_offsets
    n_same_name = Counter(path.name for path in paths)
    folders = [path.absolute().parent.name if n_same_name[path.name] > 1 else "" for path in paths]
    names = [(Path(folder) / path.name).as_posix() for folder, path in zip(folders, paths, strict=True)]
    unknown = set(clock_offsets) - set(names)
    if unknown:
        raise InputError(f"[clock] names '{min(unknown)}', which is not an input file; allowed: {', '.join(names)}")
    source_files: list[SourceFile] = []
    for number, (file, name, folder) in enumerate(zip(files, names, folders, strict=True)):
        recordings = sources.read(file, clock_offsets.get(name, 0.0), options.frame_rate)
        if len(recordings) > 1 and len(files) > 1:
            raise InputError(
                f"{file} contains {len(recordings)} recordings, so their other files are unknown: pass it alone, or "
                "export each recording into a file of its own"
            )
        duplicate = next((other for other in source_files if other.digest == recordings[0].digest), None)
        if duplicate is not None:
            raise InputError(f"{file} is identical to {duplicate.path}; its strides would count twice")
        for recording in recordings:
            source = replace(recording, folder=folder)
            source_files.append(source)
            log.require_accepted(find_source_findings(source), options.accept)
            log.files.append(source.describe())
        if progress is not None:
            progress(last_fraction * (number + 1) / len(files), "reading files")
    _log_frame_rate(source_files, options.frame_rate, log)
    return source_files


def _log_frame_rate(source_files: Sequence[SourceFile], frame_rate: float | None, log: ImportLog) -> None:
    for source in source_files:
        if source.frame_rate is not None:
            log.add_derived(f"{source.name}: times from the frame numbers at {source.frame_rate:g} Hz, as specified")
    if frame_rate is not None and not any(source.frame_rate for source in source_files):
        raise InputError("a frame rate is for Visual3D exports without times; these files have times")


def _build_reference(
    legs: Sequence[tuple[Leg, list[Stride]]],
    source_files: Sequence[SourceFile],
    options: ImportOptions,
    log: ImportLog,
) -> ImportedReference:
    strides_by_side: dict[Side, list[Stride]] = {}
    for side in SIDES:
        complete = [
            stride
            for leg, leg_strides in legs
            if leg.side == side and not leg.missing_channels
            for stride in leg_strides
        ]
        regular = select_regular_strides(complete, side, log)
        if regular:
            strides_by_side[side] = regular
    n_left, n_right = len(strides_by_side.get("left", ())), len(strides_by_side.get("right", ()))
    reference_side = options.side or ("left" if n_left > n_right else "right")
    if reference_side not in strides_by_side:
        unused = describe_unused_columns(source_files, options.mapping)
        raise InputError(_explain_missing_strides(reference_side, strides_by_side, unused, options, log))
    strides = strides_by_side[reference_side]
    if len(strides_by_side) == 2 and options.side is None:
        log.add_derived(f"Side: {reference_side}, which has {len(strides)} strides (--side)")
    impulse_mass = _estimate_body_mass(legs, strides_by_side, options, log)
    speeds = [
        speed
        for leg, leg_strides in legs
        if leg.side == reference_side and (speed := _select_walking_speed(leg, leg_strides)) is not None
    ]
    walking_speed = float(np.mean(speeds)) if speeds else None
    if impulse_mass is not None:
        stature = options.stature or estimate_stature(strides, walking_speed)
        log.require_accepted(find_mass_findings(impulse_mass, options.mass, stature), options.accept)
    mass = options.mass or impulse_mass
    if mass is None:
        raise InputError("cannot estimate body mass (no complete stance of both feet); pass --mass")
    table = _build_table(strides, mass, log)
    peak_moment = float(table["ankle_plantarflexor_moment_nm_per_kg"].max())
    if not PEAK_MOMENT_RANGE[0] <= peak_moment <= PEAK_MOMENT_RANGE[1]:
        log.add_warning(f"The peak ankle moment is {peak_moment:.2f} N·m/kg; in walking it is near 1.4")
    if walking_speed is None:
        log.add_missing("Walking speed: neither a belt speed nor the motion of pelvis or markers shows it")
    if options.stature is None:
        log.add_missing("Stature: not given (--stature); klute-sim gait uses 1.75 m by default")
    imported = ImportedReference(
        log, options, strides_by_side, reference_side, mass, impulse_mass, walking_speed, table
    )
    parsed = reference.parse_reference(
        imported.to_csv(), "computed from these files", imported.stride_time, options.accept
    )
    log.require_accepted(parsed.accepted, options.accept)
    return imported


def _explain_missing_strides(
    requested_side: Side,
    strides_by_side: Mapping[Side, Sequence[Stride]],
    unused: str,
    options: ImportOptions,
    log: ImportLog,
) -> str:
    """Return why the leg of ``requested_side`` has no stride, and whether the other leg has strides.

    If data are missing, the sentence ends with the ``unused`` columns.
    """
    other_side: Side = "right" if requested_side == "left" else "left"
    sides = (requested_side,) if options.side else SIDES
    reasons = [sentence for sentence in log.missing if len(sides) == 2 or f" {other_side} " not in sentence]
    unused_columns = f"; {unused}" if reasons and unused else ""
    reasons += [sentence for side in sides for sentence in log.exclusions.get(side, [])]
    reasons = reasons or ["no foot has two consecutive heel strikes"]
    leg = f" of the {requested_side} leg" if options.side else ""
    n_other = len(strides_by_side.get(other_side, ()))
    plural = "" if n_other == 1 else "s"
    advice = f"; the {other_side} leg has {n_other} stride{plural}: pass --side {other_side}" if n_other else ""
    return f"these files contain no complete stride{leg}: {'; '.join(reasons[:3])}{unused_columns}{advice}"


def _select_walking_speed(leg: Leg, leg_strides: Sequence[Stride]) -> float | None:
    """Return the mean belt speed during ``leg_strides`` [m/s], else the walking speed of ``leg``."""
    if leg.belt_speed is not None and leg_strides:
        inside = (leg.time >= leg_strides[0].start) & (leg.time <= leg_strides[-1].end)
        return float(np.mean(leg.belt_speed[inside]))
    return leg.walking_speed


def _build_table(leg_strides: Sequence[Stride], body_mass: float, log: ImportLog) -> dict[str, Array]:
    samples = {name: np.stack([stride.channels[name] for stride in leg_strides]) for name in LEG_UNITS}
    divisors = {name: 1.0 if LEG_UNITS[name] == "deg" else body_mass for name in LEG_UNITS}
    table = {reference.PHASE_COLUMN: 100.0 * PHASE_GRID}
    for column, name in REFERENCE_COLUMNS.items():
        table[column] = samples[name].mean(axis=0) / divisors[name]
    n_strides = len(leg_strides)
    if n_strides >= MIN_STRIDES_FOR_SD:
        for column, name in SD_COLUMNS.items():
            sd = samples[name].std(axis=0, ddof=1) / divisors[name]
            # Start and end are the same heel strikes except for two, so they get one value.
            sd[0] = sd[-1] = 0.5 * (sd[0] + sd[-1])
            table[column] = sd
        log.add_derived(f"Standard deviations: between the {n_strides} strides")
    else:
        log.add_missing(
            f"Standard deviations: {n_strides} {'stride' if n_strides == 1 else 'strides'} of the leg; "
            f"{MIN_STRIDES_FOR_SD} or more are needed"
        )
    return table


def _estimate_body_mass(
    legs: Sequence[tuple[Leg, list[Stride]]],
    strides_by_side: dict[Side, list[Stride]],
    options: ImportOptions,
    log: ImportLog,
) -> float | None:
    """Return the body mass [kg] whose weight balances the impulse of both feet over a stride; None without impulses."""
    stride_time = float(np.mean([stride.duration for strides in strides_by_side.values() for stride in strides]))
    mean_impulses = {}
    for side in SIDES:
        impulses = [impulse for leg, _ in legs if leg.side == side for impulse in leg.impulses]
        if impulses:
            mean_impulses[side] = float(np.median(impulses))
    if not mean_impulses:
        return None
    is_single_foot = len(mean_impulses) == 1
    mass = (2.0 if is_single_foot else 1.0) * sum(mean_impulses.values()) / (stride_time * GRAVITY)
    feet = "twice that of the one measured foot" if is_single_foot else "both feet"
    if options.mass is None:
        log.add_derived(
            f"Body mass: {mass:.1f} kg, from the impulse of the ground reaction ({feet}); --mass was not given"
        )
    elif abs(mass - options.mass) > MAX_MASS_DEVIATION * options.mass:
        log.add_warning(
            f"The given mass, {options.mass:g} kg, contradicts the impulse of the ground reaction, which supports "
            f"{mass:.1f} kg ({feet}; {100 * (mass / options.mass - 1):+.1f} %): weigh the person, or leave out --mass "
            "to use that of the plates; the given mass was used for values per kg"
        )
    else:
        log.add_derived(f"Mass check: the impulse of the ground reaction supports {mass:.1f} kg ({feet})")
    return mass


def _compare_events(trial_files: Sequence[SourceFile], legs: Sequence[Leg], log: ImportLog) -> None:
    """Compare the events that a file of the trial lists with the detected ones, and log the difference."""
    trial_name = trial_files[0].name
    for source in trial_files:
        for label in source.labels:
            event = label.strip().lower()
            if event not in EVENT_LABELS or source.detect_roles() != {"events"}:
                continue
            side = "left" if event[0] == "l" else "right"
            listed_times = source.get_column(label)
            listed_times = listed_times[np.isfinite(listed_times)]
            detected_times = [
                (c.foot_strike if event.endswith("hs") else c.toe_off)
                for leg in legs
                if leg.side == side and leg.trial == trial_name
                for c in leg.contacts
            ]
            if not len(listed_times) or not detected_times:
                continue
            differences = np.subtract.outer(np.array(detected_times), listed_times)
            nearest = differences[np.abs(differences).argmin(axis=0), np.arange(len(listed_times))]
            median = float(np.median(nearest))
            sentence = (
                f"{source.name}: '{label}' lists {len(listed_times)} events, {1e3 * abs(median):.0f} ms "
                f"{'before' if median > 0 else 'after'} the detected ones"
            )
            if abs(median) > MAX_EVENT_DEVIATION:
                log.add_warning(f"{sentence}; the detected events were used")
            else:
                log.add_derived(f"Event check: {sentence}")
