"""Bench test of a foot in simulation: press heel or forefoot against a plate, and measure stiffness and loss.

The foot is tilted against the plate by a fixed angle, heel down by 15 degrees or toe down by 20 (ISO 10328), and the
ankle is held. The load rises and falls as a cosine. Stiffness is the range of the load over that of the deflection;
loss is the area of the loop over the area under the loading curve, both above the smallest load. The smallest load is
not zero, because the contact itself closes under it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import mujoco
import numpy as np

from klute_sim.device.device import DEFAULT_DEVICE, Device, load_device
from klute_sim.errors import InputError
from klute_sim.gait.body import BUMPER_TENDON, PROSTHESIS_PREFIX
from klute_sim.gait.foot_section import (
    FOREFOOT_TEST_ANGLE,
    HEEL_CYCLE_TIME,
    HEEL_TEST_ANGLE,
    KEEL_CYCLE_TIME,
    get_keel_lever,
)
from klute_sim.gait.rig.build import MODEL_MASS, MODEL_STATURE, build_gait_model
from klute_sim.types import Array

TIME_STEP = 2.5e-4
"""Time step of a test [s]."""
N_CYCLES = 3
"""Number of loading cycles; the last one is measured."""
MIN_LOAD_FRACTION = 0.2
"""Smallest load over the largest one [1]."""
MAX_LOAD = 300.0
"""Largest load [N] (assumed: two thirds of the weight of 75 kg; far below the limits of a foot)."""
FIXTURE_MASS = 1e-2
"""Mass of the parts that move with the foot [kg], so that their inertia does not add to the load."""


class LoadingTest(NamedTuple):
    """Angle and duration of a test."""

    angle: float
    """Tilt of the foot against the plate [rad], plantarflexion positive."""
    cycle_time: float
    """Duration of a loading cycle [s]."""


TESTS: Mapping[str, LoadingTest] = MappingProxyType(
    {
        "heel": LoadingTest(HEEL_TEST_ANGLE, HEEL_CYCLE_TIME),
        "forefoot": LoadingTest(FOREFOOT_TEST_ANGLE, KEEL_CYCLE_TIME),
    }
)
"""Part of the foot -> its test."""


@dataclass(frozen=True)
class FootTestResult:
    """Last loading cycle of a test."""

    load: Array
    """(n,) force of the plate [N]."""
    deflection: Array
    """(n,) approach of ankle and plate [m]."""
    lever: Array
    """(n,) distance of the load from the axis of the ankle [m]."""
    stiffness: float
    """Range of the load over that of the deflection [N/m]; that of the forefoot at the keel lever of the foot."""
    loss: float
    """Share of energy lost in the cycle [1]."""


def press_foot(
    device: Device, part: str, *, max_load: float = MAX_LOAD, cycle_time: float | None = None
) -> FootTestResult:
    """Press ``part`` of the foot of ``device``, ``"heel"`` or ``"forefoot"``, against a plate up to ``max_load`` [N].

    ``cycle_time`` [s] is the duration of a cycle; None: that of :data:`TESTS`.

    Raises InputError when the part is unknown, the keel is rigid, or the device does not fit into the prosthesis.
    """
    if part not in TESTS:
        raise InputError(f"part of the foot is '{part}'; allowed: {', '.join(TESTS)}")
    section = device.spec.foot
    if part == "forefoot" and (section is None or section.get_forefoot() is None):
        raise InputError(f"the keel of device '{device.name}' is rigid; allowed: a [foot] with a forefoot stiffness")
    if device.spec.muscle is None:
        # The ankle is held, so that any muscle does.
        holder = load_device(DEFAULT_DEVICE)
        parts = {"foot": section, "effects": device.spec.effects}
        device = holder.with_spec(holder.spec.model_copy(update=parts))
    test = TESTS[part]
    period = test.cycle_time if cycle_time is None else cycle_time
    model = build_gait_model(
        device, mass=MODEL_MASS, stature=MODEL_STATURE, dt=TIME_STEP, alignment=-test.angle, model_edit=_hold_rig
    )
    data, height = mujoco.MjData(model), int(model.joint("carriage_z").qposadr[0])
    ground = int(model.sensor("ground").adr[0]) + 2
    mujoco.mj_kinematics(model, data)
    lowest = min(_lowest_point(model, data, g) for g in range(model.ngeom) if model.geom_contype[g] == 1)
    data.qpos[height] = -lowest
    n_steps = round(period / TIME_STEP)
    wave = 0.5 * (1.0 - np.cos(2.0 * np.pi * np.arange(n_steps) / n_steps))
    commands = max_load * (MIN_LOAD_FRACTION + (1.0 - MIN_LOAD_FRACTION) * wave)
    samples = np.empty((n_steps, 3))
    for k in range(N_CYCLES * n_steps):
        data.qfrc_applied[model.joint("carriage_z").dofadr[0]] = -commands[k % n_steps]
        mujoco.mj_step(model, data)
        samples[k % n_steps] = data.sensordata[ground], -data.qpos[height], _find_lever(model, data)
    load, deflection = samples[:, 0], samples[:, 1] - samples[0, 1]
    stiffness = float(np.ptp(load) / np.ptp(deflection))
    if part == "forefoot" and section is not None:
        stiffness *= (float(np.average(samples[:, 2], weights=load)) / get_keel_lever(section)) ** 2
    return FootTestResult(load, deflection, samples[:, 2], stiffness, compute_loss(load, deflection))


def compute_loss(load: Array, deflection: Array) -> float:
    """Return the share of energy lost in a periodic cycle of ``load`` [N] over ``deflection`` [m], (n,) each."""
    above = load - load.min()
    steps = 0.5 * (above + np.roll(above, -1)) * (np.roll(deflection, -1) - deflection)
    return float(steps.sum() / steps[steps > 0.0].sum())


def _hold_rig(spec: mujoco.MjSpec) -> None:
    """Remove all joints of the rig but that of the vertical carriage, and the ankle."""
    spec.option.gravity = np.zeros(3)
    held_joints = {"carriage_x", "thigh", "knee", "liner", PROSTHESIS_PREFIX + "ankle"}
    for actuator in list(spec.actuators):
        if actuator.target in held_joints | {"carriage_z"}:
            spec.delete(actuator)
    for element in [*spec.sensors, *spec.tendons]:
        if element.name in (PROSTHESIS_PREFIX + "ankle_stop", BUMPER_TENDON):
            spec.delete(element)
    for name in held_joints:
        spec.delete(spec.joint(name))
    for name in ("carriage", "thigh", "residual_limb", "socket", PROSTHESIS_PREFIX + "pylon"):
        body = spec.body(name)
        body.inertia = np.asarray(body.inertia) * (FIXTURE_MASS / float(body.mass))
        body.mass = FIXTURE_MASS
    for geom in spec.geoms:
        geom.friction = np.array([1e-5, 0.0, 0.0])  # a plate on rollers


def _lowest_point(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """Return the height of the lowest point of a sphere or an ellipsoid [m]."""
    down = data.geom_xmat[geom].reshape(3, 3)[2]
    size = model.geom_size[geom]
    is_sphere = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE
    return float(data.geom_xpos[geom][2] - (size[0] if is_sphere else math.sqrt(float(np.sum((size * down) ** 2)))))


def _find_lever(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the distance of the contact from the axis of the ankle along the plate [m]; 0 without a contact."""
    if data.ncon == 0:
        return 0.0
    ankle = data.body(PROSTHESIS_PREFIX + "foot").xpos
    return abs(float(data.contact[0].pos[0] - ankle[0]))
