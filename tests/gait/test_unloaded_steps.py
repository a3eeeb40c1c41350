"""Trials in which the foot stands beside the plates."""

from pathlib import Path

import pytest

from klute_sim.datasets import dataset as datasets
from klute_sim.gait.replay.recording_mistakes import find_recording_mistakes
from klute_sim.plausibility.finding import ImplausibleInputError
from tests.diagnosis.synthetic_gait_dataset import write_dataset

LOAD_FILE = "fit_1_0_load.csv"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("walks") / "d", groups=("fit_1",), repeats=1, strides=4)


def write_walk(folder: Path, copy: Path, begin: float, end: float) -> Path:
    """Write a copy of the dataset in which the plates show load from ``begin`` to ``end`` [s] only."""
    for path in folder.iterdir():
        (copy / path.name).write_bytes(path.read_bytes())
    heading, *rows = (copy / LOAD_FILE).read_text().splitlines()
    names = heading.split(",")
    lines = []
    for row in rows:
        cells = dict(zip(names, row.split(","), strict=True))
        if not begin < float(cells["time [s]"]) < end:
            cells |= {"grf_vertical [N]": "0", "grf_forward [N]": "0", "cop_x [m]": ""}
        lines.append(",".join(cells.values()))
    (copy / LOAD_FILE).write_text("\n".join([heading, *lines]) + "\n")
    return copy


@pytest.mark.slow
@pytest.mark.parametrize(
    ("begin", "end"),
    [
        (1.0, 99.0),  # the first strike in the middle of the recording begins at 1.1 s
        (-1.0, 3.2),
        (1.0, 3.2),
    ],
)
def test_stance_beside_the_plates_is_reported(begin: float, end: float, folder: Path, tmp_path: Path) -> None:
    copy = write_walk(folder, tmp_path, begin, end)
    with pytest.raises(
        ImplausibleInputError, match=r"shows no load from .* the foot stands beside the plates"
    ) as caught:
        datasets.load_dataset(copy, find_in_walks=find_recording_mistakes)
    assert [finding.name for finding in caught.value.findings] == ["plate-gap"]
    accepted = datasets.load_dataset(copy, accept=["plate-gap"], find_in_walks=find_recording_mistakes)
    assert [finding.name for finding in accepted.accepted] == ["plate-gap"]


@pytest.mark.slow
def test_trials_may_begin_and_end_in_swing(folder: Path, tmp_path: Path) -> None:
    copy = write_walk(folder, tmp_path, -1.0, 99.0)
    for path in copy.glob("*.csv"):
        heading, *rows = path.read_text().splitlines()
        kept = [row for row in rows if 0.75 < float(row.split(",")[0]) < 4.25]
        path.write_text("\n".join([heading, *kept]) + "\n")
    assert datasets.load_dataset(copy, find_in_walks=find_recording_mistakes).accepted == ()
