"""The gait rig put together: the model, the motion it follows, and the commands that make it follow.

Commands are given at a fixed *interval*, and drives move in straight lines between them. A stride is a whole number
of intervals, so that every stride has the same inputs.
"""

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np

from klute_sim.device.device import Device
from klute_sim.device.dynamics import compute_taut_state
from klute_sim.errors import InputError
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.reference import Reference, load_default_reference
from klute_sim.gait.rig import trajectory as paths
from klute_sim.gait.rig.build import MODEL_MASS, MODEL_STATURE, ModelEdit, build_gait_model, measure_leg
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.recording.recording import Array

DRIVE_ACTUATORS = ("carriage_x", "carriage_z", "thigh", "knee", "push", "lift")
"""Actuators of the model that are commanded by the rig; the first four are servos."""
MAX_PATH_DEVIATION = 0.3
"""Vertical distance of the carriage from its path [m] beyond which a run means nothing."""


@dataclass(frozen=True, kw_only=True)
class GaitOptions:
    """Who walks, how fast and how finely; validated when made."""

    mass: float = MODEL_MASS
    """Body mass [kg]."""
    stature: float = MODEL_STATURE
    """[m]"""
    speed: float | None = None
    """Walking speed [m/s]; None: what the reference's angles and stride time imply with these legs. A chosen speed
    scales the stride time."""
    slope: float = 0.0
    """Of the ground [rad], uphill positive. What is followed there is assumed (:meth:`Reference.on_slope`)."""
    strides: int = 5
    """Strides to walk, from heel strike to heel strike."""
    dt: float = 5e-4
    """Time step [s]."""
    reference: Reference = field(default_factory=load_default_reference)
    """What is followed and compared with."""
    spring_foot: SpringFoot | None = None
    """A passive foot in place of the device."""
    model_edit: ModelEdit | None = None
    """What else is changed of the model before it is compiled; a recording does not say what."""

    def __post_init__(self) -> None:
        """Raise InputError for a value no subject or solver has."""
        limits: list[tuple[str, float | None, float, float, str]] = [
            ("mass", self.mass, 20.0, 250.0, "kg"),
            ("stature", self.stature, 1.0, 2.4, "m"),
            ("speed", self.speed, 0.4, 2.5, "m/s"),
            ("slope", math.degrees(self.slope), -10.0, 10.0, "degrees"),
            ("strides", self.strides, 1, 200, ""),
            ("step", 1e3 * self.dt, 0.01, 1.0, "ms"),
        ]
        for name, value, low, high, unit in limits:
            if value is not None and not low <= value <= high:  # also refuses NaN
                raise InputError(f"{name} is {value:g}; allowed: {low:g} to {high:g} {unit}".rstrip())
        if self.strides != int(self.strides):
            raise InputError(f"strides is {self.strides:g}; allowed: a whole number")


@dataclass(frozen=True)
class GaitRig:
    """A rig ready to walk."""

    model: mujoco.MjModel
    options: GaitOptions
    reference: Reference
    """What is followed, in the frame of the ground: that of the options on their slope."""
    trajectory: paths.HipTrajectory
    command_interval: float
    """Between commands [s]."""
    phase: Array
    """(n,) phase of the stride [0-1] at each command."""
    commands: Array
    """(n, 6) states that the drives should have then."""
    command_rates: Array
    """(n, 6) what the drives are told then: the rates to the next command."""
    carriage_height: Array
    """(n,) planned height of the carriage [m]."""
    actuator: DeviceActuator

    @property
    def commands_per_stride(self) -> int:
        """Commands in a stride."""
        return len(self.phase)


def build_gait_rig(device: Device, options: GaitOptions, interval: float) -> GaitRig:
    """The rig for ``device``, commanded every ``interval`` [s]; raises InputError for a device that does not fit."""
    model = build_gait_model(
        device,
        mass=options.mass,
        stature=options.stature,
        dt=options.dt,
        slope=options.slope,
        spring_foot=options.spring_foot,
        model_edit=options.model_edit,
    )
    limb, reference, slope = measure_leg(model), options.reference.tilt_to_slope(options.slope), options.slope
    wanted = paths.plan_hip_trajectory(reference, limb, reference.stride_time, options.speed, slope).stride_time
    count = round(wanted / interval)
    plan = paths.plan_hip_trajectory(reference, limb, count * interval, None, slope)
    phase = np.arange(count) / count
    moved = float(model.body_mass.sum())
    commands = np.column_stack(
        [
            _compute_servo_commands(model, reference, plan, phase),
            paths.compute_forward_feedforward(reference, plan, moved, options.mass, phase, slope),
            paths.compute_vertical_feedforward(reference, plan, moved, options.mass, phase, slope),
        ]
    )
    after = np.roll(commands, -1, axis=0)
    after[-1, 0] += plan.stride_length
    return GaitRig(
        model=model,
        options=options,
        reference=reference,
        trajectory=plan,
        command_interval=interval,
        phase=phase,
        commands=commands,
        command_rates=(after - commands) / interval,
        carriage_height=np.asarray(plan.height(phase)),
        actuator=DeviceActuator(model, PROSTHESIS_PREFIX + "muscle_tendon"),
    )


def _compute_servo_commands(
    model: mujoco.MjModel, reference: Reference, trajectory: paths.HipTrajectory, phase: Array
) -> Array:
    """(n, 4) positions of the servos over a stride: ``q + (kv/kp) dq/dt``."""
    time = trajectory.stride_time
    position = np.column_stack(
        [
            np.asarray(trajectory.travel(phase)) * time,
            np.asarray(trajectory.height(phase)),
            paths.compute_thigh_angle(reference, phase),
            paths.compute_knee_angle(reference, phase),
        ]
    )
    velocity = np.column_stack(
        [
            np.asarray(trajectory.velocity(phase)),
            np.asarray(trajectory.height(phase, 1)) / time,
            paths.compute_thigh_angle(reference, phase, 1) / time,
            paths.compute_knee_angle(reference, phase, 1) / time,
        ]
    )
    lead = -model.actuator_biasprm[:4, 2] / model.actuator_gainprm[:4, 0]
    return np.asarray(position + lead * velocity)


def reset_gait_rig(gait_rig: GaitRig, data: mujoco.MjData, pressure: float, ankle_offset: float = 0.0) -> None:
    """Posture and velocities of the reference at heel strike, the device taut at ``pressure`` [Pa].

    ``ankle_offset`` [rad] is added to the reference's ankle angle, dorsiflexion positive.
    """
    mujoco.mj_resetData(gait_rig.model, data)
    plan, reference, zero = gait_rig.trajectory, gait_rig.reference, np.zeros(1)
    ankle = gait_rig.model.joint(PROSTHESIS_PREFIX + "ankle")
    data.qpos[1:4] = [
        float(plan.height(0.0)),
        paths.compute_thigh_angle(reference, zero)[0],
        paths.compute_knee_angle(reference, zero)[0],
    ]
    data.qvel[:4] = [
        float(plan.velocity(0.0)),
        float(plan.height(0.0, 1)) / plan.stride_time,
        paths.compute_thigh_angle(reference, zero, 1)[0] / plan.stride_time,
        paths.compute_knee_angle(reference, zero, 1)[0] / plan.stride_time,
    ]
    data.qpos[ankle.qposadr[0]] = -math.radians(reference("ankle_dorsiflexion_deg", zero)[0]) - ankle_offset
    data.act[: len(DRIVE_ACTUATORS)] = gait_rig.commands[0]
    mujoco.mj_forward(gait_rig.model, data)
    gait_rig.actuator.set_state(
        data, compute_taut_state(gait_rig.actuator.parameters, gait_rig.actuator.unit_length(data), pressure)
    )
