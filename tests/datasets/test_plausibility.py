"""Samples under a heading with another unit than theirs are refused, or doubted, before anything is simulated."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.errors import InputError

TIME = np.arange(40) * 0.01
WAVE = np.sin(10.0 * TIME)
COLUMNS = {
    "time [s]": TIME,
    "length [m]": 0.34 + 0.01 * WAVE,
    "muscle_length [m]": 0.18 + 0.01 * WAVE,
    "pressure_command [kPa]": 300.0 + 100.0 * WAVE,
    "pressure [kPa]": 290.0 + 100.0 * WAVE,
    "force [N]": 500.0 + WAVE,
}


def measured(folder: Path, **changed: tuple[str, np.ndarray]) -> Dataset:
    """A dataset of klute-3-4-pair in ``folder``, channels ``changed`` to (unit, samples)."""
    columns = {h: v for h, v in COLUMNS.items() if h.split(" ")[0] not in changed}
    columns |= {f"{channel} [{unit}]": samples for channel, (unit, samples) in changed.items()}
    write_trial(folder / "a.csv", columns)
    head = 'format = "klute-sim-dataset/1"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
    (folder / "dataset.toml").write_text(head + '[[trial]]\nfiles = ["a.csv"]\n', "utf-8")
    return load_dataset(folder)


@pytest.mark.parametrize(
    ("channel", "unit", "samples", "says"),
    [
        ("muscle_length", "m", 180.0 + 10.0 * WAVE, "muscle_length is 173 to 190 m, and this device's muscle is 0.25"),
        ("muscle_length", "m", 180.0 + 10.0 * WAVE, "m long at rest: is it in mm?"),
        ("muscle_length", "mm", 0.18 + 0.01 * WAVE, "muscle is 250 mm long at rest: is it in m?"),
        ("length", "mm", 13.4 + 0.4 * WAVE, "length is 13.1 to 13.8 mm, and"),
        ("length", "mm", 13.4 + 0.4 * WAVE, ": is it in in?"),
        ("muscle_length", "mm", 7.0 + 0.4 * WAVE, ": is it in in?"),
        ("length", "mm", 1e-5 * WAVE, ": its unit or its zero is another one"),
        ("length", "m", 340.0 + 10.0 * WAVE, "length is 333 to 350 m, and this device, muscle and tendon together, is"),
        ("length", "mm", 34.0 + WAVE, "is it in cm?"),
        ("pressure_command", "bar", 300.0 + 90.0 * WAVE, "supply gives no more than 5 bar: is it in kPa?"),
        ("pressure", "bar", 45.0 + 10.0 * WAVE, "pressure is 38.1 to 55 bar, and this device's supply gives no more"),
        ("pressure", "bar", 45.0 + 10.0 * WAVE, "5 bar: is it in psi?"),
    ],
)
def test_what_cannot_be_the_devices_is_refused_with_the_likely_unit(
    tmp_path: Path, channel: str, unit: str, samples: np.ndarray, says: str
) -> None:
    with pytest.raises(InputError) as refused:
        measured(tmp_path, **{channel: (unit, samples)})
    assert says in str(refused.value)
    assert str(refused.value).startswith("trial 'a': ")


@pytest.mark.parametrize(
    ("channel", "unit", "samples"),
    [
        ("muscle_length", "mm", np.full(40, 0.0)),  # dead, which is told elsewhere
        ("muscle_length", "mm", np.where(TIME == 0.2, 1e4, 180.0 + WAVE)),
        ("muscle_length", "mm", 10.0 * WAVE),  # zeroed where it rests, which a diagnosis can name
        ("muscle_length", "mm", -18.0 + 12.0 * WAVE),
        ("muscle_length", "mm", 1.2 + 0.8 * WAVE),
        ("muscle_length", "mm", 800.0 + 9.0 * WAVE),  # a wire that is drawn from elsewhere
        ("length", "mm", 500.0 + 100.0 * WAVE),
        ("pressure", "bar", np.where(TIME == 0.2, 1e4, 3.0 + WAVE)),  # a loose contact
        ("pressure_command", "bar", 12.0 + WAVE),
    ],
)
def test_what_an_odd_rig_may_show_is_read(tmp_path: Path, channel: str, unit: str, samples: np.ndarray) -> None:
    assert measured(tmp_path, **{channel: (unit, samples)}).remarks == ()


def test_commands_that_hardly_press_are_doubted_but_used(tmp_path: Path) -> None:
    low: Callable[[float], tuple[str, np.ndarray]] = lambda most: ("kPa", np.linspace(0.0, most, 40))  # noqa: E731
    (remark,) = measured(tmp_path, pressure_command=low(4.5)).remarks
    assert remark == (
        "pressure_command is never above 4.5 kPa, and this device's supply gives 500 kPa; perhaps it is in bar"
    )
    assert measured(tmp_path, pressure_command=low(20.0)).remarks == ()
    assert measured(tmp_path, pressure_command=low(0.0)).remarks == ()
