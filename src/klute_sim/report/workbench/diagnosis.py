"""A diagnosis for the rerun viewer: the answer, where the gap is, and trials as measured, before and after."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.diagnose.diagnosis import Diagnosis
from klute_sim.diagnose.experiment import UNITS
from klute_sim.errors import InputError
from klute_sim.report import diagnosis_words as words
from klute_sim.report.diagnosis_traces import Simulated, simulated
from klute_sim.report.workbench import chart, diagnosis_leg, diagnosis_map, heat, stream
from klute_sim.report.workbench.stream import BLUE, GREY, ORANGE, Line

TIMELINE = "time"
"""From each trial's begin."""
VERDICT = "verdict"
LOOK = {"measured": GREY, "before": ORANGE, "after": BLUE}


def write(diagnosis: Diagnosis, path: Path) -> None:
    """Write the shown trials of ``diagnosis`` to ``path`` (.rrd).

    Raises MissingExtraError without rerun, InputError where the data were not sufficient to simulate anything.
    """
    rr = stream.sdk()
    trials = simulated(diagnosis)
    if not trials:
        raise InputError("a rerun recording needs trials that were simulated; the data were insufficient for that")
    maps = list(diagnosis_map.maps(diagnosis, trials))
    identity = [diagnosis.dataset.digest, *map(str, diagnosis.found)]
    with stream.recorded(path, "diagnosis", identity, lambda: blueprint(diagnosis, trials, maps)) as out:
        stream.tell(out, VERDICT, page(diagnosis))
        for _, own in maps:
            for _, one_map in own:
                heat.log(out, one_map)
        for number, one in enumerate(trials, start=1):
            for channel in _channels(one):
                axis = rr.TimeColumn(TIMELINE, duration=one.time(channel))
                stream.send(out, axis, lines(diagnosis, one, number, channel))
            if diagnosis_leg.shows(diagnosis, one):
                diagnosis_leg.log(out, diagnosis, one, f"trial_{number}/leg", TIMELINE)
            for loop in loops(diagnosis, one, number):
                chart.log(out, loop)


def _cases(diagnosis: Diagnosis, one: Simulated) -> list[tuple[str, str, Any]]:
    """What was simulated: its entity, what it is called, and its channels."""
    if not diagnosis.found:
        return [("before", "simulated", one.before)]
    return [("before", "refitted", one.before), ("after", "with effects added", one.after)]


def lines(diagnosis: Diagnosis, one: Simulated, number: int, channel: str) -> Iterator[Line]:
    """Of one channel of trial ``one``, the ``number``-th: the signal's, then the residuals'.

    Trials go by numbers, because their names may hold what an entity's name may not.
    """
    unit, measured = UNITS[channel][1], one.experiment.measured[channel].value
    here = f"trial_{number}/{channel}"
    yield Line(f"{here}/signal/measured", "measured", GREY, 1.0, measured / unit)
    for entity, name, values in _cases(diagnosis, one):
        yield Line(f"{here}/signal/{entity}", name, LOOK[entity], 2.0, values[channel] / unit)
    for entity, name, values in _cases(diagnosis, one):
        yield Line(f"{here}/residual/{entity}", name, LOOK[entity], 1.0, (measured - values[channel]) / unit)


def loops(diagnosis: Diagnosis, one: Simulated, number: int) -> list[chart.Chart]:
    """The force over the length of a bench trial, measured and simulated; none of other trials."""
    if diagnosis.dataset.rig != "bench" or "force" not in _channels(one):
        return []
    experiment, course = one.experiment, one.experiment.course
    steps = experiment.begin + experiment.step * np.arange(1, len(course.values) + 1)
    length = np.interp(experiment.measured["force"].time, steps, course.values) / course.si
    curves = [chart.Curve("measured", GREY, length, experiment.measured["force"].value, thin=True)]
    curves += [
        chart.Curve(name, LOOK[entity], length, values["force"]) for entity, name, values in _cases(diagnosis, one)
    ]
    return [chart.Chart(f"trial_{number}/loop", course.label, "force [N]", tuple(curves))]


def page(diagnosis: Diagnosis) -> str:
    """The answer, the gap in numbers, and which trials it is told of."""
    d = diagnosis
    said = [f"# {words.verdict(d)}", words.improvement(d), words.equation(d), *map(words.sentence, d.reasons)]
    rows = []
    for channel, gap in d.gap.items():
        unit, si = UNITS[channel]
        known = [gap.before, gap.refitted, gap.after if d.found else None, gap.floor]
        rows.append([words.spoken(channel), unit, *(None if value is None else value / si for value in known)])
    on = "trials that no fit saw" if d.shown_on == "show" else "the fitted trials: none was kept back"
    said.append(f"## The gap: root mean square of measured minus simulated, on {on}")
    said.append(stream.table(["channel", "unit", "nominal", "refitted", "with effects", "noise of repeats"], rows))
    if d.found and d.final is not None:
        said.append("## What was added")
        numbers = []
        for unknown, value, interval in zip(d.final.hypothesis.unknowns, d.final.values, d.intervals, strict=True):
            if unknown.term is not None:
                term = d.final.hypothesis.terms[unknown.term]
                name, unit = words.unknown(unknown, term.channel)
                numbers.append([words.term(term), name, unit or "-", *words.told_apart(value, *interval)])
        said.append(stream.table(["effect", "parameter", "unit", "value", "95 % from", "to"], numbers))
    said.append("## Trials")
    uses = (("fit", "fitted"), ("select", "chosen by, not fitted"), ("show", "shown, never fitted"))
    for use, what in uses:
        names = [e.name for e in d.experiments if e.use == use]
        said.append(f"- {what}: {', '.join(names) or 'none'}")
    return "\n\n".join(filter(None, said))


def blueprint(
    diagnosis: Diagnosis, trials: Sequence[Simulated], maps: Sequence[tuple[str, list[tuple[str, heat.Heat]]]]
) -> Any:
    """Layout: a tab with the answer beside the maps of the gap, then one for each trial.

    In that the leg or the work loop, under it the channels side by side, their residuals underneath.
    """
    import rerun.blueprint as rrb

    rows = [
        rrb.Horizontal(*(heat.view(one, f"{channel}, {name}: measured - simulated") for name, one in own))
        for channel, own in maps
    ]
    answer = stream.words("verdict", VERDICT)
    tabs: list[Any] = [rrb.Horizontal(answer, rrb.Vertical(*rows), column_shares=[1, 2], name="verdict and gap")]
    for number, one in enumerate(trials, start=1):
        use = "shown, never fitted" if diagnosis.shown_on == "show" else "fitted"
        tabs.append(_trial(diagnosis, one, number, f"{one.experiment.name} ({use})"))
    return stream.whole(rrb.Tabs(*tabs), TIMELINE)


def _trial(diagnosis: Diagnosis, one: Simulated, number: int, name: str) -> Any:
    import rerun.blueprint as rrb

    columns = []
    for channel in _channels(one):
        spoken, unit = words.spoken(channel), UNITS[channel][0]
        views = [
            rrb.TimeSeriesView(
                origin=f"/trial_{number}/{channel}/{part}",
                name=title,
                plot_legend=rrb.PlotLegend(visible=part == "signal"),
            )
            for part, title in (
                ("signal", f"{spoken} [{unit}]"),
                ("residual", f"{spoken}, measured - simulated [{unit}]"),
            )
        ]
        columns.append(rrb.Vertical(*views, row_shares=[3, 2]))
    curves = rrb.Grid(*columns, grid_columns=min(4, len(columns)))
    root = f"trial_{number}/leg"
    if diagnosis_leg.shows(diagnosis, one):
        cases = [("measured", "measured"), *((entity, called) for entity, called, _ in _cases(diagnosis, one))]
        legs = rrb.Horizontal(*(diagnosis_leg.view(root, entity, called) for entity, called in cases))
        return rrb.Vertical(legs, curves, row_shares=[2, 3], name=name)
    loop = [chart.view(each, "force over length") for each in loops(diagnosis, one, number)]
    return rrb.Horizontal(*loop, curves, column_shares=[1] * len(loop) + [2], name=name)


def _channels(one: Simulated) -> list[str]:
    return [channel for channel, series in one.experiment.measured.items() if len(series.time)]
