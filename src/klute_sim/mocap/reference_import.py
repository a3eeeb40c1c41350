"""From files to a reference: trials, strides of both legs, body mass, the mean stride with its deviations."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from klute_sim.errors import InputError
from klute_sim.gait import reference
from klute_sim.gait.reference import GRAVITY
from klute_sim.mocap import trial
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import sources
from klute_sim.mocap.parsing.channel_names import EVENT_LABELS, SIDES, Side
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.mocap.strides import strides
from klute_sim.mocap.strides.leg import LEG_UNITS, LegChannels
from klute_sim.mocap.strides.strides import PHASE_GRID, Stride
from klute_sim.recording.recording import Array

MIN_STRIDES_FOR_SD = 3
MAX_MASS_DEVIATION = 0.02
"""Difference between the mass listed and that of the impulse from which it is told."""
MAX_EVENT_DEVIATION = 0.03
"""Median difference [s] between the events listed and those found from which it is told."""
EVENT_TOLERANCE, IMPULSE_TOLERANCE = 5e-3, 0.01
"""Times [s] and, relatively, impulses of all contacts up to which two trials are one walk in two forms (assumed)."""
PEAK_MOMENT_RANGE = (0.6, 2.2)
"""Peak ankle moment [N.m/kg] of walking; the sources' means run from 1.32 to 1.63."""

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


@dataclass(frozen=True, eq=False)
class ImportedReference:
    """What came of the files."""

    log: ImportLog
    options: ImportOptions
    strides: dict[Side, list[Stride]]
    side: Side
    """The leg the reference is of."""
    mass: float
    """[kg], as given or by the impulse."""
    impulse_mass: float | None
    walking_speed: float | None
    """[m/s]"""
    table: dict[str, Array]
    """Columns of the reference, with ``gait_pct``."""

    @property
    def stride_time(self) -> float:
        """Mean over the strides of the reference [s]."""
        return float(np.mean([stride.duration for stride in self.strides[self.side]]))

    @property
    def toe_off(self) -> float:
        """Mean over the strides of the reference [%]."""
        return 100.0 * float(np.mean([stride.toe_off for stride in self.strides[self.side]]))

    def to_csv(self) -> str:
        """The reference, as ``klute-sim gait --reference`` reads it."""
        rows = [",".join(self.table)]
        rows += [",".join(f"{value:.7g}" for value in row) for row in zip(*self.table.values(), strict=True)]
        return "\n".join(rows) + "\n"


def import_reference(
    files: Sequence[str | Path], options: ImportOptions, progress: Callable[[float], None] = lambda fraction: None
) -> ImportedReference:
    """Import ``files``; raises InputError in one sentence for what is wrong, missing or makes no reference."""
    findings = ImportLog()
    read = read_files(files, options, findings, lambda fraction: progress(0.6 * fraction))
    legs: list[tuple[LegChannels, list[Stride]]] = []
    groups = sources.group_into_trials(read, options.mapping)
    for number, group in enumerate(groups):
        for leg in trial.extract_legs(group, options, findings):
            twin = next((other for other, _ in legs if _is_same_trial(leg, other)), None)
            if twin is None:
                legs.append((leg, strides.segment_strides(leg, findings)))
            else:
                findings.add_warning(
                    f"{leg.trial}: the {leg.side} foot lands when it does in {twin.trial}, with the same impulse: the "
                    "same walk in another form; its strides were left out, so as not to count twice"
                )
        _compare_events(group, [leg for leg, _ in legs], findings)
        progress(0.6 + 0.4 * (number + 1) / len(groups))
    return _build_reference(legs, options, findings)


def _is_same_trial(leg: LegChannels, other: LegChannels) -> bool:
    """Whether two trials tell of the same contacts of one foot."""
    there = [(c.foot_strike, c.toe_off) for c in other.contacts if c.has_foot_strike and c.has_toe_off]
    here = [(c.foot_strike, c.toe_off) for c in leg.contacts if c.has_foot_strike and c.has_toe_off]
    if leg.side != other.side or not here or len(here) != len(there) or len(leg.impulses) != len(other.impulses):
        return False
    apart = np.abs(np.subtract(here, there)).max()
    return bool(apart < EVENT_TOLERANCE and np.allclose(leg.impulses, other.impulses, rtol=IMPULSE_TOLERANCE))


def read_files(
    files: Sequence[str | Path], options: ImportOptions, log: ImportLog, progress: Callable[[float], None]
) -> list[SourceFile]:
    """All ``files``, which are noted; raises InputError for one that cannot be read or is there twice."""
    paths, clock, read = [Path(file) for file in files], options.mapping.clock_offsets, list[SourceFile]()
    called = Counter(path.name for path in paths)
    folders = [path.absolute().parent.name if called[path.name] > 1 else "" for path in paths]
    known = [(Path(folder) / path.name).as_posix() for folder, path in zip(folders, paths, strict=True)]
    unknown = set(clock) - set(known)
    if unknown:
        raise InputError(f"[clock] names '{min(unknown)}', which is none of the files; there are {', '.join(known)}")
    for number, (file, name, folder) in enumerate(zip(files, known, folders, strict=True)):
        read.append(replace(sources.read(file, clock.get(name, 0.0)), folder=folder))
        twin = next((source for source in read[:-1] if source.digest == read[-1].digest), None)
        if twin is not None:
            raise InputError(f"{file} is the same as {twin.path}; its strides would count twice")
        log.files.append(read[-1].describe())
        progress((number + 1) / len(files))
    return read


def _build_reference(
    legs: Sequence[tuple[LegChannels, list[Stride]]], options: ImportOptions, log: ImportLog
) -> ImportedReference:
    found: dict[Side, list[Stride]] = {}
    for side in SIDES:
        whole = [stride for leg, of in legs if leg.side == side and not leg.missing_channels for stride in of]
        kept = strides.select_regular_strides(whole, side, log)
        if kept:
            found[side] = kept
    wanted = options.side or ("left" if len(found.get("left", ())) > len(found.get("right", ())) else "right")
    if wanted not in found:
        raise InputError(_explain_missing_strides(wanted, found, options, log))
    if len(found) == 2 and options.side is None:
        log.add_derived(f"Side: {wanted}, which has {len(found[wanted])} strides (--side)")
    by_impulse = _estimate_body_mass(legs, found, options, log)
    mass = options.mass or by_impulse
    if mass is None:
        raise InputError("no whole stance of both feet tells the body's mass: give it as --mass")
    speeds = [speed for leg, of in legs if leg.side == wanted and (speed := _select_walking_speed(leg, of)) is not None]
    table = _build_table(found[wanted], mass, log)
    peak = float(table["ankle_plantarflexor_moment_nm_per_kg"].max())
    if not PEAK_MOMENT_RANGE[0] <= peak <= PEAK_MOMENT_RANGE[1]:
        log.add_warning(f"The ankle's peak moment is {peak:.2f} N·m/kg; in walking it is near 1.4")
    speed = float(np.mean(speeds)) if speeds else None
    if speed is None:
        log.add_missing("Walking speed: neither a belt's speed nor the way of pelvis or markers tells it")
    if options.stature is None:
        log.add_missing("Stature: not given (--stature); klute-sim gait takes 1.75 m unless it is told")
    imported = ImportedReference(log, options, found, wanted, mass, by_impulse, speed, table)
    reference.parse_reference(imported.to_csv(), "made of these files", imported.stride_time)
    return imported


def _explain_missing_strides(
    requested_side: Side, strides_by_side: Mapping[Side, Sequence[Stride]], options: ImportOptions, log: ImportLog
) -> str:
    """Why there is no stride of ``wanted``, and whether the other leg would do."""
    other: Side = "right" if requested_side == "left" else "left"
    sides = (requested_side,) if options.side else SIDES
    reasons = [said for said in log.missing if len(sides) == 2 or f" {other} " not in said]
    reasons += [said for side in sides for said in log.exclusions.get(side, [])]
    reasons = reasons or ["no foot was seen from heel strike to heel strike"]
    told = f" of the {requested_side} leg" if options.side else ""
    many = len(strides_by_side.get(other, ()))
    way_out = f"; the {other} leg has {'one' if many == 1 else many}: --side {other}" if many else ""
    return f"no whole stride{told} can be had from these files: {'; '.join(reasons[:3])}{way_out}"


def _select_walking_speed(leg: LegChannels, leg_strides: Sequence[Stride]) -> float | None:
    if leg.belt_speed is not None and leg_strides:
        inside = (leg.time >= leg_strides[0].start) & (leg.time <= leg_strides[-1].end)
        return float(np.mean(leg.belt_speed[inside]))
    return leg.walking_speed


def _build_table(leg_strides: Sequence[Stride], body_mass: float, log: ImportLog) -> dict[str, Array]:
    every = {name: np.stack([stride.channels[name] for stride in leg_strides]) for name in LEG_UNITS}
    per = {name: 1.0 if LEG_UNITS[name] == "deg" else body_mass for name in LEG_UNITS}
    table = {reference.PHASE_COLUMN: 100.0 * PHASE_GRID}
    for column, name in REFERENCE_COLUMNS.items():
        table[column] = every[name].mean(axis=0) / per[name]
    if len(leg_strides) >= MIN_STRIDES_FOR_SD:
        for column, name in SD_COLUMNS.items():
            spread = every[name].std(axis=0, ddof=1) / per[name]
            spread[0] = spread[-1] = 0.5 * (spread[0] + spread[-1])  # the same heel strikes but for two: one number
            table[column] = spread
        log.add_derived(f"Standard deviations: between the {len(leg_strides)} strides")
    else:
        log.add_missing(
            f"Standard deviations: {len(leg_strides)} {'stride' if len(leg_strides) == 1 else 'strides'} of the leg; "
            f"{MIN_STRIDES_FOR_SD} or more are needed"
        )
    return table


def _estimate_body_mass(
    legs: Sequence[tuple[LegChannels, list[Stride]]],
    strides_by_side: dict[Side, list[Stride]],
    options: ImportOptions,
    log: ImportLog,
) -> float | None:
    """Body mass [kg] by which gravity, over a stride, undoes the impulse of the ground on both feet."""
    stride_time = float(np.mean([stride.duration for of in strides_by_side.values() for stride in of]))
    means = {}
    for side in SIDES:
        impulses = [impulse for leg, _ in legs if leg.side == side for impulse in leg.impulses]
        if impulses:
            means[side] = float(np.median(impulses))
    if not means:
        return None
    one_foot = len(means) == 1
    mass = (2.0 if one_foot else 1.0) * sum(means.values()) / (stride_time * GRAVITY)
    how = "twice that of the one foot measured" if one_foot else "both feet"
    if options.mass is None:
        log.add_derived(
            f"Body mass: {mass:.1f} kg, from the impulse of the ground reaction ({how}); --mass was not given"
        )
    elif abs(mass - options.mass) > MAX_MASS_DEVIATION * options.mass:
        log.add_warning(
            f"The mass given, {options.mass:g} kg, contradicts the impulse of the ground reaction, which carries "
            f"{mass:.1f} kg ({how}; {100 * (mass / options.mass - 1):+.1f} %): the mass or the plates are wrong; "
            "per kg, the mass given was used"
        )
    else:
        log.add_derived(f"Check of the mass: the impulse of the ground reaction carries {mass:.1f} kg ({how})")
    return mass


def _compare_events(trial_files: Sequence[SourceFile], legs: Sequence[LegChannels], log: ImportLog) -> None:
    """Events listed in a file beside those found."""
    where = trial_files[0].name
    for source in trial_files:
        for label in source.labels:
            if label.strip().lower() not in EVENT_LABELS or source.roles() != {"events"}:
                continue
            side = "left" if label.strip().lower()[0] == "l" else "right"
            listed = source.get_column(label)
            listed = listed[np.isfinite(listed)]
            seen = [
                (c.foot_strike if label.strip().lower().endswith("hs") else c.toe_off)
                for leg in legs
                if leg.side == side and leg.trial == where
                for c in leg.contacts
            ]
            if not len(listed) or not seen:
                continue
            apart = np.subtract.outer(np.array(seen), listed)
            off = apart[np.abs(apart).argmin(axis=0), np.arange(len(listed))]
            typical = float(np.median(off))
            what = f"{source.name}: '{label}'"
            sentence = f"{what} lists {len(listed)} events, {1e3 * abs(typical):.0f} ms {_format_order(typical)} those found here"
            if abs(typical) > MAX_EVENT_DEVIATION:
                log.add_warning(f"{sentence}; those found here were used")
            else:
                log.add_derived(f"Check of the events: {sentence}")


def _format_order(offset: float) -> str:
    return "before" if offset > 0 else "after"
