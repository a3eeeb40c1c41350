"""Gait datasets with known, separately stored ground truth, from the contact model with shorter time steps.

The data come from another MuJoCo model than their explanation: the complete rig with contacts, servos and the heel
spring, half the time step, and effects of the body that :mod:`walk_models` adds to the MJCF. The device follows the law
of the package with uncertain numbers drawn anew. Markers are on the limb, from which the ankle position is computed.
Repeats have slightly different speeds.
"""

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.hidden_effects.catalogue import BODY_EFFECTS, EFFECTS, GAIT_CHANNELS, instrument_forms
from benchmarks.hidden_effects.sizes import scale_to_target
from benchmarks.hidden_effects.walk_models import SPEC_EDITS, compose_spec_edits
from benchmarks.hidden_effects.walk_sizes import GaitEffectSizer

from klute_sim.controllers.pressure import PressureProfile, load_default_profile
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.recording.recording import Recording

Effects = Sequence[Mapping[str, Any]]
DEVICE_PRESET = "klute-1-1-4-pair"
TIME_STEP, N_STRIDES = 2.5e-4, 4
SEGMENT_LENGTH = 0.43
"""Length of thigh and shank of the default subject [m]."""
RELATIVE_UNCERTAINTIES = {
    "muscle.friction_slope_n_per_bar": 0.1,
    "tendon.stiffness_1_n_per_mm": 0.1,
    "muscle.c10_kpa": 0.1,
}
"""Relative standard deviations; the true values are within two of them."""
GROUP_SPEEDS = {"fit_1": 1.2, "fit_2": 1.0, "fit_3": 1.1, "validation_1": 1.3, "test_1": 1.15}
"""Speed [m/s] of each group."""
SPEED_DEVIATION = 0.01
"""Relative standard deviation of the speed of a repeat."""
CHANNEL_NOISE = {
    **{"shank_angle": 0.1, "ankle_x": 3e-4, "ankle_z": 3e-4, "grf_vertical": 2.0, "grf_forward": 1.0, "cop_x": 1e-3},
    **{
        "pressure_command": 0.0,
        "ankle_angle": GAIT_CHANNELS["ankle_angle"].noise,
        "force": GAIT_CHANNELS["force"].noise,
    },
    **{"pressure": GAIT_CHANNELS["pressure"].noise, "muscle_length": 1e-3 * GAIT_CHANNELS["muscle_length"].noise},
}
"""Noise of each channel in the units of a recording."""
FILE_CHANNELS = {
    "motion": (5e-3, ("shank_angle", "ankle_x", "ankle_z", "ankle_angle")),
    "load": (1e-3, ("grf_vertical", "grf_forward", "cop_x", "pressure_command", "force", "pressure", "muscle_length")),
}
"""Sampling interval [s] and channels of each file."""


def make_dataset(
    folder: Path,
    seed: int,
    *,
    truth: Path,
    effects: Effects = (),
    instruments: Effects = (),
    registration: Effects = (),
    block: str = "walk",
    noise: Mapping[str, float] = CHANNEL_NOISE,
) -> dict[str, Any]:
    """Write the dataset ``folder`` and its ground truth ``truth``; return the ground truth.

    Device, speeds, pressures and noise depend on ``seed`` only. Effects with a ``wanted`` size are scaled to it, which
    is their size before the registration is refitted. ``registration`` are errors of the coordinates, which are no
    missing effect. ``noise`` of each channel is in the unit of a recording.
    """
    child = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]
    nominal = load_device(DEVICE_PRESET)
    numbers = nominal.spec.collect_values()
    base = {
        k: numbers[k] * (1.0 + share * np.clip(child[0].normal(), -2.0, 2.0))
        for k, share in RELATIVE_UNCERTAINTIES.items()
    }
    device = nominal.with_changes(base, "the truth")
    profiles = {}
    for group in GROUP_SPEEDS:
        share = float(child[1].uniform(0.5, 1.0))
        profiles[group] = replace(
            load_default_profile(), pressure_bar=tuple(share * bar for bar in load_default_profile().pressure_bar)
        )
    hidden, faults = list(effects), list(instruments)
    if any("wanted" in effect for effect in (*hidden, *faults)):
        sizer = _build_sizer(device, base, profiles)
        hidden = [_scale_effect(e, (EFFECTS | BODY_EFFECTS)[e["name"], e["form"]], sizer) for e in hidden]
        faults = [_scale_effect(e, instrument_forms(e["channel"])[e["name"], e["form"]], sizer) for e in faults]
        sizer.close()
    folder.mkdir(parents=True, exist_ok=True)
    lines = _dataset_header()
    for group, speed in GROUP_SPEEDS.items():
        for repeat in "ab":
            repeat_speed = speed * (1.0 + SPEED_DEVIATION * float(child[1].normal()))
            recording = _simulate_gait_trial(device, profiles[group], repeat_speed, hidden)
            lines += _write_trial_files(
                folder,
                f"{group}_{repeat}",
                group,
                measure_channels(recording, noise, [*faults, *registration], child[2]),
            )
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    ground_truth = {
        "seed": seed,
        "block": block,
        "effects": hidden,
        "instruments": faults,
        **({"registration": list(registration)} if registration else {}),
        "strangers": [],
        "deleted": False,
        "repeats": 2,
        "defect": None,
        "base": base,
        "nominal": {key: numbers[key] for key in RELATIVE_UNCERTAINTIES},
        "size": max([0.0, *(effect.get("size", 0.0) for effect in (*hidden, *faults))]),
    }
    truth.write_text(json.dumps(ground_truth, indent=1), "utf-8")
    return ground_truth


def _scale_effect(effect: Mapping[str, Any], parameters: Mapping[str, Any], sizer: GaitEffectSizer) -> dict[str, Any]:
    """Return ``effect`` scaled to its required size, with the size that a refit of the registration leaves."""
    scaled = scale_to_target(effect, parameters, sizer.measure_size)
    return {**scaled, "size": round(sizer.measure_size(scaled, with_registration=True), 3)}


def _simulate_gait_trial(device: Device, profile: PressureProfile, speed: float, effects: Effects) -> Recording:
    """Simulate gait with ``effects`` in the device file or in the MJCF."""
    text = device.content.decode()
    for effect in effects:
        if (effect["name"], effect["form"]) not in SPEC_EDITS:
            parameter_lines = "".join(f"{key} = {value!r}\n" for key, value in effect["parameters"].items())
            text += f'\n[effects.{effect["name"]}]\nform = "{effect["form"]}"\n{parameter_lines}'
    options = GaitOptions(
        speed=speed, strides=N_STRIDES, dt=TIME_STEP, alignment=0.0, model_edit=compose_spec_edits(effects)
    )
    return simulate_gait(parse_device(text.encode(), "the truth"), profile, options)


def _build_sizer(device: Device, base: Mapping[str, float], profiles: Mapping[str, PressureProfile]) -> GaitEffectSizer:
    """Return the sizer from one simulation of each fit group."""
    with tempfile.TemporaryDirectory() as folder:
        lines, rng = _dataset_header(), np.random.default_rng(0)
        for group in (group for group in GROUP_SPEEDS if group.startswith("fit")):
            recording = _simulate_gait_trial(device, profiles[group], GROUP_SPEEDS[group], ())
            lines += _write_trial_files(
                Path(folder), group, group, measure_channels(recording, dict.fromkeys(CHANNEL_NOISE, 0.0), (), rng)
            )
        (Path(folder) / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
        return GaitEffectSizer(Path(folder), base, {name: channel.noise for name, channel in GAIT_CHANNELS.items()})


def _dataset_header() -> list[str]:
    lines = ['format = "klute-sim-dataset/2"', 'rig = "gait"', f'device = "{DEVICE_PRESET}"', "", "[uncertain]"]
    return lines + [f'"{key}" = "{100.0 * share:g} %"' for key, share in RELATIVE_UNCERTAINTIES.items()]


def _write_trial_files(
    folder: Path, name: str, group: str, columns: Mapping[str, Mapping[str, np.ndarray]]
) -> list[str]:
    """Write the files of a trial and return the lines that list them."""
    files = [f"{name}_{part}.csv" for part in FILE_CHANNELS]
    for file, part in zip(files, FILE_CHANNELS, strict=True):
        write_trial(folder / file, columns[part])
    return ["", "[[trial]]", f"files = {files!r}", f'group = "{group}"', f'use = "{group.split("_")[0]}"']


def measure_channels(
    recording: Recording, noise: Mapping[str, float], faults: Effects, rng: np.random.Generator
) -> dict[str, dict[str, np.ndarray]]:
    """Return the columns of each file as the instruments report them.

    The ankle is where the limb with its liner puts it: markers on the socket see the liner of the rig, and not the
    pistoning that an effect adds beyond the socket.
    """
    thigh, shank = np.radians(recording["thigh_angle"]), np.radians(recording["shank_angle"])
    shank_length = SEGMENT_LENGTH - recording["liner_displacement"]
    limb = {
        "ankle_x": recording["carriage_x"] - SEGMENT_LENGTH * np.sin(thigh) - shank_length * np.sin(shank),
        "ankle_z": recording["carriage_z"] - SEGMENT_LENGTH * np.cos(thigh) - shank_length * np.cos(shank),
    }
    files = {}
    for part, (interval, names) in FILE_CHANNELS.items():
        decimation = round(interval / TIME_STEP)
        columns = files[part] = {"time [s]": recording["time"][::decimation]}
        for name in names:
            values = limb[name] if name in limb else recording[name]
            for fault in (candidate for candidate in faults if candidate["channel"] == name):
                values = apply_fault(values, fault)
            values = values[::decimation]
            columns[recording.format_heading(name)] = values + noise[name] * rng.normal(0.0, 1.0, len(values))
    return files


def apply_fault(values: np.ndarray, fault: Mapping[str, Any]) -> np.ndarray:
    """Return ``values``, one per time step, as an instrument with ``fault`` reports them."""
    parameters = fault["parameters"]
    if fault["name"] == "sensor_lag":
        lagged, weight = np.empty_like(values), TIME_STEP / (parameters["time_constant_s"] + TIME_STEP)
        output = values[0]
        for k, value in enumerate(values):
            output += weight * (value - output)
            lagged[k] = output
        return lagged
    return parameters.get("gain", 1.0) * values + parameters.get("offset", 0.0)
