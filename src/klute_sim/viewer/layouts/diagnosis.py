"""Viewer recording of a diagnosis: verdict, heatmaps of the gap, and trials as measured and as simulated."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.errors import InputError
from klute_sim.report.diagnosis import text as words
from klute_sim.report.diagnosis.traces import SimulatedTrial, simulate_shown_trials
from klute_sim.viewer import chart, heatmap, stream
from klute_sim.viewer.layouts import diagnosis_leg, diagnosis_map
from klute_sim.viewer.stream import BLUE, GREY, ORANGE, SeriesLine

TIMELINE = "time"
"""Timeline of the time from the start of each trial."""
VERDICT_ENTITY = "verdict"
CASE_COLOURS = {"measured": GREY, "before": ORANGE, "after": BLUE}


def write_recording(diagnosis: Diagnosis, path: Path) -> None:
    """Write the shown trials of ``diagnosis`` to ``path`` (.rrd).

    Raises MissingExtraError without rerun, and InputError if the data were insufficient to simulate any trial.
    """
    rr = stream.import_rerun()
    trials = simulate_shown_trials(diagnosis)
    if not trials:
        raise InputError("cannot write a rerun recording: no trial was simulated, because the data are insufficient")
    maps = list(diagnosis_map.build_maps(diagnosis, trials))
    identity = [diagnosis.dataset.digest, *map(str, diagnosis.added_terms)]
    with stream.open_recording(path, "diagnosis", identity, lambda: build_blueprint(diagnosis, trials, maps)) as out:
        stream.log_text(out, VERDICT_ENTITY, format_page(diagnosis))
        for _, channel_maps in maps:
            for _, case_map in channel_maps:
                heatmap.log_heatmap(out, case_map)
        for number, trial in enumerate(trials, start=1):
            for channel in _list_channels(trial):
                axis = rr.TimeColumn(TIMELINE, duration=trial.get_sample_times(channel))
                stream.send_lines(out, axis, build_lines(diagnosis, trial, number, channel))
            if diagnosis_leg.has_ankle_motion(diagnosis, trial):
                diagnosis_leg.log_leg(out, diagnosis, trial, f"trial_{number}/leg", TIMELINE)
            for loop in build_loop_charts(diagnosis, trial, number):
                chart.log_chart(out, loop)


def _list_cases(diagnosis: Diagnosis, simulated: SimulatedTrial) -> list[tuple[str, str, Any]]:
    """Return the simulated cases: entity, name, and readings of the channels."""
    if not diagnosis.added_terms:
        return [("before", "simulated", simulated.before)]
    return [("before", "refitted", simulated.before), ("after", "with effects added", simulated.after)]


def build_lines(diagnosis: Diagnosis, simulated: SimulatedTrial, number: int, channel: str) -> Iterator[SeriesLine]:
    """Yield the lines of one channel of the ``number``-th trial: signals, then residuals.

    Entities are named by the numbers of trials: names may have characters that entity paths cannot have.
    """
    unit, measured = CHANNEL_UNITS[channel][1], simulated.experiment.measured[channel].value
    prefix = f"trial_{number}/{channel}"
    yield SeriesLine(f"{prefix}/signal/measured", "measured", GREY, 1.0, measured / unit)
    for entity, name, values in _list_cases(diagnosis, simulated):
        yield SeriesLine(f"{prefix}/signal/{entity}", name, CASE_COLOURS[entity], 2.0, values[channel] / unit)
    for entity, name, values in _list_cases(diagnosis, simulated):
        yield SeriesLine(
            f"{prefix}/residual/{entity}", name, CASE_COLOURS[entity], 1.0, (measured - values[channel]) / unit
        )


def build_loop_charts(diagnosis: Diagnosis, simulated: SimulatedTrial, number: int) -> list[chart.Chart]:
    """Return the chart of force over length of a bench trial, measured and simulated; nothing for other trials."""
    if diagnosis.dataset.rig != "bench" or "force" not in _list_channels(simulated):
        return []
    experiment, prescribed = simulated.experiment, simulated.experiment.prescribed_input
    grid = experiment.start_time + experiment.dt * np.arange(1, len(prescribed.values) + 1)
    length = np.interp(experiment.measured["force"].time, grid, prescribed.values) / prescribed.si_factor
    curves = [
        chart.ChartCurve(name, CASE_COLOURS[entity], length, values["force"])
        for entity, name, values in _list_cases(diagnosis, simulated)
    ]
    # Last, so that the thin measured curve lies on the simulated ones.
    curves.append(chart.ChartCurve("measured", GREY, length, experiment.measured["force"].value, thin=True))
    return [chart.Chart(f"trial_{number}/loop", prescribed.label, "force [N]", tuple(curves))]


def format_page(diagnosis: Diagnosis) -> str:
    """Return verdict, gap, fitted parameters and use of the trials as Markdown."""
    d = diagnosis
    paragraphs = [
        f"# {words.describe_verdict(d)}",
        words.describe_improvement(d),
        words.describe_equation_residuals(d),
        *map(words.format_sentence, d.reasons),
    ]
    rows = []
    for channel, gap in d.channel_rms.items():
        unit, si = CHANNEL_UNITS[channel]
        values = [gap.nominal, gap.refitted, gap.with_effects if d.added_terms else None, gap.noise_floor]
        rows.append(
            [words.humanize_identifier(channel), unit, *(None if value is None else value / si for value in values)]
        )
    trials = "test trials" if d.evaluated_on == "test" else "the fitted trials (there are no usable test trials)"
    paragraphs.append(f"## Gap: root mean square of measured minus simulated values, on {trials}")
    paragraphs.append(
        stream.format_markdown_table(["channel", "unit", "nominal", "refitted", "with effects", "repeat noise"], rows)
    )
    paragraphs += filter(None, [words.describe_weights(d)])
    if d.added_terms and d.final_fit is not None:
        paragraphs.append(f"## {words.format_effects_title(d)}")
        paragraphs += _format_effects(d, d.final_fit)
    paragraphs.append("## Trials")
    for use in ("fit", "validation", "test"):
        names = [e.name for e in d.experiments if e.use == use]
        paragraphs.append(f"- {use}: {', '.join(names) or 'none'}")
    return "\n\n".join(filter(None, paragraphs))


def build_blueprint(
    diagnosis: Diagnosis,
    trials: Sequence[SimulatedTrial],
    maps: Sequence[tuple[str, list[tuple[str, heatmap.Heatmap]]]],
) -> Any:
    """Build the layout: a tab with the verdict and the heatmaps of the gap, and a tab for each trial.

    The tab of a trial has the leg or the work loop, and its channels with their residuals below.
    """
    import rerun.blueprint as rrb

    rows = [
        rrb.Horizontal(
            *(
                heatmap.build_view(case_map, f"{channel}, {name}: measured - simulated")
                for name, case_map in channel_maps
            )
        )
        for channel, channel_maps in maps
    ]
    verdict = stream.build_text_view("verdict", VERDICT_ENTITY)
    tabs: list[Any] = [rrb.Horizontal(verdict, rrb.Vertical(*rows), column_shares=[1, 2], name="verdict and gap")]
    for number, trial in enumerate(trials, start=1):
        use = "test trial" if diagnosis.evaluated_on == "test" else "fitted trial"
        tabs.append(_build_trial_view(diagnosis, trial, number, f"{trial.experiment.name} ({use})"))
    return stream.build_window_blueprint(rrb.Tabs(*tabs), TIMELINE)


def _build_trial_view(diagnosis: Diagnosis, simulated: SimulatedTrial, number: int, name: str) -> Any:
    import rerun.blueprint as rrb

    columns = []
    for channel in _list_channels(simulated):
        label, unit = words.humanize_identifier(channel), CHANNEL_UNITS[channel][0]
        views = [
            rrb.TimeSeriesView(
                origin=f"/trial_{number}/{channel}/{panel}",
                name=title,
                plot_legend=rrb.PlotLegend(visible=panel == "signal"),
            )
            for panel, title in (
                ("signal", f"{label} [{unit}]"),
                ("residual", f"{label}, measured - simulated [{unit}]"),
            )
        ]
        columns.append(rrb.Vertical(*views, row_shares=[3, 2]))
    curves = rrb.Grid(*columns, grid_columns=min(4, len(columns)))
    root = f"trial_{number}/leg"
    if diagnosis_leg.has_ankle_motion(diagnosis, simulated):
        cases = [
            ("measured", "measured"),
            *((entity, case) for entity, case, _ in _list_cases(diagnosis, simulated)),
        ]
        legs = rrb.Horizontal(*(diagnosis_leg.build_view(root, entity, case) for entity, case in cases))
        return rrb.Vertical(legs, curves, row_shares=[2, 3], name=name)
    loops = [chart.build_view(loop, "force over length") for loop in build_loop_charts(diagnosis, simulated, number)]
    return rrb.Horizontal(*loops, curves, column_shares=[1] * len(loops) + [2], name=name)


def _list_channels(simulated: SimulatedTrial) -> list[str]:
    return [channel for channel, series in simulated.experiment.measured.items() if len(series.time)]


def _format_effects(diagnosis: Diagnosis, final_fit: Fit) -> Iterator[str]:
    """Yield a line for each parameter of the added effects, which wraps in a narrow panel as a table would not."""
    parameters = zip(final_fit.hypothesis.parameters, final_fit.values, diagnosis.confidence_intervals, strict=True)
    for parameter, value, interval in parameters:
        if parameter.term_index is None:
            continue
        term = final_fit.hypothesis.terms[parameter.term_index]
        name, unit = words.format_parameter_name(parameter, term.channel)
        value_text, low, high = words.format_interval(value, *interval)
        unit_text = f" {unit}" if unit else ""
        label = words.format_term(term) if term.number else f"{words.format_term(term)}, {name}"
        declared = f"; declared: {words.format_number(parameter.initial)}" if term.number else ""
        yield f"- {label}: {value_text}{unit_text} (95 %: {low} to {high}{declared})"
