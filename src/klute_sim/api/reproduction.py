"""Compare the model with the dissertation: :func:`reproduce` and its result :class:`ReproductionResult`."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.inputs import DeviceLike, to_device
from klute_sim.api.optional import import_pandas
from klute_sim.api.rendering import Printable, Summary
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.recording.run_folder import create_run_folder
from klute_sim.reproduction.item import VERDICTS, ItemAssessment
from klute_sim.reproduction.printed import load_supplied_values
from klute_sim.reproduction.run import Reproduction, run_reproduction
from klute_sim.reproduction.summary import (
    count_kinds,
    count_verdicts,
    format_dependence,
    format_headline,
    format_other_kinds,
    select_kind,
    summarize,
)
from klute_sim.types import ProgressCallback

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from rich.table import Table

DEFAULT_UNIT = "klute-3-4-pair"
"""Muscle-tendon unit of chapters 4 to 8."""
DISAGREEMENTS = ("contradicts-source", "source-contradicts-itself")
"""Verdicts that the summary lists."""


@dataclass(frozen=True, repr=False)
class ReproductionResult(Printable):
    """Assessment of every number and statement that the dissertation prints."""

    reproduction: Reproduction
    """Assessments and figures of all published items."""

    @property
    def device(self) -> Device:
        """Muscle-tendon unit of chapters 4 to 8."""
        return self.reproduction.device

    @property
    def assessments(self) -> tuple[ItemAssessment, ...]:
        """Published item, computed finding and verdict of every item."""
        return self.reproduction.assessments

    def to_records(self) -> list[dict[str, Any]]:
        """Return one dictionary per item."""
        return self.reproduction.to_records()

    @property
    def headline(self) -> str:
        """How many independent numbers agree, of those that are compared."""
        return format_headline(self.assessments)

    def to_json(self) -> str:
        """Return headline, counts and items, the content of items.json."""
        content = summarize(self.assessments) | {"items": self.to_records()}
        return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)

    def to_pandas(self) -> "pd.DataFrame":
        """Return the items as a DataFrame; raises MissingExtraError without pandas."""
        pandas = import_pandas("ReproductionResult.to_pandas")
        frame: pd.DataFrame = pandas.DataFrame(self.to_records())
        return frame

    def format_summary(self, *, all_items: bool = False) -> Summary:
        """Yield the headline, the independent numbers, the items that do not agree (or ``all_items``), and counts."""
        yield self.headline
        yield format_dependence(self.assessments)
        yield format_other_kinds(self.assessments)
        independent = [a for a in select_kind(self.assessments, "independent") if a.is_compared]
        yield from _format_items("Independent numbers", independent, with_kind=False)
        others = [a for a in self.assessments if a.verdict in DISAGREEMENTS and a not in independent]
        listed = list(self.assessments) if all_items else others
        yield from _format_items("All items" if all_items else "Other items that do not agree", listed)
        yield _format_counts(self.assessments)

    def __repr__(self) -> str:
        """Return one line: device and number of items."""
        return f"ReproductionResult({self.device.name!r}, {len(self.assessments)} items)"

    def plot(self, number: str = "3.9") -> "Figure":
        """Return the figure with ``number`` of the dissertation; raises InputError when there is none."""
        from klute_sim.report.reproduction.figures import build_figure

        figures = {figure.number: figure for figure in self.reproduction.figures}
        if number not in figures:
            raise InputError(f"there is no figure '{number}'; allowed: {', '.join(figures)}")
        return build_figure(figures[number])

    def save(self, folder: str | Path | None = None, progress: ProgressCallback | None = None) -> Path:
        """Write the files of ``klute-sim reproduce`` into ``folder`` (new or empty; default: ``runs/reproduce-NNN``).

        Returns the folder.
        """
        with create_run_folder("reproduce", folder) as (final_folder, scratch):
            self.write_files(scratch, progress)
        return final_folder

    def write_files(self, scratch: Path, progress: ProgressCallback | None = None) -> None:
        """Write page, figures, items and device into ``scratch``."""
        from klute_sim.report.reproduction.figures import save_figures
        from klute_sim.report.reproduction.page import write_page

        figures = self.reproduction.figures
        paths = {}
        for index, path in enumerate(save_figures(figures, scratch)):
            paths[figures[index].number] = path
            if progress is not None:
                progress((index + 1) / len(figures), "drawing")
        (scratch / "items.json").write_text(self.to_json() + "\n", "utf-8")
        (scratch / "device.toml").write_bytes(self.device.content)
        write_page(self.reproduction, paths, scratch)


def reproduce(
    device: DeviceLike = DEFAULT_UNIT,
    *,
    published: Mapping[str, float] | str | Path | None = None,
    progress: ProgressCallback | None = None,
) -> ReproductionResult:
    """Compute every number and statement that the dissertation prints and assess it.

    ``device`` is the muscle-tendon unit of chapters 4 to 8. ``published`` supplies numbers that are missing from this
    copy of the source: a mapping from item to number, or the path of a file that ``klute-sim reproduce --missing``
    began. Raises InputError when the device has no damper or tendon or cannot take the lengths of chapter 7.
    """
    supplied = load_supplied_values(Path(published)) if isinstance(published, str | Path) else published
    report = progress if progress is not None else lambda fraction, stage: None
    return ReproductionResult(run_reproduction(to_device(device), supplied, report))


def _format_items(title: str, assessments: list[ItemAssessment], *, with_kind: bool = True) -> Summary:
    from klute_sim.report.reproduction.page import format_outcome_cells
    from klute_sim.terminal_table import create_table

    columns = ("published", "computed", "difference", *(("kind",) if with_kind else ()))
    table = create_table("quantity", *columns, title=title)
    table.add_column("verdict", no_wrap=True)
    for assessment in assessments:
        cells = format_outcome_cells(assessment)
        unit = "" if cells["unit"] == "-" else f" [{cells['unit']}]"
        quantity = f"{assessment.item.table_title}: {cells['quantity']}{unit}"
        table.add_row(quantity, *(cells[column] for column in (*columns, "verdict")))
    yield table
    for assessment in assessments:
        if assessment.note and assessment.verdict not in ("agrees", "not-printed"):
            yield f"{assessment.item.table_title}, {assessment.item.quantity}: {assessment.note}"


def _format_counts(assessments: tuple[ItemAssessment, ...]) -> "Table":
    from klute_sim.terminal_table import create_table

    table = create_table("kind", *VERDICTS, "all", title="Items by kind and verdict")
    for kind, counts in count_kinds(assessments).items():
        table.add_row(kind, *(str(counts[verdict]) for verdict in VERDICTS), str(sum(counts.values())))
    totals = count_verdicts(assessments)
    table.add_row("all", *(str(totals[verdict]) for verdict in VERDICTS), str(len(assessments)))
    return table
