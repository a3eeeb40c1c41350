"""Clean data of digital controllers, slow instruments, filters and a hum, end to end: nothing is missing."""

import re
from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import bessel, butter, sosfilt, sosfilt_zi, sosfiltfilt

import klute_sim as ks
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import Device, parse_device

DEVICE = "klute-1-1-4-pair"
STEP_S, DURATION_S = 1e-3, 10.0
NOISE = {"force": 4.0, "pressure": 0.01, "muscle_length": 0.05}
USES = {"fit_1": "fit", "fit_2": "fit", "fit_3": "fit", "validation_1": "validation", "test_1": "test"}

pytestmark = pytest.mark.slow


def hold(values: np.ndarray, n_held: int) -> np.ndarray:
    return values[::n_held].repeat(n_held)[: len(values)]


def write_clean_dataset(
    folder: Path,
    *,
    command_held: int = 1,
    log_interval: int = 1,
    late: int = 0,
    length_held: int = 1,
    change: Callable[[np.ndarray, np.random.Generator], np.ndarray] = lambda values, rng: values,
    device: str | Device = DEVICE,
    changed: Collection[str] = tuple(NOISE),
) -> Path:
    """Write bench data of ``device``, by default clean ones; all numbers are in steps of 1 ms.

    A command is held for ``command_held``, its log is ``late``, every ``log_interval`` there is a row, and the length
    has a new reading every ``length_held``. ``change`` is applied to each channel in ``changed`` with its noise.
    """
    folder.mkdir()
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', f'device = "{DEVICE}"', "", "[uncertain]"]
    lines += ['"muscle.c10_kpa" = "10 %"', '"muscle.friction_slope_n_per_bar" = "10 %"']
    time, noise = np.arange(0.0, DURATION_S, STEP_S), np.random.default_rng(0)
    for seed, (group, use) in enumerate(USES.items()):
        rng = np.random.default_rng(seed)

        def draw_sines(highest_hz: float, n: int, rng: np.random.Generator = rng) -> np.ndarray:
            rates = 2.0 * np.pi * rng.uniform(0.15, highest_hz, n)
            return np.sum([np.sin(rate * time + rng.uniform(0.0, 6.28)) for rate in rates], axis=0) * np.clip(
                time, 0, 1
            )

        length, command = 343.0 + 4.0 * draw_sines(1.2, 4), hold(2.2 + 0.55 * draw_sines(1.2, 3), command_held)
        response = ks.simulate_response(device, time, length, command, zero_order_hold=command_held > 1, time_step=1e-4)
        log = np.r_[np.full(late, command[0]), command][: len(command)]
        for repeat in "ab":
            readings = {
                name: response[name] + deviation * noise.normal(size=len(time)) for name, deviation in NOISE.items()
            }
            columns = {
                "time [s]": time,
                "length [mm]": hold(length, length_held),
                "pressure_command [bar]": log,
                **{
                    response.format_heading(name): change(readings[name], noise) if name in changed else readings[name]
                    for name in NOISE
                },
            }
            write_trial(folder / f"{group}_{repeat}.csv", {name: v[::log_interval] for name, v in columns.items()})
            lines += ["", "[[trial]]", f'files = ["{group}_{repeat}.csv"]', f'group = "{group}"', f'use = "{use}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


def test_command_that_a_controller_holds_for_two_samples(tmp_path: Path) -> None:
    result = ks.diagnose(write_clean_dataset(tmp_path / "data", command_held=10, log_interval=5))
    assert result.verdict == "nothing-missing", result.reasons


def test_log_that_is_a_sample_late(tmp_path: Path) -> None:
    result = ks.diagnose(write_clean_dataset(tmp_path / "data", command_held=10, log_interval=5, late=1))
    assert result.verdict == "nothing-missing", result.reasons
    (delay,) = re.findall(r"the pressure command acted ([\d.]+) \[.*\] ms earlier", " ".join(result.reasons))
    assert float(delay) == pytest.approx(5.0, abs=0.6)


def test_length_that_the_log_repeats(tmp_path: Path) -> None:
    result = ks.diagnose(write_clean_dataset(tmp_path / "data", length_held=10))
    assert result.verdict == "nothing-missing", result.reasons
    assert any("'length' (for 10 ms)" in reason for reason in result.reasons)


def test_hum_of_the_mains(tmp_path: Path) -> None:
    time = np.arange(0.0, DURATION_S, STEP_S)

    def add_hum(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        size = 1e-3 * np.ptp(values)
        return values + size * np.sin(2.0 * np.pi * 50.0 * time + rng.uniform(0.0, 6.28))

    result = ks.diagnose(write_clean_dataset(tmp_path / "data", log_interval=2, change=add_hum))
    assert result.verdict == "nothing-missing", result.reasons
    assert any("N at 50 Hz" in reason for reason in result.reasons)


@pytest.mark.parametrize("cutoff_hz", [6.0, 20.0])
def test_low_pass_filter(tmp_path: Path, cutoff_hz: float) -> None:
    sections = butter(2, cutoff_hz * STEP_S * 2.0, output="sos")
    filtered = write_clean_dataset(
        tmp_path / "data", log_interval=2, change=lambda values, rng: sosfiltfilt(sections, values)
    )
    result = ks.diagnose(filtered)
    assert result.verdict == "nothing-missing", result.reasons
    (found,) = re.findall(r"'force' \(([\d.]+) Hz\)", " ".join(result.reasons))
    assert float(found) == pytest.approx(cutoff_hz, rel=0.1)


def amplify(values: np.ndarray, cutoff_hz: float, kind: str) -> np.ndarray:
    """Return ``values`` (n,) through a filter of order 4 with delay."""
    rate = {"fs": 1.0 / STEP_S, "output": "sos"}
    sections = butter(4, cutoff_hz, **rate) if kind == "butterworth" else bessel(4, cutoff_hz, norm="mag", **rate)
    return sosfilt(sections, values, zi=values[0] * sosfilt_zi(sections))[0]


@pytest.mark.parametrize(("cutoff_hz", "kind"), [(10.0, "butterworth"), (30.0, "bessel")])
def test_filter_of_an_amplifier(tmp_path: Path, cutoff_hz: float, kind: str) -> None:
    data = write_clean_dataset(
        tmp_path / "data", log_interval=2, change=lambda values, rng: amplify(values, cutoff_hz, kind)
    )
    result = ks.diagnose(data)
    assert result.verdict == "nothing-missing", result.reasons
    (found,) = re.findall(r"'force' \(([\d.]+) Hz, delay", " ".join(result.reasons))
    assert float(found) == pytest.approx(cutoff_hz, rel=0.1)


def test_effect_behind_an_amplifier_of_the_force(tmp_path: Path) -> None:
    hysteresis = '[effects.braid_hysteresis]\nform = "coulomb"\nslope_n_per_bar = 20.0\n'
    device = parse_device(ks.load_device(DEVICE).content + f"\n{hysteresis}".encode(), "truth")
    data = write_clean_dataset(
        tmp_path / "data",
        log_interval=2,
        change=lambda values, rng: amplify(values, 10.0, "butterworth"),
        device=device,
        changed=["force"],
    )
    result = ks.diagnose(data)
    assert result.verdict == "identified", result.reasons
    assert [effect.name for effect in result.effects] == ["braid_hysteresis"]
    (found,) = re.findall(r"'force' \(([\d.]+) Hz, delay", " ".join(result.reasons))
    assert float(found) == pytest.approx(10.0, rel=0.01)
