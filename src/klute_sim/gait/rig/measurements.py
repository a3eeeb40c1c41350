"""Measurements of the gait rig at each time step.

A sample belongs to the start of its time step: positions and velocities before it, and forces and moments as MuJoCo
evaluates them there. The pressure and the muscle length are those at the end of the implicit step, to which the tension
belongs. The angle of the ankle is that of the foot relative to the limb: that of the hinge, of an elastic keel and of
the alignment together. Velocity and power belong to it. The moments at hip and knee and the forces on the carriage are
those of the drives, which guide the limb and carry the rig.
"""

import mujoco
import numpy as np

from klute_sim.constants import DEGREES_PER_RADIAN
from klute_sim.device.dynamics import DeviceState
from klute_sim.gait.body import KEEL_JOINT, PROSTHESIS_PREFIX
from klute_sim.gait.rig.build import get_half_lengths
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.units import BAR

MEASURED_COLUMNS = (
    "carriage_x [m]",
    "carriage_z [m]",
    "thigh_angle [deg]",
    "knee_angle [deg]",
    "shank_angle [deg]",
    "ankle_angle [deg]",
    "ankle_velocity [deg/s]",
    "heel_compression [m]",
    "ankle_moment [N*m]",
    "actuator_moment [N*m]",
    "passive_moment [N*m]",
    "stop_moment [N*m]",
    "ankle_power [W]",
    "actuator_power [W]",
    "moment_arm [m]",
    "unit_length [m]",
    "muscle_length [m]",
    "pressure [bar]",
    "force [N]",
    "muscle_force [N]",
    "damper_force [N]",
    "grf_vertical [N]",
    "grf_forward [N]",
    "cop_x [m]",
    "hip_moment [N*m]",
    "knee_moment [N*m]",
    "hip_force_forward [N]",
    "hip_force_vertical [N]",
    "liner_displacement [m]",
    "ankle_x [m]",
    "ankle_z [m]",
    "sole_height [m]",
)
"""Columns of :meth:`GaitMeasurements.measure`, in its order."""


class GaitMeasurements:
    """Measure one sample of a gait rig."""

    def __init__(self, model: mujoco.MjModel, actuator: DeviceActuator, alignment: float = 0.0) -> None:
        """Find the elements of ``model``, whose device is on ``actuator``; ``alignment`` [rad] of the prosthesis."""
        self._alignment = alignment
        self._model = model
        self._actuator = actuator
        self._ankle_joint_id = model.joint(PROSTHESIS_PREFIX + "ankle").id
        self._ankle_dof_index = int(model.joint(PROSTHESIS_PREFIX + "ankle").dofadr[0])
        self._ankle_qpos_index = int(model.joint(PROSTHESIS_PREFIX + "ankle").qposadr[0])
        keel = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, KEEL_JOINT)
        self._keel_indices = None if keel < 0 else (int(model.jnt_qposadr[keel]), int(model.jnt_dofadr[keel]))
        self._liner_qpos_index = int(model.joint("liner").qposadr[0])
        self._heel_qpos_index = int(model.joint(PROSTHESIS_PREFIX + "heel").qposadr[0])
        self._foot_body_id = model.body(PROSTHESIS_PREFIX + "foot").id
        self._origin_site_id = model.site(PROSTHESIS_PREFIX + "achilles_origin").id
        self._insertion_site_id = model.site(PROSTHESIS_PREFIX + "achilles_insertion").id
        self._mid_range_angle = float(model.jnt_range[self._ankle_joint_id].mean())
        floor = model.geom("floor").id
        self._sole_geom_ids = np.flatnonzero((model.geom_contype & model.geom_conaffinity[floor]) != 0)
        self._sole_half_lengths = np.array([get_half_lengths(model, int(g)) for g in self._sole_geom_ids])

    def measure(
        self, data: mujoco.MjData, qpos: np.ndarray, qvel: np.ndarray, device_state: DeviceState, muscle_velocity: float
    ) -> tuple[float, ...]:
        """Return the sample of the last time step.

        ``qpos`` and ``qvel`` are the positions and velocities before it; ``device_state`` and ``muscle_velocity`` [m/s]
        are those after it.
        """
        actuator, parameters = self._actuator, self._actuator.parameters
        tension = actuator.get_tension(data)

        angle, rate = (
            float(qpos[self._ankle_qpos_index]),
            float(qvel[self._ankle_dof_index]),
        )  # plantarflexion positive, as the hinge
        foot_angle, foot_rate = angle, rate
        if self._keel_indices is not None:
            foot_angle += float(qpos[self._keel_indices[0]])
            foot_rate += float(qvel[self._keel_indices[1]])
        actuator_moment = float(data.qfrc_actuator[self._ankle_dof_index])
        passive_moment = float(data.qfrc_passive[self._ankle_dof_index])
        stop_moment = self._compute_stop_moment(data, angle)
        moment = actuator_moment + passive_moment + stop_moment
        up, forward, cop = self._compute_ground_reaction(data)
        ankle = data.xpos[self._foot_body_id]
        return (
            float(qpos[0]),
            float(qpos[1]),
            float(qpos[2]) * DEGREES_PER_RADIAN,
            float(qpos[3]) * DEGREES_PER_RADIAN,
            float(qpos[2] + qpos[3]) * DEGREES_PER_RADIAN,
            (self._alignment - foot_angle) * DEGREES_PER_RADIAN,
            -foot_rate * DEGREES_PER_RADIAN,
            float(qpos[self._heel_qpos_index]),
            moment,
            actuator_moment,
            passive_moment,
            stop_moment,
            moment * foot_rate,
            actuator_moment * rate,
            self._compute_moment_arm(data),
            actuator.get_unit_length(data),
            device_state.length,
            device_state.pressure / BAR,
            tension,
            mckibben.force(parameters.muscle, device_state.pressure, device_state.length),
            damper_law.force(parameters.damper, muscle_velocity),
            up,
            forward,
            cop,
            float(data.qfrc_actuator[2]),
            float(data.qfrc_actuator[3]),
            float(data.qfrc_actuator[0]),
            float(data.qfrc_actuator[1]),
            float(qpos[self._liner_qpos_index]),
            float(ankle[0]),
            float(ankle[2]),
            self._compute_sole_height(data),
        )

    def _compute_sole_height(self, data: mujoco.MjData) -> float:
        """Return the height [m] of the lowest point of the sole, an ellipsoid's by its support function."""
        up = data.geom_xmat[self._sole_geom_ids, 6:] * self._sole_half_lengths
        return float((data.geom_xpos[self._sole_geom_ids, 2] - np.sqrt((up * up).sum(axis=1))).min())

    def _compute_moment_arm(self, data: mujoco.MjData) -> float:
        """Return the distance [m] of the Achilles line from the ankle axis."""
        x, _, z = data.xpos[self._foot_body_id]
        ox, _, oz = data.site_xpos[self._origin_site_id]
        ix, _, iz = data.site_xpos[self._insertion_site_id]
        dx, dz = ox - ix, oz - iz
        return float(abs((ix - x) * dz - (iz - z) * dx) / (dx * dx + dz * dz) ** 0.5)

    def _compute_stop_moment(self, data: mujoco.MjData, angle: float) -> float:
        """Return the moment [N.m] of the end stop of the ankle, plantarflexor positive."""
        limits = data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
        if not limits.any():
            return 0.0
        push = float(data.efc_force[limits & (data.efc_id == self._ankle_joint_id)].sum())
        return push if angle < self._mid_range_angle else -push

    @staticmethod
    def _compute_ground_reaction(data: mujoco.MjData) -> tuple[float, float, float]:
        """Return the vertical and the forward ground reaction [N] and the centre of pressure [m] (NaN if unloaded).

        The centre of pressure is that of a force plate: the point of the floor, z = 0, about which the ground reaction
        has no moment across the walking direction. Contacts lie below it, where the sole sinks in. The sole touches
        only the floor, and a plane is always the first geom of a contact. The normal of a contact therefore points up,
        into the foot.
        """
        contact = data.contact
        active = contact.efc_address >= 0
        if not active.any():
            return 0.0, 0.0, float("nan")
        row = contact.efc_address[active]
        normal = data.efc_force[row]
        frame = contact.frame[active]
        along, across = data.efc_force[row + 1], data.efc_force[row + 2]
        forward = normal * frame[:, 0] + along * frame[:, 3] + across * frame[:, 6]
        upward = normal * frame[:, 2] + along * frame[:, 5] + across * frame[:, 8]
        total, position = float(upward.sum()), contact.pos[active]
        moment = float((position[:, 0] * upward - position[:, 2] * forward).sum())
        return total, float(forward.sum()), moment / total if total > 0.0 else float("nan")
