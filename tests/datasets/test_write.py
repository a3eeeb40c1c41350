"""Writer of trial files: exact numbers, and complete files or none."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.datasets import channels
from klute_sim.datasets.trial_files import table
from klute_sim.datasets.write import write_trial
from klute_sim.errors import InputError


@given(values=st.lists(st.floats(allow_infinity=False), min_size=1, max_size=20))
def test_reading_restores_all_numbers_exactly(tmp_path_factory: pytest.TempPathFactory, values: list[float]) -> None:
    path = tmp_path_factory.mktemp("x") / "a.csv"
    write_trial(path, {"time [s]": np.arange(len(values)), "force [N]": np.array(values)})
    samples = table.read_trial_file(path, channels.get_column_units("bench")).columns["force"]
    assert np.array_equal(samples, np.array(values), equal_nan=True)


def test_missing_samples_become_empty_cells(tmp_path: Path) -> None:
    write_trial(tmp_path / "a.csv", {"time [s]": np.array([0.0, 0.5]), "force [N]": np.array([np.nan, 2.0])})
    assert (tmp_path / "a.csv").read_text() == "time [s],force [N]\n0,\n0.5,2\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


def test_failed_write_raises_and_leaves_no_file(tmp_path: Path) -> None:
    time = np.arange(3.0)
    with pytest.raises(InputError, match="not of the form 'name"):
        write_trial(tmp_path / "a.csv", {"time": time})
    with pytest.raises(InputError, match=r"column 'force \[N\]' has shape \(2,\); all columns need"):
        write_trial(tmp_path / "a.csv", {"time [s]": time, "force [N]": time[:2]})
    with pytest.raises(InputError, match="cannot be written: No such file"):
        write_trial(tmp_path / "no" / "a.csv", {"time [s]": time})
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match="cannot be written: Is a directory"):
        write_trial(tmp_path / "folder", {"time [s]": time})
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written: Not a directory"):
        write_trial(tmp_path / "file" / "a.csv", {"time [s]": time})
    assert {p.name for p in tmp_path.iterdir()} == {"folder", "file"}
