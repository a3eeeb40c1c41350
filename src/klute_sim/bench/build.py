"""The tester as a MuJoCo model: ``bench.xml`` with a crosshead on a servo and a load cell that measures."""

import mujoco
import numpy as np

from klute_sim.device.device import Device
from klute_sim.plant import models
from klute_sim.recording.recording import Array

CROSSHEAD_MASS = 400.0
"""Moving mass of the crosshead and its drive [kg] (assumed)."""
SERVO_STIFFNESS = 4.0e7
"""Of the servo [N/m]: 1 kN moves the crosshead by 25 um (assumed: a stiff floor-standing tester)."""
SERVO_DAMPING = 2.0 * (CROSSHEAD_MASS * SERVO_STIFFNESS) ** 0.5
"""Critical [N s/m]."""


def build_tester(device: Device, dt: float) -> mujoco.MjModel:
    """The tester with ``device`` in it."""
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
    """What the servo is told, to be at ``length`` [m] after each ``step`` [s]: speed and acceleration fed forward."""
    speed = np.gradient(length, dt)
    return np.asarray(length + (SERVO_DAMPING * speed + CROSSHEAD_MASS * np.gradient(speed, dt)) / SERVO_STIFFNESS)


def place_crosshead(data: mujoco.MjData, length: float, speed: float, load: float) -> None:
    """Put the crosshead where its servo already carries ``load`` [N], at ``length`` [m] and ``speed`` [m/s]."""
    data.joint("crosshead").qpos[0] = length - load / SERVO_STIFFNESS
    data.joint("crosshead").qvel[0] = speed
