"""Size actuators, damper and tendon for a walker or a muscle: :func:`design` and its result :class:`DesignResult`."""

import json
import math
import shlex
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.rendering import Printable, Summary
from klute_sim.controllers.pressure import PressureProfile, profile_to_csv
from klute_sim.device.device import DEFAULT_DEVICE, Device, load_device
from klute_sim.errors import InputError
from klute_sim.gait.reference import Reference
from klute_sim.gait.rig.build import build_gait_model
from klute_sim.gait.rig.setup import build_gait_rig
from klute_sim.gait.subject import ReferenceLike, Subject, resolve_subject
from klute_sim.recording.run_folder import create_run_folder
from klute_sim.sizing.choices import DesignAssumptions, DesignChoices
from klute_sim.sizing.sensitivity import SensitivityResult, analyse_sensitivity
from klute_sim.sizing.sizing import Design, design_device
from klute_sim.sizing.summary import build_summary
from klute_sim.sizing.target import MuscleTarget, WalkerTarget, load_table_target
from klute_sim.types import ProgressCallback

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class DesignResult(Printable):
    """A sized device, its performance, and its sensitivity to every assumption."""

    design: Design
    """Sized device with its requirement and its performance."""
    sensitivities: tuple[SensitivityResult, ...]
    """Metrics of the design for other values of each assumption."""
    subject: Subject | None = None
    """Person who walks; None for a muscle."""
    gait_arguments: tuple[str, ...] = ()
    """Arguments of ``klute-sim gait`` that select this person."""

    @property
    def device(self) -> Device:
        """Sized device."""
        return self.design.device

    @property
    def profile(self) -> PressureProfile | None:
        """Tuned pressure profile transferred to this device and walker; None without a walker."""
        return self.design.profile

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of summary.json, except for the names of folder and files."""
        return self._summarize(Path())

    def _summarize(self, folder: Path) -> dict[str, Any]:
        from klute_sim.report.design.table import collect_remarks

        content = build_summary(self.design, list(self.sensitivities)) | {"gait": self._format_gait_command(folder)}
        if self.subject is None:
            return {**content, "remarks": collect_remarks(content)}
        assumptions = [*_describe_assumptions(self.subject), *self.subject.remarks]
        return {**content, "subject": self.subject.describe(), "remarks": [*collect_remarks(content), *assumptions]}

    def _format_gait_command(self, folder: Path) -> str | None:
        """Return the command that simulates gait with the design in ``folder``; None without a walker."""
        if self.subject is None:
            return None
        device, profile = folder / "device.toml", folder / "profile.csv"
        words = ["--device", str(device), "--controller", str(profile), *self.gait_arguments]
        return shlex.join(["klute-sim", "gait", *words])

    def format_summary(self, summary: dict[str, Any] | None = None) -> Summary:
        """Yield the tables and remarks of the design, or of a ``summary`` that :meth:`write_files` returned."""
        from klute_sim.report.design.table import build_tables

        content = self.summary if summary is None else summary
        yield from build_tables(content)
        yield from content["remarks"]

    def __repr__(self) -> str:
        """Return one line: device and actuators."""
        selected = self.design.selected
        return f"DesignResult({self.device.name!r}, {selected.count} x {selected.actuator})"

    def plot(self) -> "Figure":
        """Return the figure of the force-velocity curves, the orifices and the demand of a stride."""
        from klute_sim.report.design.figure import build_figure

        return build_figure(self.design)

    def save(self, folder: str | Path | None = None) -> Path:
        """Write the files of ``klute-sim design`` into ``folder`` (new or empty; default: next ``runs/design-NNN``).

        Returns the folder.
        """
        with create_run_folder("design", folder) as (final_folder, scratch):
            self.write_files(scratch, final_folder)
        return final_folder

    def write_files(self, scratch: Path, folder: Path) -> dict[str, Any]:
        """Write all files into ``scratch``, which becomes ``folder``; returns the content of summary.json."""
        from klute_sim.report.design.figure import DESCRIPTION
        from klute_sim.report.run_page import FIGURE_FILE, PAGE_FILE, write_run_page
        from klute_sim.report.style import save_figure

        if self.profile is not None:
            (scratch / "profile.csv").write_text(profile_to_csv(self.profile), "utf-8")
        (scratch / "device.toml").write_bytes(self.device.content)
        save_figure(self.plot(), scratch / FIGURE_FILE)
        files = sorted([*(file.name for file in scratch.iterdir()), PAGE_FILE, "summary.json"])
        content = {**self._summarize(folder), "run": str(folder), "files": files}
        (scratch / "summary.json").write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", "utf-8")
        title = f"Design {self.device.name}"
        write_run_page(scratch, title, self.format_summary(content), {FIGURE_FILE: DESCRIPTION})
        return content


def design(
    *,
    mass: float | None = None,
    reference: ReferenceLike = None,
    stride_time: float | None = None,
    accept: Collection[str] = (),
    stature: float | None = None,
    speed: float | None = None,
    slope: float = 0.0,
    muscle: str | MuscleTarget | None = None,
    isometric_force: float | None = None,
    muscle_length: float | None = None,
    peak_velocity: float | None = None,
    a: float | None = None,
    b: float | None = None,
    saturation: float | None = None,
    supply_pressure: float | None = None,
    actuator: str | None = None,
    count: int | None = None,
    resting_length: float | None = None,
    bore: float | None = None,
    cylinder_pressure: float | None = None,
    eccentric_speed: float | None = None,
    eccentric_force: float | None = None,
    moment_arm: float | None = None,
    tendon_strain: float | None = None,
    name: str = "klute-design",
    progress: ProgressCallback | None = None,
) -> DesignResult:
    """Size actuators, damper and tendon for a walker of ``mass`` [kg] or for a muscle; None selects the design rule.

    Target: ``mass`` or ``reference`` (gait of the walker, which may state the mass; ``accept`` names findings about its
    file that are right although they look implausible) with ``stride_time`` [s], ``stature`` [m], ``speed`` [m/s] and
    ``slope`` [deg] as in :func:`klute_sim.api.gait.simulate_gait`; or ``muscle`` (name of a row of Table 2.4, or a
    target) with ``isometric_force`` F0 [N] and ``muscle_length`` l0 [m]; ``peak_velocity`` Vmax [m/s], ``a`` (a/F0),
    ``b`` (b/Vmax) and ``saturation`` (eccentric force over F0) of Hill's equation.

    Choices: ``supply_pressure`` [Pa], ``actuator`` (preset), ``count`` and ``resting_length`` L0 [m] of the actuators;
    ``bore`` [m], ``cylinder_pressure`` [Pa], ``eccentric_speed`` [m/s] and ``eccentric_force`` [N] of the damper;
    ``moment_arm`` [m] and ``tendon_strain`` [1] of the tendon; ``name`` of the device.

    Raises InputError when the options exclude each other or no such device can be sized.
    """
    if not name:
        raise InputError("name is empty: give the device a name")
    is_walker = mass is not None or reference is not None
    values = {"isometric_force": isometric_force, "muscle_length": muscle_length, "muscle": muscle}
    for option, value in values.items():
        if is_walker and value is not None:
            subject_option = "reference" if mass is None else "mass"
            raise InputError(
                f"{option} and {subject_option} exclude each other: the subject determines force and length"
            )
    walker_options = _drop_none(
        moment_arm=moment_arm, stride_time=stride_time, stature=stature, speed=speed, slope=slope or None
    )
    if not is_walker and walker_options:
        raise InputError(f"{next(iter(walker_options))} requires mass or reference: only a subject walks")
    if not is_walker and muscle is None and isometric_force is None and (actuator is None or count is None):
        raise InputError("no target: give mass, reference, muscle or isometric_force, or both actuator and count")
    target = _build_muscle(muscle, isometric_force, muscle_length, peak_velocity, a, b, saturation)
    assumed = _drop_none(cylinder_pressure=cylinder_pressure, moment_arm=moment_arm, tendon_strain=tendon_strain)
    hill_constants = {"a"} if a is not None or muscle is not None else set()
    hill_constants |= {"b"} if b is not None or muscle is not None else set()
    choices = DesignChoices(
        actuator=actuator,
        count=count,
        assumptions=DesignAssumptions(**assumed),
        explicit_fields=frozenset({*assumed, *hill_constants}),
        **_drop_none(
            supply_pressure=supply_pressure,
            resting_length=resting_length,
            bore=bore,
            eccentric_speed=eccentric_speed,
            eccentric_force=eccentric_force,
        ),
    )
    report = progress if progress is not None else lambda fraction, stage: None
    if not is_walker:
        sized = design_device(target, choices, name)
        return DesignResult(sized, tuple(analyse_sensitivity(sized, report)))
    subject = resolve_subject(
        reference, stride_time=stride_time, accept=accept, mass=mass, stature=stature, speed=speed, slope=slope
    )
    if mass is None and subject.reference.mass is None:
        raise InputError(f"reference {subject.reference.name} states no body mass: give mass")
    walker = WalkerTarget(mass=subject.mass, reference=_build_walking_reference(subject), muscle=target)
    sized = design_device(walker, choices, name)
    # Raises InputError for a device that does not fit into the shank of the gait rig.
    build_gait_model(sized.device, mass=subject.mass, stature=subject.stature, dt=1e-3)
    path = str(reference) if isinstance(reference, str | Path) else None
    given = {"reference": path, "stride-time": stride_time, "mass": mass, "stature": stature, "speed": speed}
    arguments = _format_arguments({**given, "slope": slope or None})
    arguments += [f"--accept={finding.name}" for finding in subject.reference.accepted]
    return DesignResult(sized, tuple(analyse_sensitivity(sized, report)), subject, tuple(arguments))


def _build_walking_reference(subject: Subject) -> Reference:
    """Return the reference of ``subject`` on the slope, with the stride time at the walking speed."""
    reference = subject.reference.tilt_to_slope(math.radians(subject.slope_deg))
    if subject.speed is None:
        return reference
    rig = build_gait_rig(load_device(DEFAULT_DEVICE), subject.build_options(), 1e-3)
    return replace(reference, stride_time=rig.trajectory.stride_time)


def _describe_assumptions(subject: Subject) -> list[str]:
    conditions = [
        *([] if subject.speed is None else [f"at {subject.speed:g} m/s"]),
        *([] if subject.slope_deg == 0.0 else [f"on a slope of {subject.slope_deg:g} degrees"]),
    ]
    if not conditions:
        return []
    return [f"Assumed: {' and '.join(conditions)}, the ankle moment over the gait cycle is that of the reference."]


def _format_arguments(values: dict[str, Any]) -> list[str]:
    """Return the options of a command for the ``values`` that are not None."""
    words = []
    for name, value in values.items():
        if value is not None:
            words += [f"--{name}", value if isinstance(value, str) else repr(float(value)).removesuffix(".0")]
    return words


def _build_muscle(
    muscle: str | MuscleTarget | None,
    isometric_force: float | None,
    muscle_length: float | None,
    peak_velocity: float | None,
    a: float | None,
    b: float | None,
    saturation: float | None,
) -> MuscleTarget:
    target = load_table_target(muscle) if isinstance(muscle, str) else muscle or MuscleTarget()
    hill = target.hill._replace(**_drop_none(a=a, b=b, saturation=saturation))
    sizes = _drop_none(isometric_force=isometric_force, resting_length=muscle_length, peak_velocity=peak_velocity)
    return replace(target, hill=hill, **sizes)


def _drop_none(**values: float | None) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}
