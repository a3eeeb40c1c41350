"""What the runs of bench and joint share: several trials with conditions, metrics and recordings."""

import csv
import io
import json
import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from klute_sim.api.optional import import_pandas
from klute_sim.api.rendering import Printable
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.recording.run_folder import create_run_folder
from klute_sim.types import ProgressCallback

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class TrialResult(Protocol):
    """Result of one trial."""

    @property
    def name(self) -> str:
        """Name of the trial."""

    @property
    def conditions(self) -> Mapping[str, float]:
        """Set values by keys with units."""

    @property
    def metrics(self) -> Mapping[str, float]:
        """Metrics by keys with units; NaN where there is no value."""

    @property
    def recording(self) -> Recording:
        """Recording of the trial."""


class TrialRun(Printable):
    """Result of a test of several trials: metrics and recording of every trial."""

    folder_kind: ClassVar[str]
    """Beginning of the name of the default folder."""

    @property
    @abstractmethod
    def trials(self) -> Sequence[TrialResult]:
        """Trials in order."""

    @property
    @abstractmethod
    def summary(self) -> dict[str, Any]:
        """Content of summary.json without the names of the files."""

    @property
    @abstractmethod
    def title(self) -> str:
        """Title of the page of the run."""

    @property
    @abstractmethod
    def figure_description(self) -> str:
        """What the figure shows, for those who do not see it."""

    @abstractmethod
    def plot(self) -> "Figure":
        """Return the figure of the run."""

    @abstractmethod
    def _write_inputs(self, folder: Path) -> None:
        """Write the files that state what was tested, and those that only this kind of run has."""

    @property
    def table(self) -> list[dict[str, Any]]:
        """One row per trial: its name, conditions and metrics, by keys with units."""
        return [{"trial": trial.name, **trial.conditions, **trial.metrics} for trial in self.trials]

    @property
    def recordings(self) -> dict[str, Recording]:
        """Recording of each trial, by the name of the trial."""
        return {trial.name: trial.recording for trial in self.trials}

    def to_pandas(self) -> "pd.DataFrame":
        """Return :attr:`table` as a pandas DataFrame with the trials as index.

        Raises MissingExtraError without pandas.
        """
        pandas = import_pandas(f"{type(self).__name__}.to_pandas")
        frame: pd.DataFrame = pandas.DataFrame(self.table).set_index("trial")
        return frame

    def save(self, folder: str | Path | None = None) -> Path:
        """Write the files of the command into ``folder`` (new or empty; default: the next one in ``runs``).

        Returns the folder.
        """
        with create_run_folder(self.folder_kind, folder) as (final_folder, scratch):
            self.write_files(scratch, final_folder)
        return final_folder

    def write_files(
        self, scratch: Path, folder: Path, progress: ProgressCallback = lambda fraction, stage: None
    ) -> dict[str, Any]:
        """Write all files into ``scratch``, which becomes ``folder``; return the content of summary.json."""
        from klute_sim.report.run_page import FIGURE_FILE, PAGE_FILE, write_run_page
        from klute_sim.report.style import save_figure

        self._write_inputs(scratch)
        (scratch / "results.csv").write_text(self._format_results(), "utf-8")
        for index, trial in enumerate(self.trials):
            parquet.write_recording(trial.recording, scratch / f"{trial.name}.parquet")
            progress(0.7 * index / len(self.trials), "writing")
        save_figure(self.plot(), scratch / FIGURE_FILE)
        files = [*sorted(file.name for file in scratch.iterdir()), PAGE_FILE, "summary.json"]
        summary = {**self.summary, "run": str(folder), "files": files}
        (scratch / "summary.json").write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", "utf-8")
        write_run_page(scratch, self.title, self.format_summary(), {FIGURE_FILE: self.figure_description})
        return summary

    def _format_results(self) -> str:
        """Return a CSV table with one row per trial; the cells of metrics that do not exist are empty."""
        keys = ["trial", *dict.fromkeys(key for trial in self.trials for key in (*trial.conditions, *trial.metrics))]
        text = io.StringIO()
        writer = csv.DictWriter(text, keys, restval="", lineterminator="\n")
        writer.writeheader()
        for trial in self.trials:
            metrics = {key: "" if math.isnan(value) else repr(value) for key, value in trial.metrics.items()}
            writer.writerow({"trial": trial.name, **trial.conditions, **metrics})
        return text.getvalue()
