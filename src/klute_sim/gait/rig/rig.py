"""The gait rig: a driven residual limb, a tracked load and a free ankle.

As in a robotic gait simulator, stiff servos with velocity feed-forward move the residual limb as in the reference, and
the path of the hip is learned until the foot carries the load of the reference (:mod:`klute_sim.gait.rig.learning`).
The *ground reaction is therefore tracked, not predicted*. Only the device, its passive parts and the ground move the
ankle: its angle, moment, power and work and the centre of pressure are outcomes.
"""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.controllers.parse import Controller
from klute_sim.device.delay import DelayLine
from klute_sim.device.device import Device, check_accepts_pressure
from klute_sim.device.dynamics import get_dead_time
from klute_sim.device.energy.ledger import EnergyRecorder
from klute_sim.errors import InputError, SimulationError
from klute_sim.gait.rig import setup
from klute_sim.gait.rig.commands import PressureCommands
from klute_sim.gait.rig.learning import prepare_gait_rig
from klute_sim.gait.rig.measurements import MEASURED_COLUMNS, GaitMeasurements
from klute_sim.gait.rig.setup import DRIVE_ACTUATORS, GaitOptions, GaitRig, reset_gait_rig
from klute_sim.plant import callbacks
from klute_sim.provenance import collect_versions
from klute_sim.recording.recording import Recording
from klute_sim.types import Array, ProgressCallback
from klute_sim.units import BAR

MAX_SAMPLES = 2_000_000
"""Maximum number of samples of a run; a sample takes about 1 kB of memory until the run is written."""
PROGRESS_INTERVAL_STEPS = 200
"""Number of time steps between two reports of progress."""

REFERENCE_CHANNELS = (
    ("reference_ankle_angle", "deg", "ankle_dorsiflexion_deg"),
    ("reference_ankle_moment", "N*m", "ankle_plantarflexor_moment_nm_per_kg"),
    ("reference_ankle_power", "W", "ankle_power_w_per_kg"),
    ("reference_grf_vertical", "N", "grf_vertical_n_per_kg"),
    ("reference_grf_forward", "N", "grf_forward_n_per_kg"),
)
"""Channel, unit and column of the reference."""
REFERENCE_DEVIATIONS = (
    ("reference_ankle_angle_sd", "deg", "ankle_dorsiflexion_sd_deg"),
    ("reference_ankle_moment_sd", "N*m", "ankle_moment_sd_nm_per_kg"),
    ("reference_ankle_power_sd", "W", "ankle_power_sd_w_per_kg"),
)
"""Channel, unit and column of the reference for standard deviations."""


def simulate_gait(
    device: Device,
    controller: Controller,
    options: GaitOptions | None = None,
    progress: ProgressCallback = lambda fraction, stage: None,
    backend: str = "auto",
) -> Recording:
    """Simulate a gait run of ``device`` under ``controller``, and return its recording with one sample per time step.

    ``backend`` is one of :data:`klute_sim.device.backend.select.BACKENDS`.

    Raises InputError when the device does not fit into the rig. Raises SimulationError when the rig leaves its path.
    """
    options = options or GaitOptions()
    check_accepts_pressure(device, "the controller")
    progress(0.0, "learning the path of the hip")
    gait_rig = prepare_gait_rig(device, controller, options, backend)
    options = gait_rig.options
    model, actuator, steps_per_stride = gait_rig.model, gait_rig.actuator, gait_rig.commands_per_stride
    data, n_steps, n_drives = mujoco.MjData(model), steps_per_stride * options.strides, len(DRIVE_ACTUATORS)
    if n_steps > MAX_SAMPLES:
        raise InputError(
            f"{options.strides} strides of {steps_per_stride} steps are more than {MAX_SAMPLES} samples; choose fewer "
            "strides or a longer time step"
        )
    measurements = GaitMeasurements(model, actuator, options.alignment or 0.0)
    commands = PressureCommands(controller, gait_rig, n_steps)
    delay_line = DelayLine(commands.pressures, get_dead_time(actuator.parameters), options.dt)
    # The sensors of a feedback controller need a posture before the first command, which the final reset then uses.
    reset_gait_rig(gait_rig, data, 0.0)
    reset_gait_rig(gait_rig, data, commands.update(0, data))
    samples, energy = np.empty((n_steps, len(MEASURED_COLUMNS))), EnergyRecorder(actuator.parameters, n_steps)
    with callbacks.device_callbacks(backend) as used_backend:
        for k in range(n_steps):
            j = k % steps_per_stride
            data.ctrl[:n_drives] = gait_rig.command_rates[j]
            commands.update(k, data)
            actuator.set_command(data, delay_line.sample(k))
            qpos, qvel, before = data.qpos.copy(), data.qvel.copy(), actuator.get_state(data)
            callbacks.step_model(model, data)
            if not abs(data.qpos[1] - gait_rig.carriage_height[j]) < setup.MAX_PATH_DEVIATION:
                raise SimulationError(
                    f"the gait rig left its path at t = {data.time:.3f} s ({100 * gait_rig.phase[j]:.0f} % of stride "
                    f"{k // steps_per_stride + 1}): device '{device.name}', {options.mass:g} kg, "
                    f"{gait_rig.trajectory.speed:.2f} m/s"
                )
            after = actuator.compute_state_after_step(model, data, before)
            muscle_velocity = (after.length - before.length) / options.dt
            samples[k] = measurements.measure(data, qpos, qvel, after, muscle_velocity)
            energy.record_sample(k, after, actuator.get_unit_length(data), muscle_velocity)
            if k % PROGRESS_INTERVAL_STEPS == 0:
                progress(k / n_steps, "simulating gait")
    progress(1.0, "simulating gait")
    columns = [(heading, samples[:, i]) for i, heading in enumerate(MEASURED_COLUMNS)]
    columns += energy.to_energy_balance(options.dt).to_columns()
    return _build_recording(device, controller, gait_rig, commands.pressures, columns, used_backend)


def _build_recording(
    device: Device,
    controller: Controller,
    gait_rig: GaitRig,
    command: Array,
    measured_columns: list[tuple[str, Array]],
    backend: str,
) -> Recording:
    options, reference, steps_per_stride = gait_rig.options, gait_rig.reference, gait_rig.commands_per_stride
    index = np.arange(steps_per_stride * options.strides)
    phase = (index % steps_per_stride) / steps_per_stride
    columns: list[tuple[str, NDArray[np.floating[Any]]]] = [
        ("time [s]", index * options.dt),
        ("gait_phase [%]", 100.0 * phase),
        ("stride [1]", index // steps_per_stride + 1.0),
        ("pressure_command [bar]", command / BAR),
    ]
    columns += measured_columns
    # Power is moment times angular velocity, so the power of the reference scales with the inverse of the stride time.
    power = options.mass * reference.stride_time / gait_rig.trajectory.stride_time
    factors = {"deg": 1.0, "N*m": options.mass, "N": options.mass, "W": power}
    for name, unit, column in REFERENCE_CHANNELS:
        columns.append((f"{name} [{unit}]", factors[unit] * reference(column, phase)))
    for name, unit, column in REFERENCE_DEVIATIONS:
        if reference.has_column(column):
            columns.append((f"{name} [{unit}]", factors[unit] * reference.compute_standard_deviation(column, phase)))
    return Recording.from_columns(columns, _collect_provenance(device, controller, gait_rig, backend))


def _describe_device(device: Device) -> dict[str, Any]:
    return {
        "name": device.name,
        "sha256": device.digest,
        "resting_length_m": device.parameters.muscle.resting_length,
        "assumed": device.spec.collect_assumptions(),
        "without_source": device.spec.list_unsourced_keys(),
        "valve": device.spec.valve is not None,
    }


def _collect_provenance(device: Device, controller: Controller, gait_rig: GaitRig, backend: str) -> dict[str, Any]:
    options, trajectory, foot = gait_rig.options, gait_rig.trajectory, gait_rig.options.spring_foot
    return {
        "rig": "gait",
        "device": _describe_device(device) if foot is None else {"name": foot.name},
        "foot": device.spec.describe_foot(),
        "controller": controller.describe(),
        "reference": {
            **{"name": options.reference.name, "sha256": options.reference.digest},
            **({} if options.reference.speed is None else {"speed_m_per_s": options.reference.speed}),
        },
        "options": {
            "mass_kg": options.mass,
            "stature_m": options.stature,
            "speed_m_per_s": trajectory.speed,
            "stride_time_s": trajectory.stride_time,
            "stride_length_m": trajectory.stride_length,
            "spring_foot_nm_per_deg": None if foot is None else float(np.radians(foot.stiffness)),
            "slope_deg": float(np.degrees(options.slope)),
            "alignment_deg": float(np.degrees(options.alignment or 0.0)),
            "strides": options.strides,
            "step_s": options.dt,
            "backend": backend,
        },
        "hip_path": gait_rig.hip_path.to_mapping(),
        "seed": None,
        "versions": collect_versions(),
    }
