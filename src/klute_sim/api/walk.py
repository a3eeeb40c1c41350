"""Simulate a person who walks by muscles and reflexes: :func:`simulate_walk` and its result :class:`WalkRun`."""

import json
import math
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from klute_sim.api.gait import check_supply_pressure
from klute_sim.api.inputs import ControllerLike, DeviceLike, ignore_progress, to_controller, to_device
from klute_sim.api.recorded_run import RecordedRun
from klute_sim.api.rendering import Summary
from klute_sim.controllers.parse import Controller
from klute_sim.device.device import DEFAULT_DEVICE, Device
from klute_sim.errors import InputError
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.recording.recording import Recording
from klute_sim.types import ProgressCallback
from klute_sim.walker.outcomes import WalkOutcomes, compute_outcomes
from klute_sim.walker.person.build import Ground, Prosthesis
from klute_sim.walker.reflexes.walker_file import Walker, list_walkers, load_walker, select_walker
from klute_sim.walker.simulation import simulate
from klute_sim.walker.simulation.simulate import WalkOptions, describe_prosthesis
from klute_sim.walker.simulation.walk import Push

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

DEFAULT_CONTROLLER = "machine"
"""Controller where the user names none: the one that the shipped walkers have adapted to."""


@dataclass(frozen=True, repr=False)
class WalkRun(RecordedRun):
    """A simulated walk: the recording of every time step, and its outcomes."""

    kind: ClassVar[str] = "walk"
    device: Device | None
    """Device that was simulated; None: a spring foot, or two legs of flesh."""
    walker: Walker
    """Walker that walked."""
    recording: Recording
    """Channels of the walk, one sample per time step."""
    warnings: tuple[str, ...] = ()
    """Sentences on inputs that the walk could not follow."""

    @property
    def title(self) -> str:
        """Title of the page of the walk."""
        return f"Predicted walk: {self.summary['prosthesis'] or 'intact person'}"

    @property
    def figure_description(self) -> str:
        """Text that stands for the figure where it cannot be seen."""
        from klute_sim.report.walk.figure import DESCRIPTION

        return DESCRIPTION

    @cached_property
    def outcomes(self) -> WalkOutcomes:
        """Outcomes of the walk beside able-bodied adults."""
        return compute_outcomes(self.recording)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of summary.json: inputs and outcomes, in JSON types."""
        provenance = self.recording.provenance
        outcomes = asdict(self.outcomes)
        legs = {
            side: {key: value for key, value in leg.items() if key not in ("curves", "deviations")}
            for side, leg in outcomes.pop("legs").items()
        }
        return {
            "kind": provenance["kind"],
            "prosthesis": None if provenance["prosthesis"] is None else provenance["prosthesis"]["name"],
            "controller": provenance["controller"],
            "walker": provenance["walker"],
            "is_acute": provenance["is_acute"],
            **{key: value for key, value in provenance["options"].items() if key != "backend"},
            "has_been_pushed": bool(np.any(self.recording["push"])),
            **outcomes,
            "legs": legs,
        }

    def format_summary(self) -> Summary:
        """Yield the main results in one sentence, the table of the outcomes, and the remarks on the walk."""
        from klute_sim.report.walk.table import build_table, collect_remarks, format_headline

        yield format_headline(self.summary)
        if self.summary["legs"]:
            yield build_table(self.summary)
        yield from collect_remarks(self.summary)

    def __repr__(self) -> str:
        """Return one line: prosthesis, walker and duration."""
        prosthesis = self.summary["prosthesis"] or "two legs"
        return f"WalkRun({prosthesis!r}, walker {self.walker.name!r}, {self.outcomes.duration_s:.1f} s)"

    def plot(self) -> "Figure":
        """Return the figure of the mean stride of both legs over the reference."""
        from klute_sim.report.walk.figure import build_figure

        return build_figure(self.recording, self.outcomes)

    def _write_inputs(self, scratch: Path) -> None:
        if self.device is not None:
            (scratch / "device.toml").write_bytes(self.device.content)
        (scratch / "walker.toml").write_text(self.walker.to_toml(), "utf-8")

    def _write_view(self, scratch: Path) -> None:
        from klute_sim.viewer.layouts import walk as layout

        layout.write_recording(self.recording, layout.build_model(self.recording, scratch), scratch / "recording.rrd")


def simulate_walk(
    device: DeviceLike | None = None,
    *,
    controller: ControllerLike | None = None,
    spring_foot: float | None = None,
    intact: bool = False,
    foot: str | None = None,
    alignment: float | None = None,
    walker: Walker | str | Path | None = None,
    seconds: float = 20.0,
    push: tuple[float, float] | None = None,
    uneven: float = 0.0,
    slope: float = 0.0,
    seed: int = 0,
    time_step: float = 1e-3,
    backend: str = "auto",
    progress: ProgressCallback | None = None,
) -> WalkRun:
    """Simulate a person with ``device`` who walks by muscles and reflexes, and return the walk.

    Nothing prescribes the motion or the load: speed, steps, ground reactions, joint angles, metabolic cost and falls
    are predictions of a planar model of 7 segments and 14 muscles (75 kg, 1.75 m). A walker file holds the reflexes,
    which were adapted to one condition; with another one the walk is *acute*: the person has not adapted to it.

    Args:
        device: Device, name of a preset, or path of a device file. None: ``"klute-1-1-4-pair"``, unless the person has
            a spring foot or two legs of flesh.
        controller: Controller or its specification, as for :func:`simulate_gait`. One that follows the gait phase gets
            the phase that the load cell tells. None: ``"machine"``.
        spring_foot: Stiffness of a passive foot, which replaces the device [N.m/deg]. None: the device.
        intact: Whether the person has two legs of flesh and no prosthesis.
        foot: Foot below the ankle, such as ``"sach"``. None: that of the device.
        alignment: Angle by which the prosthesis is turned against the limb [deg], dorsiflexion positive. None: that of
            the device file, or 0.
        walker: Walker, name of a shipped one, or path of a walker file. None: a shipped one that has adapted to this
            condition, or to the nearest one.
        seconds: Duration [s]; a fall ends the walk earlier.
        push: Impulse [N.s], forward positive, and phase of the right leg's stride [%] of a push on the hip in the first
            stride after 5 s; the walk must last 7 s. None: no push.
        uneven: Largest height of the blocks of 0.5 m that lie on the ground [mm].
        slope: Ground slope [deg], uphill positive.
        seed: Random seed of the uneven ground.
        time_step: Time step [s], up to 1 ms.
        backend: ``"compiled"``, ``"python"`` (the same bits), or ``"auto"``: compiled if possible.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable, or the walker belongs to another body or contact.
    """
    prosthesis, chosen_controller = build_prosthesis(device, controller, spring_foot, intact, foot, alignment)
    options = WalkOptions(
        seconds=seconds,
        dt=time_step,
        ground=Ground(slope=math.radians(slope), unevenness=1e-3 * uneven, seed=seed),
        push=None if push is None else Push(impulse=push[0], phase=0.01 * push[1]),
    )
    chosen_walker = _choose_walker(walker, describe_prosthesis(prosthesis, chosen_controller))
    has_device = prosthesis is not None and prosthesis.spring_foot is None
    warnings: tuple[str, ...] = ()
    if has_device and prosthesis is not None and chosen_controller is not None:
        warnings = check_supply_pressure(prosthesis.device, chosen_controller)
    recording = simulate.simulate_walk(
        chosen_walker, prosthesis, chosen_controller, options, progress or ignore_progress, backend
    )
    return WalkRun(prosthesis.device if has_device and prosthesis else None, chosen_walker, recording, warnings)


def build_prosthesis(
    device: DeviceLike | None,
    controller: ControllerLike | None,
    spring_foot: float | None,
    intact: bool,
    foot: str | None,
    alignment: float | None,
) -> tuple[Prosthesis | None, Controller | None]:
    """Return prosthesis and controller of the arguments of :func:`simulate_walk`; None where there is none.

    Raises InputError when they contradict each other.
    """
    if intact:
        given = {"device": device, "controller": controller, "spring foot": spring_foot, "foot": foot}
        named = [name for name, value in given.items() if value is not None]
        if named:
            raise InputError(f"an intact person has no prosthesis; leave out the {named[0]}")
        return None, None
    if spring_foot is not None and (device is not None or controller is not None):
        raise InputError("a spring foot replaces the device and takes no command; leave out device and controller")
    chosen = to_device(DEFAULT_DEVICE if device is None else device, foot)  # a spring foot uses its geometry
    prosthesis = Prosthesis(
        device=chosen,
        spring_foot=None if spring_foot is None else SpringFoot(stiffness=math.degrees(spring_foot)),
        alignment=None if alignment is None else math.radians(alignment),
    )
    if spring_foot is not None:
        return prosthesis, None
    return prosthesis, to_controller(DEFAULT_CONTROLLER if controller is None else controller)


def _choose_walker(walker: Walker | str | Path | None, condition: dict[str, Any]) -> Walker:
    if walker is None:
        return select_walker(condition)
    return walker if isinstance(walker, Walker) else load_walker(walker)


def build_walker_table() -> "Table":
    """Return the table of the shipped walkers: condition, seed, cost, evaluations and speed."""
    from klute_sim.terminal_table import create_table

    table = create_table()
    for name in ("walker", "prosthesis", "controller"):
        table.add_column(name)
    for name in ("seed", "evaluations", "cost", "m/s"):
        table.add_column(name, justify="right")
    for name in list_walkers():
        walker = load_walker(name)
        condition, search = walker.condition, walker.search
        kind = str(condition["prosthesis"])
        if "stiffness_nm_per_deg" in condition:
            kind += f", {condition['stiffness_nm_per_deg']:g} N·m/deg"
        controller = json.loads(condition["controller"])["kind"] if "controller" in condition else "-"
        numbers = (f"{search['seed']}", f"{search['evaluations']}", f"{search['cost']:.2f}")
        table.add_row(name, kind, controller, *numbers, f"{search['speed_m_per_s']:.2f}")
    return table
