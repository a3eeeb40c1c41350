"""What a simulated run with a recording has in common: how it prints itself, and the files of its folder."""

import json
from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from klute_sim.api.rendering import Printable
from klute_sim.errors import MissingExtraError
from klute_sim.recording import csv, parquet
from klute_sim.recording.recording import Recording
from klute_sim.recording.run_folder import create_run_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class RecordedRun(Printable):
    """A run with a recording; a subclass gives its summary, its figure and its inputs."""

    kind: ClassVar[str]
    """Name of the command and of its folders."""
    recording: Recording
    """Channels of the run, one sample per time step."""
    warnings: tuple[str, ...]
    """Sentences on inputs that the run could not follow."""

    @property
    @abstractmethod
    def title(self) -> str:
        """Title of the page of the run."""

    @property
    @abstractmethod
    def figure_description(self) -> str:
        """Text that stands for the figure where it cannot be seen."""

    @property
    @abstractmethod
    def summary(self) -> dict[str, Any]:
        """Content of summary.json."""

    @abstractmethod
    def plot(self) -> "Figure":
        """Return the figure of the run."""

    @abstractmethod
    def _write_inputs(self, scratch: Path) -> None:
        """Write the files that state the inputs of the run, such as device.toml, into ``scratch``."""

    @abstractmethod
    def _write_view(self, scratch: Path) -> None:
        """Write recording.rrd into ``scratch``; raises MissingExtraError without the extra 'rerun'."""

    def save(self, folder: str | Path | None = None, *, with_csv: bool = False) -> Path:
        """Write the files of the command into ``folder`` (new or empty; default: the next ``runs/KIND-NNN``).

        Returns the folder. Without the extra 'rerun', recording.rrd is left out.
        """
        with create_run_folder(self.kind, folder) as (final_folder, scratch):
            self.write_files(scratch, final_folder, with_csv=with_csv)
        return final_folder

    def write_files(
        self,
        scratch: Path,
        folder: Path,
        *,
        with_csv: bool = False,
        progress: Callable[[float], None] = lambda fraction: None,
    ) -> tuple[dict[str, Any], list[str]]:
        """Write all files into ``scratch``, which becomes ``folder``.

        Returns the content of summary.json, and sentences on optional files that are left out.
        """
        from klute_sim.report.run_page import FIGURE_FILE, PAGE_FILE, write_run_page
        from klute_sim.report.style import save_figure

        notes = []
        self._write_inputs(scratch)
        parquet.write_recording(self.recording, scratch / "recording.parquet")
        if with_csv:
            csv.write(self.recording, scratch / "recording.csv")
        progress(0.3)
        save_figure(self.plot(), scratch / FIGURE_FILE)
        progress(0.6)
        try:
            self._write_view(scratch)
        except MissingExtraError as error:
            notes.append(f"No recording.rrd: {error}.")
        files = [*sorted(file.name for file in scratch.iterdir()), PAGE_FILE, "summary.json"]
        content = {**self.summary, "run": str(folder), "files": files}
        (scratch / "summary.json").write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", "utf-8")
        summary = [*self.format_summary(), *self.warnings]
        write_run_page(scratch, self.title, summary, {FIGURE_FILE: self.figure_description})
        return content, notes
