"""Visual3D's ASCII exports: recordings, times and mistakes in the file."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from klute_sim.errors import InputError
from klute_sim.mocap.formats import visual3d
from klute_sim.mocap.formats.content import FileContent
from klute_sim.mocap.formats.visual3d import ExportedRecording

ROWS = [
    ["", "C:\\lab\\a.c3d", "C:\\lab\\a.c3d", "C:\\lab\\a.c3d", "b.c3d", "b.c3d"],
    ["", "R_KNEE", "R_KNEE", "FP1", "TIME", "FP1"],
    ["", "LINK_MODEL_BASED", "LINK_MODEL_BASED", "FORCE", "FRAME_NUMBERS", "FORCE"],
    ["", "ORIGINAL", "ORIGINAL", "ORIGINAL", "ORIGINAL", "ORIGINAL"],
    ["ITEM", "X", "Y", "Z", "X", "Z"],
    ["1", "1.5", "-2", "700", "0.5", "0"],
    ["2", "", "-3", "701", "0.51", "1e2"],
    ["3", "1.7", "-4", "702", "", ""],
]


def parse(rows: list[list[str]]) -> list[ExportedRecording]:
    return visual3d.parse(FileContent("x.txt", "\r\n".join("\t".join(row) for row in rows).encode()))


def edit(row: int, column: int, cell: str) -> Callable[[], list[list[str]]]:
    return lambda: [
        [cell if (i, k) == (row, column) else old for k, old in enumerate(cells)] for i, cells in enumerate(ROWS)
    ]


def test_recordings_of_an_export_are_separated() -> None:
    first, second = parse(ROWS)
    assert (first.name, second.name) == ("a.c3d", "b.c3d")
    assert list(first.columns) == ["R_KNEE.X", "R_KNEE.Y", "FP1.Z"]
    np.testing.assert_array_equal(first.columns["R_KNEE.X"], [1.5, np.nan, 1.7])
    np.testing.assert_array_equal(first.frames, [1.0, 2.0, 3.0])
    assert first.time is None
    assert second.time is not None
    assert second.time.tolist() == [0.5, 0.51]
    assert second.columns["FP1.Z"].tolist() == [0.0, 100.0]


def test_export_is_recognised_by_its_fifth_row(tmp_path: Path) -> None:
    text = "\n".join("\t".join(row) for row in ROWS)
    assert visual3d.is_export(text.encode())
    assert not visual3d.is_export(text.replace("ITEM", "time").encode())
    assert not visual3d.is_export(b"time [s],x\n1,2\n")
    assert not visual3d.is_export(b"")


@pytest.mark.parametrize(
    ("edited", "message"),
    [
        (edit(6, 2, "no data"), "line 7: 'no data' is not a finite number; leave the cell"),
        (edit(6, 2, "1e999"), "line 7: '1e999' is not a finite number"),
        (edit(6, 0, "4"), "must count the frames"),
        (edit(1, 2, ""), "heading row 2 of the Visual3D export is empty in column 3"),
        (edit(4, 2, "X"), "'R_KNEE.X' of 'a.c3d' occurs twice"),
        (lambda: ROWS[:5], "contains no samples"),
        (lambda: [*ROWS[:7], [*ROWS[7], "5"]], "line 8 has 7 cells; the heading rows have 6"),
        (lambda: [*ROWS[:5], ["1"], ["2", "", "5"]], "the signals of 'b.c3d' contain no numbers"),
        (edit(6, 5, ""), r"different rates \('FP1' has 1 samples, others have 2\)"),
    ],
)
def test_mistakes_are_located(edited: Callable[[], list[list[str]]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse(edited())
