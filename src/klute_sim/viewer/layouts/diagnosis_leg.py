"""3-D views of the prosthesis in a gait trial, as measured and as simulated."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.rig.build import MODEL_MASS, MODEL_STATURE, build_gait_model, get_alignment
from klute_sim.recording.recording import Recording
from klute_sim.report.diagnosis.traces import SimulatedTrial
from klute_sim.types import Array
from klute_sim.viewer import scene

HIDDEN_BODIES = ("carriage", "thigh", "residual_limb")
"""Bodies whose motion was not measured."""
TIME_STEP_S = 5e-4
"""Time step [s] of the model, which is posed but not integrated."""


def has_ankle_motion(diagnosis: Diagnosis, simulated: SimulatedTrial) -> bool:
    """Return whether the angle of the ankle was measured in the trial."""
    return diagnosis.dataset.rig == "gait" and "ankle_angle" in simulated.experiment.measured


def log_leg(stream: Any, diagnosis: Diagnosis, simulated: SimulatedTrial, root: str, timeline: str) -> None:
    """Log the rig in a trial under the entity ``root``: as ``measured``, and as simulated ``before`` and ``after``."""
    (trial,) = [trial for trial in diagnosis.dataset.trials if trial.name == simulated.experiment.name]
    model = build_gait_model(trial.device, mass=MODEL_MASS, stature=MODEL_STATURE, dt=TIME_STEP_S)
    measured = {channel: series.value for channel, series in simulated.experiment.measured.items()}
    cases: dict[str, Mapping[str, Array]] = {"measured": measured, "before": simulated.before}
    if diagnosis.added_terms:
        cases["after"] = simulated.after
    for name, channels in cases.items():
        recording = build_recording(trial, simulated, channels, model)
        scene.log_scene(stream, recording, model, timeline, root=f"{root}/{name}", hidden=HIDDEN_BODIES)


def build_view(root: str, case: str, name: str) -> Any:
    """Build the view of one case."""
    return scene.build_view(name, f"{root}/{case}", origin=f"{PROSTHESIS_PREFIX}pylon", height=0.1, distance=0.75)


def build_recording(
    trial: Trial, simulated: SimulatedTrial, channels: Mapping[str, Array], model: mujoco.MjModel
) -> Recording:
    """Return ``trial`` with the ``channels`` of one case [SI] as a recording that poses ``model``.

    Its samples are those of the ankle angle; all other channels are interpolated.
    """
    time = simulated.experiment.measured["ankle_angle"].time
    prescribed = {name: _interpolate(time, series) for name, series in trial.prescribed.items()}
    shank_angle = prescribed["shank_angle"]
    ankle_x, ankle_z = _compute_ankle_position(model, shank_angle)
    columns = {
        "time [s]": time - simulated.experiment.start_time,
        # A straight leg with the angle of the shank: bodies above the pylon are hidden.
        "thigh_angle [deg]": np.degrees(shank_angle),
        "knee_angle [deg]": np.zeros(len(time)),
        "carriage_x [m]": prescribed["ankle_x"] - ankle_x,
        "carriage_z [m]": prescribed["ankle_z"] - ankle_z,
        "ankle_angle [deg]": np.degrees(channels["ankle_angle"] - (get_alignment(trial.device) or 0.0)),
        "heel_compression [m]": np.zeros(len(time)),
        "grf_vertical [N]": prescribed["grf_vertical"],
        "grf_forward [N]": prescribed["grf_forward"],
        "cop_x [m]": np.where(prescribed["grf_vertical"] > 0.0, prescribed["cop_x"], np.nan),
    }
    for channel, unit in (("force", "N"), ("muscle_length", "m"), ("pressure", "Pa")):
        if channel in channels:
            columns[f"{channel} [{unit}]"] = np.interp(
                time, simulated.experiment.measured[channel].time, channels[channel]
            )
    return Recording.from_columns(columns.items())


def _interpolate(time: Array, series: TimeSeries) -> Array:
    known = np.isfinite(series.value)
    return np.interp(time, series.time[known], series.value[known])


def _compute_ankle_position(model: mujoco.MjModel, shank_angle: Array) -> tuple[Array, Array]:
    """Return x and z of the ankle [m] for ``shank_angle`` [rad], with the carriage at 0 and a straight leg."""
    data, pylon = mujoco.MjData(model), model.body(PROSTHESIS_PREFIX + "pylon").id
    positions = np.empty((len(shank_angle), 3))
    for k, angle in enumerate(shank_angle):
        data.joint("thigh").qpos = angle
        mujoco.mj_kinematics(model, data)
        positions[k] = data.xpos[pylon]
    return positions[:, 0], positions[:, 2]
