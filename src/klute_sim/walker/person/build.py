"""Build the MuJoCo model of the walker: intact, or with a prosthesis on the right leg, on level or other ground."""

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.rig.build import apply_device_foot, get_alignment, place_achilles_origin
from klute_sim.gait.spring_foot import SpringFoot, disable_tendon
from klute_sim.plant import callbacks, models
from klute_sim.walker.person.body import Body

MAX_DT = 1e-3
"""Longest time step [s]."""
BLOCK_LENGTH = 0.5
"""Length of the blocks of uneven ground [m]."""
MAX_SLOPE_DEG, MAX_UNEVENNESS = 10.0, 0.05
"""Largest slope [deg] and largest height of blocks [m]."""
RIGHT_ANKLE_JOINT = PROSTHESIS_PREFIX + "ankle"
"""Ankle joint of the prosthesis, plantarflexion positive."""
LOAD_CELL = PROSTHESIS_PREFIX + "load_cell"
"""Force sensor in the pylon."""


@dataclass(frozen=True, kw_only=True)
class Ground:
    """Ground that the walker meets; validated when made."""

    slope: float = 0.0
    """Slope [rad], uphill positive."""
    unevenness: float = 0.0
    """Largest height of the blocks of 0.5 m that lie on the ground [m]; their heights are uniform from 0."""
    uneven_from: float = 1.5
    """Distance from the start at which the blocks begin [m]."""
    seed: int = 0
    """Random seed of the heights."""
    length: float = 100.0
    """Length of the part with blocks [m]."""

    def __post_init__(self) -> None:
        """Raise InputError when a number is out of range."""
        if not abs(math.degrees(self.slope)) <= MAX_SLOPE_DEG:
            raise InputError(f"slope is {math.degrees(self.slope):g}; allowed: -10 to 10 degrees")
        if not 0.0 <= self.unevenness <= MAX_UNEVENNESS:
            raise InputError(f"unevenness is {1e3 * self.unevenness:g}; allowed: 0 to {1e3 * MAX_UNEVENNESS:g} mm")


@dataclass(frozen=True, kw_only=True)
class Prosthesis:
    """What replaces the right shank and foot."""

    device: Device
    """Device on the prosthesis; with a spring foot only its geometry counts."""
    spring_foot: SpringFoot | None = None
    """Passive foot that replaces the device; None: the device."""
    alignment: float | None = None
    """Angle [rad] by which the prosthesis is turned against the limb, dorsiflexion positive; None: that of the device
    file, or 0."""

    def get_alignment(self) -> float:
        """Return the alignment [rad] that is used."""
        if self.alignment is not None:
            return self.alignment
        return get_alignment(self.device) or 0.0


def build_walker_model(
    body: Body, prosthesis: Prosthesis | None, *, dt: float = MAX_DT, ground: Ground | None = None
) -> mujoco.MjModel:
    """Return the model of the walker with a time step ``dt`` [s]; without a ``prosthesis`` it has two legs of flesh.

    Of an amputee's body, the difference between shank with foot and residual limb is missing; the prosthesis adds its
    mass. Raises InputError when the device does not fit, or ``dt`` is out of range.
    """
    if not 1e-5 <= dt <= MAX_DT:
        raise InputError(f"time step is {1e3 * dt:g} ms; allowed: 0.01 to 1 ms")
    spec = models.load_spec("walker")
    spec.option.timestep = dt
    spec.geom("floor").pos = np.zeros(3)  # it is lower in the file, in which the person stands in MuJoCo's viewer
    ground = ground or Ground()
    spec.option.gravity = GRAVITY * np.array([-math.sin(ground.slope), 0.0, -math.cos(ground.slope)])
    if ground.unevenness > 0.0:
        _add_blocks(spec, ground)
    if prosthesis is None:
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        return callbacks.compile_model(spec)
    return _attach_prosthesis(spec, body, prosthesis)


def get_contact(model: mujoco.MjModel) -> dict[str, list[float]]:
    """Return the contact that all soles share: ``solref``, ``solimp`` and sliding friction."""
    floor = model.geom("floor")
    return {
        "solref": floor.solref.tolist(),
        "solimp": floor.solimp.tolist(),
        "friction": [float(floor.friction[0])],
    }


def _add_blocks(spec: mujoco.MjSpec, ground: Ground) -> None:
    rng = np.random.default_rng(ground.seed)
    for k in range(round(ground.length / BLOCK_LENGTH)):
        height = float(rng.uniform(0.0, ground.unevenness))
        block = spec.worldbody.add_geom(spec.find_default("ground"), name=f"block_{k}", type=mujoco.mjtGeom.mjGEOM_BOX)
        block.size = np.array([0.5 * BLOCK_LENGTH, 1.0, 0.1])
        block.pos = np.array([ground.uneven_from + (k + 0.5) * BLOCK_LENGTH, 0.0, height - 0.1])


def _attach_prosthesis(spec: mujoco.MjSpec, body: Body, prosthesis: Prosthesis) -> mujoco.MjModel:
    device, amputation = prosthesis.device, body.document.amputation
    spec.delete(spec.sensor("load_right"))
    spec.delete(spec.body("foot_right"))
    limb: Any = spec.body("shank_right")
    limb.mass, limb.ipos = amputation.residual_limb_mass_kg, [0.0, 0.0, -amputation.residual_limb_com_m]
    limb.inertia = [amputation.residual_limb_inertia_kg_m2, amputation.residual_limb_inertia_kg_m2, 0.002]
    limb_shape: Any = spec.geom("shank_right")
    limb_shape.fromto, limb_shape.pos, limb_shape.size = [math.nan] * 6, [0.0, 0.0, -0.09], [0.05, 0.09, 0.0]
    limb_shape.quat = [1.0, 0.0, 0.0, 0.0]
    alignment = prosthesis.get_alignment()
    spec.frame("socket_end").quat = np.array([math.cos(0.5 * alignment), 0.0, -math.sin(0.5 * alignment), 0.0])
    ankle = models.load_spec("ankle")
    ankle.option.timestep = spec.option.timestep  # MuJoCo reports options that differ
    ankle.option.iterations, ankle.option.gravity = spec.option.iterations, spec.option.gravity
    spec.frame("socket_end").attach_body(ankle.body("pylon"), PROSTHESIS_PREFIX, "")
    _put_on_shoe(spec)
    place_achilles_origin(spec, device, 1.0)
    load = spec.add_sensor(
        name="load_right",
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,
        objname=PROSTHESIS_PREFIX + "foot",
        reftype=mujoco.mjtObj.mjOBJ_XBODY,
        refname="world",
    )
    load.intprm = spec.sensor("load_left").intprm
    parameters = device.parameters
    if prosthesis.spring_foot is not None:
        prosthesis.spring_foot.apply_to_joint(spec.joint(RIGHT_ANKLE_JOINT))
        parameters = disable_tendon(parameters)
    apply_device_foot(spec, device)
    return models.attach_devices(spec, {PROSTHESIS_PREFIX + "muscle_tendon": parameters})


def _put_on_shoe(spec: mujoco.MjSpec) -> None:
    """Give the soles of the prosthesis the contact of the other foot."""
    shoe = spec.geom("ball_left")
    for geom in spec.geoms:
        if geom.classname.name == PROSTHESIS_PREFIX + "sole":
            geom.solref, geom.solimp, geom.friction, geom.priority = shoe.solref, shoe.solimp, shoe.friction, 0
