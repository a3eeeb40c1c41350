"""A search's folder: the question, every walk, and in the end what came of it."""

import csv
import io
import json
import math
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from klute_sim.control.pressure import to_csv
from klute_sim.recording.recording import Recording
from klute_sim.report import table, tuning_figure
from klute_sim.report.outcomes import AnkleOutcome, StrideOutcome, human_outcome, outcomes, summary
from klute_sim.report.workbench.tuning import COLUMNS, TRIED
from klute_sim.rigs.gait.rig import walk
from klute_sim.sweep.software import software
from klute_sim.sweep.store import Store, open_folder, write
from klute_sim.tuning.knobs import Point
from klute_sim.tuning.objective import CLEARANCE, FOLLOWED, FREE, LOW, REST, UNFOLLOWED
from klute_sim.tuning.search import FINE_STEP, SPREAD, STEP, STRIDES, Question, Tried, best, front

SHOWN_STRIDES = 5
"""Of the walks before and after that are shown."""


def opened(wanted: Path | None, question: Question) -> Store:
    """The store of ``question`` in the folder ``wanted``, new or begun before; None: in the next ``runs/tune-NNN``.

    Raises InputError if something else is there or nothing can be written there.
    """
    return open_folder(wanted, described(question), "tune")


def described(question: Question) -> dict[str, Any]:
    """The question in JSON types; not how long it is searched, which may grow."""
    tunable = question.tunable
    penalties = {"rest": REST, "free": FREE, "unfollowed": UNFOLLOWED, "followed_bw": FOLLOWED}
    penalties |= {"low": LOW, "clearance_mm": CLEARANCE}
    return {
        "device": tunable.device.content.decode("utf-8-sig"),
        "profile": tunable.profile.describe(),
        "knobs": [asdict(knob) for knob in tunable.knobs],
        "mass_kg": question.mass,
        "weights": asdict(question.weights),
        "goals": asdict(question.goals),
        "seed": question.seed,
        "search": {"spread": SPREAD, "strides": STRIDES, "step_s": STEP, "fine_step_s": FINE_STEP, **penalties},
        "software": {**software(), "cma": version("cma")},
    }


def finished(store: Store, question: Question, tried: list[Tried], again: list[Tried]) -> dict[str, Any]:
    """Write what came of it into the folder; the summary. The result is the best of what was walked ``again``."""
    start, found = again[0], best(again)
    walks = _walk(question, start.places), _walk(question, found.places)
    device, profile = question.tunable.made(found.places)
    files = [TRIED, "tuned.csv", "tuning.json", "tuning.png"]
    remarks = table.remarks(summary(walks[1], outcomes(walks[1])))
    with store.writing():
        if question.tunable.keys:
            write(store.folder / "device.toml", device.content.decode("utf-8-sig"))
            files.append("device.toml")
        points = [_point(each) for each in tried if each.tracked is not None and not each.tracked.catches]
        tuning_figure.draw(
            points, [_point(e) for e in front(tried)], _point(start), _point(found), walks, store.folder / "tuning.png"
        )
        write(store.folder / "tuned.csv", to_csv(profile))
        write(store.folder / TRIED, tried_csv(tried))
        result = {
            "folder": str(store.folder),
            "files": sorted(files),
            "walks": len(tried),
            "seed": question.seed,
            "cost": {"before": start.cost, "tuned": found.cost},
            "table": _table(*walks),
            "remarks": remarks,
            "knobs": {
                knob.name: {"before": knob.start, "tuned": knob.value(float(place))}
                for knob, place in zip(question.tunable.knobs, found.places, strict=True)
            },
            "front": [{"air_g": air, "tracking_sd2": apart} for air, apart in map(_point, front(tried))],
        }
        write(store.folder / "tuning.json", json.dumps(result, indent=2, allow_nan=False) + "\n")
    return result


def tried_csv(tried: list[Tried]) -> str:
    """:data:`COLUMNS` of every walk; a walk that failed has no air, and no distance."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for number, each in enumerate(tried):
        parts = ["", ""] if each.tracked is None else [each.tracking, each.tracked.air_g]
        writer.writerow([number, each.generation, each.cost, *parts])
    return out.getvalue()


def _walk(question: Question, places: Point) -> Recording:
    combination = question.combination(places, SHOWN_STRIDES, FINE_STEP)
    return walk(combination.device, combination.controller, combination.options())


def _point(tried: Tried) -> tuple[float, float]:
    return (math.nan if tried.tracked is None else tried.tracked.air_g, tried.tracking)


ON_RIG: tuple[tuple[str, Callable[[StrideOutcome], float | None]], ...] = (
    ("moment to human, stance rms [sd]", lambda s: s.moment_distance_sd.stance_rms),
    ("angle to human, stance rms [sd]", lambda s: s.angle_distance_sd.stance_rms),
    ("power to human, stance rms [sd]", lambda s: s.power_distance_sd.stance_rms),
    ("air in a stride [g]", lambda s: s.air_g),
    ("most L/L0 of the muscle [1]", lambda s: s.muscle_ratio_max),
    ("toe clearance in mid-swing [mm]", lambda s: s.toe_clearance_mm),
    ("load to human, rms [body weights]", lambda s: s.grf_vertical_tracking_rms_bw),
)
OF_ANKLE: tuple[tuple[str, Callable[[AnkleOutcome], float]], ...] = (
    ("peak net power [W/kg]", lambda s: s.ankle_power_peak_w_per_kg),
    ("net ankle work [J/kg]", lambda s: s.ankle_work_net_j_per_kg),
    ("peak net moment [N·m/kg]", lambda s: s.ankle_moment_peak_nm_per_kg),
    ("most plantarflexion [deg]", lambda s: s.ankle_plantarflexion_deg),
)
"""Rows of the table: what only the prosthesis has, and what a human ankle has, too."""


def _table(before: Recording, after: Recording) -> list[dict[str, Any]]:
    """Rows of the walks before and after, and of the human ankle where it has such a number."""
    first, last, human = outcomes(before), outcomes(after), human_outcome(before)
    rig = [{"name": n, "before": first.mean(read), "tuned": last.mean(read), "human": None} for n, read in ON_RIG]
    ankle = [
        {"name": n, "before": first.mean(read), "tuned": last.mean(read), "human": read(human)} for n, read in OF_ANKLE
    ]
    return [*rig, *ankle]
