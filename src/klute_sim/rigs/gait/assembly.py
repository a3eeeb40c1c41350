"""The gait rig put together: the model, the motion it follows, and the commands that make it follow.

Commands are given at a fixed *interval*, and drives move in straight lines between them. A stride is a whole number
of intervals, so that every stride has the same inputs.
"""

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np

from klute_sim.device.files import Device
from klute_sim.device.step import taut
from klute_sim.errors import InputError
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.recording.recording import Samples
from klute_sim.rigs.gait import motion as paths
from klute_sim.rigs.gait.body import ANKLE
from klute_sim.rigs.gait.build import MODEL_MASS, MODEL_STATURE, Edit, build, leg
from klute_sim.rigs.gait.reference import Reference, default
from klute_sim.rigs.gait.spring_foot import SpringFoot

DRIVES = ("carriage_x", "carriage_z", "thigh", "knee", "push", "lift")
"""Actuators of the model that are commanded by the rig; the first four are servos."""
OFF_PATH = 0.3
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
    step: float = 5e-4
    """Time step [s]."""
    reference: Reference = field(default_factory=default)
    """What is followed and compared with."""
    foot: SpringFoot | None = None
    """A passive foot in place of the device."""
    edit: Edit | None = None
    """What else is changed of the model before it is compiled; a recording does not say what."""

    def __post_init__(self) -> None:
        """Raise InputError for a value no subject or solver has."""
        limits: list[tuple[str, float | None, float, float, str]] = [
            ("mass", self.mass, 20.0, 250.0, "kg"),
            ("stature", self.stature, 1.0, 2.4, "m"),
            ("speed", self.speed, 0.4, 2.5, "m/s"),
            ("slope", math.degrees(self.slope), -10.0, 10.0, "degrees"),
            ("strides", self.strides, 1, 200, ""),
            ("step", 1e3 * self.step, 0.01, 1.0, "ms"),
        ]
        for name, value, low, high, unit in limits:
            if value is not None and not low <= value <= high:  # also refuses NaN
                raise InputError(f"{name} is {value:g}; allowed: {low:g} to {high:g} {unit}".rstrip())
        if self.strides != int(self.strides):
            raise InputError(f"strides is {self.strides:g}; allowed: a whole number")


@dataclass(frozen=True)
class Assembly:
    """A rig ready to walk."""

    model: mujoco.MjModel
    options: GaitOptions
    reference: Reference
    """What is followed, in the frame of the ground: that of the options on their slope."""
    plan: paths.Motion
    interval: float
    """Between commands [s]."""
    phase: Samples
    """(n,) phase of the stride [0-1] at each command."""
    commands: Samples
    """(n, 6) states that the drives should have then."""
    slopes: Samples
    """(n, 6) what the drives are told then: the rates to the next command."""
    height: Samples
    """(n,) planned height of the carriage [m]."""
    actuator: DeviceActuator

    @property
    def per_stride(self) -> int:
        """Commands in a stride."""
        return len(self.phase)


def assemble(device: Device, options: GaitOptions, interval: float) -> Assembly:
    """The rig for ``device``, commanded every ``interval`` [s]; raises InputError for a device that does not fit."""
    model = build(
        device,
        mass=options.mass,
        stature=options.stature,
        step=options.step,
        slope=options.slope,
        foot=options.foot,
        edit=options.edit,
    )
    limb, reference, slope = leg(model), options.reference.on_slope(options.slope), options.slope
    wanted = paths.plan(reference, limb, reference.stride_time, options.speed, slope).stride_time
    count = round(wanted / interval)
    plan = paths.plan(reference, limb, count * interval, None, slope)
    phase = np.arange(count) / count
    moved = float(model.body_mass.sum())
    commands = np.column_stack(
        [
            _servo_commands(model, reference, plan, phase),
            paths.forward_feedforward(reference, plan, moved, options.mass, phase, slope),
            paths.vertical_feedforward(reference, plan, moved, options.mass, phase, slope),
        ]
    )
    after = np.roll(commands, -1, axis=0)
    after[-1, 0] += plan.stride_length
    return Assembly(
        model=model,
        options=options,
        reference=reference,
        plan=plan,
        interval=interval,
        phase=phase,
        commands=commands,
        slopes=(after - commands) / interval,
        height=np.asarray(plan.height(phase)),
        actuator=DeviceActuator(model, ANKLE + "muscle_tendon"),
    )


def _servo_commands(model: mujoco.MjModel, reference: Reference, plan: paths.Motion, phase: Samples) -> Samples:
    """(n, 4) positions of the servos over a stride: ``q + (kv/kp) dq/dt``."""
    time = plan.stride_time
    position = np.column_stack(
        [
            np.asarray(plan.travel(phase)) * time,
            np.asarray(plan.height(phase)),
            paths.thigh_angle(reference, phase),
            paths.knee_angle(reference, phase),
        ]
    )
    velocity = np.column_stack(
        [
            np.asarray(plan.velocity(phase)),
            np.asarray(plan.height(phase, 1)) / time,
            paths.thigh_angle(reference, phase, 1) / time,
            paths.knee_angle(reference, phase, 1) / time,
        ]
    )
    lead = -model.actuator_biasprm[:4, 2] / model.actuator_gainprm[:4, 0]
    return np.asarray(position + lead * velocity)


def start(rig: Assembly, data: mujoco.MjData, pressure: float, ankle_offset: float = 0.0) -> None:
    """Posture and velocities of the reference at heel strike, the device taut at ``pressure`` [Pa].

    ``ankle_offset`` [rad] is added to the reference's ankle angle, dorsiflexion positive.
    """
    mujoco.mj_resetData(rig.model, data)
    plan, reference, zero = rig.plan, rig.reference, np.zeros(1)
    ankle = rig.model.joint(ANKLE + "ankle")
    data.qpos[1:4] = [
        float(plan.height(0.0)),
        paths.thigh_angle(reference, zero)[0],
        paths.knee_angle(reference, zero)[0],
    ]
    data.qvel[:4] = [
        float(plan.velocity(0.0)),
        float(plan.height(0.0, 1)) / plan.stride_time,
        paths.thigh_angle(reference, zero, 1)[0] / plan.stride_time,
        paths.knee_angle(reference, zero, 1)[0] / plan.stride_time,
    ]
    data.qpos[ankle.qposadr[0]] = -math.radians(reference("ankle_dorsiflexion_deg", zero)[0]) - ankle_offset
    data.act[: len(DRIVES)] = rig.commands[0]
    mujoco.mj_forward(rig.model, data)
    rig.actuator.set_state(data, taut(rig.actuator.parameters, rig.actuator.unit_length(data), pressure))
