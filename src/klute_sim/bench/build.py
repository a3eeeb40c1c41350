"""MuJoCo model of the tensile tester: ``bench.xml`` with a crosshead on a position servo and a load cell."""

import mujoco
import numpy as np

from klute_sim.device.device import Device
from klute_sim.plant import models
from klute_sim.types import Array

CROSSHEAD_MASS = 400.0
"""Moving mass of the crosshead and its drive [kg] (assumed)."""
SERVO_STIFFNESS = 4.0e7
"""Stiffness of the servo [N/m]: 1 kN moves the crosshead by 25 um (assumed: a stiff floor-standing tester)."""
SERVO_DAMPING = 2.0 * (CROSSHEAD_MASS * SERVO_STIFFNESS) ** 0.5
"""Damping of the servo [N s/m], critical."""


def build_tester(device: Device, dt: float) -> mujoco.MjModel:
    """Return the model of the tester with ``device`` in it and a time step of ``dt`` [s]."""
    spec = models.load_spec("bench")
    spec.option.timestep = dt
    crosshead = spec.body("crosshead")
    crosshead.geoms[0].mass = CROSSHEAD_MASS
    servo = spec.add_actuator(name="servo", target="crosshead", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_position(kp=SERVO_STIFFNESS, kv=SERVO_DAMPING)
    spec.add_sensor(
        name="load_cell",
        type=mujoco.mjtSensor.mjSENS_FORCE,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname="load_cell",
    )
    return models.attach_devices(spec, {"muscle_tendon": device.parameters})


def compute_servo_commands(length: Array, dt: float) -> Array:
    """Return the position commands [m] with which the servo reaches ``length`` [m] after each time step ``dt`` [s].

    Velocity and acceleration are fed forward.
    """
    speed = np.gradient(length, dt)
    return np.asarray(length + (SERVO_DAMPING * speed + CROSSHEAD_MASS * np.gradient(speed, dt)) / SERVO_STIFFNESS)


def place_crosshead(data: mujoco.MjData, length: float, speed: float, load: float) -> None:
    """Set the crosshead to ``length`` [m] and ``speed`` [m/s], deflected so that its servo carries ``load`` [N]."""
    data.joint("crosshead").qpos[0] = length - load / SERVO_STIFFNESS
    data.joint("crosshead").qvel[0] = speed
