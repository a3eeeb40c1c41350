"""Walks whose truth is known, and sealed: made by the contact model in shorter steps.

What makes the data is another MuJoCo model than what explains them: the whole rig with its contacts, servos and the
heel's spring, in steps of half the length, with effects of the body put into the MJCF here (:mod:`walk_models`) and not
by the package. The device in it is the package's own law, its uncertain numbers drawn anew. Markers are on the limb:
where the ankle is, is reckoned from there. Repeats are walks at slightly other speeds.
"""

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from catalogue import BODY, EFFECTS, ON_WALKS, instrument_forms
from sizes import as_wanted
from walk_models import EDITS, edit
from walk_sizes import WalkScale

from klute_sim.control.pressure import Profile, tuned
from klute_sim.dataset.override import overridden
from klute_sim.dataset.write import write_trial
from klute_sim.device.files import Device, load, read
from klute_sim.recording.recording import Recording
from klute_sim.rigs.gait.assembly import GaitOptions
from klute_sim.rigs.gait.rig import walk

Effects = Sequence[Mapping[str, Any]]
DEVICE = "klute-1-1-4-pair"
STEP, STRIDES = 2.5e-4, 4
LIMB = 0.43
"""Length of thigh and shank of the usual walker [m]."""
UNCERTAIN = {"muscle.friction_slope_n_per_bar": 0.1, "tendon.stiffness_1_n_per_mm": 0.1, "muscle.c10_kpa": 0.1}
"""Relative standard deviations; the truth is no further off than two of them."""
GROUPS = {"fit_1": 1.2, "fit_2": 1.0, "fit_3": 1.1, "select_1": 1.3, "show_1": 1.15}
"""Group -> speed [m/s]."""
PACE = 0.01
"""Relative standard deviation of a repeat's speed."""
NOISE = {
    **{"shank_angle": 0.1, "ankle_x": 3e-4, "ankle_z": 3e-4, "grf_vertical": 2.0, "grf_forward": 1.0, "cop_x": 1e-3},
    **{"pressure_command": 0.0, "ankle_angle": ON_WALKS["ankle_angle"].noise, "force": ON_WALKS["force"].noise},
    **{"pressure": ON_WALKS["pressure"].noise, "muscle_length": 1e-3 * ON_WALKS["muscle_length"].noise},
}
"""Of every channel, in the units of a recording."""
PARTS = {
    "motion": (5e-3, ("shank_angle", "ankle_x", "ankle_z", "ankle_angle")),
    "load": (1e-3, ("grf_vertical", "grf_forward", "cop_x", "pressure_command", "force", "pressure", "muscle_length")),
}
"""File -> interval [s] and channels."""


def make(
    folder: Path, seed: int, *, truth: Path, effects: Effects = (), instruments: Effects = (), block: str = "walk"
) -> dict[str, Any]:
    """Write the dataset ``folder`` and its ``truth``; return that.

    Device, speeds, pressures and noise depend on ``seed`` only. What has a ``wanted`` size gets it.
    """
    child = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]
    nominal = load(DEVICE)
    numbers = nominal.spec.numbers()
    base = {k: numbers[k] * (1.0 + share * np.clip(child[0].normal(), -2.0, 2.0)) for k, share in UNCERTAIN.items()}
    plain = overridden(nominal, base, "the truth")
    profiles = {}
    for group in GROUPS:
        share = float(child[1].uniform(0.5, 1.0))
        profiles[group] = replace(tuned(), pressure_bar=tuple(share * bar for bar in tuned().pressure_bar))
    hidden, faults = list(effects), list(instruments)
    if any("wanted" in each for each in (*hidden, *faults)):
        scale = _scale(plain, base, profiles)
        hidden = [as_wanted(e, (EFFECTS | BODY)[e["name"], e["form"]], scale.size) for e in hidden]
        faults = [as_wanted(e, instrument_forms(e["channel"])[e["name"], e["form"]], scale.size) for e in faults]
        scale.close()
    folder.mkdir(parents=True, exist_ok=True)
    lines = _head()
    for group, speed in GROUPS.items():
        for repeat in "ab":
            own = speed * (1.0 + PACE * float(child[1].normal()))
            walked = _walked(plain, profiles[group], own, hidden)
            lines += _trial(folder, f"{group}_{repeat}", group, seen(walked, NOISE, faults, child[2]))
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    sealed = {
        "seed": seed,
        "block": block,
        "effects": hidden,
        "instruments": faults,
        "strangers": [],
        "deleted": False,
        "repeats": 2,
        "defect": None,
        "base": base,
        "nominal": {key: numbers[key] for key in UNCERTAIN},
        "size": max([0.0, *(each.get("size", 0.0) for each in (*hidden, *faults))]),
    }
    truth.write_text(json.dumps(sealed, indent=1), "utf-8")
    return sealed


def _walked(device: Device, profile: Profile, speed: float, effects: Effects) -> Recording:
    """With ``effects`` in the device's own file, or in the MJCF."""
    text = device.content.decode()
    for one in effects:
        if (one["name"], one["form"]) not in EDITS:
            own = "".join(f"{key} = {value!r}\n" for key, value in one["parameters"].items())
            text += f'\n[effects.{one["name"]}]\nform = "{one["form"]}"\n{own}'
    options = GaitOptions(speed=speed, strides=STRIDES, step=STEP, edit=edit(effects))
    return walk(read(text.encode(), "the truth"), profile, options)


def _scale(device: Device, base: Mapping[str, float], profiles: Mapping[str, Profile]) -> WalkScale:
    """From one walk of every group that is fitted."""
    with tempfile.TemporaryDirectory() as folder:
        lines, random = _head(), np.random.default_rng(0)
        for group in (group for group in GROUPS if group.startswith("fit")):
            walked = _walked(device, profiles[group], GROUPS[group], ())
            lines += _trial(Path(folder), group, group, seen(walked, dict.fromkeys(NOISE, 0.0), (), random))
        (Path(folder) / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
        return WalkScale(Path(folder), base, {name: channel.noise for name, channel in ON_WALKS.items()})


def _head() -> list[str]:
    lines = ['format = "klute-sim-dataset/1"', 'rig = "gait"', f'device = "{DEVICE}"', "", "[uncertain]"]
    return lines + [f'"{key}" = "{100.0 * share:g} %"' for key, share in UNCERTAIN.items()]


def _trial(folder: Path, name: str, group: str, columns: Mapping[str, Mapping[str, np.ndarray]]) -> list[str]:
    """Write its files; the lines that name them."""
    files = [f"{name}_{part}.csv" for part in PARTS]
    for file, part in zip(files, PARTS, strict=True):
        write_trial(folder / file, columns[part])
    return ["", "[[trial]]", f"files = {files!r}", f'group = "{group}"', f'use = "{group.split("_")[0]}"']


def seen(
    walked: Recording, noise: Mapping[str, float], faults: Effects, random: np.random.Generator
) -> dict[str, dict[str, np.ndarray]]:
    """The columns of every file, as instruments show them."""
    thigh, shank = np.radians(walked["thigh_angle"]), np.radians(walked["shank_angle"])
    limb = {
        "ankle_x": walked["carriage_x"] - LIMB * (np.sin(thigh) + np.sin(shank)),
        "ankle_z": walked["carriage_z"] - LIMB * (np.cos(thigh) + np.cos(shank)),
    }
    found = {}
    for part, (interval, names) in PARTS.items():
        every = round(interval / STEP)
        columns = found[part] = {"time [s]": walked["time"][::every]}
        for name in names:
            values = limb[name] if name in limb else walked[name]
            for fault in (one for one in faults if one["channel"] == name):
                values = distorted(values, fault)
            values = values[::every]
            columns[walked.heading(name)] = values + noise[name] * random.normal(0.0, 1.0, len(values))
    return found


def distorted(values: np.ndarray, fault: Mapping[str, Any]) -> np.ndarray:
    """``values``, one per step, through an instrument with a ``fault``."""
    own = fault["parameters"]
    if fault["name"] == "sensor_lag":
        found, share = np.empty_like(values), STEP / (own["time_constant_s"] + STEP)
        late = values[0]
        for k, value in enumerate(values):
            late += share * (value - late)
            found[k] = late
        return found
    return own.get("gain", 1.0) * values + own.get("offset", 0.0)
