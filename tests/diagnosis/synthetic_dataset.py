"""Small measured datasets whose truth is known, made with the package's own device."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from klute_sim.datasets.write import write_trial
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters, compute_equilibrium_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.effects import catalogue

INTERVAL, FINE = 0.005, 25
NOISE = {"force": 3.0, "pressure": 0.01, "muscle_length": 0.02}
UNITS = {"force": "N", "pressure": "bar", "muscle_length": "mm"}


def coloured(random: np.random.Generator, count: int, deviation: float, time_constant: float) -> np.ndarray:
    """Noise with a correlation that dies away with ``time_constant`` [s]."""
    keep = float(np.exp(-INTERVAL / time_constant))
    white = random.normal(0.0, deviation * np.sqrt(1.0 - keep * keep), count)
    found = np.empty(count)
    found[0] = random.normal(0.0, deviation)
    for k in range(1, count):
        found[k] = keep * found[k - 1] + white[k]
    return found


def inputs(number: int, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Length [m] and command [Pa] of one experiment, a sample every :data:`INTERVAL`."""
    random = np.random.default_rng(100 + number)
    time = np.arange(round(seconds / INTERVAL)) * INTERVAL
    moving = np.clip(time - 0.3, 0.0, None)
    wave = sum(
        a * np.sin(2 * np.pi * f * moving) for a, f in zip((6e-3, 3e-3, 1e-3), random.uniform(0.3, 4.0, 3), strict=True)
    )
    steps = random.uniform(0.5e5, 4.5e5, 40).repeat(round(0.4 / INTERVAL))[: len(time)]
    steps[: round(0.3 / INTERVAL)] = steps[0]
    return 0.340 + wave, steps


def dataset(
    folder: Path,
    effects: Mapping[tuple[str, str], Mapping[str, float]] | None = None,
    *,
    base: DeviceParameters | None = None,
    groups: tuple[str, ...] = ("fit_1", "fit_2", "select_1", "show_1"),
    repeats: int = 2,
    seconds: float = 3.0,
    seed: int = 0,
    device: str = "klute-3-4-pair",
    distort: Mapping[str, object] | None = None,
    muscle_length: bool = False,
) -> Path:
    """Write it; ``distort`` (channel -> function of time and value) are faults of instruments."""
    random = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    parameters = (base or load_device(device).parameters)._replace(effects=catalogue.pack_effects(effects or {}))
    lines = ['format = "klute-sim-dataset/1"', 'rig = "bench"', f'device = "{device}"', "", "[uncertain]"]
    lines += ['"tendon.stiffness_1_n_per_mm" = "10 %"', '"muscle.friction_slope_n_per_bar" = "10 %"']
    for number, group in enumerate(groups):
        length, command = inputs(number, seconds)
        time = np.arange(len(length)) * INTERVAL
        fine = np.arange(1, (len(time) - 1) * FINE + 1) * INTERVAL / FINE
        start = compute_equilibrium_state(parameters, float(length[0]), float(command[0]))
        inputs_ = np.interp(fine, time, length), np.interp(fine, time, command)
        trace = simulate_rollouts(parameters, *inputs_, INTERVAL / FINE, initial_state=start)
        for repeat in range(repeats):
            shown = {"force": trace.tension[FINE - 1 :: FINE], "pressure": trace.pressure[FINE - 1 :: FINE] / 1e5}
            if muscle_length:
                shown["muscle_length"] = 1e3 * trace.length[FINE - 1 :: FINE]
            for channel, law in (distort or {}).items():
                shown[channel] = law(time[1:], shown[channel])
            columns = {"time [s]": time[1:], "length [mm]": 1e3 * length[1:]}
            columns |= {"pressure_command [bar]": command[1:] / 1e5}
            for channel in shown:
                unit = UNITS[channel]
                columns[f"{channel} [{unit}]"] = shown[channel] + coloured(random, len(time) - 1, NOISE[channel], 0.02)
            file = f"{group}_{repeat}.csv"
            write_trial(folder / file, columns)
            use = group.split("_")[0]
            lines += ["", "[[trial]]", f'files = ["{file}"]', f'group = "{group}"', f'use = "{use}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder
