"""Viewer recording of a diagnosis: it reads back equal and shows the numbers of the diagnosis."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from klute_sim.diagnosis.result import Diagnosis
from klute_sim.errors import InputError, MissingExtraError
from klute_sim.report.diagnosis import text as words
from klute_sim.report.diagnosis import traces
from klute_sim.units import BAR
from klute_sim.viewer.layouts import diagnosis as recording
from klute_sim.viewer.layouts import diagnosis_map
from tests.report.synthetic_diagnosis import insufficient, with_html_attack


@pytest.fixture(scope="module")
def chunks(diagnosis: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> Any:
    rr = pytest.importorskip("rerun")
    file = tmp_path_factory.mktemp("rerun") / "r.rrd"
    recording.write_recording(with_html_attack(diagnosis), file)
    return rr.chunk.RrdReader(file)


def test_recording_reads_back_equal(diagnosis: Diagnosis, chunks: Any) -> None:
    series: dict[str, Any] = {}
    for chunk in chunks.stream():
        if not chunk.is_static:
            batch = chunk.to_record_batch()
            (name,) = [n for n in batch.schema.names if n.endswith("Scalars:scalars")]
            path = str(chunk.entity_path).lstrip("/")
            assert path not in series, "sent in more than one piece"
            series[path] = np.array(batch.column(name).to_pylist(), dtype=np.float64).ravel()
    trials = traces.simulate_shown_trials(diagnosis)
    assert len(series) == 2 * 2 * 5
    for number, trial in enumerate(trials, start=1):
        for channel, unit in (("force", 1.0), ("pressure", BAR)):
            prefix, measured = f"trial_{number}/{channel}", trial.experiment.measured[channel].value
            assert np.array_equal(series[f"{prefix}/signal/measured"], measured / unit)
            for case in ("before", "after"):
                value = getattr(trial, case)[channel]
                assert np.array_equal(series[f"{prefix}/signal/{case}"], value / unit)
                assert np.array_equal(series[f"{prefix}/residual/{case}"], (measured - value) / unit)


def test_recording_has_one_layout(chunks: Any) -> None:
    assert len(list(chunks.blueprints())) == 1


def test_recording_needs_rerun(diagnosis: Diagnosis, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[rerun\]'"):
        recording.write_recording(diagnosis, tmp_path / "r.rrd")
    assert not (tmp_path / "r.rrd").exists()


def test_recording_needs_simulated_trials(diagnosis: Diagnosis, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    with pytest.raises(InputError, match="insufficient"):
        recording.write_recording(insufficient(diagnosis), tmp_path / "r.rrd")
    assert not (tmp_path / "r.rrd").exists()


def test_heatmap_shows_the_gap_and_its_removal(diagnosis: Diagnosis) -> None:
    trials = traces.simulate_shown_trials(diagnosis)
    maps = {channel: dict(cases) for channel, cases in diagnosis_map.build_maps(diagnosis, trials)}
    before, after = maps["force"]["refitted"], maps["force"]["with effects added"]
    assert before.row_names == ("g0_0", "g0_1", "g1_0 *", "g1_1 *")
    assert before.scale_max == after.scale_max
    trial, noise = trials[0], diagnosis.noise["force"].std
    time, residual = trial.get_sample_times("force"), trial.experiment.measured["force"].value - trial.before["force"]
    residual = residual / trial.experiment.noise_scale.get("force", 1.0)
    for k in (5, 20, 31):
        is_inside = (time >= before.edges[k]) & (time < before.edges[k + 1])
        assert before.values[2, k] == pytest.approx(np.sqrt(np.mean(residual[is_inside] ** 2)) / noise, rel=1e-6)
    assert np.isnan(before.values[:, 0]).all()  # the initial state of friction is unknown
    assert np.nanmean(before.values) > 5.0 > 1.5 > np.nanmean(after.values) > 0.5


def test_page_shows_verdict_and_use_of_trials(diagnosis: Diagnosis) -> None:
    text = recording.format_page(diagnosis)
    assert text.startswith(f"# {words.describe_verdict(diagnosis)}")
    assert "- fit: g0_0, g0_1" in text
    assert "- test: g1_0, g1_1" in text
    gap = diagnosis.channel_rms["force"]
    assert (
        f"| force | N | {gap.nominal:.4g} | {gap.refitted:.4g} | {gap.with_effects:.4g} | {gap.noise_floor:.4g} |"
        in text
    )


def test_work_loop_of_a_trial_is_force_over_length(diagnosis: Diagnosis) -> None:
    trial = traces.simulate_shown_trials(diagnosis)[0]
    (chart,) = recording.build_loop_charts(diagnosis, trial, 1)
    before, after, measured = chart.curves
    assert np.array_equal(measured.y, trial.experiment.measured["force"].value)
    assert np.array_equal(before.y, trial.before["force"])
    assert np.array_equal(after.y, trial.after["force"])
    length = 335.0 + 8.0 * np.sin(4.0 * np.pi * np.maximum(0.0, trial.get_sample_times("force") - 0.2))
    assert measured.x == pytest.approx(length, abs=0.05)
