"""Compare two prostheses or controllers over several walkers: :func:`compare_walks` and its result."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.inputs import DeviceLike, ignore_progress
from klute_sim.api.rendering import Summary, render_html, render_text
from klute_sim.api.walk import simulate_walk
from klute_sim.errors import InputError
from klute_sim.recording.run_folder import create_run_folder
from klute_sim.types import ProgressCallback
from klute_sim.walker.outcomes import WalkOutcomes
from klute_sim.walker.paired_difference import CONFIDENCE, PairedDifference, compute_paired_difference
from klute_sim.walker.reflexes.walker_file import Walker, list_walkers, load_walker

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
class WalkComparison:
    """Two conditions, walked by the same walkers."""

    conditions: tuple[str, str]
    """Specifications of A and B."""
    walkers: tuple[str, ...]
    """Names of the walkers."""
    falls: tuple[tuple[str, ...], tuple[str, ...]]
    """Names of the walkers that fell under A and under B; they are in no difference."""
    acute: tuple[tuple[str, ...], tuple[str, ...]]
    """Names of the walkers that have not adapted to A and to B."""
    differences: dict[str, PairedDifference]
    """Paired difference by outcome; empty if no walker walked under both."""

    @property
    def summary(self) -> dict[str, Any]:
        """Content of comparison.json, in JSON types."""
        return {
            "kind": "predicted (planar reflex model)",
            "confidence": CONFIDENCE,
            **{key: list(value) for key, value in (("conditions", self.conditions), ("walkers", self.walkers))},
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
            yield "No walker walks under both conditions, so nothing can be compared."
        for name, fallen in zip(self.conditions, self.falls, strict=True):
            if fallen:
                yield f"Falls with {name}: {', '.join(fallen)} ({len(fallen)} of {len(self.walkers)})."
        for name, acute in zip(self.conditions, self.acute, strict=True):
            if acute:
                yield f"Acute with {name}, not adapted to it: {', '.join(acute)}."
        yield (
            "A sign is named only where the 95 % interval of the mean difference excludes zero. It covers the scatter "
            "between these walkers, not what people differ in; predicted by a planar reflex model (docs/walk.md)."
        )

    def _build_table(self) -> "Table":
        from rich import box
        from rich.table import Table

        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
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
                *(f"{difference.difference:+.3f}", interval, str(difference.n), words[difference.sign]),
            )
        return table

    def __repr__(self) -> str:
        """Return one line: conditions and number of walkers."""
        a, b = self.conditions
        return f"WalkComparison({a!r}, {b!r}, {len(self.walkers)} walkers)"

    def __str__(self) -> str:
        """Return the summary that the terminal shows."""
        return render_text(self.format_summary())

    def _repr_html_(self) -> str:
        return render_html(self.format_summary())

    def save(self, folder: str | Path | None = None) -> Path:
        """Write walk-comparison.json into ``folder`` (new or empty; default: the next ``runs/walk-compare-NNN``)."""
        with create_run_folder("walk-compare", folder) as (final_folder, scratch):
            text = json.dumps(self.summary, indent=2, allow_nan=False) + "\n"
            (scratch / "walk-comparison.json").write_text(text, "utf-8")
        return final_folder


def compare_walks(
    a: str,
    b: str,
    *,
    device: DeviceLike | None = None,
    foot: str | None = None,
    walkers: Sequence[Walker | str | Path] = (),
    seconds: float = 20.0,
    progress: ProgressCallback | None = None,
) -> WalkComparison:
    """Let the same walkers walk under two conditions, and return the paired differences of their outcomes.

    Args:
        a: First condition: a controller as for :func:`simulate_walk`, or ``"spring-foot:8"`` [N.m/deg].
        b: Second condition.
        device: Device of the controllers, name of a preset, or path of a device file. None: ``"klute-1-1-4-pair"``.
        foot: Foot below the ankle. None: that of the device.
        walkers: Walkers, names of shipped ones, or paths of files. Empty: all shipped ones with a prosthesis.
        seconds: Duration of each walk [s].
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable.
    """
    chosen = [walker if isinstance(walker, Walker) else load_walker(walker) for walker in walkers]
    if not chosen:
        chosen = [walker for walker in map(load_walker, list_walkers()) if not walker.is_intact]
    report, n_walks = progress or ignore_progress, 2 * len(chosen)
    outcomes: list[list[WalkOutcomes]] = [[], []]
    acute: list[list[str]] = [[], []]
    for k, walker in enumerate(chosen):
        for i, spec in enumerate((a, b)):
            report((2 * k + i) / n_walks, f"walking, {walker.name}")
            arguments = _parse_condition(spec, device, foot)
            run = simulate_walk(walker=walker, seconds=seconds, **arguments)
            outcomes[i].append(run.outcomes)
            if run.summary["is_acute"]:
                acute[i].append(walker.name)
    names = [walker.name for walker in chosen]
    falls = [[name for name, o in zip(names, walks, strict=True) if o.has_fallen] for walks in outcomes]
    differences = {}
    for name, (_, _, get_value) in OUTCOMES.items():
        pairs = [
            (value_a, value_b)
            for walk_a, walk_b in zip(*outcomes, strict=True)
            if not (walk_a.has_fallen or walk_b.has_fallen)
            and (value_a := get_value(walk_a)) is not None
            and (value_b := get_value(walk_b)) is not None
        ]
        if pairs:
            differences[name] = compute_paired_difference(*([pair[k] for pair in pairs] for k in (0, 1)))
    return WalkComparison(
        (a, b),
        tuple(names),
        (tuple(falls[0]), tuple(falls[1])),
        (tuple(acute[0]), tuple(acute[1])),
        differences,
    )


def _parse_condition(spec: str, device: DeviceLike | None, foot: str | None) -> dict[str, Any]:
    """Return the arguments of :func:`simulate_walk` for a condition."""
    kind, _, argument = spec.partition(":")
    if kind != SPRING_FOOT_KIND:
        return {"controller": spec, "device": device, "foot": foot}
    try:
        return {"spring_foot": float(argument), "foot": foot}
    except ValueError:
        raise InputError(f"condition '{spec}' needs a stiffness in N·m/deg, as in spring-foot:8") from None
