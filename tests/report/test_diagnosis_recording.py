"""The recording of a diagnosis reads back equal, and tells what the diagnosis says."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from klute_sim.diagnosis.workflow import Diagnosis
from klute_sim.errors import InputError, MissingExtraError
from klute_sim.report.diagnosis import text as words
from klute_sim.report.diagnosis import traces
from klute_sim.units import BAR
from klute_sim.viewer.layouts import diagnosis as recording
from klute_sim.viewer.layouts import diagnosis_map
from tests.report.synthetic_diagnosis import bare, evil


@pytest.fixture(scope="module")
def chunks(found: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> Any:
    rr = pytest.importorskip("rerun")
    file = tmp_path_factory.mktemp("rerun") / "r.rrd"
    recording.write_recording(evil(found), file)
    return rr.chunk.RrdReader(file)


def test_the_recording_reads_back_equal(found: Diagnosis, chunks: Any) -> None:
    series: dict[str, Any] = {}
    for chunk in chunks.stream():
        if not chunk.is_static:
            batch = chunk.to_record_batch()
            (name,) = [n for n in batch.schema.names if n.endswith("Scalars:scalars")]
            path = str(chunk.entity_path).lstrip("/")
            assert path not in series, "sent in more than one piece"
            series[path] = np.array(batch.column(name).to_pylist(), dtype=np.float64).ravel()
    trials = traces.simulate_shown_trials(found)
    assert len(series) == 2 * 2 * 5
    for number, one in enumerate(trials, start=1):
        for channel, unit in (("force", 1.0), ("pressure", BAR)):
            here, measured = f"trial_{number}/{channel}", one.experiment.measured[channel].value
            assert np.array_equal(series[f"{here}/signal/measured"], measured / unit)
            for which in ("before", "after"):
                value = getattr(one, which)[channel]
                assert np.array_equal(series[f"{here}/signal/{which}"], value / unit)
                assert np.array_equal(series[f"{here}/residual/{which}"], (measured - value) / unit)


def test_the_recording_has_one_layout(chunks: Any) -> None:
    assert len(list(chunks.blueprints())) == 1


def test_a_recording_needs_rerun(found: Diagnosis, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[rerun\]'"):
        recording.write_recording(found, tmp_path / "r.rrd")
    assert not (tmp_path / "r.rrd").exists()


def test_a_recording_needs_trials_that_were_simulated(found: Diagnosis, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    with pytest.raises(InputError, match="insufficient"):
        recording.write_recording(bare(found), tmp_path / "r.rrd")
    assert not (tmp_path / "r.rrd").exists()


def test_the_map_shows_where_the_gap_is_and_that_it_is_gone(found: Diagnosis) -> None:
    shown = traces.simulate_shown_trials(found)
    maps = {channel: dict(own) for channel, own in diagnosis_map.build_maps(found, shown)}
    before, after = maps["force"]["refitted"], maps["force"]["with effects added"]
    assert before.row_names == ("g0_0", "g0_1", "g1_0 *", "g1_1 *")
    assert before.scale_max == after.scale_max
    one, noise = shown[0], found.noise["force"].std
    since, left = one.sample_times("force"), one.experiment.measured["force"].value - one.before["force"]
    left = left / one.experiment.noise_scale.get("force", 1.0)
    for k in (5, 20, 31):
        inside = (since >= before.edges[k]) & (since < before.edges[k + 1])
        assert before.values[2, k] == pytest.approx(np.sqrt(np.mean(left[inside] ** 2)) / noise, rel=1e-6)
    assert np.isnan(before.values[:, 0]).all()  # what friction remembers is not compared
    assert np.nanmean(before.values) > 5.0 > 1.5 > np.nanmean(after.values) > 0.5


def test_the_verdict_is_told_with_the_trials_that_no_fit_saw(found: Diagnosis) -> None:
    text = recording.format_page(found)
    assert text.startswith(f"# {words.describe_verdict(found)}")
    assert "- fitted: g0_0, g0_1" in text
    assert "- shown, never fitted: g1_0, g1_1" in text
    gap = found.channel_rms["force"]
    assert (
        f"| force | N | {gap.nominal:.4g} | {gap.refitted:.4g} | {gap.with_effects:.4g} | {gap.noise_floor:.4g} |"
        in text
    )


def test_the_loop_of_a_trial_is_force_over_length(found: Diagnosis) -> None:
    one = traces.simulate_shown_trials(found)[0]
    (chart,) = recording.build_loop_charts(found, one, 1)
    measured, before, after = chart.curves
    assert np.array_equal(measured.y, one.experiment.measured["force"].value)
    assert np.array_equal(before.y, one.before["force"])
    assert np.array_equal(after.y, one.after["force"])
    moved = 335.0 + 8.0 * np.sin(4.0 * np.pi * np.maximum(0.0, one.sample_times("force") - 0.2))
    assert measured.x == pytest.approx(moved, abs=0.05)
