"""The tester as a MuJoCo model: ``bench.xml`` with a crosshead on a servo and a load cell that measures."""

import mujoco

from klute_sim.device.files import Device
from klute_sim.plant import models

CROSSHEAD = 400.0
"""Moving mass of the crosshead and its drive [kg] (assumed)."""
STIFFNESS = 4.0e7
"""Of the servo [N/m]: 1 kN moves the crosshead by 25 um (assumed: a stiff floor-standing tester)."""
DAMPING = 2.0 * (CROSSHEAD * STIFFNESS) ** 0.5
"""Critical [N s/m]."""


def build(device: Device, step: float) -> mujoco.MjModel:
    """The tester with ``device`` in it."""
    spec = models.spec("bench")
    spec.option.timestep = step
    crosshead = spec.body("crosshead")
    crosshead.geoms[0].mass = CROSSHEAD
    servo = spec.add_actuator(name="servo", target="crosshead", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_position(kp=STIFFNESS, kv=DAMPING)
    spec.add_sensor(
        name="load_cell",
        type=mujoco.mjtSensor.mjSENS_FORCE,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname="load_cell",
    )
    return models.equip(spec, {"muscle_tendon": device.parameters})
