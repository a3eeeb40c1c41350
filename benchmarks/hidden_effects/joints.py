"""Datasets of an antagonist joint with known, separately stored ground truth.

The laws of joint and devices are written a second time (:mod:`joint_truth`, :mod:`law`). Pressure commands, the angle
and both pressures are logged, as in most published measurements of such joints; the uncertain numbers of devices and
model are wrong.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from math import radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.hidden_effects.air import AIR_STEP, simulate_pressure
from benchmarks.hidden_effects.catalogue import (
    JOINT_CHANNELS,
    JOINT_EFFECTS,
    JOINT_LOAD_CELLS,
    OUT_OF_CATALOGUE_JOINT_FORMS,
    TENDONS,
    instrument_forms,
)
from benchmarks.hidden_effects.device import PRESET_FILE, add_effects, build_neutral_law, load_device
from benchmarks.hidden_effects.imperfect import SEEN_SPECIMENS
from benchmarks.hidden_effects.joint_truth import GRAVITY, STEPS_PER_TRACE, ForceError, JointLaw, integrate_joint
from benchmarks.hidden_effects.simulate import apply_faults, draw_coloured_noise, draw_wander, quantise
from benchmarks.hidden_effects.truth import TRACE_STEP

Effects = Sequence[Mapping[str, Any]]
Floats = np.ndarray
SAMPLE_INTERVAL = 5e-3  # s: of the log and of the commands
DURATION, REST_DURATION = 3.0, 0.4  # s
ORIGIN_HEIGHT = 0.29  # m: of both muscles, so that their tendons are just taut
FORCE_RANGE = 400.0  # N: of the muscles in these trials, which the error of a law is a fraction of
MAX_ANGLE, MIN_ANGLE = radians(90.0), radians(-27.0)  # away from the stops
WANDER, LOGGED_COMMAND = 0.004, 0.002  # bar
GROUPS = {"fit_1": "fit", "fit_2": "fit", "validation_1": "validation", "test_1": "test"}
UNCERTAINTIES = {
    "muscle.c10_kpa": 0.10,
    "muscle.friction_slope_n_per_bar": 0.10,
    "tendon.stiffness_1_n_per_mm": 0.10,
    "flexor/tendon.slack_length_mm": 0.01,
    "extensor/tendon.slack_length_mm": 0.01,
    "model.geom.load.mass": 0.05,
    "model.joint.joint.damping": 0.3,
}
"""Relative standard deviations; the true values are within two of them."""
MODEL_VALUES = {"model.geom.load.mass": 1.0, "model.joint.joint.damping": 0.05}


class JointNumbers(NamedTuple):
    """A joint with its devices and the error of their law."""

    joint: JointLaw
    laws: tuple[Any, Any]
    supplies: tuple[Any, Any]
    """Air supply of each device."""


@cache
def load_nominal() -> dict[str, float]:
    """Return the believed numbers of device and model."""
    device = load_device(PRESET_FILE)
    slack = device["tendon.slack_length_mm"]
    return {**device, **{f"{tendon}/tendon.slack_length_mm": slack for tendon in TENDONS}, **MODEL_VALUES}


def build_joint(numbers: Mapping[str, float], effects: Effects) -> JointNumbers:
    """Return the joint with ``numbers`` (those of :data:`UNCERTAINTIES` and of the device file) and ``effects``."""
    laws, supplies = [], []
    for tendon in TENDONS:
        device = {**numbers, "tendon.slack_length_mm": numbers[f"{tendon}/tendon.slack_length_mm"]}
        own = [e for e in effects if _is_of_device(e) and e.get("tendon") in (None, tendon)]
        law, air = add_effects(*build_neutral_law(device), own)
        laws.append(law)
        supplies.append(air)
    joint = build_joint_law(numbers["model.geom.load.mass"], numbers["model.joint.joint.damping"])
    for effect in effects:
        if not _is_of_device(effect):
            joint = _apply_joint_effect(joint, (effect["name"], effect["form"]), effect["parameters"])
    return JointNumbers(JointLaw(*map(float, joint)), (laws[0], laws[1]), (supplies[0], supplies[1]))


def _is_of_device(effect: Mapping[str, Any]) -> bool:
    key = effect["name"], effect["form"]
    return key not in JOINT_EFFECTS and key not in OUT_OF_CATALOGUE_JOINT_FORMS


def build_joint_law(load: float, damping: float) -> JointLaw:
    """Return the joint with a ``load`` [kg] at the end of its lever and ``damping`` [N m s/rad].

    Pulley: a cylinder of 0.1 kg and 25 mm. Lever: a capsule of 0.5 kg, 0.3 m between the middles of its round ends of
    15 mm. Load: a ball of 35 mm at 0.3 m.
    """
    r, length = 0.015, 0.3
    tube_share = length / (length + 4.0 * r / 3.0)
    tube, balls = 0.5 * tube_share, 0.5 * (1.0 - tube_share)
    lever = tube * (length**2 / 12.0 + r * r / 4.0)
    # Two half balls: 83/320 m r^2 about their own middle, which is 3/8 r beyond the end of the tube.
    lever += balls * (83.0 / 320.0 * r * r + (0.5 * length + 0.375 * r) ** 2)
    lever += 0.5 * 0.15**2
    inertia = 0.5 * 0.1 * 0.025**2 + lever + load * (0.4 * 0.035**2 + 0.3**2)
    return JointLaw(
        inertia=inertia,
        weight_moment=GRAVITY * (0.5 * 0.15 + load * 0.3),
        damping=damping,
        radius=0.025,
        origin_x=0.025,
        flexor_height=ORIGIN_HEIGHT,
        extensor_height=ORIGIN_HEIGHT,
        flexor_end_x=-0.01275,
        flexor_end_z=-0.02208,
        extensor_end_x=0.01639,
        extensor_end_z=-0.01953,
    )


def _apply_joint_effect(joint: JointLaw, key: tuple[str, str], p: Mapping[str, float]) -> JointLaw:
    match key:
        case ("joint_friction", "coulomb"):
            return joint._replace(coulomb=p["moment_n_m"])
        case ("joint_friction", "stribeck"):
            speed = radians(p["stribeck_velocity_deg_per_s"])
            joint = joint._replace(bristle_excess=p["static_excess"], bristle_speed=speed)
            return joint._replace(bristle=p["moment_n_m"], bristle_reach=radians(0.1))
        case ("joint_friction", "presliding"):
            return joint._replace(bristle=p["moment_n_m"], bristle_reach=radians(p["presliding_deg"]))
        case ("joint_inertia", "armature"):
            return joint._replace(inertia=joint.inertia + 1e-4 * p["inertia_kg_cm2"])
        case ("pulley_error", "radius"):
            gain = p["gain"]
            ends = {name: gain * getattr(joint, name) for name in JointLaw._fields if "_end_" in name}
            return joint._replace(radius=gain * joint.radius, **ends)
        case ("gravity_tilt", "about_y"):
            return joint._replace(tilt=radians(p["tilt_deg"]))
        case ("eccentric_pulley", "sine"):
            return joint._replace(eccentricity=1e-3 * p["eccentricity_mm"])
        case ("cable_bundle", "quadratic"):
            return joint._replace(elastic=p["moment_n_m"])
    raise ValueError(f"no effect {key[0]!r} with form {key[1]!r}")


def draw_commands(rng: np.random.Generator) -> Floats:
    """Return both pressure commands [Pa] (2, samples): a rest, then steps, ramps and sines of their difference."""
    n = round(DURATION / SAMPLE_INTERVAL) + 1
    t = np.arange(n) * SAMPLE_INTERVAL
    mean, difference = np.empty(n), np.empty(n)
    k, m, d = 0, rng.uniform(1.8, 2.4), rng.uniform(-0.2, 0.4)
    mean[:], difference[:] = m, d
    k = round(REST_DURATION / SAMPLE_INTERVAL)
    kind = int(rng.integers(3))
    while k < n:
        end = min(n, k + int(rng.uniform(0.35, 0.7) / SAMPLE_INTERVAL))
        next_m, next_d = rng.uniform(1.6, 2.8), rng.uniform(-0.4, 0.9)
        part = t[k:end] - t[k]
        share = np.ones(end - k) if kind % 3 == 0 else np.linspace(0.0, 1.0, end - k)
        mean[k:end], difference[k:end] = m + share * (next_m - m), d + share * (next_d - d)
        if kind % 3 == 2:
            difference[k:end] += 0.2 * np.sin(2.0 * np.pi * rng.uniform(1.5, 4.0) * part)
        mean[end:], difference[end:] = next_m, next_d
        k, m, d, kind = end, next_m, next_d, kind + 1
    return 1e5 * np.clip(np.stack([mean + difference, mean - difference]), 0.3, 4.5)


def simulate_channels(
    numbers: JointNumbers,
    commands: Floats,
    wander: Floats | float = 0.0,
    faults: Effects = (),
    errors: tuple[ForceError, ForceError] | None = None,
    steps: int = STEPS_PER_TRACE,
    load_cells: Sequence[str] = (),
) -> dict[str, Floats]:
    """Return the channels on the trace grid in their units, as the instruments report them, with ``load_cells``."""
    n = round((commands.shape[1] - 1) * SAMPLE_INTERVAL / TRACE_STEP) + 1
    n_air = round((n - 1) * TRACE_STEP / AIR_STEP) + 1
    pressures = np.stack(
        [
            np.maximum(simulate_pressure(command, SAMPLE_INTERVAL, n_air, air) + wander, 0.0)
            for command, air in zip(commands, numbers.supplies, strict=True)
        ]
    )
    none = ForceError(1.0, 0.0, np.zeros(0))
    out = integrate_joint(numbers.joint, numbers.laws, numbers.supplies[0], pressures, errors or (none, none), n, steps)
    decimation = round(TRACE_STEP / AIR_STEP)
    channels = {"angle_joint": np.degrees(out[0])} | {
        f"pressure_{tendon}": pressures[k, ::decimation] / 1e5 for k, tendon in enumerate(TENDONS)
    }
    plain = [fault for fault in faults if fault["name"] != "sensor_backlash"]
    channels |= {name: out[1 + TENDONS.index(name.removeprefix("force_"))] for name in load_cells}
    channels = apply_faults(channels, plain)
    for fault in faults:
        if fault["name"] == "sensor_backlash":
            channels[fault["channel"]] = _drag(channels[fault["channel"]], fault["parameters"]["play"])
    return channels


def _drag(values: Floats, play: float) -> Floats:
    """Return what a pointer shows that is dragged with ``play``, from the middle of it."""
    shown, pointer = np.empty_like(values), values[0]
    for k, value in enumerate(values):
        if value - pointer > 0.5 * play:
            pointer = value - 0.5 * play
        elif pointer - value > 0.5 * play:
            pointer = value + 0.5 * play
        shown[k] = pointer
    return shown


def make_dataset(
    folder: Path,
    seed: int,
    *,
    truth: Path,
    effects: Effects = (),
    instruments: Effects = (),
    strangers: Effects = (),
    deleted: bool = False,
    law_error: Mapping[str, Any] | None = None,
    block: str = "joint",
) -> dict[str, Any]:
    """Write the dataset ``folder`` and its ground truth ``truth``; return the ground truth.

    Numbers, inputs and noise depend on ``seed`` only. Effects with a ``wanted`` size are scaled to it. With
    ``law_error`` the law of the muscles is imperfect and the test trials are of another specimen.
    """
    from benchmarks.hidden_effects.joint_sizes import JointEffectSizer

    child = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]
    nominal = load_nominal()
    base = dict(nominal)
    for key, share in UNCERTAINTIES.items():
        base[key] = nominal[key] * (1.0 + share * float(np.clip(child[0].normal(), -2.0, 2.0)))
    commands = {group: _draw_allowed_commands(child[1], base) for group in GROUPS}
    fitted = [commands[group] for group, use in GROUPS.items() if use == "fit"]
    hidden, faults, unknown, size = list(effects), list(instruments), list(strangers), 0.0
    if any("wanted" in effect for effect in (*hidden, *faults, *unknown)):
        sizer = JointEffectSizer(base, nominal, fitted)
        hidden, faults, unknown = ([sizer.scale_effect(e) for e in group] for group in (hidden, faults, unknown))
        size = sizer.measure_size((*hidden, *unknown), faults)
    numbers = build_joint(base, (*hidden, *unknown))
    folder.mkdir(parents=True, exist_ok=True)
    lines = _write_header(law_error is not None)
    for index, (group, use) in enumerate(GROUPS.items()):
        specimen = SEEN_SPECIMENS[index % len(SEEN_SPECIMENS)] if use != "test" else "D"
        errors = make_errors(law_error, specimen)
        for repeat in "ab":
            n_air = round(DURATION / AIR_STEP) + 1
            wander = draw_wander(child[2], n_air, WANDER)
            channels = simulate_channels(numbers, commands[group], wander, faults, errors)
            file = f"{group}_{repeat}.csv"
            (folder / file).write_text(format_table(child[2], commands[group], channels, faults), "utf-8")
            lines += ["", "[[trial]]", f'files = ["{file}"]', f'group = "{group}"', f'use = "{use}"']
            lines += [f'specimen = "{specimen}"'] if law_error is not None else []
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    ground_truth = {
        "seed": seed,
        "block": block,
        **{"effects": hidden, "instruments": faults, "strangers": unknown, "deleted": deleted},
        **{"repeats": 2, "defect": None},
        **({"law_error": dict(law_error)} if law_error is not None else {}),
        "base": {key: base[key] for key in UNCERTAINTIES},
        "nominal": {key: nominal[key] for key in UNCERTAINTIES},
        "size": size,
    }
    truth.write_text(json.dumps(ground_truth, indent=1) + "\n", "utf-8")
    return ground_truth


def _draw_allowed_commands(rng: np.random.Generator, base: Mapping[str, float]) -> Floats:
    """Return commands that keep the joint away from its stops, the difference reduced where necessary."""
    commands = draw_commands(rng)
    for _ in range(8):
        if stays_off_stops(build_joint(base, ()), commands):
            return commands
        mean = commands.mean(axis=0)
        commands = mean + 0.8 * (commands - mean)
    return commands


def stays_off_stops(numbers: JointNumbers, commands: Floats) -> bool:
    """Return whether the joint stays away from its stops, which the equation of motion lacks."""
    angle = np.radians(simulate_channels(numbers, commands)["angle_joint"])
    return bool(angle.min() > MIN_ANGLE and angle.max() < MAX_ANGLE)


def make_errors(law_error: Mapping[str, Any] | None, specimen: str) -> tuple[ForceError, ForceError]:
    """Return the error of the law of both muscles on ``specimen``."""
    coefficients = np.zeros(0) if law_error is None else np.array(law_error["coefficients"])
    if law_error is None:
        return ForceError(1.0, 0.0, coefficients), ForceError(1.0, 0.0, coefficients)
    amplitude = law_error["fraction"] * FORCE_RANGE / float(np.sqrt(0.4 * np.sum(coefficients**2)))
    error = ForceError(law_error["gains"][specimen], amplitude, coefficients)
    return error, error


def _write_header(has_specimens: bool) -> list[str]:
    commands, measured = [f"pressure_command_{tendon}" for tendon in TENDONS], list(JOINT_CHANNELS)
    lines = ['format = "klute-sim-dataset/2"', 'rig = "mjcf"', 'model = "antagonist_joint"']
    lines += [f'device = "{PRESET_FILE.stem}"', f"prescribed = {commands!r}", f"measured = {measured!r}", ""]
    lines += ["[numbers]", *(f'"model.site.{tendon}_origin.pos_z" = {ORIGIN_HEIGHT}' for tendon in TENDONS), ""]
    return [*lines, "[uncertain]", *(f'"{key}" = "{100.0 * share:g} %"' for key, share in UNCERTAINTIES.items())]


def format_table(rng: np.random.Generator, commands: Floats, channels: Mapping[str, Floats], faults: Effects) -> str:
    """Return the text of a trial file: commands and channels with noise, 200 rows per second."""
    n, decimation = commands.shape[1], round(SAMPLE_INTERVAL / TRACE_STEP)
    columns = {"time [s]": [f"{k * SAMPLE_INTERVAL:.3f}" for k in range(n)]}
    for tendon, command in zip(TENDONS, commands, strict=True):
        logged = command / 1e5 + rng.normal(0.0, LOGGED_COMMAND, n)
        columns[f"pressure_command_{tendon} [bar]"] = [f"{value:.5f}" for value in logged]
    for name, values in channels.items():
        channel = (JOINT_CHANNELS | JOINT_LOAD_CELLS)[name]
        noisy = values[::decimation] + draw_coloured_noise(rng, n, channel.noise)
        noisy = quantise(name, noisy, faults)
        columns[f"{name} [{channel.unit}]"] = [f"{value:.5f}" for value in noisy]
    rows = [",".join(row) for row in zip(*columns.values(), strict=True)]
    return "\n".join([",".join(columns), *rows]) + "\n"


def list_forms(effect: Mapping[str, Any], device_forms: Mapping[tuple[str, str], Any]) -> Mapping[str, Any]:
    """Return the parameters of ``effect`` by key."""
    key = effect["name"], effect["form"]
    if "channel" in effect:
        return instrument_forms(effect["channel"])[key]
    return {**device_forms, **JOINT_EFFECTS, **OUT_OF_CATALOGUE_JOINT_FORMS}[key]
