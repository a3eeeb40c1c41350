"""A bench run for the rerun viewer: work loops of force over length, and every trial over time."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from klute_sim import units
from klute_sim.errors import InputError
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.report.bench import SHOWN
from klute_sim.report.workbench import chart, gait, stream
from klute_sim.report.workbench.stream import GREEN, MANY, PALE_GREEN, Line

TIMELINE = "time"
MOST_TABS = 8
"""Trials with a tab of their own, evenly chosen. The others are charted beside them and no more: over time each would
take a megabyte, and their Parquet files have it all."""
MOST_NAMES = 12
"""Trials up to which their names are in the legends."""
STILL = 0.01
"""Range of a unit's length [mm] up to which it was held, and force is not charted over length."""
EVERY, READINGS = "every", "readings"

PLOTS: tuple[gait.Plot, ...] = (
    (
        "gauge pressure [bar]",
        (("pressure_command", "commanded", PALE_GREEN), ("pressure", "delivered", GREEN)),
    ),
    ("device forces [N]", gait.MOTION[4][1]),
    ("lengths [mm]", (("length", "unit", stream.RED), ("muscle_length", "muscle", stream.VIOLET))),
    *gait.LEDGER[:3],
)
"""Of one trial: title and series."""


class Trial(NamedTuple):
    """A trial as its folder tells of it."""

    name: str
    setting: Mapping[str, float]
    readings: Mapping[str, float | None]
    recording: Recording

    def number(self, key: str) -> float | None:
        """A setting or reading."""
        return {**self.setting, **self.readings}.get(key)


def remake(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files of a bench run's ``folder``.

    Raises MissingExtraError without rerun and InputError for files that are damaged.
    """
    told = json.loads((folder / "summary.json").read_text("utf-8"))
    trials = [
        Trial(each["name"], each["setting"], each["readings"], parquet.read(folder / f"{each['name']}.parquet"))
        for each in told["trials"]
    ]
    if not trials:
        raise InputError(f"{folder} has no trials to show")
    write(told, trials, path)


def write(told: Mapping[str, Any], trials: Sequence[Trial], path: Path) -> None:
    """Write ``trials`` of the run that ``told`` (its summary.json) is of to ``path``."""
    rr = stream.sdk()
    with stream.recorded(path, "bench", told, lambda: blueprint(told, trials)) as out:
        stream.tell(out, READINGS, page(told, trials))
        chart.log(out, charted(trials, EVERY))
        for number in chosen(trials):
            trial = trials[number - 1]
            axis = rr.TimeColumn(TIMELINE, duration=trial.recording["time"])
            stream.send(out, axis, lines(trial, number))
            across = "length" if moved([trial]) else "time"
            own = charted([trial], f"trial_{number:03d}/chart")
            chart.log(out, own, axis, (trial.recording[across], trial.recording["force"]))


def chosen(trials: Sequence[Trial]) -> list[int]:
    """Numbers of the trials with a tab, from 1."""
    places = np.linspace(1, len(trials), min(len(trials), MOST_TABS))
    return [int(number) for number in np.unique(np.rint(places))]


def lines(trial: Trial, number: int) -> list[Line]:
    """All series of ``trial``, the ``number``-th, over time."""
    found, energies = [], gait.energies(trial.recording)
    for _, plotted in PLOTS:
        for entity, name, colour in plotted:
            channel = entity.removeprefix("channels/")
            value = energies[entity] if entity in energies else trial.recording[channel]
            width = 1.0 if colour in gait.THIN else 2.0
            found.append(Line(f"trial_{number:03d}/{entity}", name, colour, width, value))
    return found


def moved(trials: Sequence[Trial]) -> bool:
    """Whether the crosshead moved in any of ``trials``."""
    return any(np.ptp(trial.recording["length"]) > STILL for trial in trials)


def charted(trials: Sequence[Trial], entity: str) -> chart.Chart:
    """Force over length of ``trials``; over time where the crosshead held still in all of them."""
    across, label = ("length", "length of the unit [mm]") if moved(trials) else ("time", "time [s]")
    curves = tuple(
        chart.Curve(
            trial.name,
            MANY[k % len(MANY)],
            trial.recording[across],
            trial.recording["force"],
            shown=1 < len(trials) <= MOST_NAMES,
        )
        for k, trial in enumerate(trials)
    )
    return chart.Chart(entity, label, "force [N]", curves)


def _view(trials: Sequence[Trial], entity: str) -> Any:
    title = "force over length (counter-clockwise: work done)" if moved(trials) else "force over time"
    return chart.view(charted(trials, entity), title)


def page(told: Mapping[str, Any], trials: Sequence[Trial]) -> str:
    """What was run, what was read off each trial, and what was assumed."""
    where = "MuJoCo tester" if told["mujoco"] else "device alone"
    keys = dict.fromkeys(key for trial in trials for key in (*trial.setting, *(SHOWN[told["kind"]] or trial.readings)))
    differs = [key for key in keys if len({t.number(key) for t in trials}) > 1] or list(keys)
    rows = [[trial.name, *(trial.number(key) for key in differs)] for trial in trials]
    table = stream.table(["trial", *(_heading(key) for key in differs)], rows)
    assumed = [f"{key} ({why})" for key, why in told["assumptions"].items()]
    return "\n\n".join(
        [
            f"# {told['protocol']}: {told['device']}, {where}",
            *told["remarks"],
            table,
            f"Assumed: {'; '.join(assumed) or 'nothing'}.",
        ]
    )


def _heading(key: str) -> str:
    name, unit = units.split(key)
    return f"{name.replace('_', ' ')} [{unit}]" if unit else name.replace("_", " ")


def blueprint(told: Mapping[str, Any], trials: Sequence[Trial]) -> Any:
    """Layout: a tab with all trials and what was read off them, then one for each of some trials."""
    import rerun.blueprint as rrb

    tabs: list[Any] = [rrb.Horizontal(_view(trials, EVERY), stream.words("readings", READINGS), name="all trials")]
    for number in chosen(trials):
        here, trial = f"trial_{number:03d}", trials[number - 1]
        views = [_view([trial], f"{here}/chart")]
        views += [stream.plot(title, [f"{here}/{entity}" for entity, _, _ in series]) for title, series in PLOTS]
        tabs.append(rrb.Grid(*views, grid_columns=3, name=trial.name))
    return stream.whole(rrb.Tabs(*tabs), TIMELINE)
