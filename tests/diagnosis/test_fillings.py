"""Fillings of a muscle of which only the pressure was recorded: the supply is judged, as in measured fillings."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import parse_device
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.result import DiagnosisOptions
from klute_sim.diagnosis.workflow import diagnose
from tests.datasets.test_muscle_diameter import TEN_MM

INTERVAL = 0.01
NOISE_PA = 400.0
RESISTANCE = 100.0
"""Resistance of a needle valve that fills a thin muscle in seconds [s bar/dm3]; the catalogue's typical one is 4."""


def write_fillings(folder: Path, n_repeats: int) -> Path:
    """Write fillings of a clamped muscle through a needle valve of which the device file says nothing."""
    device = parse_device(TEN_MM.encode(), "10 mm muscle").with_effect(
        "choked_valve", form="symmetric", resistance_s_bar_per_dm3=RESISTANCE, critical_ratio=0.3
    )
    time = INTERVAL * np.arange(600)
    command = np.where(time < 0.5, 0.0, 6e5)
    length = np.full(len(time), 0.2)
    pressure = simulate_rollouts(device.parameters, length, command, INTERVAL).pressure
    (folder / "muscle.toml").write_text(TEN_MM, "utf-8")
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', 'device = "muscle.toml"']
    rng = np.random.default_rng(0)
    for repeat in range(n_repeats):
        columns = {"time [s]": time, "length [mm]": 1e3 * length, "pressure_command [bar]": 1e-5 * command}
        noisy = pressure + rng.normal(0.0, NOISE_PA, len(time))
        write_trial(folder / f"fill_{repeat}.csv", columns | {"pressure [bar]": 1e-5 * noisy})
        lines += ["[[trial]]", f'files = ["fill_{repeat}.csv"]', 'group = "fill"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("n_repeats", [1, 2])
def test_needle_valve_of_a_filling_is_found(n_repeats: int, tmp_path: Path) -> None:
    """Its resistance is 25 times the typical one, at which a thin muscle fills between two samples."""
    diagnosis = diagnose(load_dataset(write_fillings(tmp_path, n_repeats)), DiagnosisOptions())
    names = {term.effect for term in diagnosis.added_terms}
    assert "choked_valve" in names, diagnosis.reasons
    assert diagnosis.verdict in ("identified", "identified-in-part", "indistinguishable")
    assert diagnosis.final_fit is not None
    values = {
        p.name: v for p, v in zip(diagnosis.final_fit.hypothesis.parameters, diagnosis.final_fit.values, strict=True)
    }
    assert values["resistance_s_bar_per_dm3"] == pytest.approx(RESISTANCE, rel=0.05)
    gap = diagnosis.channel_rms["pressure"]
    assert gap.with_effects < 0.02 * gap.refitted
    if diagnosis.prediction is not None:
        assert 0.9 < diagnosis.prediction.share <= 1.0


LEVELS_BAR = (2.0, 3.0, 4.0, 5.0)
SUBSTEPS = 20


def write_levels(folder: Path, form: str) -> Path:
    """Write two fillings of a clamped muscle to each of several levels, all below the 7 bar of its supply."""
    device = parse_device(TEN_MM.encode(), "10 mm muscle").with_effect(
        "choked_valve", form=form, resistance_s_bar_per_dm3=RESISTANCE, critical_ratio=0.3
    )
    time = INTERVAL * np.arange(600)
    fine = INTERVAL / SUBSTEPS * np.arange(SUBSTEPS * len(time))
    (folder / "muscle.toml").write_text(TEN_MM, "utf-8")
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', 'device = "muscle.toml"']
    rng = np.random.default_rng(0)
    for level in LEVELS_BAR:
        command, length = np.where(time < 0.5, 0.0, 1e5 * level), np.full(len(time), 0.2)
        commanded = np.interp(fine, time, command)
        trace = simulate_rollouts(device.parameters, np.full(len(fine), 0.2), commanded, INTERVAL / SUBSTEPS)
        pressure = np.asarray(trace.pressure)[::SUBSTEPS]
        for repeat in range(2):
            columns = {"time [s]": time, "length [mm]": 1e3 * length, "pressure_command [bar]": 1e-5 * command}
            noisy = pressure + rng.normal(0.0, NOISE_PA, len(time))
            name = f"fill_{level:g}_{repeat}.csv"
            write_trial(folder / name, columns | {"pressure [bar]": 1e-5 * noisy})
            lines += ["[[trial]]", f'files = ["{name}"]', f'group = "fill to {level:g} bar"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("form", ["downstream", "symmetric"])
def test_fillings_to_several_levels_tell_a_needle_after_the_regulator_from_a_valve(form: str, tmp_path: Path) -> None:
    diagnosis = diagnose(load_dataset(write_levels(tmp_path, form)), DiagnosisOptions())
    assert diagnosis.verdict == "identified", diagnosis.reasons
    assert [(term.effect, term.form) for term in diagnosis.added_terms] == [("choked_valve", form)]
    assert diagnosis.final_fit is not None
    parameters = diagnosis.final_fit.hypothesis.parameters
    values = {p.name: v for p, v in zip(parameters, diagnosis.final_fit.values, strict=True)}
    assert values["resistance_s_bar_per_dm3"] == pytest.approx(RESISTANCE, rel=0.03)
    assert values["critical_ratio"] == pytest.approx(0.3, rel=0.05)


LAG_S = 0.03


def write_fillings_with_a_slow_gauge(folder: Path) -> Path:
    """Write fillings and emptyings of a clamped muscle through a valve, as a gauge with a lag shows them."""
    device = parse_device(TEN_MM.encode(), "10 mm muscle").with_effect(
        "choked_valve", form="symmetric", resistance_s_bar_per_dm3=20.0, critical_ratio=0.3
    )
    interval, n_steps = 1e-3, 10
    time = interval * np.arange(4000)
    (folder / "muscle.toml").write_text(TEN_MM, "utf-8")
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', 'device = "muscle.toml"']
    rng = np.random.default_rng(0)
    for level, use in ((2.0, "fit"), (3.0, "fit"), (4.0, "fit"), (5.0, "validation"), (3.5, "test")):
        command = np.where((time < 0.5) | (time > 2.2), 0.0, 1e5 * level)
        fine = np.repeat(command, n_steps)
        pressure = simulate_rollouts(device.parameters, np.full(len(fine), 0.2), fine, interval / n_steps).pressure
        decay = float(np.exp(-interval / LAG_S))
        reading = lfilter([1.0 - decay], [1.0, -decay], np.asarray(pressure)[::n_steps])
        for repeat in "ab":
            file = f"{level}_{repeat}.csv"
            columns = {"time [s]": time, "length [mm]": np.full(len(time), 200.0)}
            columns |= {"pressure_command [bar]": 1e-5 * command}
            columns |= {"pressure [bar]": 1e-5 * (reading + rng.normal(0.0, NOISE_PA, len(time)))}
            write_trial(folder / file, columns)
            lines += ["[[trial]]", f'files = ["{file}"]', f'group = "{level}"', f'use = "{use}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


@pytest.mark.slow
def test_valve_and_lag_of_the_gauge_are_told_from_a_hose(tmp_path: Path) -> None:
    """A hose explains 99 % of both and leaves 24 times the noise; it is not named beside a pair that leaves none."""
    diagnosis = diagnose(load_dataset(write_fillings_with_a_slow_gauge(tmp_path)), DiagnosisOptions())
    assert {term.effect for term in diagnosis.added_terms} == {"choked_valve", "sensor_lag"}, diagnosis.reasons
    assert diagnosis.verdict in ("identified", "indistinguishable")
    fit = diagnosis.final_fit
    assert fit is not None
    values = {p.name: v for p, v in zip(fit.hypothesis.parameters, fit.values, strict=True)}
    assert values["time_constant_s"] == pytest.approx(LAG_S, rel=0.05)
