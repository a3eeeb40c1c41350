"""From files to a reference: trials, strides of both legs, body mass, the mean stride with its deviations."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from klute_sim.errors import InputError
from klute_sim.motion import sources, strides, trial
from klute_sim.motion.findings import Findings
from klute_sim.motion.limb import UNITS, Limb
from klute_sim.motion.names import EVENTS, SIDES, Side
from klute_sim.motion.options import ImportOptions
from klute_sim.motion.sources import Source
from klute_sim.motion.strides import PHASE, Stride
from klute_sim.recording.recording import Samples
from klute_sim.rigs.gait import reference
from klute_sim.rigs.gait.reference import GRAVITY

FEWEST_FOR_DEVIATION = 3
MASS_DOUBT = 0.02
"""Difference between the mass listed and that of the impulse from which it is told."""
EVENT_DOUBT = 0.03
"""Median difference [s] between the events listed and those found from which it is told."""
SAME_EVENT, SAME_IMPULSE = 5e-3, 0.01
"""Times [s] and, relatively, impulses of all contacts up to which two trials are one walk in two forms (assumed)."""
PEAK_MOMENT = (0.6, 2.2)
"""Peak ankle moment [N.m/kg] of walking; the sources' means run from 1.32 to 1.63."""

COLUMNS = {
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
DEVIATIONS = {
    "ankle_dorsiflexion_sd_deg": "ankle_angle",
    "ankle_moment_sd_nm_per_kg": "ankle_moment",
    "ankle_power_sd_w_per_kg": "ankle_power",
}


@dataclass(frozen=True, eq=False)
class Imported:
    """What came of the files."""

    findings: Findings
    options: ImportOptions
    strides: dict[Side, list[Stride]]
    side: Side
    """The leg the reference is of."""
    mass: float
    """[kg], as given or by the impulse."""
    mass_by_impulse: float | None
    speed: float | None
    """[m/s]"""
    table: dict[str, Samples]
    """Columns of the reference, with ``gait_pct``."""

    @property
    def stride_time(self) -> float:
        """Mean over the strides of the reference [s]."""
        return float(np.mean([stride.duration for stride in self.strides[self.side]]))

    @property
    def toe_off(self) -> float:
        """Mean over the strides of the reference [%]."""
        return 100.0 * float(np.mean([stride.toe_off for stride in self.strides[self.side]]))

    def csv(self) -> str:
        """The reference, as ``klute-sim gait --reference`` reads it."""
        rows = [",".join(self.table)]
        rows += [",".join(f"{value:.7g}" for value in row) for row in zip(*self.table.values(), strict=True)]
        return "\n".join(rows) + "\n"


def run(
    files: Sequence[str | Path], options: ImportOptions, progress: Callable[[float], None] = lambda fraction: None
) -> Imported:
    """Import ``files``; raises InputError in one sentence for what is wrong, missing or makes no reference."""
    findings = Findings()
    read = read_all(files, options, findings, lambda fraction: progress(0.6 * fraction))
    legs: list[tuple[Limb, list[Stride]]] = []
    groups = sources.trials(read, options.chosen)
    for number, group in enumerate(groups):
        for leg in trial.legs(group, options, findings):
            twin = next((other for other, _ in legs if _same_walk(leg, other)), None)
            if twin is None:
                legs.append((leg, strides.segment(leg, findings)))
            else:
                findings.suspect(
                    f"{leg.trial}: the {leg.side} foot lands when it does in {twin.trial}, with the same impulse: the "
                    "same walk in another form; its strides were left out, so as not to count twice"
                )
        _compare_events(group, [leg for leg, _ in legs], findings)
        progress(0.6 + 0.4 * (number + 1) / len(groups))
    return _reference(legs, options, findings)


def _same_walk(one: Limb, other: Limb) -> bool:
    """Whether two trials tell of the same contacts of one foot."""
    there = [(c.strike, c.lift) for c in other.contacts if c.begun and c.ended]
    here = [(c.strike, c.lift) for c in one.contacts if c.begun and c.ended]
    if one.side != other.side or not here or len(here) != len(there) or len(one.impulses) != len(other.impulses):
        return False
    apart = np.abs(np.subtract(here, there)).max()
    return bool(apart < SAME_EVENT and np.allclose(one.impulses, other.impulses, rtol=SAME_IMPULSE))


def read_all(
    files: Sequence[str | Path], options: ImportOptions, findings: Findings, progress: Callable[[float], None]
) -> list[Source]:
    """All ``files``, which are noted; raises InputError for one that cannot be read or is there twice."""
    paths, clock, read = [Path(file) for file in files], options.chosen.clock, list[Source]()
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
            raise InputError(f"{file} is the same as {twin.where}; its strides would count twice")
        findings.found.append(read[-1].describe())
        progress((number + 1) / len(files))
    return read


def _reference(legs: Sequence[tuple[Limb, list[Stride]]], options: ImportOptions, findings: Findings) -> Imported:
    found: dict[Side, list[Stride]] = {}
    for side in SIDES:
        whole = [stride for leg, of in legs if leg.side == side and not leg.lacking for stride in of]
        kept = strides.usual(whole, side, findings)
        if kept:
            found[side] = kept
    wanted = options.side or ("left" if len(found.get("left", ())) > len(found.get("right", ())) else "right")
    if wanted not in found:
        raise InputError(_no_stride(wanted, found, options, findings))
    if len(found) == 2 and options.side is None:
        findings.derive(f"Side: {wanted}, which has {len(found[wanted])} strides (--side)")
    by_impulse = _mass(legs, found, options, findings)
    mass = options.mass or by_impulse
    if mass is None:
        raise InputError("no whole stance of both feet tells the body's mass: give it as --mass")
    speeds = [speed for leg, of in legs if leg.side == wanted and (speed := _speed(leg, of)) is not None]
    table = _table(found[wanted], mass, findings)
    peak = float(table["ankle_plantarflexor_moment_nm_per_kg"].max())
    if not PEAK_MOMENT[0] <= peak <= PEAK_MOMENT[1]:
        findings.suspect(f"The ankle's peak moment is {peak:.2f} N·m/kg; in walking it is near 1.4")
    speed = float(np.mean(speeds)) if speeds else None
    if speed is None:
        findings.miss("Walking speed: neither a belt's speed nor the way of pelvis or markers tells it")
    if options.stature is None:
        findings.miss("Stature: not given (--stature); klute-sim gait takes 1.75 m unless it is told")
    imported = Imported(findings, options, found, wanted, mass, by_impulse, speed, table)
    reference.parse(imported.csv(), "made of these files", imported.stride_time)
    return imported


def _no_stride(wanted: Side, found: Mapping[Side, Sequence[Stride]], options: ImportOptions, findings: Findings) -> str:
    """Why there is no stride of ``wanted``, and whether the other leg would do."""
    other: Side = "right" if wanted == "left" else "left"
    sides = (wanted,) if options.side else SIDES
    reasons = [said for said in findings.missing if len(sides) == 2 or f" {other} " not in said]
    reasons += [said for side in sides for said in findings.left_out.get(side, [])]
    reasons = reasons or ["no foot was seen from heel strike to heel strike"]
    told = f" of the {wanted} leg" if options.side else ""
    many = len(found.get(other, ()))
    way_out = f"; the {other} leg has {'one' if many == 1 else many}: --side {other}" if many else ""
    return f"no whole stride{told} can be had from these files: {'; '.join(reasons[:3])}{way_out}"


def _speed(leg: Limb, of: Sequence[Stride]) -> float | None:
    if leg.belt is not None and of:
        inside = (leg.time >= of[0].start) & (leg.time <= of[-1].end)
        return float(np.mean(leg.belt[inside]))
    return leg.speed


def _table(of: Sequence[Stride], mass: float, findings: Findings) -> dict[str, Samples]:
    every = {name: np.stack([stride.channels[name] for stride in of]) for name in UNITS}
    per = {name: 1.0 if UNITS[name] == "deg" else mass for name in UNITS}
    table = {reference.PHASE: 100.0 * PHASE}
    for column, name in COLUMNS.items():
        table[column] = every[name].mean(axis=0) / per[name]
    if len(of) >= FEWEST_FOR_DEVIATION:
        for column, name in DEVIATIONS.items():
            spread = every[name].std(axis=0, ddof=1) / per[name]
            spread[0] = spread[-1] = 0.5 * (spread[0] + spread[-1])  # the same heel strikes but for two: one number
            table[column] = spread
        findings.derive(f"Standard deviations: between the {len(of)} strides")
    else:
        findings.miss(
            f"Standard deviations: {len(of)} {'stride' if len(of) == 1 else 'strides'} of the leg; "
            f"{FEWEST_FOR_DEVIATION} or more are needed"
        )
    return table


def _mass(
    legs: Sequence[tuple[Limb, list[Stride]]],
    found: dict[Side, list[Stride]],
    options: ImportOptions,
    findings: Findings,
) -> float | None:
    """Body mass [kg] by which gravity, over a stride, undoes the impulse of the ground on both feet."""
    stride_time = float(np.mean([stride.duration for of in found.values() for stride in of]))
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
        findings.derive(
            f"Body mass: {mass:.1f} kg, from the impulse of the ground reaction ({how}); --mass was not given"
        )
    elif abs(mass - options.mass) > MASS_DOUBT * options.mass:
        findings.suspect(
            f"The mass given, {options.mass:g} kg, contradicts the impulse of the ground reaction, which carries "
            f"{mass:.1f} kg ({how}; {100 * (mass / options.mass - 1):+.1f} %): the mass or the plates are wrong; "
            "per kg, the mass given was used"
        )
    else:
        findings.derive(f"Check of the mass: the impulse of the ground reaction carries {mass:.1f} kg ({how})")
    return mass


def _compare_events(group: Sequence[Source], legs: Sequence[Limb], findings: Findings) -> None:
    """Events listed in a file beside those found."""
    where = group[0].name
    for source in group:
        for label in source.labels:
            if label.strip().lower() not in EVENTS or source.roles() != {"events"}:
                continue
            side = "left" if label.strip().lower()[0] == "l" else "right"
            listed = source.column(label)
            listed = listed[np.isfinite(listed)]
            seen = [
                (c.strike if label.strip().lower().endswith("hs") else c.lift)
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
            sentence = (
                f"{what} lists {len(listed)} events, {1e3 * abs(typical):.0f} ms {_order(typical)} those found here"
            )
            if abs(typical) > EVENT_DOUBT:
                findings.suspect(f"{sentence}; those found here were used")
            else:
                findings.derive(f"Check of the events: {sentence}")


def _order(off: float) -> str:
    return "before" if off > 0 else "after"
