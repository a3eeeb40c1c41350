"""Pictures of a diagnosis show the diagnosis's own numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosis_made import axes_of, bare, clean

from klute_sim.diagnose.diagnosis import Diagnosis
from klute_sim.report import diagnosis_figures as pictures
from klute_sim.report import diagnosis_page as page
from klute_sim.report import diagnosis_traces as traces
from klute_sim.report import diagnosis_words as words
from klute_sim.units import BAR


def test_fitted_trials_are_not_sold_as_kept_back(found: Diagnosis) -> None:
    fitted = replace(found, shown_on="fit")
    assert "none was kept back" in words.improvement(fitted)
    assert "none was kept back to show" in page.render(fitted, {})
    trials = traces.simulated(fitted)
    assert [one.experiment.name for one in trials] == ["g0_0", "g0_1"]
    assert "it was fitted" in pictures.overlay(fitted, trials[0]).get_suptitle()
    assert "fitted" in pictures.gaps(fitted).get_suptitle()


def test_all_pictures_are_saved(found: Diagnosis, tmp_path: Path) -> None:
    paths = pictures.save_all(found, tmp_path / "new" / "folder")
    assert [path.name for path in paths] == ["before_after.png", "gap.png", "ranking.png", "where.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)
    assert pictures.save_all(bare(found), tmp_path / "none") == []


def test_the_overlay_shows_the_channels_in_their_units(found: Diagnosis) -> None:
    one = traces.simulated(found)[0]
    assert one.experiment.name == "g1_0"
    figure = pictures.overlay(found, one)
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
    assert lines["measured"].get_xdata() == pytest.approx(measured.time - one.experiment.begin)
    before, after = (np.std(line.get_ydata()) for line in axes[1].get_lines()[:2])
    assert before == pytest.approx(np.std(one.experiment.measured["force"].value - one.before["force"]))
    assert before > 2.0 * after
    assert {line.get_label() for line in axes_of(pictures.overlay(clean(found), one))[0].get_lines()} == {
        "measured",
        "simulated",
    }


def test_simulated_trials_have_the_gap_of_the_diagnosis(found: Diagnosis) -> None:
    for which in ("before", "after"):
        rest = [
            one.experiment.measured["force"].value - getattr(one, which)["force"] for one in traces.simulated(found)
        ]
        gap = found.gap["force"]
        wanted = gap.refitted if which == "before" else gap.after
        assert np.sqrt(np.mean(np.concatenate(rest) ** 2)) == pytest.approx(wanted, rel=1e-9)


def test_gap_bars_are_the_gaps(found: Diagnosis) -> None:
    axes = axes_of(pictures.gaps(found))
    assert [axis.get_title() for axis in axes] == ["force", "pressure"]
    gap = found.gap["pressure"]
    widths = [bar.get_width() for bar in axes[1].patches]
    assert widths == pytest.approx([v / BAR for v in (gap.before, gap.refitted, gap.after, gap.floor)])
    assert "[bar]" in axes[1].get_xlabel()
    labels = [label.get_text() for label in axes[0].get_yticklabels()]
    assert labels == ["nominal device", "refitted", "with effects added", "noise of repeats"]
    assert len(axes_of(pictures.gaps(clean(found)))[0].patches) == 3


def test_the_ranking_has_every_step_with_its_winner_first(found: Diagnosis) -> None:
    figure = pictures.ranking(found)
    axes = axes_of(figure)
    assert len(axes) == len(found.steps)
    names = [label.get_text() for label in axes[0].get_yticklabels()]
    assert names[0] == "braid hysteresis (Coulomb)"
    assert axes[0].get_yticklabels()[0].get_fontweight() == "bold"
    assert len(names) == len(found.steps[0].candidates)
    assert axes[0].get_xscale() == "log"
    bars = pictures.ranked(found, found.steps[0])
    promised = {words.term(c.term): c.gain for c in found.steps[0].candidates}
    assert {bar.name: bar.promised for bar in bars} == promised
    assert [bar.accepted for bar in bars] == [True] + [False] * (len(bars) - 1)
    shown = [text.get_text() for text in axes[0].texts]
    assert shown[0] == f"falls by {bars[0].fall:.0f}"


def test_where_tells_the_misfit_in_units_of_noise(found: Diagnosis) -> None:
    figure = pictures.where(found)
    labels = {axis.get_xlabel() for axis in axes_of(figure)}
    assert labels == {"prescribed length [mm]", "time from the trial's start [s]", "motion of the rig"}
    assert found.base is not None
    own = pictures.seen(found, "force")
    fitted = [e for e in found.experiments if e.use == "fit"]
    rows = zip(fitted, found.base.residuals, strict=True)
    residual = np.concatenate([r["force"] / e.loud["force"] for e, r in rows]) / found.noise["force"].deviation
    assert own.before == pytest.approx(residual)
    assert own.course.min() == pytest.approx(0.327, abs=2e-4)
    assert own.pressure.max() == pytest.approx(4.0 * BAR)
    motion = next(axis for axis in axes_of(figure) if axis.get_xlabel() == "motion of the rig")
    slow = np.sqrt(np.mean(own.before[own.rate < -fitted[0].course.slow] ** 2))
    assert motion.patches[0].get_height() == pytest.approx(slow)
    title = figure.subfigs[0].get_suptitle()
    assert title.startswith(words.spoken(found.where[0].channel))
    assert f"{100.0 * found.where[0].share:.0f} % of all channels' misfit" in title
    nothing = pictures.where(replace(clean(found), verdict="nothing-missing"))
    assert "misfit" not in nothing.subfigs[0].get_suptitle()


def test_bins_hold_the_root_mean_square_where_there_are_samples() -> None:
    place = np.repeat([0.5, 1.5, 2.5], [10, 10, 3])
    residual = np.repeat([2.0, -3.0, 9.0], [10, 10, 3])
    binned = pictures._binned((place,), [np.arange(4.0)], residual)
    assert binned == pytest.approx([2.0, 3.0, np.nan], nan_ok=True)
