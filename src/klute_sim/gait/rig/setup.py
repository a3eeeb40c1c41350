"""Set up the gait rig: its model, the trajectory that it follows, and the commands of its drives.

Commands are given at a fixed *interval*, and the drives move in straight lines between them. A stride is a whole number
of intervals, so that all strides have the same inputs.
"""

import math
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.device.device import Device
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.errors import InputError
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.reference import Reference, load_default_reference
from klute_sim.gait.rig.build import MODEL_MASS, MODEL_STATURE, ModelEdit, build_gait_model, measure_leg
from klute_sim.gait.rig.hip_path import MAX_LEARNING_STRIDES, PLANNED_PATH, HipPath
from klute_sim.gait.rig.trajectory import HipTrajectory, compute_knee_angle, compute_thigh_angle, plan_hip_trajectory
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.callbacks import forward_without_devices
from klute_sim.types import Array

DRIVE_ACTUATORS = ("carriage_x", "carriage_z", "thigh", "knee", "push", "lift")
"""Actuators that the rig commands; the first four are position servos, the last two are forces."""
MAX_PATH_DEVIATION = 0.3
"""Maximum vertical distance of the carriage from its path [m]; beyond it the results are meaningless."""


@dataclass(frozen=True, kw_only=True)
class GaitOptions:
    """Subject, ground, speed and time step of a gait run."""

    mass: float = MODEL_MASS
    """Body mass [kg]."""
    stature: float = MODEL_STATURE
    """Body height [m]."""
    speed: float | None = None
    """Walking speed [m/s]; None: the speed that follows from the angles and the stride time of the reference with these
    legs. A chosen speed scales the stride time."""
    slope: float = 0.0
    """Slope of the ground [rad], uphill positive; limb kinematics on slopes are assumed
    (:meth:`klute_sim.gait.reference.Reference.tilt_to_slope`)."""
    strides: int = 5
    """Number of strides, from heel strike to heel strike."""
    dt: float = 5e-4
    """Time step [s]."""
    reference: Reference = field(default_factory=load_default_reference)
    """Gait that the rig follows, and that the run is compared with."""
    spring_foot: SpringFoot | None = None
    """Passive foot that replaces the device; None: the device."""
    alignment: float | None = None
    """Angle [rad] by which the prosthesis is turned against the limb, dorsiflexion positive. None: that of the
    device file; without one, the foot that hangs in late swing has the pitch of the foot of the reference at heel
    strike."""
    learning_strides: int = 40
    """Largest number of strides in which the rig learns the path of the hip before the run; 0: the planned path."""
    hip_path: HipPath | None = None
    """Path of the hip that was learned before; None: it is learned with the device and the controller of the run."""
    model_edit: ModelEdit | None = None
    """Further change of the model before it is compiled; a recording does not describe it."""

    def __post_init__(self) -> None:
        """Raise InputError when a value is out of range."""
        limits: list[tuple[str, float | None, float, float, str]] = [
            ("mass", self.mass, 20.0, 250.0, "kg"),
            ("stature", self.stature, 1.0, 2.4, "m"),
            ("speed", self.speed, 0.4, 2.5, "m/s"),
            ("slope", math.degrees(self.slope), -10.0, 10.0, "degrees"),
            ("alignment", None if self.alignment is None else math.degrees(self.alignment), -30.0, 30.0, "degrees"),
            ("strides", self.strides, 1, 200, ""),
            ("learning strides", self.learning_strides, 0, MAX_LEARNING_STRIDES, ""),
            ("time step", 1e3 * self.dt, 0.01, 1.0, "ms"),
        ]
        for name, value, lower, upper, unit in limits:
            if value is not None and not lower <= value <= upper:  # also rejects NaN
                raise InputError(f"{name} is {value:g}; allowed: {lower:g} to {upper:g} {unit}".rstrip())
        for name, number in (("strides", self.strides), ("learning strides", self.learning_strides)):
            if number != int(number):
                raise InputError(f"{name} is {number:g}; allowed: a whole number")


@dataclass(frozen=True)
class GaitRig:
    """A rig that is ready for a gait run."""

    model: mujoco.MjModel
    """MuJoCo model of the rig."""
    options: GaitOptions
    """Options of the run."""
    reference: Reference
    """Reference in the frame of the ground: that of the options on their slope."""
    trajectory: HipTrajectory
    """Planned motion of the hip."""
    hip_path: HipPath
    """Correction of the planned motion."""
    command_interval: float
    """Time between commands [s]."""
    phase: Array
    """(n,) gait phase (0-1) at each command."""
    commands: Array
    """(n, 6) states of the drives at each command."""
    command_rates: Array
    """(n, 6) inputs of the drives: the rates to the next command."""
    carriage_height: Array
    """(n,) commanded height of the carriage [m]."""
    actuator: DeviceActuator
    """Actuator with the device."""

    @property
    def commands_per_stride(self) -> int:
        """Number of commands in a stride."""
        return len(self.phase)


def build_gait_rig(device: Device, options: GaitOptions, interval: float) -> GaitRig:
    """Return the rig for ``device``, commanded every ``interval`` [s], on the path and with the alignment of
    ``options``.

    Without a path in ``options`` the rig has the planned one, without an alignment that of the limb;
    :func:`klute_sim.gait.rig.learning.prepare_gait_rig` finds both.

    Raises InputError when the device does not fit into the rig.
    """
    model = build_gait_model(
        device,
        mass=options.mass,
        stature=options.stature,
        dt=options.dt,
        slope=options.slope,
        alignment=options.alignment or 0.0,
        spring_foot=options.spring_foot,
        model_edit=options.model_edit,
    )
    leg, reference, slope = measure_leg(model), options.reference.tilt_to_slope(options.slope), options.slope
    alignment = options.alignment or 0.0
    stride_time = plan_hip_trajectory(reference, leg, reference.stride_time, options.speed, slope).stride_time
    n_commands = round(stride_time / interval)
    trajectory = plan_hip_trajectory(reference, leg, n_commands * interval, None, slope, alignment)
    phase = np.arange(n_commands) / n_commands
    gait_rig = GaitRig(
        model=model,
        options=options,
        reference=reference,
        trajectory=trajectory,
        hip_path=PLANNED_PATH,
        command_interval=interval,
        phase=phase,
        commands=np.empty(0),
        command_rates=np.empty(0),
        carriage_height=np.empty(0),
        actuator=DeviceActuator(model, PROSTHESIS_PREFIX + "muscle_tendon"),
    )
    return apply_hip_path(gait_rig, PLANNED_PATH if options.hip_path is None else options.hip_path)


def apply_hip_path(gait_rig: GaitRig, hip_path: HipPath) -> GaitRig:
    """Return ``gait_rig`` with the commands of ``hip_path``.

    The drives hold the planned angles, and the planned position of the hip with its correction. The two forces carry
    the weight and the inertia of the rig along this path, ``m (g sin(slope) + x'')`` and ``m (g cos(slope) + z'')``; no
    load of the reference is fed forward.
    """
    model, trajectory, phase = gait_rig.model, gait_rig.trajectory, gait_rig.phase
    time, slope = trajectory.stride_time, gait_rig.options.slope
    displacement, rate, acceleration = (hip_path.evaluate(phase, order) / time**order for order in range(3))
    position = np.column_stack(
        [
            np.asarray(trajectory.travel(phase)) * time + displacement[:, 0],
            np.asarray(trajectory.height(phase)) + displacement[:, 1],
            compute_thigh_angle(gait_rig.reference, phase),
            compute_knee_angle(gait_rig.reference, phase),
        ]
    )
    velocity = np.column_stack(
        [
            np.asarray(trajectory.velocity(phase)) + rate[:, 0],
            np.asarray(trajectory.height(phase, 1)) / time + rate[:, 1],
            compute_thigh_angle(gait_rig.reference, phase, 1) / time,
            compute_knee_angle(gait_rig.reference, phase, 1) / time,
        ]
    )
    lead = -model.actuator_biasprm[:4, 2] / model.actuator_gainprm[:4, 0]
    planned = np.column_stack(
        [np.asarray(trajectory.velocity(phase, 1)) / time, np.asarray(trajectory.height(phase, 2)) / time**2]
    )
    gravity = GRAVITY * np.array([math.sin(slope), math.cos(slope)])
    forces = float(model.body_mass.sum()) * (gravity + planned + acceleration)
    commands = np.column_stack([position + lead * velocity, forces])
    next_commands = np.roll(commands, -1, axis=0)
    next_commands[-1, 0] += trajectory.stride_length
    return replace(
        gait_rig,
        hip_path=hip_path,
        commands=commands,
        command_rates=(next_commands - commands) / gait_rig.command_interval,
        carriage_height=position[:, 1],
    )


def reset_gait_rig(gait_rig: GaitRig, data: mujoco.MjData, pressure: float, ankle_offset: float = 0.0) -> None:
    """Set ``data`` to the posture and velocities of the reference at heel strike.

    The tendon is just taut at the gauge ``pressure`` [Pa]. ``ankle_offset`` [rad] is added to the ankle angle of the
    reference, dorsiflexion positive.
    """
    mujoco.mj_resetData(gait_rig.model, data)
    trajectory, reference, zero = gait_rig.trajectory, gait_rig.reference, np.zeros(1)
    ankle = gait_rig.model.joint(PROSTHESIS_PREFIX + "ankle")
    displacement, rate = (gait_rig.hip_path.evaluate(zero, order)[0] for order in range(2))
    data.qpos[:4] = [
        displacement[0],
        float(trajectory.height(0.0)) + displacement[1],
        compute_thigh_angle(reference, zero)[0],
        compute_knee_angle(reference, zero)[0],
    ]
    data.qvel[:4] = [
        float(trajectory.velocity(0.0)) + rate[0] / trajectory.stride_time,
        (float(trajectory.height(0.0, 1)) + rate[1]) / trajectory.stride_time,
        compute_thigh_angle(reference, zero, 1)[0] / trajectory.stride_time,
        compute_knee_angle(reference, zero, 1)[0] / trajectory.stride_time,
    ]
    dorsiflexion = math.radians(reference("ankle_dorsiflexion_deg", zero)[0]) + ankle_offset
    data.qpos[ankle.qposadr[0]] = (gait_rig.options.alignment or 0.0) - dorsiflexion
    data.act[: len(DRIVE_ACTUATORS)] = gait_rig.commands[0]
    forward_without_devices(gait_rig.model, data)
    actuator = gait_rig.actuator
    actuator.set_state(data, compute_taut_state(actuator.parameters, actuator.get_unit_length(data), pressure))
