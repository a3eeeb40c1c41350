"""Test a device on the simulated tensile tester: :func:`simulate_bench` and its result :class:`BenchRun`."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.inputs import DeviceLike, to_device
from klute_sim.api.rendering import Summary
from klute_sim.api.trial_run import TrialResult, TrialRun
from klute_sim.bench.protocols.library import change_protocol, parse_protocol, read_protocol_bytes
from klute_sim.bench.protocols.protocol import BenchProtocol
from klute_sim.bench.run import BenchResult, run_protocol
from klute_sim.device.device import Device
from klute_sim.files.toml import format_toml
from klute_sim.types import ProgressCallback

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEFAULT_DEVICE = "klute-3-4-pair"
"""Default device: the muscle-tendon unit of chapters 7 and 8."""


@dataclass(frozen=True, repr=False)
class BenchRun(TrialRun):
    """Result of a protocol on the simulated tensile tester: metrics and recording of every trial."""

    result: BenchResult
    """Trials with their conditions, metrics and recordings."""
    protocol_content: bytes
    """Content of the protocol file."""
    folder_kind = "bench"

    @property
    def trials(self) -> Sequence[TrialResult]:
        """Trials in order."""
        return self.result.trials

    @property
    def device(self) -> Device:
        """Device that was tested."""
        return self.result.device

    @property
    def protocol(self) -> BenchProtocol:
        """Protocol of the run."""
        return self.result.protocol

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of summary.json without the names of the files."""
        from klute_sim.report.bench.table import summarize_bench_run

        return summarize_bench_run(self.result)

    def format_summary(self) -> Summary:
        """Yield the table of the metrics, and the remarks on the run."""
        from klute_sim.report.bench.table import build_table

        yield build_table(self.result)
        yield from self.summary["remarks"]

    def __repr__(self) -> str:
        """Return one line: protocol, device and number of trials."""
        return f"BenchRun({self.protocol.name!r}, {self.device.name!r}, {len(self.result.trials)} trials)"

    def plot(self) -> "Figure":
        """Return the figure of the run, in the layout for its kind of test."""
        from klute_sim.report.bench.figure import build_figure

        return build_figure(self.result)

    @property
    def title(self) -> str:
        """Protocol and device."""
        return f"{self.protocol.name}: {self.device.name}"

    @property
    def figure_description(self) -> str:
        """What the figure of this kind of test shows."""
        from klute_sim.report.bench.figure import DESCRIPTIONS

        return DESCRIPTIONS[self.protocol.kind]

    def _write_inputs(self, folder: Path) -> None:
        (folder / "device.toml").write_bytes(self.device.content)
        (folder / "protocol.toml").write_bytes(self.protocol_content)


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
