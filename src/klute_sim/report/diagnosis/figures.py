"""Figures of a diagnosis: traces before and after, gap, ranking of candidates, and localization of the misfit.

Matplotlib is imported when a figure is built.
"""

import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.bic import format_bic_drop
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.diagnosis.selection.selection_step import SelectionStep
from klute_sim.report.diagnosis import text as words
from klute_sim.report.diagnosis.localization_figure import CASE_COLOURS, build_localization_figure
from klute_sim.report.diagnosis.traces import SimulatedTrial, simulate_shown_trials
from klute_sim.report.style import MEASURED_COLOUR, add_heading, save_figure, use_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NOISE_COLOUR, NOMINAL_COLOUR, THRESHOLD_COLOUR = "0.85", "0.65", "#d62728"
BEFORE_COLOUR, AFTER_COLOUR = CASE_COLOURS["before"], CASE_COLOURS["after"]
PREDICTED_COLOUR, REFITTED_COLOUR = "#c6dbef", "#8c8c8c"
MAX_GAP_COLUMNS = 2
"""Maximum number of panels side by side in the figure of the gaps."""
MAX_TITLE_LINE_CHARS = 80
"""Largest length of a line of the title of a step, which the names of candidates leave room for."""
MAX_BARS_PER_STEP = 10
"""Number of candidates shown for each step, in addition to those that were refitted."""


def build_overlay_figure(diagnosis: Diagnosis, simulated: SimulatedTrial) -> "Figure":
    """Plot each channel of a trial as measured and as ``simulated`` before and after, with the residuals below."""
    channels = [c for c, series in simulated.experiment.measured.items() if len(series.time)]
    with use_style() as create_figure:
        figure = create_figure(0.9 + 3.2 * len(channels))
        axes = figure.subplots(
            2 * len(channels), 1, sharex=True, squeeze=False, height_ratios=[2.0, 1.1] * len(channels)
        )[:, 0]
        for index, channel in enumerate(channels):
            _plot_comparison(axes[2 * index], axes[2 * index + 1], diagnosis, simulated, channel)
        axes[-1].set_xlabel("time from the start of the trial [s]")
        axes[-1].set_xlim(0.0, simulated.experiment.duration)
        figure.align_ylabels()
        use = "test trial" if diagnosis.evaluated_on == "test" else "fitted trial; there are no usable test trials"
        add_heading(figure, f"trial '{simulated.experiment.name}' ({use})", axes[0])
    return figure


def _plot_comparison(
    above: "Axes", below: "Axes", diagnosis: Diagnosis, simulated: SimulatedTrial, channel: str
) -> None:
    unit, si = CHANNEL_UNITS[channel]
    time, value = simulated.get_sample_times(channel), simulated.experiment.measured[channel].value
    lines = [("refitted" if diagnosis.added_terms else "simulated", simulated.before[channel], BEFORE_COLOUR, 1.6)]
    if diagnosis.added_terms:
        lines.append(("with effects added", simulated.after[channel], AFTER_COLOUR, 1.6))
    if channel in diagnosis.noise:
        deviation = diagnosis.noise[channel].std * simulated.experiment.noise_scale.get(channel, np.ones(len(time)))
        label = "±1 sd of the noise" if diagnosis.has_repeats else "±1 sd of the residuals that count as noise"
        low, high = (value - deviation) / si, (value + deviation) / si
        above.fill_between(time, low, high, color=NOISE_COLOUR, linewidth=0.0, label=label)
        below.fill_between(time, -deviation / si, deviation / si, color=NOISE_COLOUR, linewidth=0.0)
    above.plot(time, value / si, color=MEASURED_COLOUR, linewidth=0.6, label="measured", zorder=3.0)
    for label, simulation, colour, width in lines:
        above.plot(time, simulation / si, color=colour, linewidth=width, label=label)
        below.plot(time, (value - simulation) / si, color=colour, linewidth=0.7)
    above.set_ylabel(f"{words.humanize_identifier(channel)}\n[{unit}]")
    below.set_ylabel(f"measured -\nsimulated [{unit}]")


def build_gap_figure(diagnosis: Diagnosis) -> "Figure":
    """Plot the root mean square gap of every channel, and the noise between repeats as its lower limit."""
    from matplotlib.ticker import MaxNLocator

    white = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
    with use_style() as create_figure:
        columns = min(MAX_GAP_COLUMNS, len(diagnosis.channel_rms))
        rows = -(-len(diagnosis.channel_rms) // columns)
        figure = create_figure(0.4 + 2.2 * rows)
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for unused in axes[len(diagnosis.channel_rms) :]:
            unused.set_axis_off()
        for number, (axis, (channel, gap)) in enumerate(zip(axes, diagnosis.channel_rms.items(), strict=False)):
            unit, si = CHANNEL_UNITS[channel]
            bars = [
                ("nominal device", gap.nominal, NOMINAL_COLOUR),
                ("refitted", gap.refitted, BEFORE_COLOUR),
            ]
            if diagnosis.added_terms:
                bars.append(("with effects added", gap.with_effects, AFTER_COLOUR))
            if gap.noise_floor is not None:
                bars.append(("repeat noise", gap.noise_floor, NOISE_COLOUR))
                axis.axvline(gap.noise_floor / si, color="0.5", linewidth=0.7, linestyle=":")
            container = axis.barh(
                [name for name, _, _ in bars], [v / si for _, v, _ in bars], color=[c for _, _, c in bars], height=0.7
            )
            axis.bar_label(
                container,
                labels=[words.format_number(v / si, 3) for _, v, _ in bars],
                padding=3,
                bbox=white,
            )
            axis.margins(x=0.2)
            axis.invert_yaxis()
            axis.xaxis.set_major_locator(MaxNLocator(5))
            axis.set_xlabel(f"rms, measured - simulated [{unit}]")
            axis.set_title(words.humanize_identifier(channel))
            axis.grid(visible=False, axis="y")
            if number % columns:
                axis.tick_params(labelleft=False)
        figure.suptitle("on test trials" if diagnosis.evaluated_on == "test" else "on the fitted trials")
    return figure


class RankingBar(NamedTuple):
    """A candidate effect in the ranking of one step."""

    name: str
    predicted_drop: float
    """Drop of chi squared that the screening predicts."""
    bic_drop: float | None
    """Drop of BIC after refitting; None: not refitted."""
    converged: bool
    """Whether the fit was continued until it converged, as that of an accepted candidate is after the selection."""
    accepted: bool


def rank_candidates(diagnosis: Diagnosis, step: SelectionStep) -> list[RankingBar]:
    """Return all candidates of ``step``: refitted ones by their drop of BIC, then the others by the predicted drop."""
    before = step.initial_fit.bic(diagnosis.n_independent)
    fits = {f.hypothesis.terms[-1]: f for f in step.refits}
    bars = []
    for c in step.candidates:
        refit = fits.get(c.term)
        fall = before - refit.bic(diagnosis.n_independent) if refit else None
        bars.append(
            RankingBar(
                words.format_term(c.term),
                c.predicted_gain,
                fall,
                c.term == step.added_term or bool(refit and refit.converged),
                c.term == step.added_term,
            )
        )
    return sorted(bars, key=lambda b: (b.bic_drop is None, -(b.predicted_drop if b.bic_drop is None else b.bic_drop)))


def build_ranking_figure(diagnosis: Diagnosis) -> "Figure":
    """Plot the predicted drop of chi squared and the drop of BIC after refitting, for every step."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.ticker import LogLocator

    handles = [
        Patch(color=PREDICTED_COLOUR, label="predicted by screening"),
        Patch(color=REFITTED_COLOUR, label="drop of BIC after refitting"),
        Patch(color=AFTER_COLOUR, label="drop of BIC, accepted"),
        Line2D(
            [], [], color=THRESHOLD_COLOUR, linestyle="--", linewidth=0.9, label=f"{diagnosis.bic_threshold:.0f} decide"
        ),
    ]

    steps = [(step, rank_candidates(diagnosis, step)) for step in diagnosis.selection_history]
    shown = [[b for k, b in enumerate(bars) if b.bic_drop is not None or k < MAX_BARS_PER_STEP] for _, bars in steps]
    titles = [
        _format_step_title(number, step, len(all_bars) - len(bars))
        for number, ((step, all_bars), bars) in enumerate(zip(steps, shown, strict=True), start=1)
    ]
    with use_style() as create_figure:
        ratios = [
            1.0 + 0.2 * len(title.splitlines()) + 0.27 * len(bars) for title, bars in zip(titles, shown, strict=True)
        ]
        figure = create_figure(0.6 + sum(ratios))
        axes = figure.subplots(len(steps), 1, squeeze=False, sharex=True, height_ratios=ratios)[:, 0]
        highest = max((max(b.predicted_drop, b.bic_drop or 0.0) for bars in shown for b in bars), default=1.0)
        for axis, title, bars in zip(axes, titles, shown, strict=True):
            _plot_ranking(axis, bars, diagnosis.bic_threshold)
            axis.set_title(title, loc="left")
        axes[0].set_xscale("log")
        axes[0].set_xlim(1.0, 6.0 * max(highest, 10.0))
        axes[0].xaxis.set_major_locator(LogLocator(numticks=12))
        axes[-1].set_xlabel("drop of chi squared (predicted) and of BIC (refitted), logarithmic")
        figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


def _format_step_title(number: int, step: SelectionStep, n_omitted: int) -> str:
    """Return what step ``number`` added and why, in lines that fit above the bars beside the names of candidates."""
    omitted = f"; {n_omitted} candidates with smaller predictions omitted" if n_omitted else ""
    added = f"{words.format_term(step.added_term)} is added: " if step.added_term else "nothing is added: "
    title = f"step {number}: {added}{_shorten(words.humanize_text(step.reason))}{omitted}"
    return textwrap.fill(title, MAX_TITLE_LINE_CHARS)


def _plot_ranking(axis: "Axes", bars: list[RankingBar], threshold: float) -> None:
    for position, bar in enumerate(bars):
        axis.barh(position, max(bar.predicted_drop, 1.0), color=PREDICTED_COLOUR, height=0.84)
        text = "not refitted"
        if bar.bic_drop is not None:
            axis.barh(
                position, max(bar.bic_drop, 1.0), color=AFTER_COLOUR if bar.accepted else REFITTED_COLOUR, height=0.42
            )
            text = format_bic_drop(bar.bic_drop)
            text += "" if bar.converged else " (stopped early)"
        end = max(bar.predicted_drop, bar.bic_drop or 1.0, 1.0)
        axis.text(
            1.06 * end, position, text, va="center", fontsize=8.5, color="0.3" if bar.bic_drop is not None else "0.45"
        )
    axis.axvline(threshold, color=THRESHOLD_COLOUR, linewidth=0.9, linestyle="--")
    axis.set_yticks(range(len(bars)), [bar.name for bar in bars])
    for label, bar in zip(axis.get_yticklabels(), bars, strict=True):
        label.set_fontweight("bold" if bar.accepted else "normal")
    axis.set_ylim(len(bars) - 0.4, -0.6)
    axis.grid(visible=False, axis="y")


def _shorten(text: str, max_length: int = 90) -> str:
    return text if len(text) <= max_length else f"{text[:max_length].rstrip()} …"


def build_figures(diagnosis: Diagnosis) -> Iterator[tuple[str, "Figure"]]:
    """Yield name and figure of everything that the diagnosis can show; nothing if nothing was fitted."""
    shown: list[SimulatedTrial] = simulate_shown_trials(diagnosis)
    if shown:
        yield "before_after", build_overlay_figure(diagnosis, shown[0])
    if diagnosis.channel_rms:
        yield "gap", build_gap_figure(diagnosis)
    if any(step.candidates for step in diagnosis.selection_history):
        yield "ranking", build_ranking_figure(diagnosis)
    if diagnosis.misfit_regions:
        yield "localization", build_localization_figure(diagnosis)


def save_figures(diagnosis: Diagnosis, folder: Path) -> list[Path]:
    """Write every figure as PNG into ``folder``, which is created if missing; return the paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, figure in build_figures(diagnosis):
        paths.append(folder / f"{name}.png")
        save_figure(figure, paths[-1])
    return paths
