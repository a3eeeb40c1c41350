"""Single wrong samples are told from noise, steps and pulses."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.errors import InputError
from klute_sim.plausibility.samples import Samples
from klute_sim.plausibility.spikes import check_position, find_spikes
from klute_sim.plausibility.units import Range

INTERVAL = 0.01
TIME = np.arange(0.0, 4.0, INTERVAL)
LENGTH = 0.34 + 0.005 * np.sin(5.0 * TIME)
RANDOM = np.random.default_rng(0)


def load(folder: Path, **changed: np.ndarray) -> Dataset:
    """Write and load a dataset of klute-3-4-pair with other samples, in mm, bar and N."""
    constant = np.full(len(TIME), 0.9)
    channels = {"length": 1e3 * LENGTH, "pressure_command": constant, "pressure": constant, "force": 200.0 * constant}
    units = {"length": "mm", "pressure_command": "bar", "pressure": "bar", "force": "N"}
    columns = {f"{name} [{units[name]}]": changed.get(name, values) for name, values in channels.items()}
    write_trial(folder / "a.csv", {"time [s]": TIME, **columns})
    head = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
    (folder / "dataset.toml").write_text(head + '[[trial]]\nfiles = ["a.csv"]\n', "utf-8")
    return load_dataset(folder)


def spoil(values: np.ndarray, value: float, row: int = 250, n_samples: int = 1) -> np.ndarray:
    """Return ``values`` with some of them replaced."""
    spoilt = values.copy()
    spoilt[row : row + n_samples] = value
    return spoilt


@pytest.mark.parametrize("n_samples", [1, 3])
@pytest.mark.parametrize("row", [0, 250, 397])
def test_zero_among_lengths_is_refused(tmp_path: Path, row: int, n_samples: int) -> None:
    with pytest.raises(InputError, match=rf"trial 'a': length is 0 mm at {TIME[row]:g} s.*but 3\d\d") as error:
        load(tmp_path, length=spoil(1e3 * LENGTH, 0.0, row, n_samples))
    assert "accept it with --accept length-spike" in str(error.value)


@pytest.mark.parametrize("value", [300.0, 4095.0, 32767.0, 65535.0])
@pytest.mark.parametrize("channel", ["length", "pressure_command", "force", "pressure"])
def test_single_value_that_no_process_reaches_is_refused(tmp_path: Path, channel: str, value: float) -> None:
    values = {"length": 1e3 * LENGTH, "force": np.full(len(TIME), 180.0)}.get(channel, np.full(len(TIME), 0.9))
    value = 1e3 if channel == "force" and value == 300.0 else value
    with pytest.raises(InputError, match=f"{channel}-(spike|missing)"):
        load(tmp_path, **{channel: spoil(values, value)})


def test_spike_that_is_right_can_be_accepted(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        load(tmp_path, length=spoil(1e3 * LENGTH, 300.0))
    assert load_dataset(tmp_path, accept=["length-spike"]).trials


@pytest.mark.parametrize("n_samples", [1, 2, 5, 50])
@pytest.mark.parametrize("value", [0.0, 1.0, 4.095, 5.0])
def test_pulse_of_the_command_is_accepted(tmp_path: Path, value: float, n_samples: int) -> None:
    load(tmp_path, pressure_command=spoil(np.full(len(TIME), 0.9), value, n_samples=n_samples))


@pytest.mark.parametrize("interval", [0.001, 0.01, 0.1])
@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_motion_steps_and_noise_are_no_spikes(interval: float, noise: float) -> None:
    time = interval * np.arange(2000.0)
    quick_release = np.where(time > 1000 * interval, 0.3, 0.34)
    ramps = 0.3 + 0.02 * np.abs((time / interval / 100.0) % 2.0 - 1.0)
    for waveform in (np.full(len(time), 0.3), quick_release, ramps, 0.3 + 0.02 * np.sin(0.3 / interval * time)):
        value = waveform + noise * RANDOM.standard_normal(len(time))
        for values in (value, np.round(value, 3), np.repeat(value[::4], 4)):
            samples = Samples("length", values, "m", 1.0)
            assert check_position(samples, time, "m", "trial 'a'", Range(0.1, 0.5, 0.3))[0] == []


def test_loose_contact_and_single_stroke_of_a_slow_log_are_no_spikes() -> None:
    time = 0.1 * np.arange(600.0)
    loose = np.where(np.arange(600) % 97 == 0, 0.5, 0.3)
    assert find_spikes(time, loose, 0.005) == []
    stroke = spoil(np.full(600, 0.3), 0.27, n_samples=2)
    assert check_position(Samples("length", stroke, "m", 1.0), time, "m", "", Range(0.1, 0.5, 0.3))[0] == []


def test_wrap_of_an_encoder_is_no_spike_of_an_angle() -> None:
    angle = 0.2 * np.sin(TIME)
    wrapped, wrong = spoil(angle, float(angle[250]) + 2.0 * np.pi), spoil(angle, 3.0)
    assert check_position(Samples("angle_knee", wrapped, "rad", 1.0), TIME, "rad", "")[0] == []
    (finding,), is_wrong = check_position(Samples("angle_knee", wrong, "rad", 1.0), TIME, "rad", "trial 'a'")
    assert finding.name == "angle_knee-spike"
    assert np.flatnonzero(is_wrong).tolist() == [250]


def test_missing_samples_beside_a_spike_do_not_hide_it() -> None:
    value = spoil(spoil(LENGTH, np.nan, 249), 0.2)
    (finding,), is_wrong = check_position(Samples("muscle_length", value, "mm", 1e-3), TIME, "m", "trial 'a'")
    assert "muscle_length is 200 mm at 2.5 s, but 340 and 340 mm" not in finding.statement
    assert finding.statement.startswith("muscle_length is 200 mm at 2.5 s, but 33")
    assert np.flatnonzero(is_wrong).tolist() == [250]
