"""Prepare the gait rig for a device and a controller: align the foot, and learn the path of the hip.

The path is learned from stride to stride, until the foot carries the load of the reference.

Robotic gait simulators correct their commanded path in this way (Aubin et al. 2012, known to us from citations only):
after each stride the path moves against the error of the ground reaction, within a bandwidth and in stance only. The
hip is position-controlled and the limb, the foot and the sole yield, so the load follows the path almost without delay:
``u <- u - gain LP(e) / K`` with the error ``e`` of the reaction [N], the low-pass filter ``LP`` and the stiffness ``K``
[N/m] between hip and ground. Nothing is fed forward, so nothing presses the foot down while it is in the air. The
vertical reaction moves the height, the fore-aft reaction the forward position.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.controllers.parse import Controller
from klute_sim.device.delay import DelayLine
from klute_sim.device.device import Device
from klute_sim.device.dynamics import get_dead_time
from klute_sim.errors import SimulationError
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.reference import STANCE_LOAD_BW
from klute_sim.gait.rig.build import get_alignment
from klute_sim.gait.rig.commands import PressureCommands
from klute_sim.gait.rig.hip_path import PLANNED_PATH, HipPath
from klute_sim.gait.rig.setup import (
    DRIVE_ACTUATORS,
    MAX_PATH_DEVIATION,
    GaitOptions,
    GaitRig,
    apply_hip_path,
    build_gait_rig,
    reset_gait_rig,
)
from klute_sim.plant import callbacks
from klute_sim.types import Array

N_HARMONICS = 18
"""Number of harmonics of a learned path (assumed)."""
PASS_HARMONICS = 12
"""Harmonics up to which the filter passes the whole error; from there it falls to zero at :data:`N_HARMONICS`
(assumed)."""
VERTICAL_GAIN, FORWARD_GAIN = 0.7, 0.5
"""Fraction of the error that a stride corrects, if the stiffnesses below are right (assumed)."""
VERTICAL_STIFFNESS, FORWARD_STIFFNESS = 25e3, 10e3
"""Stiffness between hip and ground [N/m] by which an error is converted into a displacement (assumed).

The vertical one is about that of liner, heel and sole in series, the other that of the servos of thigh and knee.
"""
HANGING_PHASES = 0.85, 0.95
"""Gait phases between which the angle of the hanging ankle is measured (assumed)."""
HANGING_HEIGHT_M = 0.2
"""Height to which the hip is lifted where the foot would touch the ground before it is aligned [m] (assumed)."""
MAX_ALIGNMENT = math.radians(25.0)
"""Largest alignment that is found automatically [rad] (assumed)."""
MAX_GROWTH = 1.3
"""Growth of the error over its best value at which the gains are halved and the best path is restored
(assumed)."""


class StrideReaction(NamedTuple):
    """Ground reaction and ankle in one stride of the learning, at each time step."""

    vertical: Array
    """Vertical ground reaction [body weights]."""
    forward: Array
    """Fore-aft ground reaction [body weights]."""
    dorsiflexion: Array
    """Ankle angle [rad]."""


class LearningRun:
    """Continuous simulation whose path may change between strides."""

    def __init__(self, device: Device, controller: Controller, gait_rig: GaitRig, max_strides: int) -> None:
        """Start at the heel strike of the reference."""
        self._device = device
        model, dt = gait_rig.model, gait_rig.command_interval
        self._data, self._n_strides = mujoco.MjData(model), 0
        self._commands = PressureCommands(controller, gait_rig, max_strides * gait_rig.commands_per_stride)
        self._delay_line = DelayLine(self._commands.pressures, get_dead_time(gait_rig.actuator.parameters), dt)
        self._ground_index = int(model.sensor("ground").adr[0])
        self._ankle_index = int(model.joint(PROSTHESIS_PREFIX + "ankle").qposadr[0])
        reset_gait_rig(gait_rig, self._data, 0.0)
        reset_gait_rig(gait_rig, self._data, self._commands.update(0, self._data))

    def simulate_stride(self, gait_rig: GaitRig) -> StrideReaction:
        """Return the reaction in the next stride on the path of ``gait_rig``; needs the callbacks of the device.

        Raises SimulationError when the carriage leaves its path.
        """
        data, model, n_steps = self._data, gait_rig.model, gait_rig.commands_per_stride
        n_drives, first = len(DRIVE_ACTUATORS), self._n_strides * n_steps
        data.act[:n_drives] = gait_rig.commands[0]
        data.act[0] += self._n_strides * gait_rig.trajectory.stride_length
        samples = np.empty((n_steps, 3))
        for j in range(n_steps):
            data.ctrl[:n_drives] = gait_rig.command_rates[j]
            self._commands.update(first + j, data)
            gait_rig.actuator.set_command(data, self._delay_line.sample(first + j))
            callbacks.step_model(model, data)
            fx, _, fz = data.sensordata[self._ground_index : self._ground_index + 3]
            samples[j] = fz, fx, -data.qpos[self._ankle_index]
            if not abs(data.qpos[1] - gait_rig.carriage_height[j]) < MAX_PATH_DEVIATION:
                raise SimulationError(
                    f"the gait rig left its path while it learned it, in stride {self._n_strides + 1}: device "
                    f"'{self._device.name}', {gait_rig.options.mass:g} kg, {gait_rig.trajectory.speed:.2f} m/s"
                )
        self._n_strides += 1
        weight = gait_rig.options.mass * GRAVITY
        return StrideReaction(samples[:, 0] / weight, samples[:, 1] / weight, samples[:, 2])


def prepare_gait_rig(device: Device, controller: Controller, options: GaitOptions, backend: str = "auto") -> GaitRig:
    """Return the rig, commanded at each time step, with the alignment and the path of the hip for ``controller``.

    Its options hold both, so :func:`klute_sim.gait.rig.setup.build_gait_rig` builds the same rig from them.

    Raises InputError when the device does not fit into the rig, SimulationError when the carriage leaves its path.
    """
    prepared, learner = options, remove_valve(device)
    if options.alignment is None:
        prepared = replace(options, alignment=get_alignment(device))
    gait_rig = build_gait_rig(learner, prepared, options.dt)
    with callbacks.device_callbacks(backend):
        if prepared.alignment is None:
            prepared = replace(prepared, alignment=find_alignment(learner, controller, gait_rig))
            gait_rig = build_gait_rig(learner, prepared, options.dt)
        if options.hip_path is None and options.learning_strides:
            prepared = replace(prepared, hip_path=learn_hip_path(learner, controller, gait_rig))
    return build_gait_rig(device, replace(prepared, hip_path=prepared.hip_path or PLANNED_PATH), options.dt)


def remove_valve(device: Device) -> Device:
    """Return ``device``, or, if it takes valve openings, the same device behind an ideal regulator.

    A path is learned with commanded pressures.
    """
    if device.parameters.supply.command_is_opening == 0.0:
        return device
    sections = {"valve": None, "chamber": None, "line": None, "leak": None, "tank": None}
    return Device.from_spec(device.spec.model_copy(update=sections), device.content)


def find_alignment(device: Device, controller: Controller, gait_rig: GaitRig) -> float:
    """Return the alignment [rad] with which the hanging foot meets the ground as that of the reference does.

    ``gait_rig`` has the alignment 0. The ankle hangs at the angle of its late swing; the difference to the reference at
    heel strike on level ground is the alignment. A foot that points down so far that it would touch the ground in late
    swing hangs in a stride above the ground. Call it inside :func:`klute_sim.plant.callbacks.device_callbacks`.
    """
    low, high = HANGING_PHASES
    late_swing = (gait_rig.phase > low) & (gait_rig.phase < high)
    reaction = LearningRun(device, controller, gait_rig, 1).simulate_stride(gait_rig)
    hangs = late_swing & (reaction.vertical == 0.0)
    if not hangs.any():
        lifted = apply_hip_path(gait_rig, HipPath(np.array([[0.0], [HANGING_HEIGHT_M]], dtype=np.complex128)))
        reaction, hangs = LearningRun(device, controller, lifted, 1).simulate_stride(lifted), late_swing
    at_strike = math.radians(gait_rig.options.reference("ankle_dorsiflexion_deg", np.zeros(1))[0])
    return min(max(at_strike - float(reaction.dorsiflexion[hangs].mean()), -MAX_ALIGNMENT), MAX_ALIGNMENT)


def learn_hip_path(device: Device, controller: Controller, gait_rig: GaitRig) -> HipPath:
    """Return the path that ``gait_rig``, commanded at each time step, learns for ``device``.

    Learning ends with the path that meets the tolerances, or after ``options.learning_strides`` with the path of least
    error. Call it inside :func:`klute_sim.plant.callbacks.device_callbacks`.

    Raises SimulationError when the carriage leaves its path.
    """
    weight, phase = gait_rig.options.mass * GRAVITY, gait_rig.phase
    reference = np.column_stack(
        [gait_rig.reference(name, phase) / GRAVITY for name in ("grf_forward_n_per_kg", "grf_vertical_n_per_kg")]
    )
    stance = reference[:, 1] > STANCE_LOAD_BW
    displacement_per_bw = weight / np.array([FORWARD_STIFFNESS, VERTICAL_STIFFNESS])
    gains = np.array([FORWARD_GAIN, VERTICAL_GAIN])
    run = LearningRun(device, controller, gait_rig, gait_rig.options.learning_strides)
    # The load compresses limb and foot, so the path begins lower by that much.
    start = -reference * displacement_per_bw * (0.0, 1.0)
    samples = best_samples = apply_low_pass(start)
    best, best_error = PLANNED_PATH, math.inf
    for stride in range(1, gait_rig.options.learning_strides + 1):
        trial = apply_hip_path(gait_rig, HipPath.from_samples(samples, N_HARMONICS))
        reaction = run.simulate_stride(trial)
        measured = np.column_stack([reaction.forward, reaction.vertical])
        error = reference - measured
        forward_rms, vertical_rms = np.sqrt(np.mean(error[stance] ** 2, axis=0))
        learned = replace(
            trial.hip_path,
            learning_strides=stride,
            vertical_residual_bw=float(vertical_rms),
            forward_residual_bw=float(forward_rms),
            max_learning_strides=gait_rig.options.learning_strides,
        )
        if learned.has_converged:
            return learned
        if not vertical_rms + forward_rms > best_error:
            best_error, best_samples, best = vertical_rms + forward_rms, samples, learned
        elif vertical_rms + forward_rms > MAX_GROWTH * best_error:
            gains, samples = 0.5 * gains, best_samples
            continue
        is_loaded = (reference[:, 1] > 0.0) | (reaction.vertical > 0.0)
        samples = samples - apply_low_pass(np.where(is_loaded[:, None], error, 0.0)) * gains * displacement_per_bw
    return best


def apply_low_pass(samples: Array) -> Array:
    """Return periodic ``samples`` (n, m) over a stride without the harmonics above the bandwidth."""
    spectrum = np.fft.rfft(samples, axis=0)
    harmonics = np.arange(len(spectrum))
    passed = np.clip((N_HARMONICS - harmonics) / (N_HARMONICS - PASS_HARMONICS), 0.0, 1.0)
    return np.asarray(np.fft.irfft(spectrum * passed[:, None], len(samples), axis=0))
