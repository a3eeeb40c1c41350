"""Shapes of devices in a scene of MuJoCo: muscles that swell and take the colour of their pressure, and tendons.

A muscle begins at the first site of its tendon. Its radius is that of its braid, its colour follows the gauge pressure,
that of the tendon the tension. A device with two actuators has two muscles side by side.
"""

import math
from itertools import pairwise

import mujoco
import numpy as np

from klute_sim.device.backend.packing import unpack_parameters
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.laws import mckibben, tendon
from klute_sim.plant.callbacks import get_parameter_row
from klute_sim.plant.models import REST_GROUP
from klute_sim.types import Array
from klute_sim.units import BAR

EMPTY_COLOUR, FULL_COLOUR = np.array([0.25, 0.32, 0.27]), np.array([0.16, 0.85, 0.32])
"""Colours of a muscle without pressure and at the supply pressure, RGB."""
SLACK_COLOUR, TAUT_COLOUR = np.array([0.62, 0.62, 0.62]), np.array([0.9, 0.12, 0.1])
"""Colours of a tendon without tension and at the isometric force of the full muscle, RGB."""
FITTING_COLOUR = np.array([0.7, 0.72, 0.75])
"""Colour of the fittings at both ends of a muscle, RGB."""
MAX_FITTING_LENGTH = 0.012
"""Largest length of a fitting [m]."""
TENDON_RADIUS = 0.004
"""Radius of a drawn tendon [m]."""
GAP_WIDTH = 0.003
"""Distance between two empty muscles side by side [m]."""
MUSCLE_MATERIAL = "muscle"
"""Ending of the name of the material that shows the braid."""


def make_scene_option() -> mujoco.MjvOption:
    """Return the options of a scene without what :func:`add_devices` draws: muscles at rest, and MuJoCo's tendons."""
    option = mujoco.MjvOption()
    option.geomgroup[REST_GROUP] = 0
    option.flags[mujoco.mjtVisFlag.mjVIS_TENDON] = 0
    return option


def add_devices(scene: mujoco.MjvScene, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Add muscle and tendon of every device of ``model`` to ``scene``, as ``data`` has them.

    ``data`` needs its kinematics and tendons (mj_kinematics, mj_comPos, mj_tendon). A device without a finite state is
    left out.
    """
    for actuator in range(model.nactuator):
        row = get_parameter_row(model, actuator)
        if row is not None:
            first = int(model.actuator_actadr[actuator])
            pressure, offset = data.act[first : first + 2].tolist()
            path = get_tendon_path(model, data, int(model.actuator_trnid[actuator, 0]))
            if math.isfinite(pressure) and math.isfinite(offset) and np.isfinite(path).all():
                _add_device(scene, model, unpack_parameters(row), path, pressure * BAR, offset)


def get_tendon_path(model: mujoco.MjModel, data: mujoco.MjData, tendon_id: int) -> Array:
    """Return the points (n, 3) [m] through which a spatial tendon runs, from its first site to its last."""
    first, count = int(data.ten_wrapadr[tendon_id]), int(data.ten_wrapnum[tendon_id])
    points = np.asarray(data.wrap_xpos).reshape(-1, 3)[first : first + count]
    return np.array(points, dtype=np.float64)


def split_path(path: Array, length: float) -> tuple[Array, Array]:
    """Return the part of a ``path`` (n, 3) up to ``length`` [m] along it, and the rest; both have the point there."""
    covered = 0.0
    for index in range(len(path) - 1):
        segment = path[index + 1] - path[index]
        distance = float(np.linalg.norm(segment))
        if covered + distance >= length and distance > 0.0:
            point = path[index] + (length - covered) / distance * segment
            return np.vstack([path[: index + 1], point]), np.vstack([point, path[index + 1 :]])
        covered += distance
    return path, path[-1:]


def compute_muscle_radius(parameters: DeviceParameters, length: float) -> float:
    """Return the radius of one actuator [m]: that of its braid at ``length`` [m], at least that of its bladder."""
    muscle = parameters.muscle
    radius = mckibben.compute_braid_radius(muscle.braid_length, length, muscle.braid_turns)
    return max(radius, muscle.bladder_radius)


def interpolate_colour(low: Array, high: Array, fraction: float) -> Array:
    """Return the opaque colour (4,) RGBA between ``low`` at 0 and ``high`` at 1; ``fraction`` is clipped."""
    return np.append(low + min(max(fraction, 0.0), 1.0) * (high - low), 1.0)


def _add_device(
    scene: mujoco.MjvScene,
    model: mujoco.MjModel,
    parameters: DeviceParameters,
    path: Array,
    pressure: float,
    offset: float,
) -> None:
    muscle = parameters.muscle
    unit_length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    muscle_length = min(muscle.resting_length + offset, unit_length) if muscle.n_actuators else 0.0
    muscle_path, tendon_path = split_path(path, muscle_length)
    stretch = unit_length - muscle_length - parameters.tendon.slack_length
    tension = 0.0 if parameters.tendon.is_rigid else tendon.force(parameters.tendon, stretch)
    max_force = mckibben.gas_force(muscle, parameters.supply.max_pressure, muscle.resting_length)
    tendon_colour = interpolate_colour(SLACK_COLOUR, TAUT_COLOUR, tension / max_force if max_force > 0.0 else 0.0)
    for begin, end in pairwise(tendon_path):
        _add_connector(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, TENDON_RADIUS, begin, end, tendon_colour)
    if not muscle.n_actuators:
        return
    colour = interpolate_colour(EMPTY_COLOUR, FULL_COLOUR, pressure / parameters.supply.max_pressure)
    radius = compute_muscle_radius(parameters, muscle_length)
    spacing = max(2.0 * muscle.bladder_radius + GAP_WIDTH, 2.0 * radius)
    for number in range(round(muscle.n_actuators)):
        side = (number - 0.5 * (round(muscle.n_actuators) - 1)) * spacing
        for begin, end in pairwise(muscle_path):
            _add_muscle(scene, model, begin, end, side, radius, colour)


def _add_muscle(
    scene: mujoco.MjvScene,
    model: mujoco.MjModel,
    begin: Array,
    end: Array,
    side: float,
    radius: float,
    colour: Array,
) -> None:
    """Add one muscle between ``begin`` and ``end`` (3,), moved by ``side`` [m] across its direction."""
    length = float(np.linalg.norm(end - begin))
    if length < 1e-6:
        return
    direction = (end - begin) / length
    across = np.cross(direction, [1.0, 0.0, 0.0] if abs(direction[0]) < 0.9 else [0.0, 0.0, 1.0])
    shift = side * across / np.linalg.norm(across)
    fitting = min(MAX_FITTING_LENGTH, 0.1 * length) * direction
    first, last = begin + shift, end + shift
    metal, cylinder = np.append(FITTING_COLOUR, 1.0), mujoco.mjtGeom.mjGEOM_CYLINDER
    for tip, inner in ((first, first + 2.0 * fitting), (last, last - 2.0 * fitting)):
        _add_connector(scene, cylinder, 0.6 * radius, tip, inner, metal)
    body = _add_connector(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, radius, first + fitting, last - fitting, colour)
    if body is not None:
        body.matid = _find_muscle_material(model)


def _add_connector(
    scene: mujoco.MjvScene, kind: mujoco.mjtGeom, radius: float, begin: Array, end: Array, colour: Array
) -> mujoco.MjvGeom | None:
    """Add a shape between two points; return it, or None when the scene is full."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), colour.astype(np.float32))
    mujoco.mjv_connector(geom, kind, radius, begin, end)
    geom.category = mujoco.mjtCatBit.mjCAT_DYNAMIC
    scene.ngeom += 1
    return geom


def _find_muscle_material(model: mujoco.MjModel) -> int:
    for material in range(model.nmat):
        if model.material(material).name.endswith(MUSCLE_MATERIAL):
            return material
    return -1
