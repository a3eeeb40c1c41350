"""Drives that impose prescribed motion, and motors that apply prescribed loads, at joints of a model.

A driven joint gets a large inertia and a stiff position servo with velocity and acceleration fed forward, as the
crosshead of a tensile tester has. Its motion is therefore independent of the load (the large mass method for prescribed
motion; Clough & Penzien, Dynamics of Structures), and motion of a base is a driven joint of that base.
"""

import mujoco
import numpy as np

from klute_sim.types import Array

DRIVE_INERTIA = 1.0e5
"""Inertia that a drive adds to its joint [kg or kg m2] (assumed: four orders above that of the bodies on a jig)."""
DRIVE_FREQUENCY = 2.0 * np.pi * 20.0
"""Natural frequency of the critically damped servo [rad/s]. A load of 1 kN, or 1 kN m, moves it by 0.6 um, or urad."""
DRIVE_STIFFNESS = DRIVE_INERTIA * DRIVE_FREQUENCY**2
"""Stiffness of the servo [N/m or N m/rad]."""
DRIVE_DAMPING = 2.0 * DRIVE_INERTIA * DRIVE_FREQUENCY
"""Damping of the servo [N s/m or N m s/rad], critical."""


def name_drive(joint: str) -> str:
    """Return the name of the actuator that drives ``joint``."""
    return f"{joint} drive"


def name_load(joint: str) -> str:
    """Return the name of the actuator that loads ``joint``."""
    return f"{joint} load"


def add_drive(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> None:
    """Let a servo impose the motion of ``joint``; its range no longer limits it."""
    joint.armature = DRIVE_INERTIA
    joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    actuator = spec.add_actuator(name=name_drive(joint.name), target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=DRIVE_STIFFNESS, kv=DRIVE_DAMPING)


def add_load(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> None:
    """Let a motor apply a prescribed force or moment to ``joint``."""
    actuator = spec.add_actuator(name=name_load(joint.name), target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_motor()


def compute_effective_inertia(dt: float, integrator: int) -> float:
    """Return the inertia [kg or kg m2] that a drive accelerates in a step ``dt`` [s].

    The implicit integrators add ``dt`` times the damping.
    """
    is_implicit = integrator != mujoco.mjtIntegrator.mjINT_EULER
    return DRIVE_INERTIA + (dt * DRIVE_DAMPING if is_implicit else 0.0)


def compute_drive_commands(position: Array, dt: float, integrator: int) -> Array:
    """Return the commands of a servo that leads its joint through ``position`` [m or rad], one per step ``dt`` [s].

    MuJoCo's step is ``v+ = v + dt a``, ``q+ = q + dt v+``, so the acceleration that leads from sample k to k + 1 is the
    second difference there.
    """
    following = np.append(position[1:], 2.0 * position[-1] - position[-2])
    previous = np.insert(position[:-1], 0, 2.0 * position[0] - position[1])
    speed, acceleration = (position - previous) / dt, (following - 2.0 * position + previous) / dt**2
    inertia = compute_effective_inertia(dt, integrator)
    return np.asarray(position + (DRIVE_DAMPING * speed + inertia * acceleration) / DRIVE_STIFFNESS)


def compute_initial_speed(position: Array, dt: float) -> float:
    """Return the speed [m/s or rad/s] before the first step with which :func:`compute_drive_commands` begins."""
    return float((position[1] - position[0]) / dt)
