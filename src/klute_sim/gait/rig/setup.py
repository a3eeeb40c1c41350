"""Set up the gait rig: its model, the trajectory that it follows, and the commands of its drives.

Commands are given at a fixed *interval*, and the drives move in straight lines between them. A stride is a whole number
of intervals, so that all strides have the same inputs.
"""

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np

from klute_sim.device.device import Device
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.errors import InputError
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.reference import Reference, load_default_reference
from klute_sim.gait.rig.build import MODEL_MASS, MODEL_STATURE, ModelEdit, build_gait_model, measure_leg
from klute_sim.gait.rig.trajectory import (
    HipTrajectory,
    compute_forward_feedforward,
    compute_knee_angle,
    compute_thigh_angle,
    compute_vertical_feedforward,
    plan_hip_trajectory,
)
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
    model_edit: ModelEdit | None = None
    """Further change of the model before it is compiled; a recording does not describe it."""

    def __post_init__(self) -> None:
        """Raise InputError when a value is out of range."""
        limits: list[tuple[str, float | None, float, float, str]] = [
            ("mass", self.mass, 20.0, 250.0, "kg"),
            ("stature", self.stature, 1.0, 2.4, "m"),
            ("speed", self.speed, 0.4, 2.5, "m/s"),
            ("slope", math.degrees(self.slope), -10.0, 10.0, "degrees"),
            ("strides", self.strides, 1, 200, ""),
            ("time step", 1e3 * self.dt, 0.01, 1.0, "ms"),
        ]
        for name, value, lower, upper, unit in limits:
            if value is not None and not lower <= value <= upper:  # also rejects NaN
                raise InputError(f"{name} is {value:g}; allowed: {lower:g} to {upper:g} {unit}".rstrip())
        if self.strides != int(self.strides):
            raise InputError(f"strides is {self.strides:g}; allowed: a whole number")


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
    command_interval: float
    """Time between commands [s]."""
    phase: Array
    """(n,) gait phase (0-1) at each command."""
    commands: Array
    """(n, 6) states of the drives at each command."""
    command_rates: Array
    """(n, 6) inputs of the drives: the rates to the next command."""
    carriage_height: Array
    """(n,) planned height of the carriage [m]."""
    actuator: DeviceActuator
    """Actuator with the device."""

    @property
    def commands_per_stride(self) -> int:
        """Number of commands in a stride."""
        return len(self.phase)


def build_gait_rig(device: Device, options: GaitOptions, interval: float) -> GaitRig:
    """Return the rig for ``device``, commanded every ``interval`` [s].

    Raises InputError when the device does not fit into the rig.
    """
    model = build_gait_model(
        device,
        mass=options.mass,
        stature=options.stature,
        dt=options.dt,
        slope=options.slope,
        spring_foot=options.spring_foot,
        model_edit=options.model_edit,
    )
    leg, reference, slope = measure_leg(model), options.reference.tilt_to_slope(options.slope), options.slope
    stride_time = plan_hip_trajectory(reference, leg, reference.stride_time, options.speed, slope).stride_time
    n_commands = round(stride_time / interval)
    trajectory = plan_hip_trajectory(reference, leg, n_commands * interval, None, slope)
    phase = np.arange(n_commands) / n_commands
    moving_mass = float(model.body_mass.sum())
    commands = np.column_stack(
        [
            _compute_servo_commands(model, reference, trajectory, phase),
            compute_forward_feedforward(reference, trajectory, moving_mass, options.mass, phase, slope),
            compute_vertical_feedforward(reference, trajectory, moving_mass, options.mass, phase, slope),
        ]
    )
    next_commands = np.roll(commands, -1, axis=0)
    next_commands[-1, 0] += trajectory.stride_length
    return GaitRig(
        model=model,
        options=options,
        reference=reference,
        trajectory=trajectory,
        command_interval=interval,
        phase=phase,
        commands=commands,
        command_rates=(next_commands - commands) / interval,
        carriage_height=np.asarray(trajectory.height(phase)),
        actuator=DeviceActuator(model, PROSTHESIS_PREFIX + "muscle_tendon"),
    )


def _compute_servo_commands(
    model: mujoco.MjModel, reference: Reference, trajectory: HipTrajectory, phase: Array
) -> Array:
    """Return the servo positions (n, 4) over a stride, ``q + (kv/kp) dq/dt``."""
    time = trajectory.stride_time
    position = np.column_stack(
        [
            np.asarray(trajectory.travel(phase)) * time,
            np.asarray(trajectory.height(phase)),
            compute_thigh_angle(reference, phase),
            compute_knee_angle(reference, phase),
        ]
    )
    velocity = np.column_stack(
        [
            np.asarray(trajectory.velocity(phase)),
            np.asarray(trajectory.height(phase, 1)) / time,
            compute_thigh_angle(reference, phase, 1) / time,
            compute_knee_angle(reference, phase, 1) / time,
        ]
    )
    lead = -model.actuator_biasprm[:4, 2] / model.actuator_gainprm[:4, 0]
    return np.asarray(position + lead * velocity)


def reset_gait_rig(gait_rig: GaitRig, data: mujoco.MjData, pressure: float, ankle_offset: float = 0.0) -> None:
    """Set ``data`` to the posture and velocities of the reference at heel strike.

    The tendon is just taut at the gauge ``pressure`` [Pa]. ``ankle_offset`` [rad] is added to the ankle angle of the
    reference, dorsiflexion positive.
    """
    mujoco.mj_resetData(gait_rig.model, data)
    trajectory, reference, zero = gait_rig.trajectory, gait_rig.reference, np.zeros(1)
    ankle = gait_rig.model.joint(PROSTHESIS_PREFIX + "ankle")
    data.qpos[1:4] = [
        float(trajectory.height(0.0)),
        compute_thigh_angle(reference, zero)[0],
        compute_knee_angle(reference, zero)[0],
    ]
    data.qvel[:4] = [
        float(trajectory.velocity(0.0)),
        float(trajectory.height(0.0, 1)) / trajectory.stride_time,
        compute_thigh_angle(reference, zero, 1)[0] / trajectory.stride_time,
        compute_knee_angle(reference, zero, 1)[0] / trajectory.stride_time,
    ]
    data.qpos[ankle.qposadr[0]] = -math.radians(reference("ankle_dorsiflexion_deg", zero)[0]) - ankle_offset
    data.act[: len(DRIVE_ACTUATORS)] = gait_rig.commands[0]
    forward_without_devices(gait_rig.model, data)
    actuator = gait_rig.actuator
    actuator.set_state(data, compute_taut_state(actuator.parameters, actuator.get_unit_length(data), pressure))
