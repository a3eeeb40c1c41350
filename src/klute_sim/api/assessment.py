"""Assess whether a prosthesis serves a person: :func:`assess` and its result :class:`Assessment`."""

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.assessed_person import AssessedController, AssessedPerson, build_page_entry, summarize_person
from klute_sim.api.baselines import select_baselines
from klute_sim.api.gait import simulate_gait
from klute_sim.api.inputs import ControllerLike, DeviceLike, stage_progress
from klute_sim.api.rendering import Printable, Summary
from klute_sim.baselines import assessment, table
from klute_sim.baselines.library import Baseline
from klute_sim.errors import InputError, SimulationError
from klute_sim.gait.metrics import compute_reference_metrics
from klute_sim.gait.reference import Reference
from klute_sim.gait.subject import ReferenceLike, Subject, resolve_subject
from klute_sim.recording.run_folder import create_run_folder
from klute_sim.types import ProgressCallback
from klute_sim.units import BAR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUMMARY_FILE = "assessment.json"
"""Results of an assessment."""


@dataclass(frozen=True, repr=False)
class Assessment(Printable):
    """Persons, the controllers that walked as each of them, and their shortfalls."""

    persons: tuple[AssessedPerson, ...]
    """Assessed persons in the order of the references."""

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of assessment.json, without the folder and the list of files."""
        return {
            "persons": [summarize_person(person) for person in self.persons],
            "criteria": [criterion.describe() for criterion in assessment.CRITERIA],
            "assumptions": _ASSUMPTIONS,
        }

    def format_summary(self) -> Summary:
        """Yield the table, the verdict and the shortfalls of the controller with the fewest, for each person."""
        for person in self.persons:
            yield person.build_table()
            yield person.format_verdict()
            if not person.serving:
                yield from person.ranked[0].shortfalls
            yield person.subject.format_sentence()
            yield from person.subject.remarks
        yield "A star marks a shortfall; index.html has a sentence for each, and the criteria."
        yield "BW: body weights. The air is that of a stride."
        yield from _ASSUMPTIONS

    def __repr__(self) -> str:
        """Return one line: number of persons, and how many are served."""
        n_served = sum(bool(person.serving) for person in self.persons)
        return f"Assessment({len(self.persons)} persons, {n_served} served)"

    def plot(self, person: int = 0) -> "Figure":
        """Return the figure of the user's controllers, and of those with the fewest shortfalls, over the own ankle.

        ``person`` is an index. Raises InputError when every simulation of the person failed.
        """
        from klute_sim.report.assessment.figure import build_figure

        chosen = self.persons[person]
        user_recordings, shipped_recordings = (
            {
                chosen.get_label(c): c.run.recording
                for c in chosen.ranked
                if c.run is not None and c.baseline.is_shipped is is_shipped
            }
            for is_shipped in (False, True)
        )
        if not user_recordings and not shipped_recordings:
            raise InputError(f"no gait could be simulated for {chosen.name}, so there is nothing to plot")
        return build_figure(user_recordings, shipped_recordings)

    def save(self, folder: str | Path | None = None) -> Path:
        """Write the files of ``klute-sim assess`` into ``folder`` (new or empty; default: next ``runs/assess-NNN``).

        Returns the folder.
        """
        with create_run_folder("assess", folder) as (final_folder, scratch):
            self.write_files(scratch, final_folder)
        return final_folder

    def write_files(self, scratch: Path, folder: Path) -> dict[str, Any]:
        """Write all files into ``scratch``, which becomes ``folder``; returns the content of assessment.json."""
        from klute_sim.report.assessment.page import write_page
        from klute_sim.report.run_page import PAGE_FILE
        from klute_sim.report.style import save_figure

        pictures = [
            f"person-{number}.png" if any(c.run is not None for c in person.controllers) else ""
            for number, person in enumerate(self.persons, start=1)
        ]
        for index, name in enumerate(pictures):
            if name:
                save_figure(self.plot(index), scratch / name)
        context = {
            "persons": [build_page_entry(person) for person in self.persons],
            "titles": [criterion.title.replace("\n", " ") for criterion in assessment.CRITERIA],
            "criteria": [criterion.describe() for criterion in assessment.CRITERIA],
            "assumptions": _ASSUMPTIONS,
        }
        files = sorted([*filter(None, pictures), PAGE_FILE, SUMMARY_FILE])
        content = {"folder": str(folder), "files": files, **self.summary}
        (scratch / SUMMARY_FILE).write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", "utf-8")
        write_page(context, pictures, scratch)
        return content


_ASSUMPTIONS = [
    f"Assumed: the limits of the criteria, and a tank of {1e3 * table.TANK_VOLUME_M3:g} l at "
    f"{table.TANK_PRESSURE_PA / BAR:g} bar that is used down to {table.MIN_TANK_PRESSURE_PA / BAR:g} bar.",
    "The ground reaction is tracked, not predicted: the rig learns the path of the hip so that the foot carries the "
    "load of the reference.",
]


def assess(
    references: Sequence[ReferenceLike] | ReferenceLike = None,
    *,
    only: Sequence[str] = (),
    own: Sequence[tuple[DeviceLike, ControllerLike]] = (),
    foot: str | None = None,
    stride_time: float | None = None,
    accept: Collection[str] = (),
    mass: float | None = None,
    stature: float | None = None,
    speed: float | None = None,
    strides: int = 5,
    time_step: float = 5e-4,
    progress: ProgressCallback | None = None,
) -> Assessment:
    """Assess which controllers serve the persons of ``references``, with how much air, and where they fall short.

    Every shipped baseline and every pair of ``own`` walks on level ground as each person. Its gait is compared with
    the person's own ankle by the criteria of :mod:`klute_sim.baselines.assessment`, whose limits are assumed.

    Args:
        references: Reference gaits, or paths of their files or folders. None: able-bodied adults.
        only: Names of baselines; empty: all of them. ``["own"]``: only those of ``own``.
        own: Pairs of a device and a controller of the user.
        foot: Foot below the ankle, such as ``"sach"`` or, in a shoe, ``"sach+shoe"``. None: that of the device.
        stride_time: Stride time of the references [s]. None: the time that each states, or 1.1.
        accept: Names of findings about the reference files that are right although they look implausible.
        mass: Body mass [kg]. None: the mass that each reference states, or 75.
        stature: Stature [m]. None: the stature that each reference states, or 1.75.
        speed: Walking speed [m/s]; it scales the stride time. None: the speed that reference and leg length imply.
        strides: Number of strides per gait.
        time_step: Time step [s].
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable.
    """
    if references is None or isinstance(references, str | Path | Reference):
        references = [references]
    subjects = [
        resolve_subject(reference, stride_time=stride_time, accept=accept, mass=mass, stature=stature, speed=speed)
        for reference in references
    ]
    baselines = select_baselines(only, own, foot)
    for subject in subjects:
        subject.build_options(strides, time_step)  # before minutes of simulation
    report, n_runs = stage_progress(progress, "simulating"), len(subjects) * len(baselines)
    persons: list[AssessedPerson] = []
    for subject in subjects:
        controllers = []
        for baseline in baselines:
            controllers.append(_assess_controller(subject, baseline, strides, time_step))
            report((len(persons) * len(baselines) + len(controllers)) / n_runs)
        persons.append(AssessedPerson(subject, tuple(controllers)))
    return Assessment(tuple(persons))


def _assess_controller(subject: Subject, baseline: Baseline, strides: int, time_step: float) -> AssessedController:
    stiffness, foot = baseline.foot_stiffness, baseline.device.spec.foot
    try:
        run = simulate_gait(
            baseline.device if stiffness is None else None,
            controller=baseline.controller,
            reference=subject.reference,
            mass=subject.mass,
            stature=subject.stature,
            speed=subject.speed,
            strides=strides,
            time_step=time_step,
            spring_foot=stiffness,
            foot=foot.name if stiffness is not None and foot is not None else None,
        )
    except (InputError, SimulationError) as error:  # such as a device that does not fit into a short shank
        return AssessedController(baseline, None, (), (f"The gait cannot be simulated ({error}).",))
    quantities = assessment.assess_quantities(run.gait_metrics, compute_reference_metrics(run.recording))
    shortfalls = assessment.collect_shortfalls(run.gait_metrics, quantities)
    return AssessedController(baseline, run, tuple(quantities), tuple(shortfalls))
