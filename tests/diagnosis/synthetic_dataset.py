"""Small synthetic bench datasets with known parameters, simulated with the package's own device."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from klute_sim.datasets.trial import TimeSeries
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.effects import catalogue

INTERVAL, STEPS_PER_SAMPLE = 0.005, 25
NOISE = {"force": 3.0, "pressure": 0.01, "muscle_length": 0.02}
UNITS = {"force": "N", "pressure": "bar", "muscle_length": "mm"}


def make_correlated_noise(rng: np.random.Generator, count: int, deviation: float, time_constant: float) -> np.ndarray:
    """Return noise whose autocorrelation decays with ``time_constant`` [s]."""
    decay = float(np.exp(-INTERVAL / time_constant))
    white = rng.normal(0.0, deviation * np.sqrt(1.0 - decay * decay), count)
    noise = np.empty(count)
    noise[0] = rng.normal(0.0, deviation)
    for k in range(1, count):
        noise[k] = decay * noise[k - 1] + white[k]
    return noise


def make_inputs(index: int, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return length [m] at each time step, and length [m] and command [Pa] sampled at :data:`INTERVAL`."""
    rng = np.random.default_rng(100 + index)
    n_samples = round(seconds / INTERVAL)
    motion_time = np.clip(
        np.arange((n_samples - 1) * STEPS_PER_SAMPLE + 1) * INTERVAL / STEPS_PER_SAMPLE - 0.3, 0.0, None
    )
    wave = sum(
        a * np.sin(2 * np.pi * f * motion_time)
        for a, f in zip((6e-3, 3e-3, 1e-3), rng.uniform(0.3, 4.0, 3), strict=True)
    )
    steps = rng.uniform(0.5e5, 4.5e5, 40).repeat(round(0.4 / INTERVAL))[:n_samples]
    steps[: round(0.3 / INTERVAL)] = steps[0]
    length = 0.340 + wave
    return length, length[::STEPS_PER_SAMPLE], steps


def write_dataset(
    folder: Path,
    effects: Mapping[tuple[str, str], Mapping[str, float]] | None = None,
    *,
    base: DeviceParameters | None = None,
    groups: tuple[str, ...] = ("fit_1", "fit_2", "validation_1", "test_1"),
    repeats: int = 2,
    seconds: float = 3.0,
    seed: int = 0,
    device: str = "klute-3-4-pair",
    distort: Mapping[str, object] | None = None,
    muscle_length: bool = False,
    has_zero_order_hold: bool = False,
) -> Path:
    """Write a dataset to ``folder``.

    ``distort`` (channel -> function of time and value) are instrument errors. The command is linear between its
    samples, or, with ``has_zero_order_hold``, held until the next one.
    """
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    parameters = (base or load_device(device).parameters)._replace(effects=catalogue.pack_effects(effects or {}))
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', f'device = "{device}"', "", "[uncertain]"]
    lines += ['"tendon.stiffness_1_n_per_mm" = "10 %"', '"muscle.friction_slope_n_per_bar" = "10 %"']
    for index, group in enumerate(groups):
        fine_length, length, command = make_inputs(index, seconds)
        time = np.arange(len(length)) * INTERVAL
        fine_time = np.arange(1, (len(time) - 1) * STEPS_PER_SAMPLE + 1) * INTERVAL / STEPS_PER_SAMPLE
        initial_state = compute_equilibrium_state(parameters, float(length[0]), float(command[0]))
        fine_command = np.interp(fine_time, time, command)
        if has_zero_order_hold:
            fine_command = np.repeat(command[:-1], STEPS_PER_SAMPLE)
        inputs = fine_length[1:], fine_command
        response = simulate_rollouts(parameters, *inputs, INTERVAL / STEPS_PER_SAMPLE, initial_state=initial_state)
        for repeat in range(repeats):
            readings = {
                "force": response.tension[STEPS_PER_SAMPLE - 1 :: STEPS_PER_SAMPLE],
                "pressure": response.pressure[STEPS_PER_SAMPLE - 1 :: STEPS_PER_SAMPLE] / 1e5,
            }
            if muscle_length:
                readings["muscle_length"] = 1e3 * response.length[STEPS_PER_SAMPLE - 1 :: STEPS_PER_SAMPLE]
            for channel, distortion in (distort or {}).items():
                readings[channel] = distortion(time[1:], readings[channel])
            columns = {"time [s]": time[1:], "length [mm]": 1e3 * length[1:]}
            columns |= {"pressure_command [bar]": command[1:] / 1e5}
            for channel in readings:
                unit = UNITS[channel]
                columns[f"{channel} [{unit}]"] = readings[channel] + make_correlated_noise(
                    rng, len(time) - 1, NOISE[channel], 0.02
                )
            file = f"{group}_{repeat}.csv"
            write_trial(folder / file, columns)
            use = group.split("_")[0]
            lines += ["", "[[trial]]", f'files = ["{file}"]', f'group = "{group}"', f'use = "{use}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


def make_repeats(values: list[np.ndarray], group: str = "g") -> list[Experiment]:
    """Return repeats of which only the measured force matters."""
    device, time = load_device("klute-3-4-pair"), np.arange(len(values[0])) * 0.005
    zeros = np.zeros(3)
    return [
        BenchExperiment(
            f"{group}{k}", group, "fit", device, 0.0, 0.005, zeros, {"force": TimeSeries(time, v)}, unit_length=zeros
        )
        for k, v in enumerate(values)
    ]
