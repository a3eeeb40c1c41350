"""Size actuators, damper and tendon for a walker or a muscle: :func:`design` and its result :class:`DesignResult`."""

import json
import shlex
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.inputs import ReferenceLike, to_reference
from klute_sim.api.rendering import Summary, render_html, render_text
from klute_sim.controllers.pressure import PressureProfile, profile_to_csv
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.gait.rig.build import MODEL_STATURE, build_gait_model
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
class DesignResult:
    """A sized device, its performance, and its sensitivity to every assumption."""

    design: Design
    """Sized device with its requirement and its performance."""
    sensitivities: tuple[SensitivityResult, ...]
    """Metrics of the design for other values of each assumption."""
    reference_path: str | None = None
    """Path of the reference gait, if the user gave one."""

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
        return {**content, "remarks": collect_remarks(content)}

    def _format_gait_command(self, folder: Path) -> str | None:
        """Return the command that simulates gait with the design in ``folder``; None without a walker."""
        target = self.design.target
        if not isinstance(target, WalkerTarget):
            return None
        device, profile = folder / "device.toml", folder / "profile.csv"
        words = ["--device", device, "--controller", profile, "--mass", repr(target.mass).removesuffix(".0")]
        reference = [] if self.reference_path is None else ["--reference", self.reference_path]
        reference += [f"--accept={finding.name}" for finding in target.reference.accepted]
        return shlex.join(["klute-sim", "gait", *map(str, [*words, *reference])])

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

    def __str__(self) -> str:
        """Return the summary that the terminal shows."""
        return render_text(self.format_summary())

    def _repr_html_(self) -> str:
        return render_html(self.format_summary())

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
        from klute_sim.report.style import COMPACT_DPI

        if self.profile is not None:
            (scratch / "profile.csv").write_text(profile_to_csv(self.profile), "utf-8")
        (scratch / "device.toml").write_bytes(self.device.content)
        self.plot().savefig(scratch / "figure.png", dpi=COMPACT_DPI)
        files = sorted([*(file.name for file in scratch.iterdir()), "summary.json"])
        content = {**self._summarize(folder), "run": str(folder), "files": files}
        (scratch / "summary.json").write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", "utf-8")
        return content


def design(
    *,
    mass: float | None = None,
    reference: ReferenceLike = None,
    accept: Collection[str] = (),
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

    Target: ``reference`` (gait of the walker; ``accept`` names findings about its file that are right although they
    look implausible), or ``muscle`` (name of a row of Table 2.4, or a target) with ``isometric_force`` F0 [N] and
    ``muscle_length`` l0 [m]; ``peak_velocity`` Vmax [m/s], ``a`` (a/F0), ``b`` (b/Vmax) and ``saturation`` (eccentric
    force over F0) of Hill's equation.

    Choices: ``supply_pressure`` [Pa], ``actuator`` (preset), ``count`` and ``resting_length`` L0 [m] of the actuators;
    ``bore`` [m], ``cylinder_pressure`` [Pa], ``eccentric_speed`` [m/s] and ``eccentric_force`` [N] of the damper;
    ``moment_arm`` [m] and ``tendon_strain`` [1] of the tendon; ``name`` of the device.

    Raises InputError when the options exclude each other or no such device can be sized.
    """
    if not name:
        raise InputError("name is empty: give the device a name")
    values = {"isometric_force": isometric_force, "muscle_length": muscle_length, "muscle": muscle}
    for option, value in values.items():
        if mass is not None and value is not None:
            raise InputError(f"{option} and mass exclude each other: the mass determines force and length")
    if mass is None and reference is not None:
        raise InputError("reference requires mass: only a subject has a gait")
    if mass is None and moment_arm is not None:
        raise InputError("moment_arm requires mass: only a subject has an ankle that moves the tendon")
    if mass is None and muscle is None and isometric_force is None and (actuator is None or count is None):
        raise InputError("no target: give mass, muscle or isometric_force, or both actuator and count")
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
    if mass is None:
        sized = design_device(target, choices, name)
    else:
        sized = design_device(
            WalkerTarget(mass=mass, reference=to_reference(reference, accept=accept), muscle=target), choices, name
        )
        # Raises InputError for a device that does not fit into the shank of the gait rig.
        build_gait_model(sized.device, mass=mass, stature=MODEL_STATURE, dt=1e-3)
    report = progress if progress is not None else lambda fraction, stage: None
    path = str(reference) if isinstance(reference, str | Path) else None
    return DesignResult(sized, tuple(analyse_sensitivity(sized, report)), path)


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
