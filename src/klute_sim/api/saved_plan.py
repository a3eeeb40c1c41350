"""What plans of measurements share: they print their trials, and write command files and instructions."""

from abc import abstractmethod
from collections.abc import Iterator
from pathlib import Path

from klute_sim.api.rendering import Printable
from klute_sim.recording.run_folder import create_run_folder


class SavedPlan(Printable):
    """Plan of measurements that is written into a folder."""

    simulate: bool
    """Whether the plan contains simulated recordings."""

    @abstractmethod
    def _write(self, folder: Path) -> None:
        """Write all files into the existing ``folder``."""

    def _describe_origin(self) -> Iterator[str]:
        if self.simulate:
            yield "The recordings are simulated, not measured."

    def save(self, folder: str | Path) -> Path:
        """Write the files of ``klute-sim plan`` into ``folder`` (new or empty); return the folder."""
        with create_run_folder("plan", folder) as (final_folder, scratch):
            self.write_files(scratch)
        return final_folder

    def write_files(self, folder: Path) -> list[str]:
        """Write all files into the existing ``folder``; return their names."""
        self._write(folder)
        return sorted(file.name for file in folder.iterdir())
