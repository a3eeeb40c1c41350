"""Pulleys of an MJCF model: geoms that tendons wrap around, and the ends of cables on their rims."""

from collections.abc import Sequence

import mujoco
import numpy as np

RIM_TOLERANCE = 0.1
"""Distance from the rim of a pulley, over its radius, up to which the end of a cable is on it (assumed)."""


def is_pulley(wrap: mujoco.MjsWrap) -> bool:
    """Return whether ``wrap``, an object on the path of a tendon, is a geom that the tendon wraps around."""
    return wrap.type in (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER)


def set_radius(spec: mujoco.MjSpec, pulley: mujoco.MjsGeom, before: float, after: float) -> None:
    """Change the radius [m] of ``pulley``, and move the ends of cables that are on its rim with it."""
    if after == before:
        return
    size = np.array(pulley.size, dtype=np.float64)
    size[0] = after
    pulley.size = size
    center = np.asarray(pulley.pos, dtype=np.float64)
    for site in _list_end_sites(spec, pulley):
        offset = np.asarray(site.pos, dtype=np.float64) - center
        if abs(float(np.linalg.norm(offset)) / before - 1.0) <= RIM_TOLERANCE:
            site.pos = center + after / before * offset


def _list_end_sites(spec: mujoco.MjSpec, pulley: mujoco.MjsGeom) -> Sequence[mujoco.MjsSite]:
    """Return the sites on the body of ``pulley`` next to it on the path of a tendon, each once."""
    sites = {}
    for tendon in spec.tendons:
        path = list(tendon.path)
        for index, wrap in enumerate(path):
            if is_pulley(wrap) and wrap.target.name == pulley.name:
                for neighbour in (path[k] for k in (index - 1, index + 1) if 0 <= k < len(path)):
                    is_site = neighbour.type == mujoco.mjtWrap.mjWRAP_SITE
                    if is_site and neighbour.target.parent.name == pulley.parent.name:
                        sites[neighbour.target.name] = neighbour.target
    return list(sites.values())
