"""Range checks of bench trials: samples with a wrong unit in the heading cause an error."""

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


def load_changed(folder: Path, **changed: tuple[str, np.ndarray]) -> Dataset:
    """Write and load a dataset of klute-3-4-pair whose channels in ``changed`` have another (unit, samples)."""
    columns = {h: v for h, v in COLUMNS.items() if h.split(" ")[0] not in changed}
    columns |= {f"{channel} [{unit}]": samples for channel, (unit, samples) in changed.items()}
    write_trial(folder / "a.csv", columns)
    head = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
    (folder / "dataset.toml").write_text(head + '[[trial]]\nfiles = ["a.csv"]\n', "utf-8")
    return load_dataset(folder)


@pytest.mark.parametrize(
    ("channel", "unit", "samples", "message"),
    [
        (
            "muscle_length",
            "m",
            180.0 + 10.0 * WAVE,
            "muscle_length is 173 to 190 m, but the resting length of this dev",
        ),
        ("muscle_length", "m", 180.0 + 10.0 * WAVE, "0.25 m: is its unit mm?"),
        ("muscle_length", "mm", 0.18 + 0.01 * WAVE, "muscle is 250 mm: is its unit m?"),
        ("length", "mm", 13.4 + 0.4 * WAVE, "length is 13.1 to 13.8 mm, but"),
        ("length", "mm", 13.4 + 0.4 * WAVE, ": is its unit in?"),
        ("muscle_length", "mm", 7.0 + 0.4 * WAVE, ": is its unit in?"),
        ("length", "mm", 1e-5 * WAVE, ": its unit or its zero is wrong"),
        (
            "length",
            "m",
            340.0 + 10.0 * WAVE,
            "length is 333 to 350 m, but the resting length of this device, muscle",
        ),
        ("length", "mm", 34.0 + WAVE, "is its unit cm?"),
        (
            "pressure_command",
            "bar",
            300.0 + 90.0 * WAVE,
            "pressure of this device is 5 bar: is its unit kPa?",
        ),
        ("pressure", "bar", 45.0 + 10.0 * WAVE, "pressure is 38.4 to 55 bar, but the supply pressure"),
        ("pressure", "bar", 45.0 + 10.0 * WAVE, "5 bar: is its unit psi?"),
        ("pressure", "bar", 2250.0 + 500.0 * WAVE, "5 bar: is its unit mmHg or mbar?"),
    ],
)
def test_implausible_samples_are_refused_with_the_likely_unit(
    tmp_path: Path, channel: str, unit: str, samples: np.ndarray, message: str
) -> None:
    with pytest.raises(InputError) as error:
        load_changed(tmp_path, **{channel: (unit, samples)})
    assert message in str(error.value)
    assert str(error.value).startswith("trial 'a': ")


@pytest.mark.parametrize(
    ("channel", "unit", "samples"),
    [
        ("muscle_length", "mm", np.full(40, 0.0)),  # dead, which another check reports
        ("muscle_length", "mm", 10.0 * WAVE),  # zeroed at rest, which a diagnosis identifies
        ("muscle_length", "mm", -18.0 + 12.0 * WAVE),
        ("muscle_length", "mm", 800.0 + 9.0 * WAVE),  # a draw-wire sensor mounted elsewhere
        ("length", "mm", 500.0 + 100.0 * WAVE),
        ("pressure_command", "bar", 12.0 + WAVE),
    ],
)
def test_unusual_but_possible_samples_are_accepted(
    tmp_path: Path, channel: str, unit: str, samples: np.ndarray
) -> None:
    assert load_changed(tmp_path, **{channel: (unit, samples)}).remarks == ()


def test_commands_in_per_cent_are_told_from_psi(tmp_path: Path) -> None:
    per_cent, pressure = 60.0 + 20.0 * WAVE, ("kPa", 300.0 + 100.0 * WAVE)
    with pytest.raises(InputError, match="is its unit psi, or per cent of a full scale"):
        load_changed(tmp_path, pressure_command=("bar", per_cent), pressure=pressure)
    psi = 1e3 * pressure[1] / 6894.76
    with pytest.raises(InputError, match=r"is its unit psi\? Correct it in the heading or under \[columns\]"):
        load_changed(tmp_path, pressure_command=("bar", psi), pressure=pressure)


def test_implausibly_small_commands_are_refused(tmp_path: Path) -> None:
    low: Callable[[float], tuple[str, np.ndarray]] = lambda peak: ("kPa", np.linspace(0.0, peak, 40))  # noqa: E731
    with pytest.raises(InputError, match=r"supply pressure of this device is 500 kPa: is its unit bar\?"):
        load_changed(tmp_path, pressure_command=low(4.5))
    assert load_changed(tmp_path, pressure_command=low(20.0)).remarks == ()
    assert load_changed(tmp_path, pressure_command=low(0.0)).remarks == ()


def test_displacement_that_rests_is_not_taken_for_another_unit(tmp_path: Path) -> None:
    for name, displacement in (("a", 15.0 + 7.0 * WAVE), ("b", np.full(40, 20.0))):
        columns = {h: v for h, v in COLUMNS.items() if not h.startswith("length")}
        write_trial(tmp_path / f"{name}.csv", {**columns, "length [mm]": displacement})
    head = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4"\n'
    trials = "".join(f'[[trial]]\nfiles = ["{name}.csv"]\n' for name in "ab")
    (tmp_path / "dataset.toml").write_text(head + trials, "utf-8")
    with pytest.raises(InputError, match=r"trial .a.: length is .* looks like a displacement") as error:
        load_dataset(tmp_path)
    assert "is its unit" not in str(error.value)
    assert "(and in 1 more trial)" in str(error.value)  # which is not lost
