"""Small synthetic datasets of the antagonist joint with known parameters, simulated with the package's own devices."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from klute_sim.datasets.mechanism_channels import DISPLAY_UNITS, parse_channel
from klute_sim.datasets.unit_conversion import get_conversion_factor
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import Device, load_device
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.mechanism.simulate import simulate_mechanism
from klute_sim.plant.mjcf.model_effects import ModelEffect
from klute_sim.plant.mjcf.model_file import load_model_file

INTERVAL, STEP = 0.01, 1e-4
TENDONS = ("flexor", "extensor")
INPUTS = ("pressure_command_flexor", "pressure_command_extensor")
NUMBERS = {"model.site.flexor_origin.pos_z": 0.29, "model.site.extensor_origin.pos_z": 0.29}
NOISE = {
    "angle_joint": 0.05,
    **{f"force_{tendon}": 1.0 for tendon in TENDONS},
    **{f"pressure_{tendon}": 0.005 for tendon in TENDONS},
}
"""Channel -> standard deviation of its noise in its unit for display."""


def make_commands(index: int, seconds: float) -> dict[str, np.ndarray]:
    """Return the pressure commands [Pa] of one trial, sampled at :data:`INTERVAL`: ramps between random levels."""
    rng = np.random.default_rng(200 + index)
    time = np.arange(round(seconds / INTERVAL)) * INTERVAL
    knots = np.concatenate([[0.0, 0.4], 0.4 + np.cumsum(rng.uniform(0.1, 0.5, 60))])
    commands = {}
    for name in INPUTS:
        levels = rng.uniform(1.0e5, 4.0e5, len(knots))
        levels[1] = levels[0]
        commands[name] = np.interp(time, knots, levels)
    return commands


def write_dataset(
    folder: Path,
    *,
    truth: Mapping[str, Device] | None = None,
    true_numbers: Mapping[str, float] | None = None,
    effects: Sequence[ModelEffect] = (),
    uncertain: Mapping[str, str | float] | None = None,
    measured: tuple[str, ...] = ("angle_joint",),
    groups: tuple[str, ...] = ("fit_1", "fit_2", "validation_1", "test_1"),
    repeats: int = 2,
    seconds: float = 4.0,
    extra: str = "",
    seed: int = 0,
) -> Path:
    """Write a dataset of the joint with ``truth`` (tendon -> device), ``true_numbers`` and ``effects``."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    nominal = load_device("klute-3-4-pair")
    devices = {tendon: (truth or {}).get(tendon, nominal).parameters for tendon in TENDONS}
    mechanism = Mechanism(load_model_file("antagonist_joint"), TENDONS, INPUTS)
    lines = [
        'format = "klute-sim-dataset/2"',
        'rig = "mjcf"',
        'model = "antagonist_joint"',
        'device = "klute-3-4-pair"',
    ]
    lines += [f"prescribed = {list(INPUTS)}", f"measured = {list(measured)}", extra, "[numbers]"]
    lines += [f'"{name}" = {value}' for name, value in NUMBERS.items()]
    lines += ["[uncertain]", *(f'"{k}" = {v!r}' for k, v in (uncertain or {}).items())]
    for index, group in enumerate(groups):
        commands = make_commands(index, seconds)
        time = np.arange(len(commands[INPUTS[0]])) * INTERVAL
        fine_time = np.arange(round(time[-1] / STEP) + 1) * STEP
        inputs = {name: np.interp(fine_time, time, values) for name, values in commands.items()}
        numbers = {**NUMBERS, **(true_numbers or {})}
        rollout = simulate_mechanism(mechanism, devices, inputs, STEP, numbers=numbers, effects=effects)
        for repeat in range(repeats):
            columns = {"time [s]": time} | {f"{name} [bar]": values / 1e5 for name, values in commands.items()}
            for name in measured:
                channel = parse_channel(name)
                unit = DISPLAY_UNITS[channel.si_unit]
                values = rollout.read_channel(mechanism.bind(channel)) / (
                    get_conversion_factor(unit, channel.si_unit) or 1.0
                )
                samples = np.interp(time, fine_time, values)
                columns[f"{name} [{unit}]"] = samples + rng.normal(0.0, NOISE[name], len(time))
            write_trial(folder / f"{group}_{repeat}.csv", columns)
            use = group.split("_")[0]
            lines += ["[[trial]]", f'files = ["{group}_{repeat}.csv"]', f'group = "{group}"', f'use = "{use}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder
