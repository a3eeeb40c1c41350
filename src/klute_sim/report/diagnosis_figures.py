"""Pictures of a diagnosis: before and after, the gap, the ranking of candidates, and where the misfit is.

Matplotlib is imported when something is drawn.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from klute_sim.diagnose.diagnosis import Diagnosis
from klute_sim.diagnose.experiment import UNITS, Array, Course, Experiment
from klute_sim.diagnose.search import Step
from klute_sim.report import diagnosis_words as words
from klute_sim.report.diagnosis_traces import Simulated, simulated
from klute_sim.report.style import STYLE
from klute_sim.units import BAR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURED, NOISE, NOMINAL, BEFORE, AFTER, LIMIT = "0.15", "0.85", "0.65", "#e6842a", "#1f77b4", "#d62728"
PROMISED, REFITTED = "#c6dbef", "#8c8c8c"
DPI = 120
MOST_BARS = 10
"""Candidates shown for each step, beside those that were refitted."""
BINS, TIME_BINS = 8, 12
FEWEST = 5
"""Samples in a bin that is shown."""


def overlay(diagnosis: Diagnosis, one: Simulated) -> "Figure":
    """Measured, before and after in trial ``one``, a channel at a time, the residuals underneath."""
    from matplotlib.patches import Patch

    channels = [c for c, series in one.experiment.measured.items() if len(series.time)]
    with _style() as figure_of:
        figure = figure_of(10.0, 0.7 + 3.2 * len(channels))
        axes = figure.subplots(
            2 * len(channels), 1, sharex=True, squeeze=False, height_ratios=[2.0, 1.1] * len(channels)
        )[:, 0]
        for number, channel in enumerate(channels):
            _compare(axes[2 * number], axes[2 * number + 1], diagnosis, one, channel)
        band = Patch(
            color=NOISE, label="±1 sd of the noise" if diagnosis.repeated else "±1 sd of what is taken for noise"
        )
        key = [*axes[0].get_legend_handles_labels()[0], band]
        axes[0].legend(handles=key, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2)
        axes[-1].set_xlabel("time from the trial's start [s]")
        axes[-1].set_xlim(0.0, one.experiment.duration)
        figure.align_ylabels()
        seen = "no fit saw it" if diagnosis.shown_on == "show" else "it was fitted: no trial was kept back to show"
        figure.suptitle(f"trial '{one.experiment.name}' ({seen})")
    return figure


def _compare(above: "Axes", below: "Axes", diagnosis: Diagnosis, one: Simulated, channel: str) -> None:
    unit, si = UNITS[channel]
    time, value = one.time(channel), one.experiment.measured[channel].value
    lines = [("refitted" if diagnosis.found else "simulated", one.before[channel], BEFORE, 1.6)]
    if diagnosis.found:
        lines.append(("with effects added", one.after[channel], AFTER, 1.6))
    if channel in diagnosis.noise:
        deviation = diagnosis.noise[channel].deviation * one.experiment.loud.get(channel, np.ones(len(time)))
        above.fill_between(time, (value - deviation) / si, (value + deviation) / si, color=NOISE, linewidth=0.0)
        below.fill_between(time, -deviation / si, deviation / si, color=NOISE, linewidth=0.0)
    above.plot(time, value / si, color=MEASURED, linewidth=0.6, label="measured", zorder=3.0)
    for label, simulation, colour, width in lines:
        above.plot(time, simulation / si, color=colour, linewidth=width, label=label)
        below.plot(time, (value - simulation) / si, color=colour, linewidth=0.7)
    above.set_ylabel(f"{words.spoken(channel)}\n[{unit}]")
    below.set_ylabel(f"measured -\nsimulated [{unit}]")
    for axis in (above, below):
        axis.grid(alpha=0.25, linewidth=0.5)


def gaps(diagnosis: Diagnosis) -> "Figure":
    """Root mean square gap of every channel, and the noise under which it cannot go."""
    from matplotlib.ticker import MaxNLocator

    white = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
    with _style() as figure_of:
        figure = figure_of(max(6.0, 3.6 * len(diagnosis.gap)), 2.6)
        axes = figure.subplots(1, len(diagnosis.gap), squeeze=False)[0]
        for axis, (channel, gap) in zip(axes, diagnosis.gap.items(), strict=True):
            unit, si = UNITS[channel]
            bars = [
                ("nominal device", gap.before, NOMINAL),
                ("refitted", gap.refitted, BEFORE),
            ]
            if diagnosis.found:
                bars.append(("with effects added", gap.after, AFTER))
            if gap.floor is not None:
                bars.append(("noise of repeats", gap.floor, NOISE))
                axis.axvline(gap.floor / si, color="0.5", linewidth=0.7, linestyle=":")
            drawn = axis.barh(
                [name for name, _, _ in bars], [v / si for _, v, _ in bars], color=[c for _, _, c in bars], height=0.7
            )
            axis.bar_label(
                drawn, labels=[words.number(v / si, 3) for _, v, _ in bars], padding=3, fontsize=8, bbox=white
            )
            axis.margins(x=0.2)
            axis.invert_yaxis()
            axis.xaxis.set_major_locator(MaxNLocator(5))
            axis.set_xlabel(f"rms, measured - simulated [{unit}]")
            axis.set_title(words.spoken(channel))
            if axis is not axes[0]:
                axis.tick_params(labelleft=False)
        figure.suptitle("on trials that no fit saw" if diagnosis.shown_on == "show" else "on the fitted trials")
    return figure


class Bar(NamedTuple):
    """A candidate in the ranking."""

    name: str
    promised: float
    """Fall of chi squared that the screening predicts."""
    fall: float | None
    """Of BIC after refitting; None: not refitted."""
    finished: bool
    """Whether its fit was carried on until it converged."""
    accepted: bool


def ranked(diagnosis: Diagnosis, step: Step) -> list[Bar]:
    """All candidates of ``step``: those that were refitted by their fall of BIC, the others by what they promised."""
    before = step.before.criterion(diagnosis.effective)
    fits = {f.hypothesis.terms[-1]: f for f in step.refits}
    bars = []
    for c in step.candidates:
        refit = fits.get(c.term)
        fall = before - refit.criterion(diagnosis.effective) if refit else None
        bars.append(Bar(words.term(c.term), c.gain, fall, bool(refit and refit.converged), c.term == step.added))
    return sorted(bars, key=lambda b: (b.fall is None, -(b.promised if b.fall is None else b.fall)))


def ranking(diagnosis: Diagnosis) -> "Figure":
    """What the screening promised and what refitting kept of it, in every step."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.ticker import LogLocator

    key = [
        Patch(color=PROMISED, label="promised by screening"),
        Patch(color=REFITTED, label="fall of BIC after refitting"),
        Patch(color=AFTER, label="the same, accepted"),
        Line2D([], [], color=LIMIT, linestyle="--", linewidth=0.9, label=f"{diagnosis.decisive:.0f} decide"),
    ]

    steps = [(step, ranked(diagnosis, step)) for step in diagnosis.steps]
    shown = [[b for k, b in enumerate(bars) if b.fall is not None or k < MOST_BARS] for _, bars in steps]
    with _style() as figure_of:
        figure = figure_of(9.0, 0.6 + sum(1.2 + 0.27 * len(bars) for bars in shown))
        ratios = [1.2 + 0.27 * len(bars) for bars in shown]
        axes = figure.subplots(len(steps), 1, squeeze=False, sharex=True, height_ratios=ratios)[:, 0]
        highest = max((max(b.promised, b.fall or 0.0) for bars in shown for b in bars), default=1.0)
        for number, (axis, (step, every), bars) in enumerate(zip(axes, steps, shown, strict=True), start=1):
            _rank(axis, bars, diagnosis.decisive)
            left = len(every) - len(bars)
            rest = f"; {left} more promise less" if left else ""
            added = f"{words.term(step.added)} is added: " if step.added else "nothing is added: "
            axis.set_title(
                f"step {number}: {added}{_shortened(words.spoken_in(step.why))}{rest}", loc="left", fontsize=9
            )
        axes[0].set_xscale("log")
        axes[0].set_xlim(1.0, 6.0 * max(highest, 10.0))
        axes[0].xaxis.set_major_locator(LogLocator(numticks=12))
        axes[-1].set_xlabel("fall of chi squared (promised) and of BIC (refitted), logarithmic")
        figure.legend(handles=key, loc="outside lower center", ncols=4)
    return figure


def _rank(axis: "Axes", bars: list[Bar], decisive: float) -> None:
    for place, bar in enumerate(bars):
        axis.barh(place, max(bar.promised, 1.0), color=PROMISED, height=0.84)
        text = "not refitted"
        if bar.fall is not None:
            axis.barh(place, max(bar.fall, 1.0), color=AFTER if bar.accepted else REFITTED, height=0.42)
            text = f"falls by {bar.fall:.0f}" if bar.fall >= 0.5 else f"rises by {-bar.fall:.0f}"
            text += "" if bar.finished else " (stopped early)"
        end = max(bar.promised, bar.fall or 1.0, 1.0)
        axis.text(1.06 * end, place, text, va="center", fontsize=7.5, color="0.3" if bar.fall is not None else "0.6")
    axis.axvline(decisive, color=LIMIT, linewidth=0.9, linestyle="--")
    axis.set_yticks(range(len(bars)), [bar.name for bar in bars])
    for label, bar in zip(axis.get_yticklabels(), bars, strict=True):
        label.set_fontweight("bold" if bar.accepted else "normal")
    axis.set_ylim(len(bars) - 0.4, -0.6)
    axis.grid(axis="x", alpha=0.25, linewidth=0.5)


def _shortened(text: str, most: int = 110) -> str:
    return text if len(text) <= most else f"{text[:most].rstrip()} …"


class Seen(NamedTuple):
    """A channel of all fitted trials, sample by sample."""

    pressure: Array
    """Commanded [Pa]."""
    course: Array
    """Prescribed: the length [m], or what the rig prescribes instead of it [SI]."""
    rate: Array
    """Of that, over 50 ms [SI/s]."""
    time: Array
    """From each trial's begin [s]."""
    before: Array
    """Residual over the noise, with none added."""
    after: Array
    """With what was found."""


def seen(diagnosis: Diagnosis, channel: str) -> Seen:
    """``channel`` of the fitted trials with what was prescribed; nothing where nothing was fitted."""
    rows = []
    base, final = diagnosis.base, diagnosis.final
    if base is not None and final is not None:
        fitted = [e for e in diagnosis.experiments if e.use == "fit" and e.measured]
        for experiment, early, late in zip(fitted, base.residuals, final.residuals, strict=True):
            if channel in experiment.measured:
                rows.append(_seen(experiment, channel, early, late, diagnosis.noise[channel].deviation))
    return Seen(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def _seen(
    experiment: Experiment, channel: str, early: Mapping[str, Array], late: Mapping[str, Array], noise: float
) -> Seen:
    time = experiment.measured[channel].time - experiment.begin
    count = len(experiment.command)
    step, noise_then = experiment.duration / count, noise * experiment.loud.get(channel, 1.0)
    grid, course = step * np.arange(1, count + 1), experiment.course.values
    later, earlier = (np.interp(time + shift, grid, course) for shift in (0.025, -0.025))
    return Seen(
        np.interp(time, grid, experiment.command),
        np.interp(time, grid, course),
        (later - earlier) / 0.05,
        time,
        early[channel] / noise_then,
        late[channel] / noise_then,
    )


def where(diagnosis: Diagnosis) -> "Figure":
    """Root mean square misfit of the fitted trials over pressure and length, over time and by the rig's motion."""
    channels = [place.channel for place in diagnosis.where]
    told = {place.channel: place for place in diagnosis.where}
    pairs = [("before", "refitted")] + ([("after", "with effects added")] if diagnosis.found else [])
    with _style() as figure_of:
        figure = figure_of(13.0 if diagnosis.found else 10.5, 0.7 + 2.9 * len(channels))
        rows = figure.subfigures(len(channels), 1, squeeze=False)[:, 0]
        for row, channel in zip(rows, channels, strict=True):
            own, place = seen(diagnosis, channel), told[channel]
            title = f"{words.spoken(channel)}: rms {np.sqrt(np.mean(own.before**2)):.3g} times the noise"
            if diagnosis.verdict != "nothing-missing":  # shares of nothing
                title += f"; {place.region or 'all of it'}: {100.0 * place.share:.0f} % of all channels' misfit"
            row.suptitle(title, fontsize=10, fontweight="bold")
            axes = row.subplots(1, len(pairs) + 2, squeeze=False)[0]
            axes[-1].sharey(axes[-2])
            course = next(e for e in diagnosis.experiments if channel in e.measured).course
            _maps(row, axes[: len(pairs)], own, course, pairs)
            _over_time(axes[-2], own, pairs, repeated=diagnosis.repeated)
            _by_motion(axes[-1], own, course, pairs)
    return figure


def _maps(figure: Any, axes: Any, own: Seen, course: Course, pairs: list[tuple[str, str]]) -> None:
    pressure, along = own.pressure / BAR, own.course / course.si
    edges = [np.histogram_bin_edges(along, BINS), np.histogram_bin_edges(pressure, BINS)]
    maps = [_binned((along, pressure), edges, getattr(own, which)) for which, _ in pairs]
    top = max(3.0, max(float(np.nanmax(found, initial=0.0)) for found in maps))
    for axis, found, (_, name) in zip(axes, maps, pairs, strict=True):
        mesh = axis.pcolormesh(*edges, found.T, cmap="YlOrRd", vmin=0.0, vmax=top)
        axis.set_title(name)
        axis.set_xlabel(course.label)
        axis.set_ylabel("pressure command [bar]" if axis is axes[0] else "")
        axis.set_facecolor("0.94")
    bar = figure.colorbar(mesh, ax=list(axes), fraction=0.08, aspect=18)
    bar.ax.set_title("rms / sd", fontsize=8)


def _binned(values: tuple[Array, ...], edges: list[Array], residual: Array) -> Array:
    sample = np.stack(values, axis=1)
    count = np.histogramdd(sample, edges)[0]
    total = np.histogramdd(sample, edges, weights=residual**2)[0]
    found = np.sqrt(total / np.maximum(count, 1.0))
    found[count < FEWEST] = np.nan
    return np.asarray(found)


COLOURS = {"before": BEFORE, "after": AFTER}


def _over_time(axis: "Axes", own: Seen, pairs: list[tuple[str, str]], *, repeated: bool) -> None:
    edges = np.linspace(0.0, float(own.time.max()), TIME_BINS + 1)
    for which, name in pairs:
        found = _binned((own.time,), [edges], getattr(own, which))
        axis.stairs(found, edges, fill=True, color=COLOURS[which], label=name, alpha=0.85)
    axis.axhline(
        1.0, color="0.4", linewidth=0.8, linestyle="--", label="noise alone" if repeated else "what is taken for noise"
    )
    axis.set_xlim(0.0, edges[-1])
    axis.set_xlabel("time from the trial's start [s]")
    axis.set_ylabel("rms misfit / sd of the noise")
    axis.legend(
        ncols=len(pairs) + 1,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.2,
        columnspacing=0.9,
        handlelength=1.2,
    )


def _by_motion(axis: "Axes", own: Seen, course: Course, pairs: list[tuple[str, str]]) -> None:
    parts = own.rate < -course.slow, np.abs(own.rate) <= course.slow, own.rate > course.slow
    masks = dict(zip(course.motions, parts, strict=True))
    width = 0.8 / len(pairs)
    for number, (which, name) in enumerate(pairs):
        residual = getattr(own, which)
        rms = [float(np.sqrt(np.mean(residual[m] ** 2))) if m.sum() >= FEWEST else np.nan for m in masks.values()]
        places = np.arange(len(masks)) + (number - 0.5 * (len(pairs) - 1)) * width
        axis.bar(places, rms, width=0.92 * width, color=COLOURS[which], label=name)
    axis.set_xticks(range(len(masks)), list(masks))
    axis.axhline(1.0, color="0.4", linewidth=0.8, linestyle="--")
    axis.set_xlabel("motion of the rig")


@contextmanager
def _style() -> Iterator[Callable[[float, float], "Figure"]]:
    """The style while a figure is drawn; gives what makes one (width and height in inches)."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        yield lambda width, height: Figure(figsize=(width, height), layout="constrained")


def figures(diagnosis: Diagnosis) -> Iterator[tuple[str, "Figure"]]:
    """Name and figure of every picture that there is something for; none where nothing was fitted."""
    shown: list[Simulated] = simulated(diagnosis)
    if shown:
        yield "before_after", overlay(diagnosis, shown[0])
    if diagnosis.gap:
        yield "gap", gaps(diagnosis)
    if any(step.candidates for step in diagnosis.steps):
        yield "ranking", ranking(diagnosis)
    if diagnosis.where:
        yield "where", where(diagnosis)


def save_all(diagnosis: Diagnosis, folder: Path) -> list[Path]:
    """Write every picture into ``folder`` (made if missing) as PNG; returns where they are."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, figure in figures(diagnosis):
        paths.append(folder / f"{name}.png")
        figure.savefig(paths[-1], dpi=DPI)
    return paths
