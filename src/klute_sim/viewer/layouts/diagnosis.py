"""A diagnosis for the rerun viewer: the answer, where the gap is, and trials as measured, before and after."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.workflow import Diagnosis
from klute_sim.errors import InputError
from klute_sim.report.diagnosis import text as words
from klute_sim.report.diagnosis.traces import SimulatedTrial, simulate_shown_trials
from klute_sim.viewer import chart, heatmap, stream
from klute_sim.viewer.layouts import diagnosis_leg, diagnosis_map
from klute_sim.viewer.stream import BLUE, GREY, ORANGE, SeriesLine

TIMELINE = "time"
"""From each trial's begin."""
VERDICT_ENTITY = "verdict"
CASE_COLOURS = {"measured": GREY, "before": ORANGE, "after": BLUE}


def write_recording(diagnosis: Diagnosis, path: Path) -> None:
    """Write the shown trials of ``diagnosis`` to ``path`` (.rrd).

    Raises MissingExtraError without rerun, InputError where the data were not sufficient to simulate anything.
    """
    rr = stream.import_rerun()
    trials = simulate_shown_trials(diagnosis)
    if not trials:
        raise InputError("a rerun recording needs trials that were simulated; the data were insufficient for that")
    maps = list(diagnosis_map.build_maps(diagnosis, trials))
    identity = [diagnosis.dataset.digest, *map(str, diagnosis.added_terms)]
    with stream.open_recording(path, "diagnosis", identity, lambda: build_blueprint(diagnosis, trials, maps)) as out:
        stream.log_text(out, VERDICT_ENTITY, format_page(diagnosis))
        for _, own in maps:
            for _, one_map in own:
                heatmap.log_heatmap(out, one_map)
        for number, one in enumerate(trials, start=1):
            for channel in _list_channels(one):
                axis = rr.TimeColumn(TIMELINE, duration=one.sample_times(channel))
                stream.send_lines(out, axis, build_lines(diagnosis, one, number, channel))
            if diagnosis_leg.has_ankle_motion(diagnosis, one):
                diagnosis_leg.log_leg(out, diagnosis, one, f"trial_{number}/leg", TIMELINE)
            for loop in build_loop_charts(diagnosis, one, number):
                chart.log_chart(out, loop)


def _list_cases(diagnosis: Diagnosis, simulated: SimulatedTrial) -> list[tuple[str, str, Any]]:
    """What was simulated: its entity, what it is called, and its channels."""
    if not diagnosis.added_terms:
        return [("before", "simulated", simulated.before)]
    return [("before", "refitted", simulated.before), ("after", "with effects added", simulated.after)]


def build_lines(diagnosis: Diagnosis, simulated: SimulatedTrial, number: int, channel: str) -> Iterator[SeriesLine]:
    """Of one channel of trial ``one``, the ``number``-th: the signal's, then the residuals'.

    Trials go by numbers, because their names may hold what an entity's name may not.
    """
    unit, measured = CHANNEL_UNITS[channel][1], simulated.experiment.measured[channel].value
    here = f"trial_{number}/{channel}"
    yield SeriesLine(f"{here}/signal/measured", "measured", GREY, 1.0, measured / unit)
    for entity, name, values in _list_cases(diagnosis, simulated):
        yield SeriesLine(f"{here}/signal/{entity}", name, CASE_COLOURS[entity], 2.0, values[channel] / unit)
    for entity, name, values in _list_cases(diagnosis, simulated):
        yield SeriesLine(
            f"{here}/residual/{entity}", name, CASE_COLOURS[entity], 1.0, (measured - values[channel]) / unit
        )


def build_loop_charts(diagnosis: Diagnosis, simulated: SimulatedTrial, number: int) -> list[chart.Chart]:
    """The force over the length of a bench trial, measured and simulated; none of other trials."""
    if diagnosis.dataset.rig != "bench" or "force" not in _list_channels(simulated):
        return []
    experiment, course = simulated.experiment, simulated.experiment.prescribed_input
    steps = experiment.start_time + experiment.dt * np.arange(1, len(course.values) + 1)
    length = np.interp(experiment.measured["force"].time, steps, course.values) / course.si_factor
    curves = [chart.ChartCurve("measured", GREY, length, experiment.measured["force"].value, thin=True)]
    curves += [
        chart.ChartCurve(name, CASE_COLOURS[entity], length, values["force"])
        for entity, name, values in _list_cases(diagnosis, simulated)
    ]
    return [chart.Chart(f"trial_{number}/loop", course.label, "force [N]", tuple(curves))]


def format_page(diagnosis: Diagnosis) -> str:
    """The answer, the gap in numbers, and which trials it is told of."""
    d = diagnosis
    said = [
        f"# {words.describe_verdict(d)}",
        words.describe_improvement(d),
        words.describe_equation_residuals(d),
        *map(words.format_sentence, d.reasons),
    ]
    rows = []
    for channel, gap in d.channel_rms.items():
        unit, si = CHANNEL_UNITS[channel]
        known = [gap.nominal, gap.refitted, gap.with_effects if d.added_terms else None, gap.noise_floor]
        rows.append(
            [words.humanize_identifier(channel), unit, *(None if value is None else value / si for value in known)]
        )
    on = "trials that no fit saw" if d.evaluated_on == "show" else "the fitted trials: none was kept back"
    said.append(f"## The gap: root mean square of measured minus simulated, on {on}")
    said.append(
        stream.format_markdown_table(
            ["channel", "unit", "nominal", "refitted", "with effects", "noise of repeats"], rows
        )
    )
    if d.added_terms and d.final_fit is not None:
        said.append("## What was added")
        numbers = []
        for unknown, value, interval in zip(
            d.final_fit.hypothesis.parameters, d.final_fit.values, d.confidence_intervals, strict=True
        ):
            if unknown.term_index is not None:
                term = d.final_fit.hypothesis.terms[unknown.term_index]
                name, unit = words.format_parameter_name(unknown, term.channel)
                numbers.append([words.format_term(term), name, unit or "-", *words.format_interval(value, *interval)])
        said.append(stream.format_markdown_table(["effect", "parameter", "unit", "value", "95 % from", "to"], numbers))
    said.append("## Trials")
    uses = (("fit", "fitted"), ("select", "chosen by, not fitted"), ("show", "shown, never fitted"))
    for use, what in uses:
        names = [e.name for e in d.experiments if e.use == use]
        said.append(f"- {what}: {', '.join(names) or 'none'}")
    return "\n\n".join(filter(None, said))


def build_blueprint(
    diagnosis: Diagnosis,
    trials: Sequence[SimulatedTrial],
    maps: Sequence[tuple[str, list[tuple[str, heatmap.Heatmap]]]],
) -> Any:
    """Layout: a tab with the answer beside the maps of the gap, then one for each trial.

    In that the leg or the work loop, under it the channels side by side, their residuals underneath.
    """
    import rerun.blueprint as rrb

    rows = [
        rrb.Horizontal(*(heatmap.build_view(one, f"{channel}, {name}: measured - simulated") for name, one in own))
        for channel, own in maps
    ]
    answer = stream.build_text_view("verdict", VERDICT_ENTITY)
    tabs: list[Any] = [rrb.Horizontal(answer, rrb.Vertical(*rows), column_shares=[1, 2], name="verdict and gap")]
    for number, one in enumerate(trials, start=1):
        use = "shown, never fitted" if diagnosis.evaluated_on == "show" else "fitted"
        tabs.append(_build_trial_view(diagnosis, one, number, f"{one.experiment.name} ({use})"))
    return stream.build_window_blueprint(rrb.Tabs(*tabs), TIMELINE)


def _build_trial_view(diagnosis: Diagnosis, simulated: SimulatedTrial, number: int, name: str) -> Any:
    import rerun.blueprint as rrb

    columns = []
    for channel in _list_channels(simulated):
        spoken, unit = words.humanize_identifier(channel), CHANNEL_UNITS[channel][0]
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
    if diagnosis_leg.has_ankle_motion(diagnosis, simulated):
        cases = [
            ("measured", "measured"),
            *((entity, called) for entity, called, _ in _list_cases(diagnosis, simulated)),
        ]
        legs = rrb.Horizontal(*(diagnosis_leg.build_view(root, entity, called) for entity, called in cases))
        return rrb.Vertical(legs, curves, row_shares=[2, 3], name=name)
    loop = [chart.build_view(each, "force over length") for each in build_loop_charts(diagnosis, simulated, number)]
    return rrb.Horizontal(*loop, curves, column_shares=[1] * len(loop) + [2], name=name)


def _list_channels(simulated: SimulatedTrial) -> list[str]:
    return [channel for channel, series in simulated.experiment.measured.items() if len(series.time)]
