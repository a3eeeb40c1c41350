"""``index.html`` of every run folder: one self-contained page with results, pictures and links, which works offline."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.table import Table
from rich.text import Text

from klute_sim.provenance import collect_versions
from klute_sim.recording.atomic_file import is_temporary, write_atomically
from klute_sim.report.html import render_template

PAGE_FILE, FIGURE_FILE = "index.html", "figure.png"
"""Page of a run folder, and the figure of a run that has one."""
FILE_DESCRIPTIONS = {
    "adaptation.json": "results of the search",
    "adapted.toml": "walker, for klute-sim walk --walker",
    "assessment.json": "results",
    "bands.parquet": "mean curves with their bands",
    "baselines.json": "plan of the runs",
    "cases": "result of each case, from which the same command resumes",
    "checkpoint.zip": "state from which the training resumes",
    "comparison.csv": "differences, one row for each channel",
    "comparison.json": "results",
    "config.toml": "configuration of the training",
    "costs.csv": "cost of each walk of the search",
    "device.toml": "device, for --device",
    "evaluations.csv": "evaluations of the search, one row each",
    "items.json": "results",
    "learning_curve.csv": "learning curve",
    "model.xml": "model with the changed numbers, for MuJoCo",
    "predictions.json": "predictions of other datasets",
    "policy.npz": "trained policy; that of a prosthesis for --controller",
    "profile.csv": "pressure profile, for --controller",
    "protocol.toml": "protocol of the test",
    "recording.csv": "all channels, one row for each time step",
    "recording.parquet": "all channels, one row for each time step",
    "response.csv": "measured and simulated frequency response",
    "results.csv": "conditions and metrics, one row for each trial",
    "summary.json": "results",
    "sweep.csv": "inputs and metrics, one row for each case",
    "sweep.json": "plan of the sweep",
    "sweep.parquet": "inputs and metrics, one row for each case",
    "table.json": "results",
    "tune.json": "plan of the search",
    "tune-walk.json": "plan of the search",
    "tune-joint.json": "plan of the search",
    "joint_evaluations.csv": "evaluations of the search, one row each",
    "tuned.csv": "tuned pressure profile, for --controller",
    "tuned.toml": "tuned state machine, for --controller",
    "tuning.json": "results",
    "verdict.json": "results",
    "walk_evaluations.csv": "evaluations of the search, one row each",
    "walk-comparison.json": "results",
    "walker.toml": "reflexes of the person, for --walker",
}
"""Name of a file or folder -> what it holds."""
SUFFIX_DESCRIPTIONS = {
    ".parquet": "recording of a trial",
    ".png": "picture",
    ".rrd": "recording for klute-sim view",
    ".toml": "device",
}
"""Suffix -> what a file holds that :data:`FILE_DESCRIPTIONS` does not name."""


class PageTable(NamedTuple):
    """A table as text."""

    title: str
    headings: list[str]
    is_numeric: list[bool]
    """Whether a column is aligned at its right."""
    rows: list[list[str]]


def write_run_page(
    folder: Path,
    title: str,
    summary: Iterable[Table | str],
    pictures: Mapping[str, str],
    planned_files: Sequence[str] = (),
) -> None:
    """Write the page of the run in ``folder``: its title, sentences before the first table, pictures, and the rest.

    ``pictures`` maps the names of PNG files of the folder to the text that stands for each where it cannot be seen.
    ``planned_files`` are linked although they are written later. Text is escaped.
    """
    lead, blocks = _split_summary(summary)
    content = render_template(
        "run.html",
        title=title,
        lead=lead,
        blocks=blocks,
        pictures=[{"data": encode_picture(folder / name), "text": text} for name, text in pictures.items()],
        files=list_files(folder, planned_files),
        versions=collect_versions(),
    )
    write_atomically(folder / PAGE_FILE, content)


def render_summary(summary: Iterable[Table | str]) -> str:
    """Return the tables and sentences of ``summary`` as HTML without a page, for notebooks. Text is escaped."""
    lead, blocks = _split_summary(summary)
    return render_template("notebook.html", lead=lead, blocks=blocks)


def encode_picture(path: Path) -> str:
    """Return the PNG file ``path`` in base 64."""
    return base64.b64encode(path.read_bytes()).decode("ascii")


def list_files(folder: Path, planned_files: Sequence[str] = ()) -> list[dict[str, str]]:
    """Return name and description of each file of ``folder``, and of the ``planned_files``, but not of the page."""
    names = {entry.name for entry in folder.iterdir() if not entry.name.startswith(".")}
    names = {name for name in names | set(planned_files) if name != PAGE_FILE and not is_temporary(name)}
    return [{"name": name, "description": _describe_file(name)} for name in sorted(names)]


def _describe_file(name: str) -> str:
    return FILE_DESCRIPTIONS.get(name, SUFFIX_DESCRIPTIONS.get(Path(name).suffix, ""))


def _split_summary(summary: Iterable[Table | str]) -> tuple[list[str], list[dict[str, Any]]]:
    """Return the sentences before the first table, and what follows as tables and sentences."""
    lead: list[str] = []
    blocks: list[dict[str, Any]] = []
    for item in summary:
        if isinstance(item, Table):
            blocks.append({"table": convert_table(item), "sentence": ""})
        elif blocks:
            blocks.append({"table": None, "sentence": str(item)})
        else:
            lead.append(str(item))
    return lead, blocks


def convert_table(table: Table) -> PageTable:
    """Return the cells of ``table`` as text."""
    columns = [[_get_text(cell) for cell in column.cells] for column in table.columns]
    return PageTable(
        title=_get_text(table.title),
        headings=[_get_text(column.header).replace("-\n", "").replace("\n", " ") for column in table.columns],
        is_numeric=[column.justify == "right" for column in table.columns],
        rows=[list(row) for row in zip(*columns, strict=True)],
    )


def _get_text(cell: Any) -> str:
    return cell.plain if isinstance(cell, Text) else str(cell or "")
