"""The prosthesis in 3-D as a walk's trial has it: as it was measured, and as it was simulated."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from klute_sim.datasets.trial import Series, Trial
from klute_sim.diagnosis.experiments.base import Array
from klute_sim.diagnosis.workflow import Diagnosis
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.rig.build import MODEL_MASS, MODEL_STATURE, build_gait_model
from klute_sim.recording.recording import Recording
from klute_sim.report.diagnosis.traces import SimulatedTrial
from klute_sim.viewer import scene

HIDDEN_BODIES = ("carriage", "thigh", "residual_limb")
"""Nothing was measured of them."""
TIME_STEP_S = 5e-4
"""Of the model that is posed [s]; nothing is stepped."""


def has_ankle_motion(diagnosis: Diagnosis, simulated: SimulatedTrial) -> bool:
    """Whether there is an ankle that was measured."""
    return diagnosis.dataset.rig == "gait" and "ankle_angle" in simulated.experiment.measured


def log_leg(stream: Any, diagnosis: Diagnosis, simulated: SimulatedTrial, root: str, timeline: str) -> None:
    """Log trial ``one`` under the entity ``root``: the rig ``measured``, ``before`` and ``after``."""
    (trial,) = [each for each in diagnosis.dataset.trials if each.name == simulated.experiment.name]
    model = build_gait_model(trial.device, mass=MODEL_MASS, stature=MODEL_STATURE, dt=TIME_STEP_S)
    measured = {channel: series.value for channel, series in simulated.experiment.measured.items()}
    cases: dict[str, Mapping[str, Array]] = {"measured": measured, "before": simulated.before}
    if diagnosis.added_terms:
        cases["after"] = simulated.after
    for name, channels in cases.items():
        posed = build_recording(trial, simulated, channels, model)
        scene.log_scene(stream, posed, model, timeline, root=f"{root}/{name}", hidden=HIDDEN_BODIES)


def build_view(root: str, case: str, name: str) -> Any:
    """The view of one case."""
    return scene.build_view(name, f"{root}/{case}", origin=f"{PROSTHESIS_PREFIX}pylon", height=0.1, distance=0.75)


def build_recording(
    trial: Trial, simulated: SimulatedTrial, channels: Mapping[str, Array], model: mujoco.MjModel
) -> Recording:
    """``trial`` with the ``channels`` of one case [SI], as the rig's ``model`` is posed by it.

    At the times of the ankle's samples; where the others have none, between their neighbours.
    """
    clock = simulated.experiment.measured["ankle_angle"].time
    at = {name: _interpolate(clock, series) for name, series in trial.prescribed.items()}
    lean = at["shank_angle"]
    forward, upward = _compute_ankle_position(model, lean)
    columns = {
        "time [s]": clock - simulated.experiment.start_time,
        # The whole leg leans as the shank does: what is above the pylon is not shown.
        "thigh_angle [deg]": np.degrees(lean),
        "knee_angle [deg]": np.zeros(len(clock)),
        "carriage_x [m]": at["ankle_x"] - forward,
        "carriage_z [m]": at["ankle_z"] - upward,
        "ankle_angle [deg]": np.degrees(channels["ankle_angle"]),
        "heel_compression [m]": np.zeros(len(clock)),
        "grf_vertical [N]": at["grf_vertical"],
        "grf_forward [N]": at["grf_forward"],
        "cop_x [m]": np.where(at["grf_vertical"] > 0.0, at["cop_x"], np.nan),
    }
    for channel, unit in (("force", "N"), ("muscle_length", "m"), ("pressure", "Pa")):
        if channel in channels:
            columns[f"{channel} [{unit}]"] = np.interp(
                clock, simulated.experiment.measured[channel].time, channels[channel]
            )
    return Recording.from_columns(columns.items())


def _interpolate(time: Array, series: Series) -> Array:
    known = np.isfinite(series.value)
    return np.interp(time, series.time[known], series.value[known])


def _compute_ankle_position(model: mujoco.MjModel, shank_angle: Array) -> tuple[Array, Array]:
    """Where the ankle is [m] with the carriage at 0 and the leg straight, leaning by so much [rad]."""
    data, pylon = mujoco.MjData(model), model.body(PROSTHESIS_PREFIX + "pylon").id
    places = np.empty((len(shank_angle), 3))
    for k, angle in enumerate(shank_angle):
        data.joint("thigh").qpos = angle
        mujoco.mj_kinematics(model, data)
        places[k] = data.xpos[pylon]
    return places[:, 0], places[:, 2]
