"""Test a device on the simulated tensile tester: :func:`simulate_bench` and its result :class:`BenchRun`."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.inputs import DeviceLike, to_device
from klute_sim.api.optional import import_pandas
from klute_sim.api.rendering import Summary, render_html, render_text
from klute_sim.bench.protocols.library import change_protocol, parse_protocol, read_protocol_bytes
from klute_sim.bench.protocols.protocol import BenchProtocol
from klute_sim.bench.run import BenchResult, run_protocol
from klute_sim.device.device import Device
from klute_sim.files.toml import format_toml
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.recording.run_folder import create_run_folder
from klute_sim.types import ProgressCallback

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

DEFAULT_DEVICE = "klute-3-4-pair"
"""Default device: the muscle-tendon unit of chapters 7 and 8."""


@dataclass(frozen=True, repr=False)
class BenchRun:
    """Result of a protocol on the simulated tensile tester: metrics and recording of every trial."""

    result: BenchResult
    """Trials with their conditions, metrics and recordings."""
    protocol_content: bytes
    """Content of the protocol file."""

    @property
    def device(self) -> Device:
        """Device that was tested."""
        return self.result.device

    @property
    def protocol(self) -> BenchProtocol:
        """Protocol of the run."""
        return self.result.protocol

    @property
    def table(self) -> list[dict[str, Any]]:
        """One row per trial: its name, conditions and metrics, by keys with units."""
        return [{"trial": trial.name, **trial.conditions, **trial.metrics} for trial in self.result.trials]

    @property
    def recordings(self) -> dict[str, Recording]:
        """Recording of each trial, by the name of the trial."""
        return {trial.name: trial.recording for trial in self.result.trials}

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of summary.json without the names of the files."""
        from klute_sim.report.bench.table import summarize_bench_run

        return summarize_bench_run(self.result)

    def to_pandas(self) -> "pd.DataFrame":
        """Return :attr:`table` as a pandas DataFrame with the trials as index.

        Raises MissingExtraError without pandas.
        """
        pandas = import_pandas("BenchRun.to_pandas")
        frame: pd.DataFrame = pandas.DataFrame(self.table).set_index("trial")
        return frame

    def format_summary(self) -> Summary:
        """Yield the table of the metrics, and the remarks on the run."""
        from klute_sim.report.bench.table import build_table

        yield build_table(self.result)
        yield from self.summary["remarks"]

    def __repr__(self) -> str:
        """Return one line: protocol, device and number of trials."""
        return f"BenchRun({self.protocol.name!r}, {self.device.name!r}, {len(self.result.trials)} trials)"

    def __str__(self) -> str:
        """Return the summary that the terminal shows."""
        return render_text(self.format_summary())

    def _repr_html_(self) -> str:
        return render_html(self.format_summary())

    def plot(self) -> "Figure":
        """Return the figure of the run, in the layout for its kind of test."""
        from klute_sim.report.bench.figure import build_figure

        return build_figure(self.result)

    def save(self, folder: str | Path | None = None) -> Path:
        """Write the files of ``klute-sim bench`` into ``folder`` (new or empty; default: the next ``runs/bench-NNN``).

        Returns the folder.
        """
        with create_run_folder("bench", folder) as (final_folder, scratch):
            self.write_files(scratch, final_folder)
        return final_folder

    def write_files(
        self, scratch: Path, folder: Path, progress: ProgressCallback = lambda fraction, stage: None
    ) -> dict[str, Any]:
        """Write all files into ``scratch``, which becomes ``folder``; return the content of summary.json."""
        from klute_sim.report.bench.figure import DESCRIPTIONS
        from klute_sim.report.bench.table import format_results_csv
        from klute_sim.report.run_page import FIGURE_FILE, PAGE_FILE, write_run_page
        from klute_sim.report.style import save_figure

        (scratch / "device.toml").write_bytes(self.device.content)
        (scratch / "protocol.toml").write_bytes(self.protocol_content)
        (scratch / "results.csv").write_text(format_results_csv(self.result), "utf-8")
        for index, trial in enumerate(self.result.trials):
            parquet.write_recording(trial.recording, scratch / f"{trial.name}.parquet")
            progress(0.7 * index / len(self.result.trials), "writing")
        save_figure(self.plot(), scratch / FIGURE_FILE)
        files = [*sorted(file.name for file in scratch.iterdir()), PAGE_FILE, "summary.json"]
        summary = {**self.summary, "run": str(folder), "files": files}
        (scratch / "summary.json").write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", "utf-8")
        write_run_page(
            scratch,
            f"{self.protocol.name}: {self.device.name}",
            self.format_summary(),
            {FIGURE_FILE: DESCRIPTIONS[self.protocol.kind]},
        )
        return summary


def simulate_bench(
    device: DeviceLike = DEFAULT_DEVICE,
    protocol: BenchProtocol | str | Path = "isokinetic",
    *,
    mujoco: bool = False,
    time_step: float = 5e-4,
    progress: ProgressCallback | None = None,
    **changes: Any,
) -> BenchRun:
    """Run ``protocol`` on ``device`` on the simulated tensile tester and return the run.

    The crosshead moves the whole muscle-tendon unit, and the regulator follows a pressure command.

    Args:
        device: Device, name of a preset, or path of a device file.
        protocol: Protocol, name of a protocol of the package, or path of a protocol file.
        mujoco: Whether to use the MuJoCo tester with its servo and load cell (slower). False: the device alone, with
            an ideal crosshead.
        time_step: Time step [s].
        progress: Receives the completed fraction and the current stage.
        **changes: New values of keys of the protocol, such as ``pressures_bar=[3, 5]``; a number stands for a list
            with one entry.

    Raises InputError when an input is not usable or the device cannot run the protocol.
    """
    if isinstance(protocol, BenchProtocol):
        chosen_protocol = protocol
        content = format_toml(protocol.model_dump()).encode()
    else:
        content = read_protocol_bytes(protocol)
        chosen_protocol = parse_protocol(content, str(protocol))
    if changes:
        chosen_protocol = change_protocol(chosen_protocol, changes)
        content = format_toml(chosen_protocol.model_dump()).encode()
    report = progress or (lambda fraction, stage: None)
    result = run_protocol(to_device(device), chosen_protocol, use_mujoco=mujoco, dt=time_step, progress=report)
    return BenchRun(result, content)
