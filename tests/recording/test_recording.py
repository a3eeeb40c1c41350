"""Recordings: validation, and exact round trips through files."""

import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.errors import InputError, MissingExtraError
from klute_sim.recording import csv, parquet
from klute_sim.recording.recording import Recording, split_heading

TIME = np.arange(5) * 0.1


def example() -> Recording:
    force = np.array([0.1, np.nan, 1e-300, -2.0, 1 / 3])
    columns = [("time [s]", TIME), ("force [N]", force), ("ankle_moment [N*m]", TIME**2)]
    return Recording.from_columns(columns, {"device": {"name": "x"}, "seed": None})


def test_headings_split_and_join() -> None:
    assert split_heading("ankle_moment [N*m]") == ("ankle_moment", "N*m")
    assert example().format_heading("ankle_moment") == "ankle_moment [N*m]"


@given(st.text(max_size=20))
def test_invalid_headings_are_refused(text: str) -> None:
    try:
        name, unit = split_heading(text)
    except InputError:
        return
    assert f"{name} [{unit}]" == text


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ([("force [N]", TIME)], "needs a channel 'time"),
        ([("time [s]", TIME), ("force [N]", TIME[1:])], "'force' has shape"),
        ([("time [s]", TIME), ("force", TIME)], "'name \\[unit\\]'"),
        ([("time [s]", TIME), ("force [N]", TIME), ("force [kN]", TIME)], "'force' occurs twice"),
    ],
)
def test_invalid_columns_are_refused(columns: list[tuple[str, np.ndarray]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Recording.from_columns(columns)


@pytest.mark.parametrize("units", [{"time": "s"}, {"time": "s", "force": "N", "torque": "N*m"}])
def test_units_and_channels_must_match(units: dict[str, str]) -> None:
    with pytest.raises(InputError, match="channels and units do not match"):
        Recording({"time": TIME, "force": TIME}, units)


def test_unknown_channel_lists_the_channels() -> None:
    with pytest.raises(InputError, match="time, force, ankle_moment"):
        example()["torque"]
    assert "force" in example()
    assert "torque" not in example()


def test_select_keeps_units_and_provenance() -> None:
    part = example().select(TIME > 0.15)
    assert len(part) == 3
    assert part.units == example().units
    assert part.provenance == example().provenance


def test_parquet_round_trip_is_exact(tmp_path: Path) -> None:
    file = tmp_path / "r.parquet"
    parquet.write_recording(example(), file)
    back = parquet.load_recording(file)
    for name, samples in example().channels.items():
        assert np.array_equal(back[name], samples, equal_nan=True)
    assert list(back.channels) == list(example().channels)
    assert back.units == example().units
    assert back.provenance == example().provenance
    schema = pq.read_schema(file)
    assert schema.field("force [N]").metadata[b"unit"] == b"N"
    parquet.write_recording(example(), tmp_path / "again.parquet")
    assert (tmp_path / "again.parquet").read_bytes() == file.read_bytes()


def test_invalid_parquet_is_refused_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "x.parquet").write_text("hello")
    with pytest.raises(InputError, match="is not a Parquet file"):
        parquet.load_recording(tmp_path / "x.parquet")
    with pytest.raises(InputError, match="cannot be read"):
        parquet.load_recording(tmp_path / "none.parquet")
    pq.write_table(pa.table({"time [s]": TIME, "note [1]": list("abcde")}), tmp_path / "t.parquet")
    with pytest.raises(InputError, match="'note \\[1\\]' holds string; allowed: numbers"):
        parquet.load_recording(tmp_path / "t.parquet")


def test_csv_round_trip_is_exact_and_missing_samples_are_empty(tmp_path: Path) -> None:
    csv.write(example(), tmp_path / "r.csv")
    lines = (tmp_path / "r.csv").read_text().splitlines()
    assert lines[0] == "time [s],force [N],ankle_moment [N*m]"
    cells = [line.split(",") for line in lines[1:]]
    assert cells[1][1] == ""
    assert [float(row[2]) for row in cells] == example()["ankle_moment"].tolist()


def test_pandas_and_xarray_keep_units_and_provenance() -> None:
    pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    recording = example()
    frame, dataset = recording.to_pandas(), recording.to_xarray()
    assert isinstance(frame, pandas.DataFrame)
    assert isinstance(dataset, xarray.Dataset)
    assert frame.attrs["units"] == dict(recording.units)
    assert dataset["force"].attrs["units"] == "N"
    assert np.array_equal(frame["force"], recording["force"], equal_nan=True)
    assert np.array_equal(dataset["force"], recording["force"], equal_nan=True)
    assert np.array_equal(dataset["time"], recording["time"])


def test_missing_optional_packages_are_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    for package, convert in (("pandas", Recording.to_pandas), ("xarray", Recording.to_xarray)):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(MissingExtraError, match=f"Recording.to_{package} needs the optional extra 'tables'"):
            convert(example())


def test_repr_is_short() -> None:
    assert repr(example()).startswith("<Recording of ")
    assert "<td>force</td><td>N</td>" in example()._repr_html_()
