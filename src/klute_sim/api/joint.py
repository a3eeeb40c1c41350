"""Devices on a joint, a free load or in another model: :func:`simulate_joint` and :func:`export_mjcf`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.inputs import DeviceLike, ignore_progress, to_device
from klute_sim.api.rendering import Summary
from klute_sim.api.trial_run import TrialResult, TrialRun
from klute_sim.datasets.mechanism_channels import name_files
from klute_sim.errors import InputError, suggest
from klute_sim.mechanism.export import format_mjcf
from klute_sim.mechanism.mounting import mount_devices
from klute_sim.mechanism.protocols import ProtocolSettings
from klute_sim.mechanism.run import JointTestResult, find_joint, run_joint_test
from klute_sim.plant.mjcf.model_export import build_model_files, collect_model_files, write_files
from klute_sim.plant.mjcf.model_file import load_model_file
from klute_sim.plant.mjcf.model_numbers import collect_model_numbers, set_model_numbers
from klute_sim.recording.frequency_response import (
    FrequencyResponse,
    ResponseComparison,
    compare_responses,
    read_frequency_response,
)
from klute_sim.recording.run_folder import create_run_folder
from klute_sim.types import ProgressCallback
from klute_sim.units import BAR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEFAULT_DEVICE = "klute-3-4-pair"
"""Default device on every tendon."""
DEFAULT_LOADS = {"hanging_mass": -50.0}
"""Model -> default load [N or N m] of the tests with a load; other models have :data:`DEFAULT_MOMENT`."""
DEFAULT_MOMENT = -2.0
"""Default load of the tests with a load [N m], against the first muscle."""


@dataclass(frozen=True, repr=False)
class JointRun(TrialRun):
    """Result of a test of a joint or a free load: metrics and recording of every trial."""

    result: JointTestResult
    """Trials with their conditions, metrics and recordings."""
    measured: FrequencyResponse | None = None
    """Measured frequency response that the sines are compared with."""
    folder_kind = "joint"

    @property
    def trials(self) -> Sequence[TrialResult]:
        """Trials in order."""
        return self.result.trials

    @cached_property
    def comparison(self) -> ResponseComparison | None:
        """The measured beside the simulated frequency response; None without one."""
        if self.measured is None:
            return None
        return compare_responses(self.measured, *self.result.compute_frequency_response())

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of summary.json without the names of the files."""
        from klute_sim.report.joint.response import summarize_response
        from klute_sim.report.joint.table import summarize_joint_test

        comparison = self.comparison
        response = {} if comparison is None else {"response": summarize_response(comparison)}
        return {**summarize_joint_test(self.result), **response}

    def format_summary(self) -> Summary:
        """Yield the table of the metrics, or of the measured and simulated response and what it says."""
        from klute_sim.report.joint.response import build_response_table, describe_response
        from klute_sim.report.joint.table import build_table

        if self.comparison is None:
            yield build_table(self.result)
            return
        yield build_response_table(self.comparison)
        yield from describe_response(self.comparison, self.result.unit)

    def __repr__(self) -> str:
        """Return one line: test, model and number of trials."""
        return f"JointRun({self.result.test!r}, {self.result.file.name!r}, {len(self.result.trials)} trials)"

    def plot(self) -> "Figure":
        """Return the figure of the run: all trials, or the measured and simulated frequency response."""
        from klute_sim.report.joint.figure import build_figure
        from klute_sim.report.joint.response import build_response_figure

        return build_figure(self.result) if self.comparison is None else build_response_figure(self.comparison)

    @property
    def title(self) -> str:
        """Test and model."""
        return f"{self.result.test}: {self.result.file.name}"

    @property
    def figure_description(self) -> str:
        """What the figure shows."""
        from klute_sim.report.joint.figure import DESCRIPTION
        from klute_sim.report.joint.response import RESPONSE_DESCRIPTION

        return DESCRIPTION if self.comparison is None else RESPONSE_DESCRIPTION

    def _write_inputs(self, folder: Path) -> None:
        from klute_sim.report.joint.response import format_response_csv

        for name, stem in name_files(self.result.devices).items():
            (folder / f"{stem}.toml").write_bytes(self.result.devices[name].content)
        spec = self.result.file.make_spec()
        set_model_numbers(spec, self.result.numbers)
        write_files(build_model_files(self.result.file, spec), folder)
        if self.comparison is not None:
            (folder / "response.csv").write_text(format_response_csv(self.comparison, self.result.unit), "utf-8")


def simulate_joint(
    device: DeviceLike | Mapping[str, DeviceLike] = DEFAULT_DEVICE,
    test: str = "steps",
    *,
    model: str | Path = "antagonist_joint",
    mean_pressure_bar: float = 2.5,
    difference_bar: float = 1.0,
    load: float | None = None,
    numbers: Mapping[str, float] | None = None,
    response: FrequencyResponse | str | Path | None = None,
    time_step: float = 5e-4,
    progress: ProgressCallback | None = None,
) -> JointRun:
    """Run ``test`` with a device on every tendon of ``model`` and return the run.

    Args:
        device: Device, preset or path for all tendons, or a mapping from tendons to devices.
        test: ``"steps"``, ``"sines"``, ``"multisine"``, ``"co-contraction"`` or ``"quick-release"``.
        model: ``"antagonist_joint"``, ``"hanging_mass"``, ``"knee_jig"``, or the path of an MJCF file with one joint.
        mean_pressure_bar: Mean gauge pressure [bar].
        difference_bar: Amplitude of the pressure difference [bar].
        load: External moment [N m] or force [N] of the tests with a load (default: -2 N m, or -50 N).
        numbers: Changed numbers of the model, such as ``{"model.geom.load.mass": 2}``; they follow the mounting.
        response: Measured frequency response of position over pressure difference, or the path of its CSV file (columns
            ``frequency [Hz]``, ``gain [1]`` and ``phase [deg]``); the sines get its frequencies.
        time_step: Time step [s].
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable, and SimulationError when the model diverges.
    """
    file = load_model_file(model)
    if response is not None and test != "sines":
        raise InputError(f"a measured frequency response is compared with the test 'sines', not with '{test}'")
    measured = read_frequency_response(response) if isinstance(response, str | Path) else response
    spec = file.make_spec()
    tendons = [tendon.name for tendon in spec.tendons if tendon.name]
    devices = {name: to_device(entry) for name, entry in assign_devices(device, tendons).items()}
    known = collect_model_numbers(spec)
    for name in numbers or {}:
        if name not in known:
            hint = "klute-sim bench joint --numbers lists them"
            raise InputError(f"'{name}' is not a number of the model; {suggest(name, known, hint)}")
    all_numbers = {**mount_devices(file, devices), **(numbers or {})}
    if load is None:
        load = DEFAULT_LOADS.get(file.name, DEFAULT_MOMENT)
    settings = ProtocolSettings(mean_pressure_bar * BAR, difference_bar * BAR, load)
    if measured is not None:
        joint, unit = find_joint(file)
        if measured.gain_unit not in ("1", f"{unit}/bar"):
            raise InputError(
                f"the measured gain is in {measured.gain_unit}, but the joint '{joint}' moves in {unit}; allowed: "
                f"gain [1] or gain [{unit}/bar]"
            )
        settings = settings._replace(frequencies_hz=tuple(map(float, measured.frequency)))
    result = run_joint_test(
        file, devices, all_numbers, test, settings, dt=time_step, progress=progress or ignore_progress
    )
    return JointRun(result, measured)


def export_mjcf(
    device: DeviceLike | Mapping[str, DeviceLike] = DEFAULT_DEVICE,
    folder: str | Path | None = None,
    *,
    model: str | Path = "hanging_mass",
    numbers: Mapping[str, float] | None = None,
) -> Path:
    """Write ``model`` as an MJCF file with devices on its tendons; return the folder.

    MuJoCo alone loads ``model.xml``, and the devices give no force there. Inside
    :func:`klute_sim.plant.callbacks.device_callbacks` they do. The folder also holds the device file of each tendon.

    Args:
        device: Device, preset or path for all tendons, or a mapping from those tendons that carry one to their devices.
        folder: New or empty folder. None: the next ``runs/export-NNN``.
        model: Model of the package, whose frame is moved to fit the devices, or the path of an MJCF file.
        numbers: Changed numbers of the model.

    Raises InputError when an input is not usable.
    """
    file = load_model_file(model)
    tendons = [tendon.name for tendon in file.make_spec().tendons if tendon.name]
    if not tendons:
        raise InputError(f"{file.path} has no tendon with a name, so nothing can carry a device")
    assigned = assign_devices(device, tendons, may_omit=True)
    devices = {name: to_device(entry) for name, entry in assigned.items()}
    files = collect_model_files(file, format_mjcf(file, devices, {**mount_devices(file, devices), **(numbers or {})}))
    with create_run_folder("export", folder) as (final_folder, scratch):
        write_files(files, scratch)
        for name, stem in name_files(devices).items():
            (scratch / f"{stem}.toml").write_bytes(devices[name].content)
    return final_folder


def assign_devices(
    device: DeviceLike | Mapping[str, DeviceLike], tendons: list[str], *, may_omit: bool = False
) -> dict[str, DeviceLike]:
    """Return tendon -> device.

    Raises InputError for a tendon that the model lacks and, unless a mapping ``may_omit`` tendons, for one that gets no
    device.
    """
    if not isinstance(device, Mapping):
        return dict.fromkeys(tendons, device)
    for name in device:
        if name not in tendons:
            listing = f"allowed: {', '.join(tendons)}"
            raise InputError(f"there is no tendon '{name}'; {suggest(name, tendons, listing)}")
    missing = [name for name in tendons if name not in device]
    if missing and not (may_omit and len(missing) < len(tendons)):
        raise InputError(f"tendon '{missing[0]}' has no device; name one for each of: {', '.join(tendons)}")
    return {name: device[name] for name in tendons if name in device}
