"""Figures of a diagnosis show the numbers of the diagnosis."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from klute_sim.diagnosis.result import Diagnosis
from klute_sim.report.diagnosis import figures, localization_figure, page, traces
from klute_sim.report.diagnosis import text as words
from klute_sim.units import BAR
from tests.report.figure_checks import check_figure
from tests.report.synthetic_diagnosis import axes_of, insufficient, without_effects


def test_fitted_trials_are_not_presented_as_test_trials(diagnosis: Diagnosis) -> None:
    fitted = replace(diagnosis, evaluated_on="fit")
    assert "there are no usable test trials" in words.describe_improvement(fitted)
    assert "because there are no usable test trials" in page.render_page(fitted, {})
    trials = traces.simulate_shown_trials(fitted)
    assert [trial.experiment.name for trial in trials] == ["g0_0", "g0_1"]
    overlay = figures.build_overlay_figure(fitted, trials[0])
    assert "fitted trial" in overlay.legends[0].get_title().get_text()
    check_figure(overlay)
    assert "fitted" in figures.build_gap_figure(fitted).get_suptitle()


@pytest.mark.slow
def test_all_figures_are_saved(diagnosis: Diagnosis, tmp_path: Path) -> None:
    paths = figures.save_figures(diagnosis, tmp_path / "new" / "folder")
    assert [path.name for path in paths] == ["before_after.png", "gap.png", "ranking.png", "localization.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)
    assert figures.save_figures(insufficient(diagnosis), tmp_path / "none") == []


def test_overlay_shows_channels_in_their_units(diagnosis: Diagnosis) -> None:
    trial = traces.simulate_shown_trials(diagnosis)[0]
    assert trial.experiment.name == "g1_0"
    figure = figures.build_overlay_figure(diagnosis, trial)
    axes = axes_of(figure)
    assert [axis.get_ylabel().replace("\n", " ") for axis in axes] == [
        "force [N]",
        "measured - simulated [N]",
        "pressure [bar]",
        "measured - simulated [bar]",
    ]
    assert axes[-1].get_xlabel().endswith("[s]")
    assert "g1_0" in figure.legends[0].get_title().get_text()
    lines = {line.get_label(): line for line in axes[2].get_lines()}
    measured = trial.experiment.measured["pressure"]
    assert lines["measured"].get_ydata() == pytest.approx(measured.value / BAR)
    assert lines["measured"].get_xdata() == pytest.approx(measured.time - trial.experiment.start_time)
    before, after = (np.std(line.get_ydata()) for line in axes[1].get_lines()[:2])
    assert before == pytest.approx(np.std(trial.experiment.measured["force"].value - trial.before["force"]))
    assert before > 2.0 * after
    assert {
        line.get_label()
        for line in axes_of(figures.build_overlay_figure(without_effects(diagnosis), trial))[0].get_lines()
    } == {
        "measured",
        "simulated",
    }


def test_simulated_trials_have_the_gap_of_the_diagnosis(diagnosis: Diagnosis) -> None:
    gap = diagnosis.channel_rms["force"]
    for case, expected in (("before", gap.refitted), ("after", gap.with_effects)):
        residuals = [
            trial.experiment.measured["force"].value - getattr(trial, case)["force"]
            for trial in traces.simulate_shown_trials(diagnosis)
        ]
        assert np.sqrt(np.mean(np.concatenate(residuals) ** 2)) == pytest.approx(expected, rel=1e-9)


def test_gap_figure_shows_the_gaps(diagnosis: Diagnosis) -> None:
    axes = axes_of(figures.build_gap_figure(diagnosis))
    assert [axis.get_title() for axis in axes] == ["force", "pressure"]
    gap = diagnosis.channel_rms["pressure"]
    widths = [bar.get_width() for bar in axes[1].patches]
    assert widths == pytest.approx([v / BAR for v in (gap.nominal, gap.refitted, gap.with_effects, gap.noise_floor)])
    assert "[bar]" in axes[1].get_xlabel()
    labels = [label.get_text() for label in axes[0].get_yticklabels()]
    assert labels == ["nominal device", "refitted", "with effects added", "repeat noise"]
    assert len(axes_of(figures.build_gap_figure(without_effects(diagnosis)))[0].patches) == 3


def test_ranking_shows_every_step_with_the_accepted_candidate_first(diagnosis: Diagnosis) -> None:
    figure = figures.build_ranking_figure(diagnosis)
    check_figure(figure)
    axes = axes_of(figure)
    assert len(axes) == len(diagnosis.selection_history)
    names = [label.get_text() for label in axes[0].get_yticklabels()]
    assert names[0] == "braid hysteresis (Coulomb)"
    assert axes[0].get_yticklabels()[0].get_fontweight() == "bold"
    assert len(names) == len(diagnosis.selection_history[0].candidates)
    assert axes[0].get_xscale() == "log"
    bars = figures.rank_candidates(diagnosis, diagnosis.selection_history[0])
    stopped = [replace(fit, converged=False) for fit in diagnosis.selection_history[0].refits]
    step = replace(diagnosis.selection_history[0], refits=tuple(stopped))
    assert [bar.converged for bar in figures.rank_candidates(diagnosis, step) if bar.accepted] == [True]  # later
    predicted = {words.format_term(c.term): c.predicted_gain for c in diagnosis.selection_history[0].candidates}
    assert {bar.name: bar.predicted_drop for bar in bars} == predicted
    assert [bar.accepted for bar in bars] == [True] + [False] * (len(bars) - 1)
    labels = [text.get_text() for text in axes[0].texts]
    assert labels[0] == f"falls by {bars[0].bic_drop:.0f}"


@pytest.mark.slow
def test_long_titles_of_steps_stay_inside_the_figure(diagnosis: Diagnosis) -> None:
    reason = "it reduces the misfit of every channel on the validation trials by more than its parameters cost"
    steps = tuple(replace(step, reason=reason) for step in diagnosis.selection_history)
    figure = figures.build_ranking_figure(replace(diagnosis, selection_history=steps))
    check_figure(figure)
    titles = [text for text in figure.findobj(Text) if isinstance(text, Text) and text.get_text().startswith("step ")]
    assert len(titles) == len(steps)
    for title in titles:
        assert title.get_window_extent().x1 <= figure.bbox.x1, title.get_text()


@pytest.mark.slow
def test_localization_shows_the_misfit_in_units_of_noise(diagnosis: Diagnosis) -> None:
    figure = localization_figure.build_localization_figure(diagnosis)
    check_figure(figure)
    labels = {axis.get_xlabel() for axis in axes_of(figure)}
    assert labels == {"prescribed length [mm]", "time from the start of the trial [s]", "motion of the rig"}
    assert diagnosis.base_fit is not None
    samples = localization_figure.collect_residuals(diagnosis, "force")
    fitted = [e for e in diagnosis.experiments if e.use == "fit"]
    rows = zip(fitted, diagnosis.base_fit.residuals, strict=True)
    residual = np.concatenate([r["force"] / e.noise_scale["force"] for e, r in rows]) / diagnosis.noise["force"].std
    assert samples.before == pytest.approx(residual)
    assert samples.prescribed.min() == pytest.approx(0.327, abs=2e-4)
    assert samples.pressure_command.max() == pytest.approx(4.0 * BAR)
    motion = next(axis for axis in axes_of(figure) if axis.get_xlabel() == "motion of the rig")
    shortening = np.sqrt(
        np.mean(samples.before[samples.prescribed_rate < -fitted[0].prescribed_input.stationary_rate] ** 2)
    )
    assert motion.patches[0].get_height() == pytest.approx(shortening)
    title = figure.subfigs[0].get_suptitle()
    assert title.startswith(words.humanize_identifier(diagnosis.misfit_regions[0].channel))
    assert f"{100.0 * diagnosis.misfit_regions[0].fraction:.0f} % of all channels' misfit" in title
    nothing_missing = localization_figure.build_localization_figure(
        replace(without_effects(diagnosis), verdict="nothing-missing")
    )
    assert "misfit" not in nothing_missing.subfigs[0].get_suptitle()


def test_bins_have_the_rms_of_enough_samples() -> None:
    position = np.repeat([0.5, 1.5, 2.5], [10, 10, 3])
    residual = np.repeat([2.0, -3.0, 9.0], [10, 10, 3])
    binned = localization_figure._compute_binned_rms((position,), [np.arange(4.0)], residual)
    assert binned == pytest.approx([2.0, 3.0, np.nan], nan_ok=True)
