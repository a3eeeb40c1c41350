"""``ks.compare``: inputs, summary, table, figure and files."""

import json
from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording


def make_recording(offset: float = 0.0, n_strides: int = 3) -> Recording:
    phase = np.tile(np.arange(0.0, 100.0, 2.0), n_strides)
    wave = np.sin(0.02 * np.pi * phase) + offset
    time = np.arange(len(phase)) / 50.0
    return Recording.from_columns([("time [s]", time), ("gait_phase [%]", phase), ("ankle_angle [deg]", wave)])


def test_recordings_are_compared_with_their_labels() -> None:
    result = ks.compare({"before": make_recording(), "after": [make_recording(1.0), make_recording(1.0)]})
    assert [series.label for series in result.parts[0].series] == ["before", "after"]
    assert result.parts[0].differences["ankle_angle"]["after"].bias == pytest.approx(1.0)
    assert repr(result) == "ComparisonResult('before', 'after', over phase)"
    assert "ankle angle" in str(result)
    assert "<table>" in result._repr_html_()


def test_recordings_without_labels_are_numbered() -> None:
    result = ks.compare([make_recording(), make_recording(2.0)])
    assert [series.label for series in result.parts[0].series] == ["run 1", "run 2"]


def test_paths_get_labels_of_their_files(tmp_path: Path) -> None:
    for name, offset in (("a", 0.0), ("b", 1.0)):
        parquet.write_recording(make_recording(offset), tmp_path / f"{name}.parquet")
    result = ks.compare([tmp_path / "a.parquet", f"second={tmp_path / 'b.parquet'}"])
    assert [series.label for series in result.parts[0].series] == ["a", "second"]


def test_saved_files_equal_table_and_json(tmp_path: Path) -> None:
    result = ks.compare({"a": make_recording(), "b": make_recording(1.0)})
    folder = result.save(tmp_path / "out", report=False)
    content = json.loads((folder / "comparison.json").read_text())
    assert content["baseline"] == "a"
    assert content["parts"][0]["channels"][0]["differences"][0]["bias"] == pytest.approx(1.0)
    assert {file.name for file in folder.iterdir()} == {"comparison.csv", "comparison.json", "bands.parquet"}
    pandas = pytest.importorskip("pandas")
    table = result.to_pandas()
    assert list(table.columns) == list(pandas.read_csv(folder / "comparison.csv").columns)


def test_plot_returns_figure_of_part() -> None:
    result = ks.compare([make_recording(), make_recording(1.0)])
    assert result.plot().axes
    with pytest.raises(ks.InputError, match="unknown part 'x'"):
        result.plot("x")


def test_other_objects_are_refused() -> None:
    with pytest.raises(ks.InputError, match="is of the type int; allowed are paths, recordings"):
        ks.compare([make_recording(), 3])
