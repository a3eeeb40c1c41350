"""Localization figure of a diagnosis: in which conditions the fitted trials and the simulation differ."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from klute_sim.diagnosis.experiments.base import Experiment, PrescribedInput
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.report.diagnosis import text as words
from klute_sim.report.style import add_legend, use_style
from klute_sim.types import Array
from klute_sim.units import BAR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CASE_COLOURS = {"before": "#e6842a", "after": "#1f77b4"}
N_MAP_BINS, N_TIME_BINS = 8, 12
MIN_SAMPLES_PER_BIN = 5
"""Minimum number of samples in a bin that is shown."""


class ResidualSamples(NamedTuple):
    """Residuals of one channel in all fitted trials, with the inputs at its samples."""

    pressure_command: Array
    """Pressure command [Pa]."""
    prescribed: Array
    """Prescribed length [m], or the input that the rig prescribes instead of it [SI]."""
    prescribed_rate: Array
    """Rate of the prescribed input over 50 ms [SI/s]."""
    time: Array
    """Time from the start of the trial [s]."""
    before: Array
    """Residual in standard deviations of the noise, without added effects."""
    after: Array
    """Residual in standard deviations of the noise, with the added effects."""


def collect_residuals(diagnosis: Diagnosis, channel: str) -> ResidualSamples:
    """Return the residuals of ``channel``, which the fitted trials measure, in these trials."""
    base, final = diagnosis.base_fit, diagnosis.final_fit
    assert base is not None
    assert final is not None
    rows = [
        _collect_trial_residuals(experiment, channel, before, after, diagnosis.noise[channel].std)
        for experiment, before, after in zip(diagnosis.fitted_experiments, base.residuals, final.residuals, strict=True)
        if channel in experiment.measured
    ]
    return ResidualSamples(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def _collect_trial_residuals(
    experiment: Experiment, channel: str, before: Mapping[str, Array], after: Mapping[str, Array], noise_sd: float
) -> ResidualSamples:
    time = experiment.measured[channel].time - experiment.start_time
    count = len(experiment.command)
    dt, sample_sd = experiment.duration / count, noise_sd * experiment.noise_scale.get(channel, 1.0)
    grid, prescribed = dt * np.arange(1, count + 1), experiment.prescribed_input.values
    later, earlier = (np.interp(time + shift, grid, prescribed) for shift in (0.025, -0.025))
    return ResidualSamples(
        np.interp(time, grid, experiment.command),
        np.interp(time, grid, prescribed),
        (later - earlier) / 0.05,
        time,
        before[channel] / sample_sd,
        after[channel] / sample_sd,
    )


def build_localization_figure(diagnosis: Diagnosis) -> "Figure":
    """Plot the rms misfit of the fitted trials over pressure and length, over time, and by the motion of the rig."""
    regions = {region.channel: region for region in diagnosis.misfit_regions}
    cases = [("before", "refitted")] + ([("after", "with effects added")] if diagnosis.added_terms else [])
    with use_style() as create_figure:
        figure = create_figure(0.4 + 5.4 * len(regions))
        rows = figure.subfigures(len(regions), 1, squeeze=False)[:, 0]
        for row, (channel, region) in zip(rows, regions.items(), strict=True):
            residuals = collect_residuals(diagnosis, channel)
            title = (
                f"{words.humanize_identifier(channel)}: rms {np.sqrt(np.mean(residuals.before**2)):.3g} times the noise"
            )
            if diagnosis.verdict != "nothing-missing":  # otherwise the misfit is noise
                title += f"; {region.region or 'everywhere'}: {100.0 * region.fraction:.0f} % of all channels' misfit"
            row.suptitle(title, fontweight="bold")
            above, below = row.subfigures(2, 1)
            maps, bars = above.subplots(1, len(cases), squeeze=False)[0], below.subplots(1, 2, sharey=True)
            prescribed_input = next(e for e in diagnosis.experiments if channel in e.measured).prescribed_input
            _plot_maps(above, maps, residuals, prescribed_input, cases)
            _plot_over_time(bars[0], residuals, cases, has_repeats=diagnosis.has_repeats)
            _plot_by_motion(bars[1], residuals, prescribed_input, cases)
    return figure


def _plot_maps(
    figure: Any, axes: Any, residuals: ResidualSamples, prescribed_input: PrescribedInput, cases: list[tuple[str, str]]
) -> None:
    pressure, prescribed = residuals.pressure_command / BAR, residuals.prescribed / prescribed_input.si_factor
    edges = [np.histogram_bin_edges(prescribed, N_MAP_BINS), np.histogram_bin_edges(pressure, N_MAP_BINS)]
    maps = [_compute_binned_rms((prescribed, pressure), edges, getattr(residuals, case)) for case, _ in cases]
    scale_max = max(3.0, max(float(np.nanmax(rms, initial=0.0)) for rms in maps))
    for axis, rms, (_, name) in zip(axes, maps, cases, strict=True):
        mesh = axis.pcolormesh(*edges, rms.T, cmap="YlOrRd", vmin=0.0, vmax=scale_max)
        axis.set_title(name)
        axis.set_xlabel(prescribed_input.label)
        axis.set_ylabel("pressure command [bar]" if axis is axes[0] else "")
        axis.set_facecolor("0.94")
    bar = figure.colorbar(mesh, ax=list(axes), fraction=0.08, aspect=18)
    bar.ax.set_title("rms / sd", fontsize="medium")


def _compute_binned_rms(values: tuple[Array, ...], edges: list[Array], residual: Array) -> Array:
    """Return the rms of ``residual`` in bins of ``values``; NaN in bins with too few samples."""
    sample = np.stack(values, axis=1)
    count = np.histogramdd(sample, edges)[0]
    total = np.histogramdd(sample, edges, weights=residual**2)[0]
    rms = np.sqrt(total / np.maximum(count, 1.0))
    rms[count < MIN_SAMPLES_PER_BIN] = np.nan
    return np.asarray(rms)


def _plot_over_time(
    axis: "Axes", residuals: ResidualSamples, cases: list[tuple[str, str]], *, has_repeats: bool
) -> None:
    edges = np.linspace(0.0, float(residuals.time.max()), N_TIME_BINS + 1)
    for k, (case, name) in enumerate(cases):
        rms = _compute_binned_rms((residuals.time,), [edges], getattr(residuals, case))
        axis.stairs(rms, edges, fill=True, color=CASE_COLOURS[case], alpha=0.15)
        # Wider below narrower: both are seen where they agree.
        axis.stairs(rms, edges, color=CASE_COLOURS[case], linewidth=(4.0, 1.6)[k], label=name)
    axis.axhline(
        1.0,
        color="0.4",
        linewidth=0.8,
        linestyle="--",
        label="noise alone" if has_repeats else "residuals that count as noise",
    )
    axis.set_xlim(0.0, edges[-1])
    axis.set_xlabel("time from the start of the trial [s]")
    axis.set_ylabel("rms misfit / sd of the noise")
    add_legend(axis, max_columns=2)


def _plot_by_motion(
    axis: "Axes", residuals: ResidualSamples, prescribed_input: PrescribedInput, cases: list[tuple[str, str]]
) -> None:
    directions = (
        residuals.prescribed_rate < -prescribed_input.stationary_rate,
        np.abs(residuals.prescribed_rate) <= prescribed_input.stationary_rate,
        residuals.prescribed_rate > prescribed_input.stationary_rate,
    )
    masks = dict(zip(prescribed_input.direction_labels, directions, strict=True))
    width = 0.8 / len(cases)
    for index, (case, name) in enumerate(cases):
        residual = getattr(residuals, case)
        rms = [
            float(np.sqrt(np.mean(residual[m] ** 2))) if m.sum() >= MIN_SAMPLES_PER_BIN else np.nan
            for m in masks.values()
        ]
        positions = np.arange(len(masks)) + (index - 0.5 * (len(cases) - 1)) * width
        axis.bar(positions, rms, width=0.92 * width, color=CASE_COLOURS[case], label=name)
    axis.set_xticks(range(len(masks)), list(masks))
    axis.axhline(1.0, color="0.4", linewidth=0.8, linestyle="--")
    axis.set_xlabel("motion of the rig")
