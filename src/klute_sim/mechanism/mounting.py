"""Mount devices on the mechanisms of the package: the frame moves until every muscle has its neutral length."""

from collections.abc import Mapping

import mujoco
import numpy as np

from klute_sim.device.device import Device
from klute_sim.laws.mckibben import lock_length
from klute_sim.plant.callbacks import compile_model
from klute_sim.plant.mjcf.model_file import ModelFile
from klute_sim.plant.mjcf.model_numbers import collect_model_numbers, set_model_numbers

NEUTRAL_MUSCLE_RATIO = 0.88
"""Muscle length over resting length in the middle of the joint's range (assumed: between rest and full contraction)."""
MAX_ITERATIONS = 20
"""Largest number of corrections of an origin; the flexor of the knee needs four."""
LENGTH_TOLERANCE = 1e-9
"""Error of a unit length [m] up to which a device is mounted."""
ORIGIN_NUMBERS = {
    "antagonist_joint": ("pos_z", 1.0),
    "hanging_mass": ("pos_z", 1.0),
    "knee_jig": ("pos_x", -1.0),
}
"""Model -> coordinate of the origins ``<tendon>_origin``, and its sign where the tendon becomes longer."""


def mount_devices(file: ModelFile, devices: Mapping[str, Device]) -> dict[str, float]:
    """Return the numbers of the model ``file`` (name -> value) that fit ``devices`` (tendon -> device).

    In the middle of the range of all joints each muscle has :data:`NEUTRAL_MUSCLE_RATIO` of its resting length with its
    tendon just taut. A model that is not of the package stays as it is: the result is empty.
    """
    if file.name not in ORIGIN_NUMBERS:
        return {}
    coordinate, sign = ORIGIN_NUMBERS[file.name]
    known = collect_model_numbers(file.make_spec())
    keys = {tendon: f"model.site.{tendon}_origin.{coordinate}" for tendon in devices}
    numbers = {key: known[key] for key in keys.values()}
    targets = {tendon: _compute_neutral_length(device) for tendon, device in devices.items()}
    for _ in range(MAX_ITERATIONS):
        lengths = _measure_lengths(file, numbers)
        errors = {tendon: target - lengths[tendon] for tendon, target in targets.items()}
        if max(map(abs, errors.values())) < LENGTH_TOLERANCE:
            break
        for tendon, error in errors.items():
            numbers[keys[tendon]] += sign * error
    return numbers


def _compute_neutral_length(device: Device) -> float:
    muscle, tendon = device.parameters.muscle, device.parameters.tendon
    if muscle.resting_length == 0.0:  # a tendon alone
        return tendon.slack_length
    shortest = lock_length(muscle) / muscle.resting_length
    return tendon.slack_length + max(NEUTRAL_MUSCLE_RATIO, 0.5 * (shortest + 1.0)) * muscle.resting_length


def _measure_lengths(file: ModelFile, numbers: Mapping[str, float]) -> dict[str, float]:
    """Return the length of every tendon [m] in the middle of the range of all joints."""
    spec = file.make_spec()
    set_model_numbers(spec, numbers)
    model = compile_model(spec)
    data = mujoco.MjData(model)
    data.qpos[:] = np.where(model.jnt_limited, model.jnt_range.mean(axis=1), data.qpos)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_tendon(model, data)
    return {model.tendon(index).name: float(data.ten_length[index]) for index in range(model.ntendon)}
