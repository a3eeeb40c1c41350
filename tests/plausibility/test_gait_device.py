"""Channels of the device in gait trials: mistakes are found by name, weak and passive devices accepted."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from benchmarks.robustness.gait_plausibility.files import Columns, make_trial, write_table
from benchmarks.robustness.gait_plausibility.walker import Walker
from benchmarks.robustness.gait_plausibility.wrong import exchange, on, times

from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.laws.foot import moment_arm
from klute_sim.plausibility.finding import ImplausibleInputError
from klute_sim.plausibility.gait.device import MOMENT_ARM

WALKER = Walker()
DATASET = 'format = "klute-sim-dataset/2"\nrig = "gait"\ndevice = "klute-1-1-4-pair"\n[[trial]]\nfiles = ["walk.csv"]\n'
Edit = Callable[[Columns], Columns]


def make_walk(share: float = 0.8, seed: int = 0) -> Columns:
    """Return a walk whose tendon carries ``share`` of the ankle moment."""
    rng = np.random.default_rng(seed)
    columns = make_trial(WALKER)
    moment = WALKER.compute_leg("right")["moment"]
    columns["force [N]"] = np.maximum(share * moment / MOMENT_ARM, 0.0) + 5.0 * rng.normal(size=len(moment))
    columns["pressure [bar]"] = columns["pressure_command [bar]"] + 0.01 * rng.normal(size=len(moment))
    return columns


def load(folder: Path, columns: Columns) -> Dataset:
    (folder / "dataset.toml").write_text(DATASET, "utf-8")
    write_table(columns, folder / "walk.csv")
    return load_dataset(folder)


def test_moment_arm_is_that_of_the_prosthesis() -> None:
    foot = build_device_foot(load_device("klute-1-1-4-pair"))
    assert moment_arm(foot, 0.0) == pytest.approx(MOMENT_ARM, rel=0.01)
    assert moment_arm(foot, np.radians(15.0)) == pytest.approx(MOMENT_ARM, rel=0.05)


@pytest.mark.parametrize(
    ("edit", "name", "advice"),
    [
        (times("force", -1.0), "force-sign", "its sign seems reversed; tension is positive"),
        (times("force", 1e-3), "force-unit", "is its unit kN?"),
        (times("force", 1.0 / 4.448), "force-unit", "is its unit lbf?"),
        (times("force", 1.0 / 9.807), "force-unit", "is its unit kgf?"),
        (times("force", 10.0), "force-unit", "its unit or its scale is wrong"),
        (on("pressure [", lambda values: values + 1.01), "pressure-absolute", "always about 1.01 bar above"),
        (exchange("force [N]", "pressure [bar]"), "force-pressure-exchanged", "exchange the headings"),
    ],
)
def test_mistake_is_named(edit: Edit, name: str, advice: str, tmp_path: Path) -> None:
    with pytest.raises(ImplausibleInputError) as error:
        load(tmp_path, edit(make_walk()))
    assert [finding.name for finding in error.value.findings] == [name]
    assert advice in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("channel", "value"), [("shank_angle", 0.0), ("ankle_angle", 60.0), ("ankle_z", 0.0)])
def test_wrong_sample_of_the_motion_is_named(channel: str, value: float, tmp_path: Path) -> None:
    columns = make_walk()
    heading = next(heading for heading in columns if heading.startswith(channel))
    values = columns[heading].copy()
    row = int(np.abs(values[100:-100] - value).argmax()) + 100
    values[row] = value
    with pytest.raises(ImplausibleInputError, match=f"{channel} is {value:g} .*nothing moves as fast") as error:
        load(tmp_path, {**columns, heading: values})
    assert [finding.name for finding in error.value.findings] == [f"{channel}-spike"]


@pytest.mark.parametrize(("share", "newtons", "units"), [(0.9, 9.807, "kgf or lbf"), (0.6, 4.448, "lbf or kgf")])
def test_units_of_force_that_fit_are_both_named(share: float, newtons: float, units: str, tmp_path: Path) -> None:
    with pytest.raises(ImplausibleInputError, match=rf"is its unit {units}\? Correct the heading"):
        load(tmp_path, times("force", 1.0 / newtons)(make_walk(share)))


def test_finding_of_the_walk_explains_the_tension(tmp_path: Path) -> None:
    with pytest.raises(ImplausibleInputError) as error:
        load(tmp_path, times("grf", 1e-3)(make_walk()))
    assert {finding.name for finding in error.value.findings} == {"grf_vertical-unit", "grf_forward-unit"}


@pytest.mark.parametrize("lag", [0.0, 0.05, 0.15])
def test_gauge_with_an_offset_or_a_slow_supply_is_accepted(lag: float, tmp_path: Path) -> None:
    columns = make_walk()
    columns["pressure [bar]"] = 0.5 + np.interp(WALKER.time - lag, WALKER.time, columns["pressure_command [bar]"])
    load(tmp_path, columns)


@pytest.mark.parametrize("share", [0.35, 0.54, 1.0, 1.6])
def test_other_shares_of_the_moment_are_accepted(share: float, tmp_path: Path) -> None:
    load(tmp_path, make_walk(share))


def test_broken_load_cell_is_left_to_the_diagnosis(tmp_path: Path) -> None:
    columns = make_walk()
    load(tmp_path, {**columns, "force [N]": np.random.default_rng(1).normal(size=len(columns["force [N]"]))})


def test_passive_walk_with_exchanged_columns_is_named(tmp_path: Path) -> None:
    columns = make_walk(0.54)
    still = 0.0 * columns["pressure_command [bar]"]
    columns |= {"pressure_command [bar]": still, "pressure [bar]": still + 0.01}
    load(tmp_path, columns)
    with pytest.raises(ImplausibleInputError, match="--accept force-pressure-exchanged"):
        load(tmp_path, exchange("force [N]", "pressure [bar]")(columns))


def test_motion_at_exactly_50_hz_is_accepted_and_slower_motion_refused(tmp_path: Path) -> None:
    columns = make_walk()
    load(tmp_path, {heading: values[::2] for heading, values in columns.items()})
    with pytest.raises(InputError, match=r"'shank_angle' has 33\.3 samples a second; a replay needs 50 or more"):
        load(tmp_path, {heading: values[::3] for heading, values in columns.items()})
