"""Equations of a mechanism, evaluated with measured channels: of its joints (inverse dynamics) and of its devices.

Drives impose the measured positions, and supplies the measured pressures (the commands where none were measured). What
the drive of a joint must add is what the equation of this joint lacks. Where the force of a device was measured, it
replaces the simulated one in the equations of the joints, and the difference is the residual of the device. The same is
done with simulated channels, and the difference removes the influence of smoothing, of sampling and of the unknown
states at the start.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from klute_sim.datasets.mechanism_channels import normalize_name
from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.experiments.base import DeviceResponse, SimulationSetup
from klute_sim.diagnosis.experiments.initial_motion import MOTION_QUANTITIES
from klute_sim.diagnosis.experiments.mechanism import PRESSURE_QUANTITIES, MechanismExperiment
from klute_sim.diagnosis.localization.device_equations import find_unlimited_samples
from klute_sim.errors import SimulationError
from klute_sim.mechanism import drives
from klute_sim.mechanism.assembly import compute_unit_lengths
from klute_sim.mechanism.simulate import MechanismRollout, simulate_mechanism
from klute_sim.types import Array

SMOOTHING_TIME = 0.02
"""Standard deviation [s] of the Gaussian that smooths positions, whose second derivative is needed (assumed: it passes
what happens within a tenth of a second)."""
SETTLING_FRACTION = 0.05
"""Fraction of a trial at both ends that is left out: the states at the start are unknown, and smoothing needs both
sides."""
MIN_SAMPLES = 40
"""Minimum number of samples of a trial."""
DEVICE_EQUATION = "muscle, damper or tendon"
"""Kind of the equation of a device: nobody measures the length of a muscle in a mechanism."""
POSITION_CHANGE = 1e-5
"""Change of a position [rad or m] that measures moment arms."""


class MechanismEquation(NamedTuple):
    """An equation of a mechanism."""

    kind: str
    """Kind of the equation."""
    part: str
    """Joint or device that it belongs to."""


def name_equation(kind: str, part: str | None) -> str:
    """Return the name of an equation; ``part`` is its joint or device in a mechanism."""
    if part is None:
        return kind
    return kind.replace("joint", f"joint '{part}'") if "joint" in kind else f"{kind} of '{part}'"


def list_mechanism_equations(experiment: MechanismExperiment) -> dict[str, MechanismEquation]:
    """Return the equations that the channels of ``experiment`` can check, by name.

    A supply needs command and pressure of its device. Muscle, damper and tendon of a device need its force and its
    pressure; without the forces of all devices, those of the others are simulated, and a joint is checked together with
    them. There are none unless the position of every joint that is not driven is measured.
    """
    if not experiment.has_known_motion:
        return {}
    equations = []
    for device in experiment.devices:
        command, pressure, force = _name_channels(device)
        if pressure in experiment.measured and command in experiment.inputs:
            equations.append(MechanismEquation("supply", device))
        if force in experiment.measured and (pressure in experiment.measured or pressure in experiment.inputs):
            equations.append(MechanismEquation(DEVICE_EQUATION, device))
    is_complete = all(_name_channels(device)[2] in experiment.measured for device in experiment.devices)
    ending = "" if is_complete else " or its devices"
    equations += [MechanismEquation(f"{kind}{ending}", joint) for joint, kind in experiment.joint_kinds.items()]
    return {name_equation(*equation): equation for equation in equations}


def compute_mechanism_residual_series(experiment: MechanismExperiment, setup: SimulationSetup) -> dict[str, TimeSeries]:
    """Return the residual [SI] of each equation that can be checked, at measured samples, by the equation's name.

    Empty where the measured channels have no common clock, or a simulation diverges.
    """
    equations = list_mechanism_equations(experiment)
    measured = experiment.measured
    clocks = [series.time for series in measured.values()]
    if not equations or len(clocks[0]) < MIN_SAMPLES or not all(np.array_equal(c, clocks[0]) for c in clocks):
        return {}
    time = clocks[0]
    try:
        simulated = _sample(experiment, experiment.simulate(setup), time)
        rows = [
            _evaluate_equations(experiment, setup, time, channels)
            for channels in ({name: series.value for name, series in measured.items()}, simulated)
        ]
    except SimulationError:
        return {}
    is_used = find_unlimited_samples({name: series.value for name, series in measured.items()}, experiment.limits)
    n_omitted = int(np.ceil(SETTLING_FRACTION * len(time)))
    is_used[:n_omitted] = is_used[-n_omitted:] = False
    residuals = {}
    for name, (kind, part) in equations.items():
        if kind == "supply":
            pressure = _name_channels(part)[1]
            residual = measured[pressure].value - simulated[pressure]
        else:
            index = int(kind == DEVICE_EQUATION)
            residual = rows[0][index][part] - rows[1][index][part]
        residuals[name] = TimeSeries(time[is_used], residual[is_used])
    return residuals


def _name_channels(device: str) -> tuple[str, str, str]:
    """Return the channels of ``device``: command, pressure and force."""
    command, pressure = (f"{quantity}_{normalize_name(device)}" for quantity in PRESSURE_QUANTITIES)
    return command, pressure, f"force_{normalize_name(device)}"


def _sample(experiment: MechanismExperiment, response: DeviceResponse, time: Array) -> dict[str, Array]:
    """Return the simulated channels at ``time`` [s]."""
    return {name: np.interp(time, response.time, response.read_channel(name)) for name in experiment.measured}


def _evaluate_equations(
    experiment: MechanismExperiment, setup: SimulationSetup, time: Array, channels: Mapping[str, Array]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return what each joint [N m or N] and each device with a measured force [N] lacks under ``channels``."""
    joints = {
        binding.name: name
        for name, binding in experiment.outputs.items()
        if binding.channel.quantity in MOTION_QUANTITIES and binding.name in experiment.joint_kinds
    }
    grid = np.arange(time[0], time[-1], experiment.dt)
    step_times = experiment.start_time + experiment.dt * np.arange(1, len(experiment.command) + 1)
    inputs = {name: np.interp(grid, step_times, values) for name, values in experiment.inputs.items()}
    for device in experiment.devices:
        command, pressure, _ = _name_channels(device)
        if pressure in channels:
            inputs.pop(command, None)
            inputs[pressure] = np.interp(grid, time, channels[pressure])
    loads = {
        binding.name: inputs.pop(name)
        for name, binding in experiment.mechanism.bindings.items()
        if binding.channel.quantity.startswith("external") and binding.name in joints
    }
    width = SMOOTHING_TIME / float(np.median(np.diff(time)))
    for name in joints.values():
        smooth = gaussian_filter1d(channels[name], width, mode="nearest")
        inputs[name] = np.asarray(CubicSpline(time, smooth)(grid), dtype=np.float64)
    mechanism = replace(experiment.mechanism, prescribed=tuple(inputs))
    parameters = setup.devices or tuple(device.parameters for device in experiment.devices.values())
    devices = dict(zip(experiment.devices, parameters, strict=True))
    numbers = {**experiment.numbers, **dict(setup.model_numbers)}
    rollout = simulate_mechanism(mechanism, devices, inputs, experiment.dt, numbers=numbers)
    excess = {
        device: channels[force] - np.interp(time, grid, rollout.trace_device(device).tension)
        for device in experiment.devices
        for force in (_name_channels(device)[2],)
        if force in channels
    }
    moments = {}
    for joint in joints:
        armature = numbers.get(f"model.joint.{joint}.armature", float(mechanism.spec.joint(joint).armature))
        moment = np.interp(time, grid, _compute_drive_moment(rollout, joint, armature) - loads.get(joint, 0.0))
        if excess:
            positions = {
                binding.name: np.interp(time, grid, inputs[name])
                for name, binding in mechanism.bindings.items()
                if binding.channel.quantity in MOTION_QUANTITIES
            }
            changed = {**positions, joint: positions[joint] + POSITION_CHANGE}
            before, after = (compute_unit_lengths(mechanism, numbers, p) for p in (positions, changed))
            moment += sum(f * (after[device] - before[device]) / POSITION_CHANGE for device, f in excess.items())
        moments[joint] = moment
    return moments, excess


def _compute_drive_moment(rollout: MechanismRollout, joint: str, armature: float) -> Array:
    """Return the moment [N m] of the drive of ``joint`` beyond what accelerates the drive, one value per step.

    The drive replaces the ``armature`` [kg m2] of the joint, so it supplies what that needs. The first step repeats the
    second.
    """
    model, dt = rollout.model, rollout.dt
    actuator = model.actuator(drives.name_drive(joint)).id
    force = rollout.fields["actuator_force"][:, int(model.actuator_outadr[actuator])]
    address = int(model.joint(joint).qposadr[0])
    position = np.concatenate([[rollout.initial_qpos[address]], rollout.fields["qpos"][:, address]])
    acceleration = np.diff(position, n=2) / dt**2
    inertia = drives.compute_effective_inertia(dt, model.opt.integrator) - armature
    moment = force[1:] - inertia * acceleration
    return np.concatenate([moment[:1], moment])
