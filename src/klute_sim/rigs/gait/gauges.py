"""What the gait rig measures at each step.

A sample belongs to the start of its step: positions and velocities before it, forces and moments as MuJoCo
evaluated them there, and the device as its implicit step balanced it (pressure and muscle length at the
step's end, which are those the tension belongs to). Angle, velocity and power of the ankle are those of the foot
against the pylon, as markers see them: where the foot bends, hinge and bending together.
"""

import mujoco
import numpy as np

from klute_sim.device.step import State
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.rigs.gait.body import ANKLE, KEEL
from klute_sim.units import BAR

CHANNELS = (
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
    "ankle_x [m]",
    "ankle_z [m]",
    "sole_height [m]",
)
"""Columns of :meth:`Gauges.read`, in its order."""


class Gauges:
    """Reads one sample off a gait rig."""

    def __init__(self, model: mujoco.MjModel, actuator: DeviceActuator) -> None:
        """For the rig's ``model`` with the device bound to ``actuator``."""
        self._model = model
        self._actuator = actuator
        self._joint = model.joint(ANKLE + "ankle").id
        self._dof = int(model.joint(ANKLE + "ankle").dofadr[0])
        self._angle = int(model.joint(ANKLE + "ankle").qposadr[0])
        keel = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, KEEL)
        self._bent = None if keel < 0 else (int(model.jnt_qposadr[keel]), int(model.jnt_dofadr[keel]))
        self._heel = int(model.joint(ANKLE + "heel").qposadr[0])
        self._foot = model.body(ANKLE + "foot").id
        self._origin = model.site(ANKLE + "achilles_origin").id
        self._insertion = model.site(ANKLE + "achilles_insertion").id
        self._middle = float(model.jnt_range[self._joint].mean())
        floor = model.geom("floor").id
        self._sole = np.flatnonzero((model.geom_contype & model.geom_conaffinity[floor]) != 0)
        self._radius = model.geom_size[self._sole, 0]

    def read(
        self, data: mujoco.MjData, q: np.ndarray, v: np.ndarray, device: State, muscle_rate: float
    ) -> tuple[float, ...]:
        """The sample of the step just taken, from positions ``q`` and velocities ``v`` before it.

        It led to ``device``, with the muscle moving at ``muscle_rate`` [m/s].
        """
        actuator, parameters = self._actuator, self._actuator.parameters
        tension = actuator.tension(data)

        angle, rate = float(q[self._angle]), float(v[self._dof])  # plantarflexion positive, as the hinge
        turned, turning = angle, rate
        if self._bent is not None:
            turned, turning = turned + float(q[self._bent[0]]), turning + float(v[self._bent[1]])
        by_actuator = float(data.qfrc_actuator[self._dof])
        by_passive = float(data.qfrc_passive[self._dof])
        by_stop = self._stop_moment(data, angle)
        moment = by_actuator + by_passive + by_stop
        up, forward, cop = self._ground(data)
        ankle = data.xpos[self._foot]
        degrees = 57.29577951308232
        return (
            float(q[0]),
            float(q[1]),
            float(q[2]) * degrees,
            float(q[3]) * degrees,
            float(q[2] + q[3]) * degrees,
            -turned * degrees,
            -turning * degrees,
            float(q[self._heel]),
            moment,
            by_actuator,
            by_passive,
            by_stop,
            moment * turning,
            by_actuator * rate,
            self._moment_arm(data),
            actuator.unit_length(data),
            device.length,
            device.pressure / BAR,
            tension,
            mckibben.force(parameters.muscle, device.pressure, device.length),
            damper_law.force(parameters.damper, muscle_rate),
            up,
            forward,
            cop,
            float(ankle[0]),
            float(ankle[2]),
            float((data.geom_xpos[self._sole, 2] - self._radius).min()),
        )

    def _moment_arm(self, data: mujoco.MjData) -> float:
        """Distance [m] of the Achilles line from the ankle axis, from the sites' positions."""
        x, _, z = data.xpos[self._foot]
        ox, _, oz = data.site_xpos[self._origin]
        ix, _, iz = data.site_xpos[self._insertion]
        dx, dz = ox - ix, oz - iz
        return float(abs((ix - x) * dz - (iz - z) * dx) / (dx * dx + dz * dz) ** 0.5)

    def _stop_moment(self, data: mujoco.MjData, angle: float) -> float:
        """Moment [N.m] of the ankle's end stop, plantarflexor positive."""
        limits = data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
        if not limits.any():
            return 0.0
        push = float(data.efc_force[limits & (data.efc_id == self._joint)].sum())
        return push if angle < self._middle else -push

    @staticmethod
    def _ground(data: mujoco.MjData) -> tuple[float, float, float]:
        """Vertical and forward reaction [N], centre of pressure [m] (NaN unloaded).

        The floor is the only partner of the sole, and a plane is always the first of the two, so a contact's
        normal points up, into the foot.
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
        total = float(upward.sum())
        cop = float((normal * contact.pos[active, 0]).sum() / normal.sum()) if normal.sum() > 0.0 else float("nan")
        return total, float(forward.sum()), cop
