"""Simulate gait with a prosthesis on the gait rig: :func:`simulate_gait` and its result :class:`GaitRun`."""

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from klute_sim.api.inputs import (
    ControllerLike,
    DeviceLike,
    ignore_progress,
    to_controller,
    to_device,
)
from klute_sim.api.recorded_run import RecordedRun
from klute_sim.api.rendering import Summary
from klute_sim.controllers.learned import PolicyController
from klute_sim.controllers.parse import Controller
from klute_sim.controllers.pressure import ConstantPressure, PressureProfile, create_off_controller
from klute_sim.device.device import DEFAULT_DEVICE, Device, load_device, parse_device, set_number
from klute_sim.errors import InputError
from klute_sim.files.toml import format_toml, parse_toml
from klute_sim.gait.code_digest import describe_policy_code
from klute_sim.gait.metrics import GaitMetrics, compute_gait_metrics, compute_reference_metrics
from klute_sim.gait.reference import Reference
from klute_sim.gait.rig import rig
from klute_sim.gait.rig.hip_path import HipPath
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.gait.subject import ReferenceLike, resolve_subject
from klute_sim.gait.summary import summarize_gait_run
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.types import ProgressCallback
from klute_sim.units import BAR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INPUT_KEYS = (
    "mass_kg", "stature_m", "slope_deg", "strides", "reference_speed_m_per_s", "spring_foot_nm_per_deg",
)  # fmt: skip
"""Numeric keys of the summary that are inputs and not metrics."""


@dataclass(frozen=True, repr=False)
class GaitRun(RecordedRun):
    """A simulated gait run: the recording of every time step, and the metrics of every stride."""

    kind: ClassVar[str] = "gait"
    device: Device | None
    """Device that was simulated; None: a spring foot."""
    options: GaitOptions
    """Subject, speed, slope, strides and time step of the run."""
    recording: Recording
    """Channels of the run, one sample per time step."""
    warnings: tuple[str, ...] = ()
    """Sentences on inputs that the run could not follow, such as a pressure command above the supply."""

    @property
    def title(self) -> str:
        """Title of the page of the run."""
        return f"Gait with {self.recording.provenance['device']['name']}"

    @property
    def figure_description(self) -> str:
        """Text that stands for the figure where it cannot be seen."""
        from klute_sim.report.gait.figure import DESCRIPTION

        return DESCRIPTION

    @property
    def reference(self) -> Reference:
        """Reference gait that the rig follows and the metrics are compared with."""
        return self.options.reference

    @cached_property
    def gait_metrics(self) -> GaitMetrics:
        """Metrics of every stride."""
        return compute_gait_metrics(self.recording)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of summary.json: inputs, means over the steady strides, and the metrics of every stride."""
        return summarize_gait_run(self.recording, self.gait_metrics)

    @property
    def metrics(self) -> dict[str, float | bool | None]:
        """Mean of each metric over the steady strides, such as ``metrics["ankle_work_net_j_per_kg"]``."""
        return {
            name: value
            for name, value in self.summary.items()
            if name not in INPUT_KEYS and (value is None or isinstance(value, bool | float))
        }

    def format_summary(self) -> Summary:
        """Yield the main results in one sentence, the table of the metrics, and the remarks on the run."""
        from klute_sim.report.gait.headline import format_headline
        from klute_sim.report.gait.table import build_table, collect_remarks

        yield format_headline(self.summary, compute_reference_metrics(self.recording))
        yield build_table(self.recording, self.gait_metrics)
        yield from collect_remarks(self.summary)

    def format_strides(self) -> Summary:
        """Yield the table of the last strides beside each other, with their standard deviation."""
        from klute_sim.report.gait.table import build_stride_table

        yield build_stride_table(self.recording, self.gait_metrics)

    def __repr__(self) -> str:
        """Return one line: device, number of strides, and speed."""
        options = self.recording.provenance["options"]
        name = self.recording.provenance["device"]["name"]
        return f"GaitRun({name!r}, {self.options.strides} strides, {options['speed_m_per_s']:.2f} m/s)"

    def plot(self) -> "Figure":
        """Return the figure of the last stride over the reference."""
        from klute_sim.report.gait.figure import build_figure

        return build_figure(self.recording)

    def _write_inputs(self, scratch: Path) -> None:
        if self.device is not None:
            align = self.recording.provenance["options"]["alignment_deg"]
            (scratch / "device.toml").write_bytes(state_alignment(self.device, align).content)

    def _write_view(self, scratch: Path) -> None:
        from klute_sim.gait.rig.build import build_gait_model
        from klute_sim.viewer.layouts import gait as layout

        foot_name = self.recording.provenance["foot"]["name"]
        options, device = self.options, self.device or load_device(DEFAULT_DEVICE).with_foot(foot_name)
        alignment = math.radians(self.recording.provenance["options"]["alignment_deg"])
        model = build_gait_model(device, mass=options.mass, stature=options.stature, dt=options.dt, alignment=alignment)
        layout.write_recording(self.recording, model, scratch / "recording.rrd")


def simulate_gait(
    device: DeviceLike | None = None,
    *,
    controller: ControllerLike | None = None,
    mass: float | None = None,
    stature: float | None = None,
    speed: float | None = None,
    slope: float = 0.0,
    strides: int = 5,
    time_step: float = 5e-4,
    reference: ReferenceLike = None,
    stride_time: float | None = None,
    accept: Collection[str] = (),
    spring_foot: float | None = None,
    foot: str | None = None,
    alignment: float | None = None,
    learning_strides: int = 40,
    hip_path: "GaitRun | str | Path | None" = None,
    backend: str = "auto",
    progress: ProgressCallback | None = None,
) -> GaitRun:
    """Simulate gait with ``device`` on the gait rig and return the run.

    The residual limb follows the motion of the reference, and the rig learns the path of the hip with which the foot
    carries its load. The ankle is moved only by the device, its passive parts and the ground: ankle angle, moment,
    power and work are predictions.

    Args:
        device: Device, name of a preset, or path of a device file. None: ``"klute-1-1-4-pair"``, or a spring foot.
        controller: Controller, or its specification: ``"profile"``, ``"off"``, ``"constant:BAR"``, ``"machine"``, or
            the path of a profile (.csv), a state machine (.toml) or a policy (.npz). None: ``"profile"``, or ``"off"``
            with a spring foot.
        mass: Body mass [kg]. None: the mass that the reference states, or 75.
        stature: Stature [m]. None: the stature that the reference states, or 1.75.
        speed: Walking speed [m/s]; it scales the stride time. None: the speed that reference and leg length imply.
        slope: Ground slope [deg], uphill positive; limb kinematics on slopes are assumed.
        strides: Number of strides.
        time_step: Time step [s].
        reference: Reference gait, or the path of its file or folder. None: able-bodied adults.
        stride_time: Stride time of the reference file [s]. None: the time that its folder states, or 1.1.
        accept: Names of findings about the reference file that are right although they look implausible.
        spring_foot: Stiffness of a passive foot, which replaces the device [N.m/deg]. None: the device.
        foot: Foot below the ankle, such as ``"sach"`` or, in a shoe, ``"sach+shoe"``. None: that of the device.
        alignment: Angle by which the prosthesis is turned against the limb [deg], dorsiflexion positive. None: that of
            the device file, or the one with which the hanging foot meets the ground as that of the reference does.
        learning_strides: Largest number of strides in which the rig learns the path of the hip before the run, until
            the foot carries the load of the reference. 0: the planned path.
        hip_path: Gait run, or its folder, whose path of the hip is used again instead of learning one.
        backend: ``"compiled"``, ``"python"`` (the same bits), or ``"auto"``: compiled if possible.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable, SimulationError when the rig leaves its path.
    """
    if spring_foot is not None and device is not None:
        raise InputError("a spring foot replaces the device; leave out either the device or the spring foot")
    chosen_device = to_device(DEFAULT_DEVICE if device is None else device, foot)  # a spring foot uses its geometry
    chosen_controller = to_controller(_default_controller(spring_foot) if controller is None else controller)
    if spring_foot is not None and chosen_controller != create_off_controller():
        raise InputError("a spring foot takes no pressure command; leave out the controller, or set it to off")
    chosen_foot = None if spring_foot is None else SpringFoot(stiffness=math.degrees(spring_foot))
    warnings = check_supply_pressure(chosen_device, chosen_controller)
    subject = resolve_subject(
        reference, stride_time=stride_time, accept=accept, mass=mass, stature=stature, speed=speed, slope=slope
    )
    options = replace(
        subject.build_options(strides, time_step, chosen_foot),
        alignment=None if alignment is None else math.radians(alignment),
        learning_strides=learning_strides,
        hip_path=None if hip_path is None else load_hip_path(hip_path),
    )
    warnings += subject.remarks
    if isinstance(chosen_controller, PolicyController):
        code_note = describe_policy_code(chosen_controller.metadata)
        warnings += (code_note,) if code_note else ()
    recording = rig.simulate_gait(chosen_device, chosen_controller, options, progress or ignore_progress, backend)
    warnings += report_rounded_stride_time(recording, options)
    return GaitRun(None if chosen_foot else chosen_device, options, recording, warnings)


def load_hip_path(source: "GaitRun | str | Path") -> HipPath:
    """Return the path of the hip of a gait run, or of the folder of one; raises InputError when there is none."""
    if isinstance(source, GaitRun):
        return HipPath.from_mapping(source.recording.provenance.get("hip_path"), "the gait run")
    file = Path(source) / "recording.parquet" if Path(source).is_dir() else Path(source)
    return HipPath.from_mapping(parquet.load_recording(file).provenance.get("hip_path"), str(source))


def state_alignment(device: Device, alignment_deg: float) -> Device:
    """Return ``device`` with the alignment [deg] of a run in its file; the device itself if its file states it."""
    mounting, alignment_deg = device.spec.mounting, round(alignment_deg, 3)
    if mounting is None or (mounting.alignment_deg is not None and round(mounting.alignment_deg, 3) == alignment_deg):
        return device
    content = parse_toml(device.content, f"device {device.name}")
    set_number(content, "mounting.alignment_deg", alignment_deg, "alignment of the gait run")
    return parse_device(format_toml(content).encode(), device.name)


MIN_STATED_ERROR = 1e-3
"""Smallest relative error of the stride time that is stated (assumed); people vary by far more."""


def report_rounded_stride_time(recording: Recording, options: GaitOptions) -> tuple[str, ...]:
    """Return a sentence if the time step does not divide the stride time of the reference, which a stride then misses.

    Errors below :data:`MIN_STATED_ERROR` are not stated.
    A given speed sets the stride time, so there is nothing to miss.
    """
    stride_time, walked = options.reference.stride_time, float(recording.provenance["options"]["stride_time_s"])
    if options.speed is not None or math.isclose(walked, stride_time, rel_tol=MIN_STATED_ERROR):
        return ()
    return (
        f"A stride takes {walked:.6g} s instead of the {stride_time:.6g} s of the reference, because it has a whole "
        f"number of time steps of {1e3 * options.dt:g} ms; a step that divides it keeps it.",
    )


def check_supply_pressure(device: Device, controller: Controller) -> tuple[str, ...]:
    """Return a warning if the profile of ``controller`` exceeds the supply pressure of ``device``.

    Raises InputError for a constant pressure above the supply.
    """
    supply = device.parameters.supply.max_pressure / BAR
    if isinstance(controller, ConstantPressure) and controller.gauge_pressure / BAR > supply:
        raise InputError(
            f"the controller commands {controller.gauge_pressure / BAR:g} bar; "
            f"the supply of '{device.name}' has {supply:g} bar"
        )
    if isinstance(controller, PressureProfile) and max(controller.pressure_bar) > supply:
        return (
            f"The profile commands up to {max(controller.pressure_bar):g} bar; the supply has only {supply:g} bar.",
        )
    return ()


def _default_controller(spring_foot: float | None) -> str:
    return "profile" if spring_foot is None else "off"
