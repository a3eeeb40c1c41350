"""Effects of a mechanism in its MJCF: numbers of joints, pulleys and gravity, and the friction of a bristle."""

from collections.abc import Iterable
from typing import NamedTuple

import mujoco
import numpy as np

from klute_sim.effects import catalogue
from klute_sim.errors import InputError, suggest
from klute_sim.laws.joint import NO_BRISTLE, BristleFriction, Joint, Resistance
from klute_sim.plant.joint_friction import (
    FRICTION_LAYOUT_ID,
    FRICTION_ROW_SIZE,
    N_FRICTION_STATES,
    pack_friction,
    unpack_friction,
)
from klute_sim.plant.mjcf.pulleys import is_pulley, set_radius

FRICTION_SOLREF, FRICTION_SOLIMP = (0.004, 1.0), (0.99, 0.999, 0.001, 0.5, 2.0)
"""MuJoCo's solref and solimp of dry friction: as stiff as a time step of 2 ms allows, because the soft default creeps.
"""
JOINT_TYPES = {"hinge joint": mujoco.mjtJoint.mjJNT_HINGE, "slide joint": mujoco.mjtJoint.mjJNT_SLIDE}
"""Kind of a part -> type of joint."""


class ModelEffect(NamedTuple):
    """A form of an effect of a mechanism."""

    effect: str
    """Name of the effect in the catalogue."""
    form: str
    """Name of the form."""
    parameters: tuple[tuple[str, float], ...]
    """Key and value of each parameter, in the unit of the key."""
    part: str | None = None
    """Name of the joint or pulley that has the effect; None for the rig."""


def list_parts(spec: mujoco.MjSpec) -> dict[str, tuple[str, ...]]:
    """Return kind of part -> names of the parts of ``spec`` that may have effects; the rig has no name."""
    parts = {
        kind: tuple(joint.name for joint in spec.joints if joint.type == joint_type and joint.name)
        for kind, joint_type in JOINT_TYPES.items()
    }
    pulleys = {wrap.target.name: None for tendon in spec.tendons for wrap in tendon.path if is_pulley(wrap)}
    return {**parts, "pulley": tuple(filter(None, pulleys)), "rig": ("",)}


def apply_model_effects(spec: mujoco.MjSpec, effects: Iterable[ModelEffect]) -> None:
    """Edit ``spec`` so that it has ``effects``, in their order; neutral parameters change nothing.

    Raises InputError for an effect without a law for models, or a part that the model does not have.
    """
    for name, form_name, parameters, part in effects:
        effect, form = catalogue.find_form(name, form_name)
        hooks = [hook for hook in ("joint", "pulley", "gravity") if hook in form.laws]
        if not hooks:
            raise InputError(f"effect '{name}' is none of joints, pulleys or gravity of a mechanism")
        known = list_parts(spec)[effect.part]
        if (part or "") not in known:
            listing = f"there are: {', '.join(known) or 'none'}"
            raise InputError(f"'{part}' is no {effect.part} of the model; {suggest(str(part), known, listing)}")
        neutral = {p.key: p.neutral for p in form.parameters if p.neutral is not None and effect.data_driven}
        p, law = form.pack(neutral | dict(parameters)), form.laws[hooks[0]]
        if hooks[0] == "joint":
            joint = spec.joint(part)
            before = read_joint(spec, joint)
            _write_joint(spec, joint, before, law(p, before))
        elif hooks[0] == "pulley":
            pulley = spec.geom(part)
            radius = float(pulley.size[0])
            set_radius(spec, pulley, radius, law(p, radius))
        else:
            gravity = tuple(float(value) for value in spec.option.gravity)
            spec.option.gravity = law(p, gravity)


def read_joint(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> Joint:
    """Return the numbers of ``joint`` in ``spec``."""
    friction, constant, *bristles = list_resistance_actuators(joint.name)
    actuator = spec.actuator(constant)
    stiffness, damping = (np.asarray(values, dtype=np.float64) for values in (joint.stiffness, joint.damping))
    return Joint(
        float(damping[0]),
        float(joint.frictionloss),
        float(joint.armature),
        _read_bristle(spec, friction),
        Resistance(
            0.0 if actuator is None else -float(actuator.biasprm[0]),
            (float(stiffness[0]), float(stiffness[1]), float(stiffness[2])),
            float(damping[1]),
            (_read_bristle(spec, bristles[0]), _read_bristle(spec, bristles[1])),
        ),
    )


def _read_bristle(spec: mujoco.MjSpec, name: str) -> BristleFriction:
    """Return the friction of the actuator ``name``."""
    actuator = spec.actuator(name)
    row = [] if actuator is None else [float(value) for value in actuator.userdata]
    has_bristle = len(row) >= FRICTION_ROW_SIZE and row[0] == FRICTION_LAYOUT_ID
    return unpack_friction(row) if has_bristle else NO_BRISTLE


def list_resistance_actuators(joint: str) -> tuple[str, str, str, str]:
    """Return the names of the actuators that effects add to ``joint``.

    They have its friction, and the constant and the two frictions of a data-driven term.
    """
    return f"{joint} friction", f"{joint} constant", f"{joint} friction 1", f"{joint} friction 2"


def _write_joint(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, before: Joint, after: Joint) -> None:
    """Change the numbers of ``joint`` that differ."""
    friction, constant, *bristles = list_resistance_actuators(joint.name)
    old, new = before.resistance, after.resistance
    if (after.damping, new.quadratic_damping) != (before.damping, old.quadratic_damping):
        damping = np.array(joint.damping, dtype=np.float64)
        damping[:2] = after.damping, new.quadratic_damping
        joint.damping = damping
    if new.stiffness != old.stiffness:
        joint.stiffness = np.array(new.stiffness)
    if new.constant != old.constant:
        actuator = _find_actuator(spec, joint, constant)
        actuator.biastype, actuator.biasprm[0] = mujoco.mjtBias.mjBIAS_AFFINE, -new.constant
    for name, bristle_before, bristle in zip(bristles, old.bristles, new.bristles, strict=True):
        _write_bristle(spec, joint, name, bristle_before, bristle)
    if after.friction_moment != before.friction_moment:
        joint.frictionloss = after.friction_moment
        joint.solref_friction, joint.solimp_friction = FRICTION_SOLREF, FRICTION_SOLIMP
    if after.armature != before.armature:
        joint.armature = after.armature
    _write_bristle(spec, joint, friction, before.bristle, after.bristle)


def _write_bristle(
    spec: mujoco.MjSpec, joint: mujoco.MjsJoint, name: str, before: BristleFriction, after: BristleFriction
) -> None:
    """Give the actuator ``name`` at ``joint`` the friction ``after``, if it differs."""
    if after != before and after.sliding_moment > 0.0:
        actuator = _find_actuator(spec, joint, name)
        actuator.dyntype, actuator.biastype = mujoco.mjtDyn.mjDYN_USER, mujoco.mjtBias.mjBIAS_USER
        actuator.actdim, actuator.userdata = N_FRICTION_STATES, pack_friction(after)


def _find_actuator(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, name: str) -> mujoco.MjsActuator:
    """Return the actuator ``name`` at ``joint``, whose control has no influence; it is added where it is missing."""
    actuator = spec.actuator(name) or spec.add_actuator(name=name)
    actuator.target, actuator.trntype = joint.name, mujoco.mjtTrn.mjTRN_JOINT
    actuator.gaintype, actuator.gainprm[0] = mujoco.mjtGain.mjGAIN_FIXED, 0.0
    return actuator
