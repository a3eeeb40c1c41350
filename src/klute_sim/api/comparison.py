"""Compare simulated and measured recordings: :func:`compare` and its result :class:`ComparisonResult`."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

from klute_sim.api.inputs import stage_progress
from klute_sim.api.optional import import_pandas
from klute_sim.api.rendering import Printable, Summary
from klute_sim.comparison import results
from klute_sim.comparison.comparison import Comparison, ComparisonOptions, ComparisonPart, Domain
from klute_sim.comparison.comparison import compare as compare_runs
from klute_sim.comparison.runs import ComparedRun, check_recording, read_runs
from klute_sim.errors import InputError, MissingExtraError
from klute_sim.recording.recording import Recording
from klute_sim.recording.run_folder import create_run_folder
from klute_sim.types import ProgressCallback

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

RRD_FILE = "comparison.rrd"
"""Name of the file for the rerun viewer."""


@runtime_checkable
class _SingleRun(Protocol):
    """Result with one recording, such as :class:`klute_sim.api.gait.GaitRun`."""

    @property
    def recording(self) -> Recording:
        """Recording of the run."""
        ...


@runtime_checkable
class _MultipleRun(Protocol):
    """Result with one recording per trial, such as :class:`klute_sim.api.bench.BenchRun`."""

    @property
    def recordings(self) -> Mapping[str, Recording]:
        """Trial -> recording."""
        ...


RunLike: TypeAlias = str | Path | Recording | _SingleRun | _MultipleRun
"""Run folder, recording file, recording, or result of a simulation; a string may be ``LABEL=PATH``."""


@dataclass(frozen=True, repr=False)
class ComparisonResult(Printable):
    """Differences of recordings from a baseline, channel by channel."""

    comparison: Comparison
    """Mean curves, differences and remarks."""

    @property
    def parts(self) -> tuple[ComparisonPart, ...]:
        """Compared trials, each with its curves and differences; gait runs have one part."""
        return self.comparison.parts

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the compared runs, one sentence each."""
        return self.comparison.remarks

    def format_summary(self) -> Summary:
        """Yield the largest differences in words, two tables per compared series, and sentences on the numbers."""
        from klute_sim.report.comparison.headline import format_headline
        from klute_sim.report.comparison.table import build_tables, collect_remarks

        yield from format_headline(self.comparison)
        yield from build_tables(self.comparison)
        yield from collect_remarks(self.comparison)

    def __repr__(self) -> str:
        """Return one line: labels and axis."""
        labels = ", ".join(repr(series.label) for series in self.parts[0].series)
        return f"ComparisonResult({labels}, over {self.comparison.domain})"

    def plot(self, part: str | None = None) -> "Figure":
        """Return the figure of the trial ``part``; None selects the first trial.

        Raises InputError for an unknown trial.
        """
        from klute_sim.report.comparison.figures import build_part_figure

        parts = {candidate.name: candidate for candidate in self.parts}
        name = self.parts[0].name if part is None else part
        if name not in parts:
            raise InputError(f"unknown part '{name}'; allowed: {', '.join(map(repr, parts))}")
        return build_part_figure(parts[name], self.comparison.domain)

    def to_pandas(self) -> "pd.DataFrame":
        """Return the content of comparison.csv; raises MissingExtraError without pandas."""
        pandas = import_pandas("ComparisonResult.to_pandas")
        frame: pd.DataFrame = pandas.DataFrame(list(results.iter_rows(self.comparison)))
        return frame

    def save(self, folder: str | Path | None = None, *, report: bool = True) -> Path:
        """Write the files of ``klute-sim compare`` into ``folder`` (new or empty; default: ``runs/compare-NNN``).

        Returns the folder. ``report`` False leaves out the page, the figures and the file for the rerun viewer.
        """
        with create_run_folder("compare", folder) as (final_folder, scratch):
            self.write_files(scratch, final_folder, report=report)
        return final_folder

    def write_files(
        self,
        scratch: Path,
        folder: Path,
        *,
        report: bool = True,
        progress: Callable[[float], None] = lambda fraction: None,
    ) -> tuple[dict[str, Any], list[str]]:
        """Write all files into ``scratch``, which becomes ``folder``.

        Returns the content of comparison.json, and sentences on optional files that are left out.
        """
        from klute_sim.report.comparison import page
        from klute_sim.report.run_page import PAGE_FILE

        (scratch / "comparison.csv").write_text(results.format_csv(self.comparison), "utf-8")
        results.write_curves(self.comparison, scratch / "bands.parquet")
        pictures, notes = self._write_pictures(scratch, progress) if report else ({}, [])
        files = [*sorted(file.name for file in scratch.iterdir()), *([PAGE_FILE] if report else []), "comparison.json"]
        content = {**results.as_json(self.comparison), "run": str(folder), "files": files}
        (scratch / "comparison.json").write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", "utf-8")
        if report:
            page.write_page(self.comparison, pictures, scratch)
        return content, notes

    def _write_pictures(self, scratch: Path, progress: Callable[[float], None]) -> tuple[dict[str, str], list[str]]:
        """Write figures and viewer recording; return the file by part, and sentences on what is left out."""
        from klute_sim.report.comparison import figures
        from klute_sim.report.style import save_figure
        from klute_sim.viewer.layouts import comparison as layout

        notes, pictures = [], {}
        n_figures = min(len(self.parts), figures.MAX_FIGURES)
        for number, (part, figure) in enumerate(figures.build_figures(self.comparison), start=1):
            pictures[part.name] = f"{part.name or 'comparison'}.png"
            save_figure(figure, scratch / pictures[part.name])
            progress(0.8 * number / n_figures)
        try:
            layout.write_recording(self.comparison, scratch / RRD_FILE)
        except MissingExtraError as error:
            notes.append(f"No {RRD_FILE}: {error}.")
        return pictures, notes


def compare(
    runs: RunLike | Sequence[RunLike] | Mapping[str, RunLike | Sequence[RunLike]],
    *,
    domain: Domain | None = None,
    channels: Sequence[str] = (),
    reference: bool = False,
    baseline: str | None = None,
    skip_strides: int | None = None,
    progress: ProgressCallback | None = None,
) -> ComparisonResult:
    """Compare runs or recordings channel by channel: the size of their differences, and their position.

    A single run is summarised as its mean stride with a band.

    Args:
        runs: Runs, or a mapping from label to a run or to repeats of it. A run is a run folder, a recording file
            (``PATH`` or ``LABEL=PATH``), a recording, or the result of a simulation.
        domain: ``"phase"`` compares strides over the gait cycle, ``"time"`` whole recordings over their common time.
            None: phase if every recording has strides.
        channels: Channels to compare; ``["all"]`` for all. Empty: the main ones.
        reference: Whether the human reference of the first gait run is added as the series ``"human"`` (that
            of one subject: ``"subject NAME"``).
        baseline: Label of the series that the others are compared with. None: the first one.
        skip_strides: Number of strides skipped at the start of each recording. None: 1 of a simulated gait, 0 of a
            measured one.
        progress: Receives the completed fraction and the current stage.

    Raises InputError if a run cannot be read, or if there is nothing to compare.
    """
    options = ComparisonOptions(
        domain=domain,
        channels=tuple(channels),
        include_reference=reference,
        baseline=baseline,
        skip_strides=skip_strides,
    )
    report = stage_progress(progress, "comparing")
    compared_runs = _collect_runs(runs)
    report(0.5)
    comparison = compare_runs(compared_runs, options)
    report(1.0)
    return ComparisonResult(comparison)


def _collect_runs(
    runs: RunLike | Sequence[RunLike] | Mapping[str, RunLike | Sequence[RunLike]],
) -> list[ComparedRun]:
    if isinstance(runs, Mapping):
        return [
            run
            for label, labelled in runs.items()
            for repeat in _as_sequence(labelled)
            for run in [_to_run(repeat, label, prefix_label=True)]
        ]
    sequence = _as_sequence(runs)
    if all(isinstance(run, str | Path) for run in sequence):
        return read_runs([str(run) for run in sequence])  # default labels are unique among all runs
    return [_to_run(run, f"run {number}", prefix_label=False) for number, run in enumerate(sequence, 1)]


def _as_sequence(runs: RunLike | Sequence[RunLike]) -> Sequence[RunLike]:
    return runs if isinstance(runs, Sequence) and not isinstance(runs, str) else [runs]


def _to_run(run: RunLike, label: str, *, prefix_label: bool) -> ComparedRun:
    """Return ``run`` with ``label``; a path without ``prefix_label`` keeps its own label."""
    if isinstance(run, str | Path):
        return read_runs([f"{label}={run}" if prefix_label else str(run)])[0]
    path = Path(label)
    if isinstance(run, Recording):
        return ComparedRun(label, path, {label: check_recording(run, path)})
    if isinstance(run, _SingleRun):
        return ComparedRun(label, path, {label: check_recording(run.recording, path)})
    if isinstance(run, _MultipleRun):
        return ComparedRun(label, path, {name: check_recording(r, path / name) for name, r in run.recordings.items()})
    raise InputError(
        f"'{label}' is of the type {type(run).__name__}; allowed are paths, recordings, and results of simulate_gait "
        "and simulate_bench"
    )
