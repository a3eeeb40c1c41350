"""Build the model of the gait rig for a subject and a device."""

import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.device.device import Device, list_presets
from klute_sim.device.schema import effects
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.gait.body import PROSTHESIS_PREFIX, apply_foot, read_foot
from klute_sim.gait.foot_section import apply_heel, bend_keel
from klute_sim.gait.rig.trajectory import LegGeometry
from klute_sim.gait.spring_foot import SpringFoot, disable_tendon
from klute_sim.plant import models
from klute_sim.types import Array

MODEL_MASS = 75.0
"""Body mass of the model in the MJCF file [kg]."""
MODEL_STATURE = 1.75
"""Stature of the model in the MJCF file [m]."""

ModelEdit = Callable[[mujoco.MjSpec], None]
"""Function that changes a model before it is compiled."""


def build_gait_model(
    device: Device,
    *,
    mass: float,
    stature: float,
    dt: float,
    slope: float = 0.0,
    alignment: float = 0.0,
    spring_foot: SpringFoot | None = None,
    model_edit: ModelEdit | None = None,
) -> mujoco.MjModel:
    """Return the model of a subject of ``mass`` [kg] and ``stature`` [m] with ``device``; time step ``dt`` [s].

    ``alignment`` [rad] turns the prosthesis about its ankle axis against the limb, dorsiflexion positive, as a
    prosthetist does at the socket. Ground with a ``slope`` [rad] stays level in the model; gravity is inclined instead.
    A ``spring_foot`` replaces the device and the return spring of the prosthesis. ``model_edit`` is applied last. The
    lengths of the limbs and the foot scale with stature, the masses of the limbs with body mass; the carriage holds the
    rest of the mass. The device and the mass of the prosthesis do not scale. The Achilles origin moves along the pylon
    until the muscle has its mounting length at a neutral ankle.

    Raises InputError when the device does not fit into the prosthesis.
    """
    spec = models.load_spec("gait_rig")
    spec.geom("floor").pos = np.zeros(3)  # it is lower in the file, which stands by itself in MuJoCo's viewer
    spec.option.timestep = dt
    if slope != 0.0:
        spec.option.gravity = GRAVITY * np.array([-np.sin(slope), 0.0, -np.cos(slope)])
    scale = stature / MODEL_STATURE
    _scale_limbs(spec, scale, mass)
    spec.frame("socket_end").quat = np.array([math.cos(0.5 * alignment), 0.0, -math.sin(0.5 * alignment), 0.0])
    place_achilles_origin(spec, device, scale)
    parameters = device.parameters
    if spring_foot is not None:
        spring_foot.apply_to_joint(spec.joint(PROSTHESIS_PREFIX + "ankle"))
        parameters = disable_tendon(parameters)
    apply_device_foot(spec, device)
    if model_edit is not None:
        model_edit(spec)
    return models.attach_devices(spec, {PROSTHESIS_PREFIX + "muscle_tendon": parameters})


def _scale_limbs(spec: mujoco.MjSpec, scale: float, mass: float) -> None:
    limb_mass = 0.0
    for body in spec.bodies:
        name = body.name
        if name in ("thigh", "residual_limb", "socket"):
            body.mass *= mass / MODEL_MASS
            body.inertia = np.asarray(body.inertia) * (mass / MODEL_MASS) * scale * scale
            body.ipos = np.asarray(body.ipos) * scale
        if name == "residual_limb":
            body.pos = np.asarray(body.pos) * scale
        if name not in ("world", "carriage"):
            limb_mass += float(body.mass)
    spec.body("carriage").mass = mass - limb_mass
    frame = spec.frame("socket_end")
    frame.pos = np.asarray(frame.pos) * scale
    foot_classes = {PROSTHESIS_PREFIX + name for name in ("sole", "carbon", "rubber")}
    for geom in spec.geoms:
        if geom.classname.name in foot_classes and geom.parent.name != PROSTHESIS_PREFIX + "pylon":
            geom.pos = np.asarray(geom.pos) * scale
            geom.size = np.asarray(geom.size) * scale
        elif geom.classname.name == "limb":  # a shape to look at
            geom.pos, geom.fromto = np.asarray(geom.pos) * scale, np.asarray(geom.fromto) * scale


def place_achilles_origin(spec: mujoco.MjSpec, device: Device, scale: float) -> None:
    """Move the Achilles origin of ``spec``, and the clevis that is drawn there, to where ``device`` fits.

    Raises InputError as :func:`compute_achilles_origin` does.
    """
    origin = compute_achilles_origin(device, spec, scale)
    spec.site(PROSTHESIS_PREFIX + "achilles_origin").pos = origin
    spec.frame(PROSTHESIS_PREFIX + "clevis").pos = origin


def compute_achilles_origin(device: Device, spec: mujoco.MjSpec, scale: float) -> Array:
    """Return the origin (3,) of the Achilles tendon on the pylon [m] at which the device has its mounting length.

    Raises InputError when the device file has no tendon or mounting, or the device is longer than the shank.
    """
    if device.spec.tendon is None or device.spec.mounting is None:
        missing = "[tendon]" if device.spec.tendon is None else "[mounting]"
        pair = f"{device.name}-pair"
        hint = f"; did you mean '{pair}'?" if pair in list_presets() else ""
        raise InputError(
            f"device '{device.name}' cannot be built into an ankle: its file has no {missing} section{hint}"
        )
    ratio = device.spec.mounting.neutral_muscle_ratio
    length = ratio * device.parameters.muscle.resting_length + device.parameters.tendon.slack_length
    available = -float(spec.frame("socket_end").pos[2])
    if length > available:
        raise InputError(
            f"device '{device.name}' is {1e3 * length:.0f} mm long at a neutral ankle, but the shank has only "
            f"{1e3 * available:.0f} mm"
        )
    origin = np.array(spec.site(PROSTHESIS_PREFIX + "achilles_origin").pos, dtype=np.float64)
    insertion = np.asarray(spec.site(PROSTHESIS_PREFIX + "achilles_insertion").pos, dtype=np.float64)
    horizontal_distance = np.hypot(origin[0] - insertion[0], origin[1] - insertion[1])
    origin[2] = insertion[2] + np.sqrt(length * length - horizontal_distance * horizontal_distance)
    return origin


def apply_device_foot(spec: mujoco.MjSpec, device: Device) -> None:
    """Apply the foot and, on top of it, the body effects of the device file.

    Their numbers belong to the stature and mass of the MJCF file.
    """
    section = device.spec.foot if device.spec.foot is not None and not device.spec.foot.is_rigid else None
    if section is None and not any(catalogue.get_effects()[name].kind == "body" for name in device.spec.effects):
        return
    model = models.attach_devices(spec.copy(), {PROSTHESIS_PREFIX + "muscle_tendon": device.parameters})
    original = read_foot(model)
    foot = original
    if section is not None:
        apply_heel(spec, section)
        foot = bend_keel(section, foot)
    apply_foot(spec, original, effects.apply_body_effects(device.spec.effects, foot))


def get_alignment(device: Device) -> float | None:
    """Return the alignment [rad] in the file of ``device``; None: the file has none."""
    mounting = device.spec.mounting
    return None if mounting is None or mounting.alignment_deg is None else math.radians(mounting.alignment_deg)


def get_half_lengths(model: mujoco.MjModel, geom_id: int) -> Array:
    """Return the half lengths (3,) of a sphere or an ellipsoid [m]."""
    is_sphere = model.geom_type[geom_id] == mujoco.mjtGeom.mjGEOM_SPHERE
    return np.full(3, model.geom_size[geom_id, 0]) if is_sphere else np.array(model.geom_size[geom_id])


def measure_leg(model: mujoco.MjModel) -> LegGeometry:
    """Return the lengths and the sole of a built model."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    hip, knee = data.body("thigh").xpos[2], data.body("residual_limb").xpos[2]
    foot: Any = data.body(PROSTHESIS_PREFIX + "foot")
    ankle, axes = foot.xpos.copy(), foot.xmat.reshape(3, 3)
    sole = [
        (*((data.geom_xpos[g] - ankle) @ axes)[[0, 2]], *get_half_lengths(model, g)[[0, 2]])
        for g in range(model.ngeom)
        if model.geom_contype[g] == 1
    ]
    return LegGeometry(float(hip - knee), float(knee - ankle[2]), np.array(sole), float(hip - ankle[2]) / 0.86)
