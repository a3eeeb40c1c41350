"""Ankle moment of a leg without markers: ground reaction times its distance from the ankle.

Weight and inertia of the foot are neglected: with Winter's foot (:mod:`klute_sim.mocap.kinematics.dynamics`) they are
0.014 N.m/kg rms in stance and at most 0.05 N.m/kg in swing, where the moment is set to 0.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from klute_sim.datasets.foot_load import find_loaded_samples
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics.loads import GroundReaction
from klute_sim.mocap.kinematics.postprocess import ResampledLoads
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing.channel_lookup import Column, apply_given_sign
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.plausibility.gait.positions import ScaledSeries, check_cop, check_progression
from klute_sim.plausibility.gait.steps import Series, find_steps
from klute_sim.types import Array

COP, ANKLE_FORWARD, ANKLE_HEIGHT = "cop_x", "ankle_x", "ankle_z"
"""Channels: positions along the forward axis from a common origin, and height above the ground [m]."""
MAX_DISTANCE = 0.05
"""Longest time [s] to a known centre of pressure of a loaded foot (assumed); programs leave it out below 20 to 50 N."""


def add_cop(
    load: GroundReaction, columns: Mapping[str, Column], side: Side, options: ImportOptions, log: ImportLog
) -> GroundReaction:
    """Return ``load`` with the centre of pressure of the column :data:`COP`, if there is one and no other.

    Samples of the loaded foot within :data:`MAX_DISTANCE` of a known one are interpolated; with longer gaps the centre
    of pressure stays unknown, which is logged.
    """
    column = columns.get(COP)
    if load.cop is not None or column is None:
        return load
    values = np.interp(load.time, column.time, apply_given_sign(column, side, log), left=np.nan, right=np.nan)
    is_loaded = find_loaded_samples(load.vertical, options.contact_threshold)
    known = load.time[is_loaded & np.isfinite(values)]
    later = np.searchsorted(known, load.time)
    bounds = np.concatenate([[-np.inf], known, [np.inf]])
    distance = np.minimum(load.time - bounds[later], bounds[later + 1] - load.time)
    is_missing = distance[is_loaded] > MAX_DISTANCE
    if is_missing.any() or not len(known):
        percentage = 100.0 * float(is_missing.mean())
        log.add_missing(f"{column.file_name}: '{column.label}' is empty for {percentage:.0f} % of the loaded time")
        return load
    filled = np.interp(load.time, known, values[is_loaded & np.isfinite(values)])
    return replace(load, cop=np.stack([np.where(is_loaded, filled, np.nan), np.zeros(len(filled))], axis=1))


def describe_missing_positions(columns: Mapping[str, Column], has_cop: bool) -> str:
    """Return which of the positions that determine the moment are still needed, as columns to add."""
    is_known = {COP: has_cop, ANKLE_FORWARD: ANKLE_FORWARD in columns, ANKLE_HEIGHT: ANKLE_HEIGHT in columns}
    names = [f"'{name} [m]'" for name, known in is_known.items() if not known]
    return (
        f"the column{'s' * (len(names) > 1)} {', '.join(names)} (centre of pressure and ankle along the direction of "
        "walking from one origin, and height of the ankle)"
    )


def compute_quasistatic_moment(
    time: Array, foot: ResampledLoads, ankle: Mapping[str, Array], place: str, options: ImportOptions, log: ImportLog
) -> Array | None:
    """Return the ankle moment (n,) [N.m], plantarflexor positive; None without centre of pressure.

    ``ankle`` holds :data:`ANKLE_FORWARD` and :data:`ANKLE_HEIGHT` (n,) [m] at ``time``. Raises ImplausibleInputError
    when the centre of pressure is far from the ankle of the loaded foot, or moves from toe to heel.
    """
    if foot.cop is None:
        return None
    is_loaded = foot.vertical > options.contact_threshold
    vertical = Series(time, foot.vertical)
    cop = ScaledSeries(COP, Series(time, np.where(is_loaded, foot.cop[:, 0], np.nan)), "m", 1.0)
    steps = find_steps(vertical)
    findings, progression = check_cop(cop, Series(time, ankle[ANKLE_FORWARD]), vertical, steps, place)
    log.require_accepted([*findings, *check_progression(progression, COP, place)], options.accept)
    log.add_derived(
        "Ankle moment: ground reaction times its distance from the ankle; weight and inertia of the foot are neglected"
    )
    arm_forward, arm_up = foot.cop[:, 0] - ankle[ANKLE_FORWARD], foot.cop[:, 1] - ankle[ANKLE_HEIGHT]
    return np.where(is_loaded, arm_forward * foot.vertical - arm_up * foot.forward, 0.0)
