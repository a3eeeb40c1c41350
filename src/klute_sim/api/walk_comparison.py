"""Compare two prostheses or controllers over several walkers: :func:`compare_walks` and its result."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.inputs import DeviceLike, ignore_progress
from klute_sim.api.rendering import Printable, Summary
from klute_sim.api.walk import build_prosthesis, simulate_walk
from klute_sim.errors import InputError
from klute_sim.recording.run_folder import create_run_folder
from klute_sim.types import ProgressCallback
from klute_sim.walker.mean_difference import (
    CONFIDENCE,
    MeanDifference,
    compute_group_difference,
    compute_paired_difference,
)
from klute_sim.walker.outcomes import WalkOutcomes
from klute_sim.walker.reflexes.walker_file import Walker, list_walkers, load_walker
from klute_sim.walker.simulation.simulate import describe_prosthesis

if TYPE_CHECKING:
    from rich.table import Table

SPRING_FOOT_KIND = "spring-foot"
"""Kind of a specification that names a passive foot, as in ``spring-foot:8``."""
OUTCOMES: dict[str, tuple[str, str, Callable[[WalkOutcomes], float | None]]] = {
    "cost_minetti_j_per_kg_m": ("metabolic cost (Minetti)", "J/kg/m", lambda o: o.cost_minetti_j_per_kg_m),
    "cost_bhargava_j_per_kg_m": ("metabolic cost (Bhargava)", "J/kg/m", lambda o: o.cost_bhargava_j_per_kg_m),
    "speed_m_per_s": ("speed", "m/s", lambda o: o.speed_m_per_s),
    "step_asymmetry": ("step asymmetry", "1", lambda o: o.step_asymmetry),
    "peak_load_left_bw": ("peak load, left leg", "body wt", lambda o: _get_peak_load(o, "left")),
    "peak_load_right_bw": ("peak load, prosthesis", "body wt", lambda o: _get_peak_load(o, "right")),
}
"""Label, unit and value of the compared outcomes."""


def _get_peak_load(outcomes: WalkOutcomes, side: str) -> float | None:
    leg = outcomes.legs.get(side)
    return None if leg is None else leg.peak_load_bw


@dataclass(frozen=True, repr=False)
class WalkComparison(Printable):
    """Two conditions, walked by the same walkers or each by walkers that have adapted to it."""

    conditions: tuple[str, str]
    """Specifications of A and B."""
    walkers: tuple[tuple[str, ...], tuple[str, ...]]
    """Names of the walkers under A and under B."""
    is_paired: bool
    """Whether the same walkers walked under both."""
    falls: tuple[tuple[str, ...], tuple[str, ...]]
    """Names of the walkers that fell under A and under B; they are in no difference."""
    acute: tuple[tuple[str, ...], tuple[str, ...]]
    """Names of the walkers that have not adapted to A and to B."""
    differences: dict[str, MeanDifference]
    """Difference by outcome; empty if no walker walked under both, or none under one of them."""

    @property
    def summary(self) -> dict[str, Any]:
        """Content of comparison.json, in JSON types."""
        return {
            "kind": "predicted (planar reflex model)",
            "confidence": CONFIDENCE,
            "conditions": list(self.conditions),
            "walkers": [list(names) for names in self.walkers],
            "is_paired": self.is_paired,
            "falls": [list(names) for names in self.falls],
            "acute": [list(names) for names in self.acute],
            "differences": {
                name: {**asdict(difference), "sign": difference.sign} for name, difference in self.differences.items()
            },
        }

    def format_summary(self) -> Summary:
        """Yield the table of the differences, the falls, and what limits the comparison."""
        if self.differences:
            yield self._build_table()
        else:
            yield "Too few walkers walk under both conditions, so nothing can be compared."
        if self.is_paired:
            yield "The same walkers walked under both conditions."
        else:
            yield "Each condition was walked by the walkers that have adapted to it."
        for name, fallen, walkers in zip(self.conditions, self.falls, self.walkers, strict=True):
            if fallen:
                yield f"Falls with {name}: {', '.join(fallen)} ({len(fallen)} of {len(walkers)})."
        for name, acute in zip(self.conditions, self.acute, strict=True):
            if acute:
                yield f"Acute with {name}, not adapted to it: {', '.join(acute)}."
        yield (
            "A sign is named only where the 95 % interval of the mean difference excludes zero. It covers the scatter "
            "between these walkers, not what people differ in; predicted by a planar reflex model (docs/walk.md)."
        )

    def _build_table(self) -> "Table":
        from klute_sim.terminal_table import create_table

        table = create_table()
        for name in ("outcome", "unit"):
            table.add_column(name, no_wrap=True)
        for name in (*self.conditions, "difference", "95 % interval", "walkers"):
            table.add_column(name, justify="right")
        table.add_column("sign")
        words = {1: "higher", -1: "lower", 0: "not sure"}
        for name, difference in self.differences.items():
            label, unit, _ = OUTCOMES[name]
            interval = "-" if difference.low is None else f"{difference.low:+.3f} to {difference.high:+.3f}"
            table.add_row(
                *(label, unit, f"{difference.mean_a:.3f}", f"{difference.mean_b:.3f}"),
                *(f"{difference.difference:+.3f}", interval, self._count(difference), words[difference.sign]),
            )
        return table

    def _count(self, difference: MeanDifference) -> str:
        return str(difference.n_a) if self.is_paired else f"{difference.n_a}, {difference.n_b}"

    def __repr__(self) -> str:
        """Return one line: conditions and number of walkers."""
        (a, b), (walkers_a, walkers_b) = self.conditions, self.walkers
        count = str(len(walkers_a)) if self.is_paired else f"{len(walkers_a)} and {len(walkers_b)}"
        return f"WalkComparison({a!r}, {b!r}, {count} walkers)"

    def save(self, folder: str | Path | None = None) -> Path:
        """Write walk-comparison.json and index.html into ``folder`` (default: the next ``runs/walk-compare-NNN``).

        Returns the folder, which has to be new or empty.
        """
        from klute_sim.report.run_page import write_run_page

        with create_run_folder("walk-compare", folder) as (final_folder, scratch):
            text = json.dumps(self.summary, indent=2, allow_nan=False) + "\n"
            (scratch / "walk-comparison.json").write_text(text, "utf-8")
            write_run_page(scratch, " against ".join(self.conditions), self.format_summary(), {})
        return final_folder


def compare_walks(
    a: str,
    b: str,
    *,
    device: DeviceLike | None = None,
    foot: str | None = None,
    walkers: Sequence[Walker | str | Path] = (),
    acute: bool = False,
    seconds: float = 20.0,
    progress: ProgressCallback | None = None,
) -> WalkComparison:
    """Let walkers walk under two conditions, and return the differences of their mean outcomes with intervals.

    Where several shipped walkers have adapted to each condition, they are compared as two groups. Otherwise, and with
    ``walkers`` or ``acute``, the same walkers walk under both, and the differences are paired.

    Args:
        a: First condition: a controller as for :func:`simulate_walk`, or ``"spring-foot:8"`` [N.m/deg].
        b: Second condition.
        device: Device of the controllers, name of a preset, or path of a device file. None: ``"klute-1-1-4-pair"``.
        foot: Foot below the ankle. None: that of the device.
        walkers: Walkers, names of shipped ones, or paths of files. Empty: the shipped ones that have adapted to the
            conditions; without any, all with a prosthesis.
        acute: Whether the same walkers walk under both even where others have adapted to B.
        seconds: Duration of each walk [s].
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable.
    """
    arguments = [_parse_condition(spec, device, foot) for spec in (a, b)]
    groups = _select_groups(arguments, walkers, acute)
    is_paired = groups[0] is groups[1]
    report, n_walks = progress or ignore_progress, len(groups[0]) + len(groups[1])
    outcomes: list[list[WalkOutcomes]] = [[], []]
    not_adapted: list[list[str]] = [[], []]
    for i, (group, condition) in enumerate(zip(groups, arguments, strict=True)):
        for k, walker in enumerate(group):
            report((i * len(groups[0]) + k) / n_walks, f"walking, {walker.name}")
            run = simulate_walk(walker=walker, seconds=seconds, **condition)
            outcomes[i].append(run.outcomes)
            if run.summary["is_acute"]:
                not_adapted[i].append(walker.name)
    names = [tuple(walker.name for walker in group) for group in groups]
    falls = [
        tuple(name for name, o in zip(group, walks, strict=True) if o.has_fallen)
        for group, walks in zip(names, outcomes, strict=True)
    ]
    if is_paired:
        fallen = {*falls[0], *falls[1]}
        walks = [[o for name, o in zip(names[0], group, strict=True) if name not in fallen] for group in outcomes]
    else:
        walks = [[o for o in group if not o.has_fallen] for group in outcomes]
    return WalkComparison(
        conditions=(a, b),
        walkers=(names[0], names[1]),
        is_paired=is_paired,
        falls=(falls[0], falls[1]),
        acute=(tuple(not_adapted[0]), tuple(not_adapted[1])),
        differences=_compute_differences(walks[0], walks[1], is_paired=is_paired),
    )


def _select_groups(
    arguments: Sequence[dict[str, Any]], walkers: Sequence[Walker | str | Path], acute: bool
) -> tuple[list[Walker], list[Walker]]:
    """Return the walkers of both conditions; one and the same list where the comparison is paired."""
    if walkers:
        chosen = [walker if isinstance(walker, Walker) else load_walker(walker) for walker in walkers]
        return chosen, chosen
    shipped = [walker for walker in map(load_walker, list_walkers()) if not walker.is_intact]
    conditions = [
        describe_prosthesis(
            *build_prosthesis(c.get("device"), c.get("controller"), c.get("spring_foot"), False, c.get("foot"), None)
        )
        for c in arguments
    ]
    adapted = [[walker for walker in shipped if dict(walker.condition) == condition] for condition in conditions]
    if not acute and conditions[0] != conditions[1] and min(len(group) for group in adapted) > 1:
        return adapted[0], adapted[1]
    same = adapted[0] or adapted[1] or shipped
    return same, same


def _compute_differences(
    walks_a: Sequence[WalkOutcomes], walks_b: Sequence[WalkOutcomes], *, is_paired: bool
) -> dict[str, MeanDifference]:
    """Return the difference of each outcome that all walks have; empty without walks."""
    compute = compute_paired_difference if is_paired else compute_group_difference
    differences = {}
    for name, (_, _, get_value) in OUTCOMES.items():
        values_a, values_b = ([get_value(o) for o in walks] for walks in (walks_a, walks_b))
        known_a, known_b = ([value for value in values if value is not None] for values in (values_a, values_b))
        if known_a and known_b and len(known_a) == len(values_a) and len(known_b) == len(values_b):
            differences[name] = compute(known_a, known_b)
    return differences


def _parse_condition(spec: str, device: DeviceLike | None, foot: str | None) -> dict[str, Any]:
    """Return the arguments of :func:`simulate_walk` for a condition."""
    kind, _, argument = spec.partition(":")
    if kind != SPRING_FOOT_KIND:
        return {"controller": spec, "device": device, "foot": foot}
    try:
        return {"spring_foot": float(argument), "foot": foot}
    except ValueError:
        raise InputError(f"condition '{spec}' needs a stiffness in N·m/deg, as in spring-foot:8") from None
