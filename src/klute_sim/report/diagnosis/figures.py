"""Pictures of a diagnosis: before and after, the gap, the ranking of candidates, and where the misfit is.

Matplotlib is imported when something is drawn.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Array, Experiment, PrescribedInput
from klute_sim.diagnosis.selection.forward_selection import SelectionStep
from klute_sim.diagnosis.workflow import Diagnosis
from klute_sim.report.diagnosis import text as words
from klute_sim.report.diagnosis.traces import SimulatedTrial, simulate_shown_trials
from klute_sim.report.style import STYLE
from klute_sim.units import BAR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURED_COLOUR, NOISE_COLOUR, NOMINAL_COLOUR, BEFORE_COLOUR, AFTER_COLOUR, THRESHOLD_COLOUR = (
    "0.15",
    "0.85",
    "0.65",
    "#e6842a",
    "#1f77b4",
    "#d62728",
)
PREDICTED_COLOUR, REFITTED_COLOUR = "#c6dbef", "#8c8c8c"
DPI = 120
MAX_BARS_PER_STEP = 10
"""Candidates shown for each step, beside those that were refitted."""
N_MAP_BINS, N_TIME_BINS = 8, 12
MIN_SAMPLES_PER_BIN = 5
"""Samples in a bin that is shown."""


def build_overlay_figure(diagnosis: Diagnosis, simulated: SimulatedTrial) -> "Figure":
    """Measured, before and after in trial ``one``, a channel at a time, the residuals underneath."""
    from matplotlib.patches import Patch

    channels = [c for c, series in simulated.experiment.measured.items() if len(series.time)]
    with _use_style() as figure_of:
        figure = figure_of(10.0, 0.7 + 3.2 * len(channels))
        axes = figure.subplots(
            2 * len(channels), 1, sharex=True, squeeze=False, height_ratios=[2.0, 1.1] * len(channels)
        )[:, 0]
        for number, channel in enumerate(channels):
            _plot_comparison(axes[2 * number], axes[2 * number + 1], diagnosis, simulated, channel)
        band = Patch(
            color=NOISE_COLOUR,
            label="±1 sd of the noise" if diagnosis.has_repeats else "±1 sd of what is taken for noise",
        )
        key = [*axes[0].get_legend_handles_labels()[0], band]
        axes[0].legend(handles=key, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2)
        axes[-1].set_xlabel("time from the trial's start [s]")
        axes[-1].set_xlim(0.0, simulated.experiment.duration)
        figure.align_ylabels()
        seen = "no fit saw it" if diagnosis.evaluated_on == "show" else "it was fitted: no trial was kept back to show"
        figure.suptitle(f"trial '{simulated.experiment.name}' ({seen})")
    return figure


def _plot_comparison(
    above: "Axes", below: "Axes", diagnosis: Diagnosis, simulated: SimulatedTrial, channel: str
) -> None:
    unit, si = CHANNEL_UNITS[channel]
    time, value = simulated.sample_times(channel), simulated.experiment.measured[channel].value
    lines = [("refitted" if diagnosis.added_terms else "simulated", simulated.before[channel], BEFORE_COLOUR, 1.6)]
    if diagnosis.added_terms:
        lines.append(("with effects added", simulated.after[channel], AFTER_COLOUR, 1.6))
    if channel in diagnosis.noise:
        deviation = diagnosis.noise[channel].std * simulated.experiment.noise_scale.get(channel, np.ones(len(time)))
        above.fill_between(time, (value - deviation) / si, (value + deviation) / si, color=NOISE_COLOUR, linewidth=0.0)
        below.fill_between(time, -deviation / si, deviation / si, color=NOISE_COLOUR, linewidth=0.0)
    above.plot(time, value / si, color=MEASURED_COLOUR, linewidth=0.6, label="measured", zorder=3.0)
    for label, simulation, colour, width in lines:
        above.plot(time, simulation / si, color=colour, linewidth=width, label=label)
        below.plot(time, (value - simulation) / si, color=colour, linewidth=0.7)
    above.set_ylabel(f"{words.humanize_identifier(channel)}\n[{unit}]")
    below.set_ylabel(f"measured -\nsimulated [{unit}]")
    for axis in (above, below):
        axis.grid(alpha=0.25, linewidth=0.5)


def build_gap_figure(diagnosis: Diagnosis) -> "Figure":
    """Root mean square gap of every channel, and the noise under which it cannot go."""
    from matplotlib.ticker import MaxNLocator

    white = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
    with _use_style() as figure_of:
        figure = figure_of(max(6.0, 3.6 * len(diagnosis.channel_rms)), 2.6)
        axes = figure.subplots(1, len(diagnosis.channel_rms), squeeze=False)[0]
        for axis, (channel, gap) in zip(axes, diagnosis.channel_rms.items(), strict=True):
            unit, si = CHANNEL_UNITS[channel]
            bars = [
                ("nominal device", gap.nominal, NOMINAL_COLOUR),
                ("refitted", gap.refitted, BEFORE_COLOUR),
            ]
            if diagnosis.added_terms:
                bars.append(("with effects added", gap.with_effects, AFTER_COLOUR))
            if gap.noise_floor is not None:
                bars.append(("noise of repeats", gap.noise_floor, NOISE_COLOUR))
                axis.axvline(gap.noise_floor / si, color="0.5", linewidth=0.7, linestyle=":")
            drawn = axis.barh(
                [name for name, _, _ in bars], [v / si for _, v, _ in bars], color=[c for _, _, c in bars], height=0.7
            )
            axis.bar_label(
                drawn, labels=[words.format_number(v / si, 3) for _, v, _ in bars], padding=3, fontsize=8, bbox=white
            )
            axis.margins(x=0.2)
            axis.invert_yaxis()
            axis.xaxis.set_major_locator(MaxNLocator(5))
            axis.set_xlabel(f"rms, measured - simulated [{unit}]")
            axis.set_title(words.humanize_identifier(channel))
            if axis is not axes[0]:
                axis.tick_params(labelleft=False)
        figure.suptitle("on trials that no fit saw" if diagnosis.evaluated_on == "show" else "on the fitted trials")
    return figure


class RankingBar(NamedTuple):
    """A candidate in the ranking."""

    name: str
    predicted_drop: float
    """Fall of chi squared that the screening predicts."""
    bic_drop: float | None
    """Of BIC after refitting; None: not refitted."""
    converged: bool
    """Whether its fit was carried on until it converged."""
    accepted: bool


def rank_candidates(diagnosis: Diagnosis, step: SelectionStep) -> list[RankingBar]:
    """All candidates of ``step``: those that were refitted by their fall of BIC, the others by what they promised."""
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
                bool(refit and refit.converged),
                c.term == step.added_term,
            )
        )
    return sorted(bars, key=lambda b: (b.bic_drop is None, -(b.predicted_drop if b.bic_drop is None else b.bic_drop)))


def build_ranking_figure(diagnosis: Diagnosis) -> "Figure":
    """What the screening promised and what refitting kept of it, in every step."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.ticker import LogLocator

    key = [
        Patch(color=PREDICTED_COLOUR, label="promised by screening"),
        Patch(color=REFITTED_COLOUR, label="fall of BIC after refitting"),
        Patch(color=AFTER_COLOUR, label="the same, accepted"),
        Line2D(
            [], [], color=THRESHOLD_COLOUR, linestyle="--", linewidth=0.9, label=f"{diagnosis.bic_threshold:.0f} decide"
        ),
    ]

    steps = [(step, rank_candidates(diagnosis, step)) for step in diagnosis.selection_history]
    shown = [[b for k, b in enumerate(bars) if b.bic_drop is not None or k < MAX_BARS_PER_STEP] for _, bars in steps]
    with _use_style() as figure_of:
        figure = figure_of(9.0, 0.6 + sum(1.2 + 0.27 * len(bars) for bars in shown))
        ratios = [1.2 + 0.27 * len(bars) for bars in shown]
        axes = figure.subplots(len(steps), 1, squeeze=False, sharex=True, height_ratios=ratios)[:, 0]
        highest = max((max(b.predicted_drop, b.bic_drop or 0.0) for bars in shown for b in bars), default=1.0)
        for number, (axis, (step, every), bars) in enumerate(zip(axes, steps, shown, strict=True), start=1):
            _plot_ranking(axis, bars, diagnosis.bic_threshold)
            left = len(every) - len(bars)
            rest = f"; {left} more promise less" if left else ""
            added = f"{words.format_term(step.added_term)} is added: " if step.added_term else "nothing is added: "
            axis.set_title(
                f"step {number}: {added}{_shorten(words.humanize_text(step.reason))}{rest}", loc="left", fontsize=9
            )
        axes[0].set_xscale("log")
        axes[0].set_xlim(1.0, 6.0 * max(highest, 10.0))
        axes[0].xaxis.set_major_locator(LogLocator(numticks=12))
        axes[-1].set_xlabel("fall of chi squared (promised) and of BIC (refitted), logarithmic")
        figure.legend(handles=key, loc="outside lower center", ncols=4)
    return figure


def _plot_ranking(axis: "Axes", bars: list[RankingBar], threshold: float) -> None:
    for place, bar in enumerate(bars):
        axis.barh(place, max(bar.predicted_drop, 1.0), color=PREDICTED_COLOUR, height=0.84)
        text = "not refitted"
        if bar.bic_drop is not None:
            axis.barh(
                place, max(bar.bic_drop, 1.0), color=AFTER_COLOUR if bar.accepted else REFITTED_COLOUR, height=0.42
            )
            text = f"falls by {bar.bic_drop:.0f}" if bar.bic_drop >= 0.5 else f"rises by {-bar.bic_drop:.0f}"
            text += "" if bar.converged else " (stopped early)"
        end = max(bar.predicted_drop, bar.bic_drop or 1.0, 1.0)
        axis.text(
            1.06 * end, place, text, va="center", fontsize=7.5, color="0.3" if bar.bic_drop is not None else "0.6"
        )
    axis.axvline(threshold, color=THRESHOLD_COLOUR, linewidth=0.9, linestyle="--")
    axis.set_yticks(range(len(bars)), [bar.name for bar in bars])
    for label, bar in zip(axis.get_yticklabels(), bars, strict=True):
        label.set_fontweight("bold" if bar.accepted else "normal")
    axis.set_ylim(len(bars) - 0.4, -0.6)
    axis.grid(axis="x", alpha=0.25, linewidth=0.5)


def _shorten(text: str, max_length: int = 110) -> str:
    return text if len(text) <= max_length else f"{text[:max_length].rstrip()} …"


class ResidualSamples(NamedTuple):
    """A channel of all fitted trials, sample by sample."""

    pressure_command: Array
    """Commanded [Pa]."""
    prescribed: Array
    """Prescribed: the length [m], or what the rig prescribes instead of it [SI]."""
    prescribed_rate: Array
    """Of that, over 50 ms [SI/s]."""
    time: Array
    """From each trial's begin [s]."""
    before: Array
    """Residual over the noise, with none added."""
    after: Array
    """With what was found."""


def collect_residuals(diagnosis: Diagnosis, channel: str) -> ResidualSamples:
    """``channel`` of the fitted trials with what was prescribed; nothing where nothing was fitted."""
    rows = []
    base, final = diagnosis.base_fit, diagnosis.final_fit
    if base is not None and final is not None:
        fitted = [e for e in diagnosis.experiments if e.use == "fit" and e.measured]
        for experiment, early, late in zip(fitted, base.residuals, final.residuals, strict=True):
            if channel in experiment.measured:
                rows.append(_collect_trial_residuals(experiment, channel, early, late, diagnosis.noise[channel].std))
    return ResidualSamples(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def _collect_trial_residuals(
    experiment: Experiment, channel: str, before: Mapping[str, Array], after: Mapping[str, Array], noise_sd: float
) -> ResidualSamples:
    time = experiment.measured[channel].time - experiment.start_time
    count = len(experiment.command)
    step, noise_then = experiment.duration / count, noise_sd * experiment.noise_scale.get(channel, 1.0)
    grid, course = step * np.arange(1, count + 1), experiment.prescribed_input.values
    later, earlier = (np.interp(time + shift, grid, course) for shift in (0.025, -0.025))
    return ResidualSamples(
        np.interp(time, grid, experiment.command),
        np.interp(time, grid, course),
        (later - earlier) / 0.05,
        time,
        before[channel] / noise_then,
        after[channel] / noise_then,
    )


def build_localization_figure(diagnosis: Diagnosis) -> "Figure":
    """Root mean square misfit of the fitted trials over pressure and length, over time and by the rig's motion."""
    channels = [place.channel for place in diagnosis.misfit_regions]
    told = {place.channel: place for place in diagnosis.misfit_regions}
    pairs = [("before", "refitted")] + ([("after", "with effects added")] if diagnosis.added_terms else [])
    with _use_style() as figure_of:
        figure = figure_of(13.0 if diagnosis.added_terms else 10.5, 0.7 + 2.9 * len(channels))
        rows = figure.subfigures(len(channels), 1, squeeze=False)[:, 0]
        for row, channel in zip(rows, channels, strict=True):
            own, place = collect_residuals(diagnosis, channel), told[channel]
            title = f"{words.humanize_identifier(channel)}: rms {np.sqrt(np.mean(own.before**2)):.3g} times the noise"
            if diagnosis.verdict != "nothing-missing":  # shares of nothing
                title += f"; {place.region or 'all of it'}: {100.0 * place.fraction:.0f} % of all channels' misfit"
            row.suptitle(title, fontsize=10, fontweight="bold")
            axes = row.subplots(1, len(pairs) + 2, squeeze=False)[0]
            axes[-1].sharey(axes[-2])
            course = next(e for e in diagnosis.experiments if channel in e.measured).prescribed_input
            _plot_maps(row, axes[: len(pairs)], own, course, pairs)
            _plot_over_time(axes[-2], own, pairs, repeated=diagnosis.has_repeats)
            _plot_by_motion(axes[-1], own, course, pairs)
    return figure


def _plot_maps(
    figure: Any, axes: Any, residuals: ResidualSamples, prescribed_input: PrescribedInput, cases: list[tuple[str, str]]
) -> None:
    pressure, along = residuals.pressure_command / BAR, residuals.prescribed / prescribed_input.si_factor
    edges = [np.histogram_bin_edges(along, N_MAP_BINS), np.histogram_bin_edges(pressure, N_MAP_BINS)]
    maps = [_compute_binned_rms((along, pressure), edges, getattr(residuals, which)) for which, _ in cases]
    top = max(3.0, max(float(np.nanmax(found, initial=0.0)) for found in maps))
    for axis, found, (_, name) in zip(axes, maps, cases, strict=True):
        mesh = axis.pcolormesh(*edges, found.T, cmap="YlOrRd", vmin=0.0, vmax=top)
        axis.set_title(name)
        axis.set_xlabel(prescribed_input.label)
        axis.set_ylabel("pressure command [bar]" if axis is axes[0] else "")
        axis.set_facecolor("0.94")
    bar = figure.colorbar(mesh, ax=list(axes), fraction=0.08, aspect=18)
    bar.ax.set_title("rms / sd", fontsize=8)


def _compute_binned_rms(values: tuple[Array, ...], edges: list[Array], residual: Array) -> Array:
    sample = np.stack(values, axis=1)
    count = np.histogramdd(sample, edges)[0]
    total = np.histogramdd(sample, edges, weights=residual**2)[0]
    found = np.sqrt(total / np.maximum(count, 1.0))
    found[count < MIN_SAMPLES_PER_BIN] = np.nan
    return np.asarray(found)


CASE_COLOURS = {"before": BEFORE_COLOUR, "after": AFTER_COLOUR}


def _plot_over_time(axis: "Axes", residuals: ResidualSamples, cases: list[tuple[str, str]], *, repeated: bool) -> None:
    edges = np.linspace(0.0, float(residuals.time.max()), N_TIME_BINS + 1)
    for which, name in cases:
        found = _compute_binned_rms((residuals.time,), [edges], getattr(residuals, which))
        axis.stairs(found, edges, fill=True, color=CASE_COLOURS[which], label=name, alpha=0.85)
    axis.axhline(
        1.0, color="0.4", linewidth=0.8, linestyle="--", label="noise alone" if repeated else "what is taken for noise"
    )
    axis.set_xlim(0.0, edges[-1])
    axis.set_xlabel("time from the trial's start [s]")
    axis.set_ylabel("rms misfit / sd of the noise")
    axis.legend(
        ncols=len(cases) + 1,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.2,
        columnspacing=0.9,
        handlelength=1.2,
    )


def _plot_by_motion(
    axis: "Axes", residuals: ResidualSamples, prescribed_input: PrescribedInput, cases: list[tuple[str, str]]
) -> None:
    parts = (
        residuals.prescribed_rate < -prescribed_input.stationary_rate,
        np.abs(residuals.prescribed_rate) <= prescribed_input.stationary_rate,
        residuals.prescribed_rate > prescribed_input.stationary_rate,
    )
    masks = dict(zip(prescribed_input.direction_labels, parts, strict=True))
    width = 0.8 / len(cases)
    for number, (which, name) in enumerate(cases):
        residual = getattr(residuals, which)
        rms = [
            float(np.sqrt(np.mean(residual[m] ** 2))) if m.sum() >= MIN_SAMPLES_PER_BIN else np.nan
            for m in masks.values()
        ]
        places = np.arange(len(masks)) + (number - 0.5 * (len(cases) - 1)) * width
        axis.bar(places, rms, width=0.92 * width, color=CASE_COLOURS[which], label=name)
    axis.set_xticks(range(len(masks)), list(masks))
    axis.axhline(1.0, color="0.4", linewidth=0.8, linestyle="--")
    axis.set_xlabel("motion of the rig")


@contextmanager
def _use_style() -> Iterator[Callable[[float, float], "Figure"]]:
    """The style while a figure is drawn; gives what makes one (width and height in inches)."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        yield lambda width, height: Figure(figsize=(width, height), layout="constrained")


def build_figures(diagnosis: Diagnosis) -> Iterator[tuple[str, "Figure"]]:
    """Name and figure of every picture that there is something for; none where nothing was fitted."""
    shown: list[SimulatedTrial] = simulate_shown_trials(diagnosis)
    if shown:
        yield "before_after", build_overlay_figure(diagnosis, shown[0])
    if diagnosis.channel_rms:
        yield "gap", build_gap_figure(diagnosis)
    if any(step.candidates for step in diagnosis.selection_history):
        yield "ranking", build_ranking_figure(diagnosis)
    if diagnosis.misfit_regions:
        yield "where", build_localization_figure(diagnosis)


def save_figures(diagnosis: Diagnosis, folder: Path) -> list[Path]:
    """Write every picture into ``folder`` (made if missing) as PNG; returns where they are."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, figure in build_figures(diagnosis):
        paths.append(folder / f"{name}.png")
        figure.savefig(paths[-1], dpi=DPI)
    return paths
