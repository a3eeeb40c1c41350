"""The gait rig: a driven residual limb, a tracked load, a free ankle.

As in a robotic gait simulator, the residual limb follows the reference's motion on stiff servos with velocity
feed-forward, and the reference's ground reaction is fed forward to the carriage. The *vertical ground reaction is
therefore tracked, not predicted*. The ankle is moved only by the device, its passive parts and the ground: its
angle, moment, power and work, the fore-aft force's timing and the centre of pressure are outcomes.
"""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.controllers.parse import Controller
from klute_sim.device.device import Device, check_takes_pressure
from klute_sim.device.dynamics import get_dead_time
from klute_sim.device.energy.ledger import EnergyRecorder
from klute_sim.errors import InputError, SimulationError
from klute_sim.gait.rig import setup
from klute_sim.gait.rig.commands import PressureCommands
from klute_sim.gait.rig.measurements import MEASURED_COLUMNS, GaitMeasurements
from klute_sim.gait.rig.setup import DRIVE_ACTUATORS, GaitOptions, GaitRig, build_gait_rig, reset_gait_rig
from klute_sim.plant import callbacks
from klute_sim.provenance import collect_versions
from klute_sim.recording.recording import Array, Recording
from klute_sim.units import BAR

MAX_SAMPLES = 2_000_000
"""Longest run; a sample takes about 1 kB of memory until the run is written."""

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


def simulate_gait(
    device: Device,
    controller: Controller,
    options: GaitOptions | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
    backend: str = "auto",
) -> Recording:
    """Walk ``device`` under ``controller``; every step is a sample.

    ``progress`` is told the finished fraction now and then, ``law`` is one of
    :data:`klute_sim.device.backend.select.LAWS`. Raises InputError for a device that does not fit, SimulationError when
    the rig leaves its path.
    """
    options = options or GaitOptions()
    check_takes_pressure(device, "the controller")
    rig = build_gait_rig(device, options, options.dt)
    model, data, actuator, per_stride = rig.model, mujoco.MjData(rig.model), rig.actuator, rig.commands_per_stride
    if per_stride * options.strides > MAX_SAMPLES:
        raise InputError(
            f"{options.strides} strides of {per_stride} steps are more than {MAX_SAMPLES} samples: take fewer strides "
            "or a longer step"
        )
    gauges, count, drives = GaitMeasurements(model, actuator), per_stride * options.strides, len(DRIVE_ACTUATORS)
    commands, late = PressureCommands(controller, rig, count), get_dead_time(actuator.parameters) / options.dt
    reset_gait_rig(rig, data, 0.0)
    reset_gait_rig(rig, data, commands.update(0, data))
    samples, book = np.empty((count, len(MEASURED_COLUMNS))), EnergyRecorder(actuator.parameters, count)
    with callbacks.device_callbacks(backend) as in_force:
        for k in range(count):
            j = k % per_stride
            data.ctrl[:drives] = rig.command_rates[j]
            commands.update(k, data)
            actuator.set_command(data, commands.sample(k - late))
            q, v, before = data.qpos.copy(), data.qvel.copy(), actuator.get_state(data)
            callbacks.step_model(model, data)
            if not abs(data.qpos[1] - rig.carriage_height[j]) < setup.MAX_PATH_DEVIATION:
                raise SimulationError(
                    f"the gait rig left its path at t = {data.time:.3f} s ({100 * rig.phase[j]:.0f} % of stride "
                    f"{k // per_stride + 1}): device '{device.name}', {options.mass:g} kg, {rig.trajectory.speed:.2f} m/s"
                )
            after = actuator.state_after_step(model, data, before)
            muscle_rate = (after.length - before.length) / options.dt
            samples[k] = gauges.measure(data, q, v, after, muscle_rate)
            book.record_sample(k, after, actuator.unit_length(data), muscle_rate)
            if k % 200 == 0:
                progress(k / count)
    progress(1.0)
    columns = [(heading, samples[:, i]) for i, heading in enumerate(MEASURED_COLUMNS)]
    columns += book.to_energy_balance(options.dt).to_columns()
    return _build_recording(device, controller, rig, commands.pressures, columns, in_force)


def _build_recording(
    device: Device,
    controller: Controller,
    gait_rig: GaitRig,
    command: Array,
    measured_columns: list[tuple[str, Array]],
    backend: str,
) -> Recording:
    options, plan, per_stride = gait_rig.options, gait_rig.trajectory, gait_rig.commands_per_stride
    count, reference = per_stride * options.strides, gait_rig.reference
    index = np.arange(count)
    phase = (index % per_stride) / per_stride
    columns: list[tuple[str, NDArray[np.floating[Any]]]] = [
        ("time [s]", index * options.dt),
        ("gait_phase [%]", 100.0 * phase),
        ("stride [1]", index // per_stride + 1.0),
        ("pressure_command [bar]", command / BAR),
    ]
    columns += measured_columns
    # The reference's moment over its angle at another stride time: its power is that much slower or faster.
    power = options.mass * reference.stride_time / plan.stride_time
    factors = {"deg": 1.0, "N*m": options.mass, "N": options.mass, "W": power}
    for name, unit, column in REFERENCE_CHANNELS:
        columns.append((f"{name} [{unit}]", factors[unit] * reference(column, phase)))
    for name, unit, column in REFERENCE_DEVIATIONS:
        if reference.has_column(column):
            columns.append((f"{name} [{unit}]", factors[unit] * reference.standard_deviation(column, phase)))
    return Recording.from_columns(columns, _collect_provenance(device, controller, gait_rig, backend))


def _collect_provenance(device: Device, controller: Controller, gait_rig: GaitRig, backend: str) -> dict[str, Any]:
    options, plan = gait_rig.options, gait_rig.trajectory
    return {
        "rig": "gait",
        "device": {
            "name": device.name,
            "sha256": device.digest,
            "resting_length_m": device.parameters.muscle.resting_length,
            "assumed": device.spec.collect_assumptions(),
            "without_source": device.spec.list_unsourced_keys(),
            "valve": device.spec.valve is not None,
        },
        "controller": controller.describe(),
        "reference": {
            **{"name": options.reference.name, "sha256": options.reference.digest},
            **({} if options.reference.speed is None else {"speed_m_per_s": options.reference.speed}),
        },
        "options": {
            "mass_kg": options.mass,
            "stature_m": options.stature,
            "speed_m_per_s": plan.speed,
            "stride_time_s": plan.stride_time,
            "stride_length_m": plan.stride_length,
            "spring_foot_nm_per_deg": None
            if options.spring_foot is None
            else float(np.radians(options.spring_foot.stiffness)),
            "slope_deg": float(np.degrees(options.slope)),
            "strides": options.strides,
            "step_s": options.dt,
            "law": backend,
        },
        "seed": None,
        "versions": collect_versions(),
    }
