"""Adapt a walker to a prosthesis: :func:`adapt_walker` and its result :class:`AdaptationResult`."""

import csv
import io
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from klute_sim.api.inputs import ControllerLike, DeviceLike, ignore_progress
from klute_sim.api.rendering import Printable, Summary
from klute_sim.api.sweep import explain_interrupt
from klute_sim.api.walk import build_prosthesis
from klute_sim.files.limits import RESULT
from klute_sim.files.lines import read_csv_rows
from klute_sim.files.reading import read_text
from klute_sim.parameter_sweep import cluster
from klute_sim.parameter_sweep.fingerprint import fingerprint_software
from klute_sim.parameter_sweep.store import ResultStore, open_store
from klute_sim.recording.atomic_file import write_atomically
from klute_sim.report.run_page import FIGURE_FILE, PAGE_FILE, write_run_page
from klute_sim.types import ProgressCallback
from klute_sim.walker.adaptation.objective import (
    HORIZON,
    PUSHES,
    UNEVEN_FROM,
    UNEVENNESS,
    AdaptationProblem,
)
from klute_sim.walker.adaptation.search import (
    POPULATION,
    EvaluatePoints,
    SearchProgress,
    evaluate_in_threads,
    evaluate_on_cluster,
    import_cma,
    search,
)
from klute_sim.walker.outcomes import WalkOutcomes, compute_outcomes
from klute_sim.walker.person.body import load_body
from klute_sim.walker.person.build import get_contact
from klute_sim.walker.reflexes.walker_file import Walker, load_walker, select_walker
from klute_sim.walker.simulation.simulate import WalkOptions, describe_prosthesis, simulate_walk

COSTS_FILE, WALKER_FILE, SUMMARY_FILE = "costs.csv", "adapted.toml", "adaptation.json"
"""Files in the folder of an adaptation."""
ACCEPTANCE_FACTOR = 3.0
"""Duration of the walk that accepts a walker, over the horizon of the search."""


@dataclass(frozen=True, repr=False)
class AdaptationResult(Printable):
    """Result of an adaptation."""

    walker: Walker
    """Best walker."""
    outcomes: WalkOutcomes
    """Outcomes of its walk of three horizons on level ground."""
    folder: Path
    """Folder of the search."""
    summary: dict[str, Any]
    """Content of adaptation.json."""

    @property
    def is_accepted(self) -> bool:
        """Whether the walker walked three horizons without a fall."""
        return not self.outcomes.has_fallen

    def format_summary(self) -> Summary:
        """Yield what the search found, and whether the walker is accepted."""
        search_, seconds = self.walker.search, ACCEPTANCE_FACTOR * HORIZON
        yield (
            f"Best of {search_['evaluations']} walks (seed {search_['seed']}): cost {search_['cost']:.3f}, "
            f"{search_['speed_m_per_s']:.3f} m/s."
        )
        if self.is_accepted:
            yield f"Accepted: it walks {seconds:g} s on level ground."
        else:
            yield (
                f"Not accepted: it falls after {self.outcomes.duration_s:.1f} of {seconds:g} s on level ground; "
                "continue with more --evaluations, or with another --seed."
            )

    def __repr__(self) -> str:
        """Return one line: evaluations, cost and folder."""
        search_ = self.walker.search
        cost = f"cost {search_['cost']:.3g}"
        return f"AdaptationResult({search_['evaluations']} evaluations, {cost}, folder={str(self.folder)!r})"


def adapt_walker(
    device: DeviceLike | None = None,
    *,
    controller: ControllerLike | None = None,
    spring_foot: float | None = None,
    intact: bool = False,
    foot: str | None = None,
    alignment: float | None = None,
    start: Walker | str | Path | None = None,
    speed: float = 1.25,
    evaluations: int = 4000,
    sigma: float = 0.5,
    seed: int = 0,
    folder: str | Path | None = None,
    n_jobs: int = 0,
    ray_address: str | None = None,
    progress: ProgressCallback | None = None,
) -> AdaptationResult:
    """Adapt the reflexes of a walker to ``device`` and ``controller`` by CMA-ES, and return the best walker.

    The costs of all walks are stored in ``folder``; an interrupted search resumes there, exactly.

    Args:
        device: Device, name of a preset, or path of a device file. None: ``"klute-1-1-4-pair"``, unless the person has
            a spring foot or two legs of flesh.
        controller: Controller or its specification; None: ``"machine"``.
        spring_foot: Stiffness of a passive foot, which replaces the device [N.m/deg]. None: the device.
        intact: Whether the person has two legs of flesh, with equal gains.
        foot: Foot below the ankle, such as ``"sach"``. None: that of the device.
        alignment: Angle by which the prosthesis is turned against the limb [deg], dorsiflexion positive. None: that of
            the device file, or 0.
        start: Walker from which the search starts. None: the shipped one that is nearest to the condition.
        speed: Speed that the walker should reach [m/s].
        evaluations: Number of walks, rounded up to whole generations.
        sigma: Initial standard deviation of the search, in the widths of the gains.
        seed: Random seed of search and ground.
        folder: Folder of the search, new, empty or of the same search; None: the next ``runs/adapt-NNN``.
        n_jobs: Number of threads; 0: one per core.
        ray_address: Address of a Ray cluster, ``"auto"`` or ``"local"``; None: threads of this process.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable, MissingExtraError without the package cma.
    """
    prosthesis, chosen_controller = build_prosthesis(device, controller, spring_foot, intact, foot, alignment)
    condition = describe_prosthesis(prosthesis, chosen_controller)
    if start is None:
        start_walker = select_walker(condition)
    else:
        start_walker = start if isinstance(start, Walker) else load_walker(start)
    problem = AdaptationProblem(
        body=load_body(), prosthesis=prosthesis, controller=chosen_controller, speed=speed, seed=seed
    )
    import_cma()  # before a folder is made
    # A cluster that does not answer is refused before a folder is made.
    with _open_evaluator(problem, n_jobs, ray_address) as evaluate_points:
        store = open_store(folder, _describe_problem(problem, condition, start_walker, sigma), "adapt")
        report = progress or ignore_progress

        def on_generation(state: SearchProgress, costs: list[float]) -> None:
            all_costs.extend(costs)
            _write_costs(store, all_costs)
            report(min(1.0, state.n_evaluations / evaluations), f"adapting, best cost {state.best.cost:.2f}")

        with store.lock(), explain_interrupt(store.folder):
            all_costs = _read_costs(store.folder)
            search_result = search(
                problem,
                start_walker.reflexes,
                evaluations,
                evaluate_points,
                sigma=sigma,
                stored_costs=tuple(all_costs),
                on_generation=on_generation,
            )
            walker = Walker(
                store.folder.name,
                problem.decode(search_result.best_point),
                problem.body.digest,
                get_contact(problem.build_model()),
                condition,
                {
                    "seed": seed,
                    "evaluations": search_result.n_evaluations,
                    "cost": search_result.best.cost,
                    "speed_m_per_s": search_result.best.speed,
                    "terms": search_result.best.terms,
                    "weights": asdict(problem.weights),
                    "start": start_walker.name,
                    "horizon_s": problem.horizon,
                },
            )
            options = WalkOptions(seconds=ACCEPTANCE_FACTOR * problem.horizon)
            outcomes = compute_outcomes(simulate_walk(walker, prosthesis, chosen_controller, options))
            result = AdaptationResult(walker, outcomes, store.folder, _build_summary(store, walker, outcomes))
            _write_results(store, result, all_costs)
    return result


@contextmanager
def _open_evaluator(problem: AdaptationProblem, n_jobs: int, ray_address: str | None) -> Iterator[EvaluatePoints]:
    """Yield the evaluation of points in threads, or on the cluster at ``ray_address``."""
    if ray_address is None:
        with evaluate_in_threads(problem, n_jobs or os.cpu_count() or 1) as evaluate_points:
            yield evaluate_points
        return
    with cluster.connect(ray_address) as ray:
        yield evaluate_on_cluster(problem, ray)


def _describe_problem(
    problem: AdaptationProblem, condition: dict[str, Any], start: Walker, sigma: float
) -> dict[str, Any]:
    """Return the search in JSON types; the number of evaluations is left out, because it may grow."""
    return {
        "condition": condition,
        "start": start.digest,
        "speed_m_per_s": problem.speed,
        "weights": asdict(problem.weights),
        "seed": problem.seed,
        "sigma": sigma,
        "search": {
            "population": POPULATION,
            "horizon_s": problem.horizon,
            "uneven_from_m": UNEVEN_FROM,
            "unevenness_m": UNEVENNESS,
            "pushes": [asdict(push) for push in PUSHES],
        },
        "software": {**fingerprint_software(), "cma": version("cma")},
    }


def _read_costs(folder: Path) -> list[float]:
    path = folder / COSTS_FILE
    if not path.exists():
        return []
    return [float(row[1]) for _, row in read_csv_rows(read_text(path, RESULT), str(path))[1:]]


def _write_costs(store: ResultStore, costs: list[float]) -> None:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["evaluation", "cost"])
    writer.writerows([number, repr(cost)] for number, cost in enumerate(costs, start=1))
    with store.translate_write_errors():
        write_atomically(store.folder / COSTS_FILE, buffer.getvalue())


def _build_summary(store: ResultStore, walker: Walker, outcomes: WalkOutcomes) -> dict[str, Any]:
    """Return the content of adaptation.json."""
    legs = {
        side: {key: value for key, value in asdict(leg).items() if key not in ("curves", "deviations")}
        for side, leg in outcomes.legs.items()
    }
    walk = {key: value for key, value in asdict(outcomes).items() if key != "legs"}
    return {
        "folder": str(store.folder),
        "files": sorted([COSTS_FILE, WALKER_FILE, SUMMARY_FILE, FIGURE_FILE, PAGE_FILE]),
        "is_accepted": not outcomes.has_fallen,
        "condition": dict(walker.condition),
        "search": dict(walker.search),
        "walk": {**walk, "legs": legs},
    }


def _write_results(store: ResultStore, result: AdaptationResult, costs: Sequence[float]) -> None:
    from klute_sim.report.style import save_figure
    from klute_sim.report.walk.adaptation_figure import DESCRIPTION, build_figure

    with store.translate_write_errors():
        write_atomically(store.folder / WALKER_FILE, result.walker.to_toml())
        write_atomically(store.folder / SUMMARY_FILE, json.dumps(result.summary, indent=2, allow_nan=False) + "\n")
        save_figure(build_figure(costs), store.folder / FIGURE_FILE)
        write_run_page(store.folder, "Adaptation of a walker", result.format_summary(), {FIGURE_FILE: DESCRIPTION})
