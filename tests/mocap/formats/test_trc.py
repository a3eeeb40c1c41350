"""Marker files: units, markers that were not seen, round trips, and a reader that is not ours."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.errors import InputError
from klute_sim.mocap.formats import trc
from klute_sim.mocap.formats.content import FileContent
from klute_sim.mocap.formats.trc import Markers

TEXT = (
    "PathFileType\t4\t(X/Y/Z)\tx.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n"
    "60\t60\t2\t2\tmm\t60\t1\t2\n"
    "Frame#\tTime\tR.Heel\t\t\tR Toe\t\t\n"
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
    "\n"
    "1\t0.0\t100\t-50.5\t0\t1\t2\t3\n"
    "2\t0.017\t101\t\t\t\n"
)


def test_file_matches_known_values() -> None:
    trajectories = trc.parse(FileContent("x.trc", TEXT.encode()))
    assert trajectories.time.tolist() == [0.0, 0.017]
    assert trajectories.positions["R.Heel"][0] == pytest.approx([0.1, -0.0505, 0.0])
    assert trajectories.positions["R Toe"][0] == pytest.approx([0.001, 0.002, 0.003])
    assert np.isnan(trajectories.positions["R Toe"][1]).all()
    assert np.isnan(trajectories.positions["R.Heel"][1]).tolist() == [False, True, True]


places = st.floats(-1e3, 1e3, allow_nan=False)
names = st.text("abcXYZ019. _", min_size=1, max_size=9).map(str.strip).filter(bool)


@settings(max_examples=40, deadline=None)
@given(data=st.data(), markers=st.lists(names, unique=True, min_size=1, max_size=4))
def test_round_trip_is_exact(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, markers: list[str]) -> None:
    path = tmp_path_factory.mktemp("trc") / "made.trc"
    draw = st.lists(places | st.just(np.nan), min_size=9, max_size=9)
    positions = {name: np.array(data.draw(draw)).reshape(3, 3) for name in markers}
    time = np.array([0.0, 0.01, 0.02])
    trc.write(Markers(time, positions), path)
    trajectories = trc.read(path)
    assert np.array_equal(trajectories.time, time)
    assert list(trajectories.positions) == markers
    for name, samples in positions.items():
        assert np.array_equal(trajectories.positions[name], samples, equal_nan=True)
    # by NumPy's own reader: frame, time, then three cells for each marker in metres
    table = np.genfromtxt(path, delimiter="\t", skip_header=5, ndmin=2)
    assert np.array_equal(table[:, 0], [1, 2, 3])
    assert np.array_equal(table[:, 2:], np.hstack(list(positions.values())), equal_nan=True)
    assert path.read_text().splitlines()[2].split("\t")[4] == "m"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("PathFileType", "Path", "must start with 'PathFileType'"),
        ("\tmm\t", "\tinch\t", "Units is 'inch'; allowed: mm, cm, m"),
        ("60\t60\t2\t2", "60\t60\t3\t2", "NumFrames is 3, but there are 2 rows"),
        ("60\t60\t2\t2", "60\t60\t2\t7", "NumMarkers is 7, but 2 markers are named"),
        ("R Toe", "R.Heel", "marker 'R.Heel' occurs twice"),
        ("-50.5", "left", "line 7: 'left' is not a finite number"),
        ("\t1\t2\t3\n", "\t1\t2\t3\t4\n", "line 7 has 9 cells"),
        ("0.017", "0.0", "must increase strictly"),
    ],
)
def test_error_names_location(old: str, new: str, message: str) -> None:
    assert old in TEXT
    with pytest.raises(InputError) as caught:
        trc.parse(FileContent("x.trc", TEXT.replace(old, new, 1).encode()))
    assert message in str(caught.value)
    assert "x.trc" in str(caught.value)


def test_invalid_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="without tabs"):
        trc.write(Markers(np.arange(2.0), {"a\tb": np.zeros((2, 3))}), tmp_path / "x.trc")


@pytest.mark.parametrize("key", ["NumFrames", "NumMarkers"])
def test_count_of_thousands_of_digits_is_refused(key: str) -> None:
    counts = {"NumFrames": "60\t60\t{}\t2\tmm", "NumMarkers": "60\t60\t2\t{}\tmm"}
    text = TEXT.replace("60\t60\t2\t2\tmm", counts[key].format("9" * 5000))
    with pytest.raises(InputError, match=rf"x\.trc: {key} is 9{{20}}, but") as caught:
        trc.parse(FileContent("x.trc", text.encode()))
    assert len(str(caught.value)) < 150
