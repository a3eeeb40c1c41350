"""Small synthetic gait datasets: contact model, another time step, noisy instruments, known parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from klute_sim.controllers.pressure import PressureProfile, load_default_profile
from klute_sim.controllers.state_machine import load_default_state_machine
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import load_device, parse_device
from klute_sim.gait.rig.build import ModelEdit
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.recording.recording import Recording
from klute_sim.types import Array

DEVICE = "klute-1-1-4-pair"
TIME_STEP = 2.5e-4
MOTION = {"shank_angle [deg]": 0.1, "ankle_x [m]": 3e-4, "ankle_z [m]": 3e-4, "ankle_angle [deg]": 0.1}
COMMAND = {"pressure_command [bar]": 0.0}
LOAD = {
    **{"grf_vertical [N]": 2.0, "grf_forward [N]": 1.0, "cop_x [m]": 1e-3},
    **{"force [N]": 5.0, "pressure [bar]": 0.01, "muscle_length [m]": 5e-5},
}
"""Columns and their noise: markers at 200 Hz; sensors and force plates at 1 kHz."""
GROUP_CONDITIONS = {
    "fit_1": (1.19, 1.0),
    "fit_2": (1.0, 0.7),
    "validation_1": (1.3, 0.85),
    "test_1": (1.1, 0.5),
}
"""Group -> walking speed [m/s] and fraction of the tuned profile's pressure."""


@lru_cache(maxsize=16)
def simulate_group(
    group: str, effects: str = "", edit: ModelEdit | None = None, strides: int = 4, *, has_state_machine: bool = False
) -> Recording:
    """Simulate gait; ``effects`` are sections of a device file. A state machine holds its commands for 10 ms."""
    speed, fraction = GROUP_CONDITIONS[group]
    text = load_device(DEVICE).content.decode() + effects
    profile = load_default_profile()
    profile = replace(profile, pressure_bar=tuple(fraction * bar for bar in profile.pressure_bar))
    assert isinstance(profile, PressureProfile)
    return simulate_gait(
        parse_device(text.encode(), DEVICE),
        load_default_state_machine() if has_state_machine else profile,
        GaitOptions(speed=speed, strides=strides, dt=TIME_STEP, alignment=0.0, model_edit=edit),
    )


def compute_from_limb(recording: Recording, channel: str) -> Array:
    """Return ``channel``, with the ankle position computed from a rigid thigh and shank."""
    thigh, shank = (np.radians(recording[name]) for name in ("thigh_angle", "shank_angle"))
    if channel == "ankle_x":
        return np.asarray(recording["carriage_x"] - 0.43 * (np.sin(thigh) + np.sin(shank)))
    if channel == "ankle_z":
        return np.asarray(recording["carriage_z"] - 0.43 * (np.cos(thigh) + np.cos(shank)))
    return recording[channel]


def write_dataset(
    folder: Path,
    *,
    effects: str = "",
    edit: ModelEdit | None = None,
    groups: Sequence[str] = tuple(GROUP_CONDITIONS),
    repeats: int = 2,
    strides: int = 4,
    seed: int = 0,
    uncertain: Mapping[str, str] | None = None,
    offset: Mapping[str, float] | None = None,
    limb: bool = False,
    has_state_machine: bool = False,
    command_interval: float = 1e-3,
    command_delay: float = 0.0,
) -> Path:
    """Write a dataset to ``folder``; commands are logged every ``command_interval`` [s], late by ``command_delay`` [s].

    ``offset`` is added to columns; with ``limb`` the ankle position is computed from limb angles.
    """
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    lines = ['format = "klute-sim-dataset/2"', 'rig = "gait"', f'device = "{DEVICE}"', "", "[uncertain]"]
    default_uncertain = {"muscle.friction_slope_n_per_bar": "10 %", "tendon.stiffness_1_n_per_mm": "10 %"}
    lines += [f'"{key}" = "{value}"' for key, value in (default_uncertain if uncertain is None else uncertain).items()]
    for group in groups:
        recording = simulate_group(group, effects, edit, strides, has_state_machine=has_state_machine)
        channel_by_limb = partial(compute_from_limb, recording)
        for repeat in range(repeats):
            files = []
            for file_kind, interval, noise_by_heading in (
                ("motion", 5e-3, MOTION),
                ("load", 1e-3, LOAD),
                ("command", command_interval, COMMAND),
            ):
                decimation = round(interval / TIME_STEP)
                clock = recording["time"] + (command_delay if file_kind == "command" else 0.0)
                columns = {"time [s]": clock[::decimation]}
                for heading, noise in noise_by_heading.items():
                    values = (channel_by_limb if limb else recording.__getitem__)(heading.split(" ")[0])[::decimation]
                    samples = values + rng.normal(0.0, 1.0, len(values)) * noise
                    columns[heading] = samples + (offset or {}).get(heading, 0.0)
                files.append(f"{group}_{repeat}_{file_kind}.csv")
                write_trial(folder / files[-1], columns)
            lines += ["", "[[trial]]", f"files = {files!r}", f'group = "{group}"', f'use = "{group.split("_")[0]}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder
