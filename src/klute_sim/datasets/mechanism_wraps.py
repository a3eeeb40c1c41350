"""Spheres and cylinders that the tendons of a model wrap around, and the sites next to them."""

from collections.abc import Sequence

import mujoco
import numpy as np

from klute_sim.datasets.mechanism_paths import list_poses
from klute_sim.plausibility.wrapping import Wrap

_CYLINDER, _SPHERE = int(mujoco.mjtWrap.mjWRAP_CYLINDER), int(mujoco.mjtWrap.mjWRAP_SPHERE)


def list_wraps(model: mujoco.MjModel, tendons: Sequence[str]) -> list[Wrap]:
    """Return each geom on the path of one of ``tendons`` with each of its neighbouring sites."""
    data = mujoco.MjData(model)
    pairs = [pair for tendon in tendons for pair in _list_neighbours(model, tendon)]
    distances = []
    for pose in list_poses(model):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        distances.append([_measure_distance(model, data, geom, site) for _, geom, site in pairs])
    largest = np.max(distances, axis=0)
    return [
        Wrap(
            tendon,
            model.geom(geom).name,
            float(model.geom_size[geom, 0]),
            model.site(site).name,
            float(distance),
        )
        for (tendon, geom, site), distance in zip(pairs, largest, strict=True)
    ]


def _list_neighbours(model: mujoco.MjModel, tendon: str) -> list[tuple[str, int, int]]:
    """Return the indices of each geom and of each site next to it on the path of ``tendon``, after its name."""
    index_of_tendon = model.tendon(tendon).id
    first, number = int(model.tendon_adr[index_of_tendon]), int(model.tendon_num[index_of_tendon])
    kinds, objects = (array[first : first + number] for array in (model.wrap_type, model.wrap_objid))
    return [
        (tendon, int(objects[index]), int(objects[neighbour]))
        for index in range(1, number - 1)
        if int(kinds[index]) in (_SPHERE, _CYLINDER)
        for neighbour in (index - 1, index + 1)
    ]


def _measure_distance(model: mujoco.MjModel, data: mujoco.MjData, geom: int, site: int) -> float:
    """Return the distance [m] of ``site`` from the axis of a cylinder or the centre of a sphere."""
    offset = data.geom_xmat[geom].reshape(3, 3).T @ (data.site_xpos[site] - data.geom_xpos[geom])
    is_cylinder = int(model.geom_type[geom]) == int(mujoco.mjtGeom.mjGEOM_CYLINDER)
    return float(np.linalg.norm(offset[: 2 if is_cylinder else 3]))
