"""The gait rig: a driven residual limb, a tracked load, a free ankle.

As in a robotic gait simulator, the residual limb follows the reference's motion on stiff servos with velocity
feed-forward, and the reference's ground reaction is fed forward to the carriage. The *vertical ground reaction is
therefore tracked, not predicted*. The ankle is moved only by the device, its passive parts and the ground: its
angle, moment, power and work, the fore-aft force's timing and the centre of pressure are outcomes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.control.pressure import PressureController
from klute_sim.device.files import Device
from klute_sim.device.step import State
from klute_sim.errors import InputError, SimulationError
from klute_sim.laws import mckibben
from klute_sim.plant import router
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.provenance import versions
from klute_sim.recording.recording import Recording, Samples
from klute_sim.rigs.gait import motion as paths
from klute_sim.rigs.gait.build import ANKLE, MODEL_MASS, MODEL_STATURE, build, leg
from klute_sim.rigs.gait.gauges import CHANNELS, Gauges
from klute_sim.rigs.gait.reference import Reference, default
from klute_sim.units import BAR

MOST_SAMPLES = 2_000_000
"""Longest run; a sample takes about 1 kB of memory until the run is written."""
OFF_PATH = 0.3
"""Vertical distance of the carriage from its path [m] beyond which a run means nothing."""

REFERENCE_CHANNELS = (
    ("reference_ankle_angle", "deg", "ankle_dorsiflexion_deg"),
    ("reference_ankle_moment", "N*m", "ankle_plantarflexor_moment_nm_per_kg"),
    ("reference_ankle_power", "W", "ankle_power_w_per_kg"),
    ("reference_grf_vertical", "N", "grf_vertical_n_per_kg"),
    ("reference_grf_forward", "N", "grf_forward_n_per_kg"),
)
REFERENCE_DEVIATIONS = (
    ("reference_ankle_angle_sd", "deg", "ankle_dorsiflexion_sd_deg"),
    ("reference_ankle_moment_sd", "N*m", "ankle_moment_sd_nm_per_kg"),
    ("reference_ankle_power_sd", "W", "ankle_power_sd_w_per_kg"),
)
"""Channel, unit, reference column."""


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
    strides: int = 5
    """Strides to walk, from heel strike to heel strike."""
    step: float = 5e-4
    """Time step [s]."""
    reference: Reference = field(default_factory=default)
    """What is followed and compared with."""

    def __post_init__(self) -> None:
        """Raise InputError for a value no subject or solver has."""
        limits: list[tuple[str, float | None, float, float, str]] = [
            ("mass", self.mass, 20.0, 250.0, "kg"),
            ("stature", self.stature, 1.0, 2.4, "m"),
            ("speed", self.speed, 0.4, 2.5, "m/s"),
            ("strides", self.strides, 1, 200, ""),
            ("step", 1e3 * self.step, 0.01, 1.0, "ms"),
        ]
        for name, value, low, high, unit in limits:
            if value is not None and not low <= value <= high:  # also refuses NaN
                raise InputError(f"{name} is {value:g}; allowed: {low:g} to {high:g} {unit}".rstrip())


def walk(
    device: Device,
    controller: PressureController,
    options: GaitOptions | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Recording:
    """Walk ``device`` under ``controller``; every step is a sample.

    ``progress`` is told the finished fraction now and then. Raises InputError for a device that does not fit,
    SimulationError when the rig leaves its path.
    """
    options = options or GaitOptions()
    model = build(device, mass=options.mass, stature=options.stature, step=options.step)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    data = mujoco.MjData(model)
    actuator = DeviceActuator(model, ANKLE + "muscle_tendon", device.parameters)
    gauges = Gauges(model, actuator)

    limb = leg(model)
    stride_time = paths.plan(options.reference, limb, options.reference.stride_time, options.speed).stride_time
    # A stride is a whole number of steps, so that every stride has the same inputs.
    per_stride = round(stride_time / options.step)
    if per_stride * options.strides > MOST_SAMPLES:
        raise InputError(
            f"{options.strides} strides of {per_stride} steps are more than {MOST_SAMPLES} samples: take fewer strides "
            "or a longer step"
        )
    plan = paths.plan(options.reference, limb, per_stride * options.step)
    phase = np.arange(per_stride) / per_stride
    servo = _servo_commands(model, options.reference, plan, phase)
    moved = float(model.body_mass.sum())
    lift = paths.vertical_feedforward(options.reference, plan, moved, options.mass, phase)
    push = paths.forward_feedforward(options.reference, plan, moved, options.mass, phase)
    pressure = np.array([controller.pressure(float(p)) for p in phase])
    planned_height = np.asarray(plan.height(phase))

    _start(model, data, actuator, options.reference, plan, controller)
    count = per_stride * options.strides
    samples = np.empty((count, len(CHANNELS)))
    with router.installed():
        for k in range(count):
            j = k % per_stride
            data.ctrl[:4] = servo[j]
            data.ctrl[0] += (k // per_stride) * plan.stride_length
            data.qfrc_applied[0] = push[j]
            data.qfrc_applied[1] = lift[j]
            actuator.command(data, pressure[j])
            q, v, before = data.qpos.copy(), data.qvel.copy(), actuator.state(data)
            mujoco.mj_step(model, data)
            if not abs(data.qpos[1] - planned_height[j]) < OFF_PATH:
                raise SimulationError(
                    f"the gait rig left its path at t = {data.time:.3f} s ({100 * phase[j]:.0f} % of stride "
                    f"{k // per_stride + 1}): device '{device.name}', {options.mass:g} kg, {plan.speed:.2f} m/s"
                )
            samples[k] = gauges.read(data, q, v, before)
            if k % 200 == 0:
                progress(k / count)
    progress(1.0)
    return _recording(device, controller, options, plan, pressure, samples, per_stride)


def _servo_commands(model: mujoco.MjModel, reference: Reference, plan: paths.Motion, phase: Samples) -> Samples:
    """(n, 4) commands of the position servos over a stride: ``q + (kv/kp) dq/dt``."""
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


def _start(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    actuator: DeviceActuator,
    reference: Reference,
    plan: paths.Motion,
    controller: PressureController,
) -> None:
    """The reference's posture and velocities at heel strike, the device at its first command."""
    zero, time = np.zeros(1), plan.stride_time
    ankle = model.joint(ANKLE + "ankle")
    data.qpos[1:4] = [
        float(plan.height(0.0)),
        paths.thigh_angle(reference, zero)[0],
        paths.knee_angle(reference, zero)[0],
    ]
    data.qvel[:4] = [
        float(plan.velocity(0.0)),
        float(plan.height(0.0, 1)) / time,
        paths.thigh_angle(reference, zero, 1)[0] / time,
        paths.knee_angle(reference, zero, 1)[0] / time,
    ]
    data.qpos[ankle.qposadr[0]] = -math.radians(reference("ankle_dorsiflexion_deg", zero)[0])
    mujoco.mj_forward(model, data)
    parameters = actuator.parameters
    taut = actuator.unit_length(data) - parameters.tendon.slack_length
    shortest, longest = mckibben.lock_length(parameters.muscle), parameters.muscle.resting_length
    pressure = min(max(controller.pressure(0.0), 0.0), parameters.supply.pressure)
    actuator.set_state(data, State(pressure, min(max(taut, shortest), longest)))


def _recording(
    device: Device,
    controller: PressureController,
    options: GaitOptions,
    plan: paths.Motion,
    command: Samples,
    samples: Samples,
    per_stride: int,
) -> Recording:
    count, reference = len(samples), options.reference
    index = np.arange(count)
    phase = (index % per_stride) / per_stride
    columns: list[tuple[str, NDArray[np.floating[Any]]]] = [
        ("time [s]", index * options.step),
        ("gait_phase [%]", 100.0 * phase),
        ("stride [1]", index // per_stride + 1.0),
        ("pressure_command [bar]", np.tile(command, options.strides) / BAR),
    ]
    columns += [(heading, samples[:, i]) for i, heading in enumerate(CHANNELS)]
    # The reference's moment over its angle at another stride time: its power is that much slower or faster.
    power = options.mass * reference.stride_time / plan.stride_time
    factors = {"deg": 1.0, "N*m": options.mass, "N": options.mass, "W": power}
    for name, unit, column in REFERENCE_CHANNELS:
        columns.append((f"{name} [{unit}]", factors[unit] * reference(column, phase)))
    for name, unit, column in REFERENCE_DEVIATIONS:
        if reference.has(column):
            columns.append((f"{name} [{unit}]", factors[unit] * reference.deviation(column, phase)))
    return Recording.from_columns(columns, _provenance(device, controller, options, plan))


def _provenance(
    device: Device, controller: PressureController, options: GaitOptions, plan: paths.Motion
) -> dict[str, Any]:
    return {
        "rig": "gait",
        "device": {"name": device.name, "sha256": device.digest, "assumed": device.spec.assumed()},
        "controller": controller.describe(),
        "reference": {"name": options.reference.name, "sha256": options.reference.digest},
        "options": {
            "mass_kg": options.mass,
            "stature_m": options.stature,
            "speed_m_per_s": plan.speed,
            "stride_time_s": plan.stride_time,
            "stride_length_m": plan.stride_length,
            "strides": options.strides,
            "step_s": options.step,
        },
        "seed": None,
        "versions": versions(),
    }
