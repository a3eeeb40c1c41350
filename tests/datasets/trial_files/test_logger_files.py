"""Files as loggers and LabVIEW write them: commas in headings, empty headings, comments below the rows."""

from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.datasets.channels import get_column_units
from klute_sim.datasets.trial_files.table import Table, read_trial_file
from klute_sim.datasets.unit_conversion import describe_wrong_unit
from klute_sim.errors import InputError

LABVIEW_HEAD = """LabVIEW Measurement\t
Separator\tTab
Decimal_Separator\t,
Time\t10:00:00,1234567
***End_of_Header***\t

Channels\t3\t\t\t
Time\t10:00:00,12\t10:00:00,12\t10:00:00,12\t
Delta_X\t0,010000\t0,010000\t0,010000\t
***End_of_Header***\t\t\t\t
"""


def read(folder: Path, content: str) -> Table:
    (folder / "a.csv").write_text(content, "utf-8")
    return read_trial_file(folder / "a.csv", get_column_units("bench"))


@pytest.mark.parametrize(
    ("heading", "row"),
    [
        ("time [s];force [N];p (bar, gauge);x (mm, filtered, 10 Hz)", "0,5;1,5;2,5;3"),  # as many commas
        ("time [s];force [N];p (bar, gauge)", "0.5;1.5;2.5"),
        ("time [s];force [N];p, inlet, bar, gauge", "0,5;1,5;2,5"),  # more commas than semicolons
        ("time [s]\tforce [N]\tp (bar, gauge)\tx, y, z", "0,5\t1,5\t2,5\t3,5"),
        ("time [s]\tforce [N]\tp; x; y", "0.5\t1.5\t2"),
        ("time [s],force [N],a;b;c", "0.5,1.5,2"),
    ],
)
def test_rows_tell_which_character_separates_the_cells(tmp_path: Path, heading: str, row: str) -> None:
    columns = read(tmp_path, f"{heading}\n{row}\n{row}\n").columns
    assert (columns["time"][0], columns["force"][0]) == (0.5, 1.5)


@pytest.mark.parametrize("last", ["", "Comment"])
def test_heading_at_the_end_without_cells_is_no_column(tmp_path: Path, last: str) -> None:
    file = read(tmp_path, f"time [s],force [N],{last}\n0,1\n1,2\n")
    assert file.columns["force"].tolist() == [1.0, 2.0]
    assert file.available == ("time [s]", "force [N]")


@pytest.mark.parametrize("end", ["# end of test\n", "% 305 N\n\n", '"# a, b",\n# c\n', "//\n,,\n"])
def test_comments_below_the_rows_are_no_samples(tmp_path: Path, end: str) -> None:
    assert read(tmp_path, f"time [s],force [N]\n0,1\n1,2\n{end}").columns["force"].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("end", "message"),
    [
        ("End of file", "line 4 has 1 cell, but the heading (line 1) has 2 cells; complete the row, or delete it"),
        ("Mean,3", "'Mean' is not a number; every row needs a time as a number, such as seconds; delete rows that"),
        ("10:00:02,3", 'or state the sampling rate under [columns], such as time = "row / 100 [s]"'),
    ],
)
def test_other_rows_are_refused_with_what_to_do(tmp_path: Path, end: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, f"time [s],force [N]\n0,1\n1,2\n{end}\n")
    assert message in str(error.value)


def test_unit_in_capitals_is_named() -> None:
    assert describe_wrong_unit("S", "s").startswith("a unit of the wrong kind, 'S'; did you mean 's'? Allowed: s")


@pytest.mark.parametrize("end", ["", "\t"])
def test_draft_reads_labview_files_with_or_without_cells_for_comments(tmp_path: Path, end: str) -> None:
    time = 0.01 * np.arange(200)
    channels = (time, 340.0 + 0.0 * time, 3.0 + 0.0 * time, 400.0 + np.sin(3.0 * time))
    rows = ["\t".join(f"{value:.6f}" for value in row).replace(".", ",") + end for row in zip(*channels, strict=True)]
    heading = "X_Value\tLength (mm)\tp_set (bar, gauge)\tForce (N, filtered)\tComment\n"
    (tmp_path / "a.lvm").write_text(LABVIEW_HEAD + heading + "\n".join(rows), "utf-8")
    ks.draft_dataset(tmp_path, "klute-3-4-pair")
    force = ks.load_dataset(tmp_path).trials[0].measured["force"]
    assert force.time == pytest.approx(time)
    assert force.value == pytest.approx(channels[3], abs=1e-6)
