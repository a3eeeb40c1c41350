"""Pictures of a diagnosis show the diagnosis's own numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.diagnosis.workflow import Diagnosis
from klute_sim.report.diagnosis import figures as pictures
from klute_sim.report.diagnosis import page, traces
from klute_sim.report.diagnosis import text as words
from klute_sim.units import BAR
from tests.report.synthetic_diagnosis import axes_of, bare, clean


def test_fitted_trials_are_not_sold_as_kept_back(found: Diagnosis) -> None:
    fitted = replace(found, evaluated_on="fit")
    assert "none was kept back" in words.describe_improvement(fitted)
    assert "none was kept back to show" in page.render_page(fitted, {})
    trials = traces.simulate_shown_trials(fitted)
    assert [one.experiment.name for one in trials] == ["g0_0", "g0_1"]
    assert "it was fitted" in pictures.build_overlay_figure(fitted, trials[0]).get_suptitle()
    assert "fitted" in pictures.build_gap_figure(fitted).get_suptitle()


def test_all_pictures_are_saved(found: Diagnosis, tmp_path: Path) -> None:
    paths = pictures.save_figures(found, tmp_path / "new" / "folder")
    assert [path.name for path in paths] == ["before_after.png", "gap.png", "ranking.png", "where.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)
    assert pictures.save_figures(bare(found), tmp_path / "none") == []


def test_the_overlay_shows_the_channels_in_their_units(found: Diagnosis) -> None:
    one = traces.simulate_shown_trials(found)[0]
    assert one.experiment.name == "g1_0"
    figure = pictures.build_overlay_figure(found, one)
    axes = axes_of(figure)
    assert [axis.get_ylabel().replace("\n", " ") for axis in axes] == [
        "force [N]",
        "measured - simulated [N]",
        "pressure [bar]",
        "measured - simulated [bar]",
    ]
    assert axes[-1].get_xlabel().endswith("[s]")
    assert "g1_0" in figure.get_suptitle()
    lines = {line.get_label(): line for line in axes[2].get_lines()}
    measured = one.experiment.measured["pressure"]
    assert lines["measured"].get_ydata() == pytest.approx(measured.value / BAR)
    assert lines["measured"].get_xdata() == pytest.approx(measured.time - one.experiment.start_time)
    before, after = (np.std(line.get_ydata()) for line in axes[1].get_lines()[:2])
    assert before == pytest.approx(np.std(one.experiment.measured["force"].value - one.before["force"]))
    assert before > 2.0 * after
    assert {line.get_label() for line in axes_of(pictures.build_overlay_figure(clean(found), one))[0].get_lines()} == {
        "measured",
        "simulated",
    }


def test_simulated_trials_have_the_gap_of_the_diagnosis(found: Diagnosis) -> None:
    for which in ("before", "after"):
        rest = [
            one.experiment.measured["force"].value - getattr(one, which)["force"]
            for one in traces.simulate_shown_trials(found)
        ]
        gap = found.channel_rms["force"]
        wanted = gap.refitted if which == "before" else gap.with_effects
        assert np.sqrt(np.mean(np.concatenate(rest) ** 2)) == pytest.approx(wanted, rel=1e-9)


def test_gap_bars_are_the_gaps(found: Diagnosis) -> None:
    axes = axes_of(pictures.build_gap_figure(found))
    assert [axis.get_title() for axis in axes] == ["force", "pressure"]
    gap = found.channel_rms["pressure"]
    widths = [bar.get_width() for bar in axes[1].patches]
    assert widths == pytest.approx([v / BAR for v in (gap.nominal, gap.refitted, gap.with_effects, gap.noise_floor)])
    assert "[bar]" in axes[1].get_xlabel()
    labels = [label.get_text() for label in axes[0].get_yticklabels()]
    assert labels == ["nominal device", "refitted", "with effects added", "noise of repeats"]
    assert len(axes_of(pictures.build_gap_figure(clean(found)))[0].patches) == 3


def test_the_ranking_has_every_step_with_its_winner_first(found: Diagnosis) -> None:
    figure = pictures.build_ranking_figure(found)
    axes = axes_of(figure)
    assert len(axes) == len(found.selection_history)
    names = [label.get_text() for label in axes[0].get_yticklabels()]
    assert names[0] == "braid hysteresis (Coulomb)"
    assert axes[0].get_yticklabels()[0].get_fontweight() == "bold"
    assert len(names) == len(found.selection_history[0].candidates)
    assert axes[0].get_xscale() == "log"
    bars = pictures.rank_candidates(found, found.selection_history[0])
    promised = {words.format_term(c.term): c.predicted_gain for c in found.selection_history[0].candidates}
    assert {bar.name: bar.predicted_drop for bar in bars} == promised
    assert [bar.accepted for bar in bars] == [True] + [False] * (len(bars) - 1)
    shown = [text.get_text() for text in axes[0].texts]
    assert shown[0] == f"falls by {bars[0].bic_drop:.0f}"


def test_where_tells_the_misfit_in_units_of_noise(found: Diagnosis) -> None:
    figure = pictures.build_localization_figure(found)
    labels = {axis.get_xlabel() for axis in axes_of(figure)}
    assert labels == {"prescribed length [mm]", "time from the trial's start [s]", "motion of the rig"}
    assert found.base_fit is not None
    own = pictures.collect_residuals(found, "force")
    fitted = [e for e in found.experiments if e.use == "fit"]
    rows = zip(fitted, found.base_fit.residuals, strict=True)
    residual = np.concatenate([r["force"] / e.noise_scale["force"] for e, r in rows]) / found.noise["force"].std
    assert own.before == pytest.approx(residual)
    assert own.prescribed.min() == pytest.approx(0.327, abs=2e-4)
    assert own.pressure_command.max() == pytest.approx(4.0 * BAR)
    motion = next(axis for axis in axes_of(figure) if axis.get_xlabel() == "motion of the rig")
    slow = np.sqrt(np.mean(own.before[own.prescribed_rate < -fitted[0].prescribed_input.stationary_rate] ** 2))
    assert motion.patches[0].get_height() == pytest.approx(slow)
    title = figure.subfigs[0].get_suptitle()
    assert title.startswith(words.humanize_identifier(found.misfit_regions[0].channel))
    assert f"{100.0 * found.misfit_regions[0].fraction:.0f} % of all channels' misfit" in title
    nothing = pictures.build_localization_figure(replace(clean(found), verdict="nothing-missing"))
    assert "misfit" not in nothing.subfigs[0].get_suptitle()


def test_bins_hold_the_root_mean_square_where_there_are_samples() -> None:
    place = np.repeat([0.5, 1.5, 2.5], [10, 10, 3])
    residual = np.repeat([2.0, -3.0, 9.0], [10, 10, 3])
    binned = pictures._compute_binned_rms((place,), [np.arange(4.0)], residual)
    assert binned == pytest.approx([2.0, 3.0, np.nan], nan_ok=True)
