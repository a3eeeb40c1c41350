"""The gait rig's model, scaled to a subject and cut to a device."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from klute_sim.device import effects_file
from klute_sim.device.files import Device, preset_names
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.plant import models
from klute_sim.recording.recording import Samples
from klute_sim.rigs.gait.body import ANKLE, into, read
from klute_sim.rigs.gait.motion import Leg
from klute_sim.rigs.gait.reference import GRAVITY
from klute_sim.rigs.gait.spring_foot import SpringFoot, without_pull

MODEL_MASS = 75.0
"""Body mass of the model as it is in the file [kg]."""
MODEL_STATURE = 1.75
"""Stature of the model as it is in the file [m]."""

Edit = Callable[[mujoco.MjSpec], None]
"""Changes a model before it is compiled."""


def build(
    device: Device,
    *,
    mass: float,
    stature: float,
    step: float,
    slope: float = 0.0,
    foot: SpringFoot | None = None,
    edit: Edit | None = None,
) -> mujoco.MjModel:
    """Model of a subject of ``mass`` [kg] and ``stature`` [m] wearing ``device``; ``step`` [s].

    Ground that rises by ``slope`` [rad] stays level in the model, and gravity leans instead.
    A ``foot`` takes the place of the device and of the prosthesis' return spring. An ``edit`` has the last word.
    Limb lengths and the foot scale with stature, limb masses with body mass; the carriage carries the rest.
    The device and the prosthesis' mass stay what they are. The Achilles origin is moved up or down the pylon
    so that the muscle has its mounting length at a neutral ankle.
    """
    spec = models.spec("gait_rig")
    spec.option.timestep = step
    if slope != 0.0:
        spec.option.gravity = GRAVITY * np.array([-np.sin(slope), 0.0, -np.cos(slope)])
    scale = stature / MODEL_STATURE
    _scale_limbs(spec, scale, mass)
    spec.site(ANKLE + "achilles_origin").pos = _origin(device, spec, scale)
    parameters = device.parameters
    if foot is not None:
        foot.into(spec.joint(ANKLE + "ankle"))
        parameters = without_pull(parameters)
    _put_in_effects(spec, device)
    if edit is not None:
        edit(spec)
    return models.equip(spec, {ANKLE + "muscle_tendon": parameters})


def _scale_limbs(spec: mujoco.MjSpec, scale: float, mass: float) -> None:
    carried = 0.0
    for body in spec.bodies:
        name = body.name
        if name in ("thigh", "residual_limb"):
            body.mass *= mass / MODEL_MASS
            body.inertia = np.asarray(body.inertia) * (mass / MODEL_MASS) * scale * scale
            body.ipos = np.asarray(body.ipos) * scale
        if name == "residual_limb":
            body.pos = np.asarray(body.pos) * scale
        if name not in ("world", "carriage"):
            carried += float(body.mass)
    spec.body("carriage").mass = mass - carried
    frame = spec.frame("socket_end")
    frame.pos = np.asarray(frame.pos) * scale
    for geom in spec.geoms:
        if geom.classname.name == ANKLE + "sole":
            geom.pos = np.asarray(geom.pos) * scale
            geom.size = np.asarray(geom.size) * scale


def _origin(device: Device, spec: mujoco.MjSpec, scale: float) -> Samples:
    if device.spec.tendon is None or device.spec.mounting is None:
        missing = "[tendon]" if device.spec.tendon is None else "[mounting]"
        pair = f"{device.name}-pair"
        mend = f"; did you mean '{pair}'?" if pair in preset_names() else ""
        raise InputError(
            f"device '{device.name}' cannot be built into an ankle: its file has no {missing} section{mend}"
        )
    ratio = device.spec.mounting.neutral_muscle_ratio
    length = ratio * device.parameters.muscle.resting_length + device.parameters.tendon.slack_length
    room = -float(spec.frame("socket_end").pos[2])
    if length > room:
        raise InputError(
            f"device '{device.name}' is {1e3 * length:.0f} mm long at a neutral ankle, but the shank has room for "
            f"{1e3 * room:.0f} mm"
        )
    origin = np.array(spec.site(ANKLE + "achilles_origin").pos, dtype=np.float64)
    insertion = np.asarray(spec.site(ANKLE + "achilles_insertion").pos, dtype=np.float64)
    across = np.hypot(origin[0] - insertion[0], origin[1] - insertion[1])
    origin[2] = insertion[2] + np.sqrt(length * length - across * across)
    return origin


def _put_in_effects(spec: mujoco.MjSpec, device: Device) -> None:
    """What the device file says of the body, at the models' own stature and mass: those of the prosthesis."""
    if any(catalogue.effects()[name].kind == "body" for name in device.spec.effects):
        was = read(models.equip(spec.copy(), {ANKLE + "muscle_tendon": device.parameters}))
        into(spec, was, effects_file.edited(device.spec.effects, was))


def leg(model: mujoco.MjModel) -> Leg:
    """Lengths and sole of a built model."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    hip, knee = data.body("thigh").xpos[2], data.body("residual_limb").xpos[2]
    ankle: Any = data.body(ANKLE + "foot").xpos.copy()
    sole = [
        (*(data.geom_xpos[g] - ankle)[[0, 2]], model.geom_size[g, 0])
        for g in range(model.ngeom)
        if model.geom_contype[g] == 1
    ]
    return Leg(float(hip - knee), float(knee - ankle[2]), np.array(sole), float(hip - ankle[2]) / 0.86)
