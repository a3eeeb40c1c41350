"""OpenSim's storage files: what is written is read, by us and by a reader that shares no line with ours."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.errors import InputError
from klute_sim.files.limits import FileKind
from klute_sim.mocap.formats import storage
from klute_sim.mocap.formats.content import FileContent
from klute_sim.mocap.formats.storage import Storage

TEXT = """Coordinates
version=1
nRows=3
nColumns=3
inDegrees=yes

Units are S.I. units (second, meters, Newtons, ...)
endheader
time\tknee_angle_r\tankle_angle_r
   0.00\t  10.5\t-3.25
   0.01\t  11.0\tnan
   0.02\t  11.5\t-1e-3
"""


def independent(path: Path) -> tuple[dict[str, str], list[str], np.ndarray]:
    """Header, names and numbers as NumPy's own text reader has them."""
    lines = path.read_text().split("\n")
    end = lines.index("endheader")
    header = dict(line.split("=", 1) for line in lines[:end] if "=" in line)
    return header, lines[end + 1].split("\t"), np.loadtxt(path, skiprows=end + 2, delimiter="\t", ndmin=2)


def test_file_matches_known_values() -> None:
    table = storage.parse(FileContent("x.mot", TEXT.encode()))
    assert (table.name, table.in_degrees, list(table.columns)) == (
        "Coordinates",
        True,
        ["time", "knee_angle_r", "ankle_angle_r"],
    )
    assert table.columns["knee_angle_r"].tolist() == [10.5, 11.0, 11.5]
    assert table.columns["ankle_angle_r"][[0, 2]].tolist() == [-3.25, -1e-3]
    assert np.isnan(table.columns["ankle_angle_r"][1])


numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)
labels = st.text("abcdefghijklmnopqrstuvwxyz_0123456789/", min_size=1, max_size=12).filter(lambda name: name != "time")


@settings(max_examples=40, deadline=None)
@given(data=st.data(), degrees=st.booleans(), names=st.lists(labels, unique=True, max_size=4))
def test_round_trip_is_exact(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, degrees: bool, names: list[str]
) -> None:
    path = tmp_path_factory.mktemp("sto") / "made.sto"
    columns = {"time": np.arange(3) / 7.0}
    columns |= {name: np.array(data.draw(st.lists(numbers, min_size=3, max_size=3))) for name in names}
    storage.write(Storage(columns, degrees, "made", {"DataRate": "7"}), path)
    stored = storage.read(path)
    assert stored.in_degrees == degrees
    assert stored.header["DataRate"] == "7"
    assert list(stored.columns) == list(columns)
    header, order, table = independent(path)
    assert header["inDegrees"] == ("yes" if degrees else "no")
    assert (int(header["nRows"]), int(header["nColumns"])) == (3, len(columns))
    assert order == list(columns)
    for number, (name, samples) in enumerate(columns.items()):
        assert np.array_equal(stored.columns[name], samples)
        assert np.array_equal(table[:, number], samples)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("endheader", "end", "the line 'endheader' is missing"),
        ("nRows=3", "nRows=4", "the header states nRows=4, but there are 3"),
        ("nColumns=3", "nColumns=9", "the header states nColumns=9, but there are 3"),
        ("11.0\t", "11,0\t", "line 11: '11,0' is not a finite number"),
        ("11.0\t", "inf\t", "line 11: 'inf' is not a finite number"),
        ("  11.5\t-1e-3", "  11.5", "line 12 has 2 numbers, but there are 3 columns"),
        ("   0.02", "   0.01", "'time' must increase strictly"),
        ("time\t", "t\t", "column 'time' is missing"),
        ("ankle_angle_r", "knee_angle_r", "column 'knee_angle_r' occurs twice"),
        ("Coordinates", "Coordin\0tes", "is not a text file"),
        (TEXT[TEXT.index("time") :], "", "the line with the column names is missing"),
    ],
)
def test_error_names_location(old: str, new: str, message: str) -> None:
    assert old in TEXT
    with pytest.raises(InputError) as caught:
        storage.parse(FileContent("x.mot", TEXT.replace(old, new, 1).encode()))
    assert message in str(caught.value)
    assert "x.mot" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_invalid_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="blanks are not allowed"):
        storage.write(Storage({"time": np.zeros(2), "a b": np.zeros(2)}, False), tmp_path / "x.sto")
    with pytest.raises(InputError, match="shape"):
        storage.write(Storage({"time": np.zeros(2), "a": np.zeros(3)}, False), tmp_path / "x.sto")


def test_missing_empty_and_large_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="No such file"):
        storage.read(tmp_path / "none.mot")
    (tmp_path / "empty.mot").write_text("\n\n")
    with pytest.raises(InputError, match="is empty"):
        storage.read(tmp_path / "empty.mot")
    (tmp_path / "x.mot").write_text(TEXT)
    monkeypatch.setattr("klute_sim.mocap.formats.content.MOTION", FileKind("", 100))
    with pytest.raises(InputError, match=r"allowed: up to 0\.0001 MB"):
        storage.read(tmp_path / "x.mot")


@pytest.mark.parametrize("declared", ["4", "9" * 5000, "0" * 5000 + "4"])
def test_other_number_of_rows_is_refused(declared: str) -> None:
    content = FileContent("x.mot", TEXT.replace("nRows=3", f"nRows={declared}").encode())
    with pytest.raises(InputError, match=r"x\.mot: the header states nRows=\d{1,20}, but there are 3") as caught:
        storage.parse(content)
    assert len(str(caught.value)) < 150


def test_number_of_rows_may_have_leading_zeros() -> None:
    content = FileContent("x.mot", TEXT.replace("nRows=3", f"nRows={'0' * 5000}3").encode())
    assert len(storage.parse(content).time) == 3
