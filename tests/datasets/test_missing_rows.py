"""Rows that trial files leave out: refused where a straight line would replace motion or load."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.plausibility.finding import ImplausibleInputError
from klute_sim.types import Array, Mask
from tests.diagnosis.synthetic_gait_dataset import write_dataset

BENCH = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-1-1-4-pair"\n[[trial]]\nfiles = ["a.csv"]\n'
TIME = np.arange(0.0, 10.0, 0.01)
WAVE = 350.0 + 5.0 * np.sin(2.0 * np.pi * TIME)
RAMPS = 350.0 + 5.0 * np.interp(TIME, [0, 3, 7, 10], [0, -1, -1, 1])
NOISE = 0.02 * np.random.default_rng(1).normal(size=len(TIME))


def load_bench(folder: Path, time: Array, length: Array) -> None:
    (folder / "dataset.toml").write_text(BENCH)
    columns = {"time [s]": time, "length [mm]": length, "pressure_command [bar]": 0.0 * time + 2.0}
    write_trial(folder / "a.csv", {**columns, "force [N]": 300.0 + 10.0 * (length - 350.0)})
    load_dataset(folder)


@pytest.mark.parametrize(("begin", "end"), [(2.2, 2.8), (2.25, 3.25), (4.0, 4.13)])
def test_rows_of_a_moving_crosshead_are_missed(begin: float, end: float, tmp_path: Path) -> None:
    is_present = ~((begin <= TIME) & (end >= TIME))
    with pytest.raises(ImplausibleInputError) as caught:
        load_bench(tmp_path, TIME[is_present], WAVE[is_present])
    assert [finding.name for finding in caught.value.findings] == ["time-gap"]
    line = int(np.argmin(is_present)) + 1
    assert f"trial 'a': `length` has no samples between {TIME[line - 2]:g} and" in str(caught.value)
    assert f"{tmp_path / 'a.csv'}, line {line})" in str(caught.value)


@pytest.mark.parametrize(
    ("time", "length"),
    [
        (TIME[(TIME < 4.0) | (TIME > 6.0)], (RAMPS + NOISE)[(TIME < 4.0) | (TIME > 6.0)]),  # at rest
        (TIME[(TIME < 1.0) | (TIME > 1.5)], RAMPS[(TIME < 1.0) | (TIME > 1.5)]),  # at constant speed
        (TIME[(TIME < 4.0) | (TIME > 6.0)], (350.0 + NOISE)[(TIME < 4.0) | (TIME > 6.0)]),  # isometric
        (TIME[np.arange(len(TIME)) % 100 != 7], WAVE[np.arange(len(TIME)) % 100 != 7]),  # single rows
        (np.arange(40.0) + np.where(np.arange(40) > 20, 1.0, 0.0), 350.0 + np.sin(np.arange(40.0))),  # a slow log
    ],
)
def test_harmless_gaps_are_bridged(time: Array, length: Array, tmp_path: Path) -> None:
    load_bench(tmp_path, time, length)


def test_rows_of_a_driven_joint_are_missed(tmp_path: Path) -> None:
    (tmp_path / "dataset.toml").write_text(
        'format = "klute-sim-dataset/2"\nrig = "mjcf"\ndevice = "klute-3-4-pair"\nmodel = "antagonist_joint"\n'
        'prescribed = ["angle_joint", "pressure_command_flexor", "pressure_command_extensor"]\n'
        'measured = ["force_flexor"]\n[[trial]]\nfiles = ["a.csv"]\n'
    )
    is_present = ~((TIME >= 2.2) & (TIME <= 2.8))
    time = TIME[is_present]
    columns = {f"pressure_command_{tendon} [bar]": 3.0 + 0.0 * time for tendon in ("flexor", "extensor")}
    columns |= {"angle_joint [deg]": 10.0 * np.sin(2.0 * np.pi * time), "force_flexor [N]": 300.0 + 10.0 * np.sin(time)}
    write_trial(tmp_path / "a.csv", {"time [s]": time, **columns})
    with pytest.raises(ImplausibleInputError, match="`angle_joint` has no samples between"):
        load_dataset(tmp_path)
    load_dataset(tmp_path, accept=["time-gap"])


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("walks") / "d", groups=("fit_1",), repeats=1, strides=3)


def load_walk(walk: Path, folder: Path, select_rows: Callable[[str, Array, Array], Mask | None]) -> None:
    """Load ``walk`` with the rows that ``select_rows`` returns for the heading, times and first column of each file."""
    (folder / "dataset.toml").write_bytes((walk / "dataset.toml").read_bytes())
    for path in sorted(walk.glob("*.csv")):
        heading, *rows = path.read_text().splitlines()
        cells = np.array([[float(cell or "nan") for cell in row.split(",")] for row in rows])
        is_present = select_rows(heading, cells[:, 0], cells[:, 1])
        kept = rows if is_present is None else [row for row, kept in zip(rows, is_present, strict=True) if kept]
        (folder / path.name).write_text("\n".join([heading, *kept]) + "\n")
    load_dataset(folder)


@pytest.mark.slow
@pytest.mark.parametrize(("first", "channel"), [("shank_angle", "shank_angle"), ("grf_vertical", "grf_vertical")])
def test_motion_and_load_of_a_walk_need_every_row(first: str, channel: str, walk: Path, tmp_path: Path) -> None:
    with pytest.raises(ImplausibleInputError, match=f"`{channel}` has no samples between 1.5 and") as caught:
        load_walk(walk, tmp_path, lambda heading, t, v: (t <= 1.5) | (t > 2.1) if f",{first}" in heading else None)
    assert {finding.name for finding in caught.value.findings} == {"time-gap"}


def test_commands_and_swings_may_be_left_out(walk: Path, tmp_path: Path) -> None:
    def select_rows(heading: str, time: Array, value: Array) -> Mask | None:
        if ",grf_vertical" in heading:
            return np.convolve(value > 20.0, np.ones(41), "same") > 0.0
        if ",pressure_command" in heading:  # logged when it changes
            return np.append(True, np.diff(value) != 0.0)
        return None

    load_walk(walk, tmp_path, select_rows)
