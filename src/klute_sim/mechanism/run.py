"""Run a test on a mechanism of the package, or on another one with a single free joint, trial by trial."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from klute_sim.datasets.mechanism_channels import normalize_name
from klute_sim.device.device import Device, check_accepts_pressure
from klute_sim.device.energy.ledger import POWER_TERMS
from klute_sim.device.rollout import MAX_TIME_STEP
from klute_sim.errors import InputError
from klute_sim.mechanism import metrics
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.mechanism.protocols import JointTrial, ProtocolSettings, plan_test
from klute_sim.mechanism.record import record_mechanism
from klute_sim.mechanism.simulate import simulate_mechanism
from klute_sim.plant.mjcf.model_file import ModelFile
from klute_sim.recording.frequency_response import Response
from klute_sim.recording.recording import Recording
from klute_sim.types import Array, ProgressCallback
from klute_sim.units import BAR

MAX_RECORDED_SAMPLES = 4000
"""Approximate number of samples in a trial's recording; metrics are computed at the full rate before."""


@dataclass(frozen=True)
class JointTrialResult:
    """Result of one trial."""

    name: str
    conditions: dict[str, float]
    """Set values by keys with units."""
    metrics: dict[str, float]
    """Values from the recording at its full rate, by keys with units; NaN where there is no value."""
    recording: Recording
    """Recording, decimated to about :data:`MAX_RECORDED_SAMPLES` samples."""


@dataclass(frozen=True)
class JointTestResult:
    """Results of all trials of a test."""

    file: ModelFile
    """MJCF file."""
    devices: Mapping[str, Device]
    """Tendon -> device."""
    numbers: Mapping[str, float]
    """Changed numbers of the model."""
    test: str
    """Name of the test."""
    settings: ProtocolSettings
    """Settings of the test."""
    joint: str
    """Name of the joint."""
    unit: str
    """Unit of its position: ``deg`` or ``mm``."""
    dt: float
    """Time step [s]."""
    trials: tuple[JointTrialResult, ...]
    """Trials in order."""

    @property
    def position_channel(self) -> str:
        """Channel of the joint's position."""
        return f"{'angle' if self.unit == 'deg' else 'position'}_{normalize_name(self.joint)}"

    def compute_frequency_response(self) -> tuple[Response, Array]:
        """Return position over pressure difference [unit per bar] at each frequency of the sines, and coherence."""
        gain, phase, coherence = (
            np.array([trial.metrics[key] for trial in self.trials])
            for key in (f"gain_{self.unit}_per_bar", "phase_deg", "coherence")
        )
        return gain * np.exp(1j * np.radians(phase)), coherence


def run_joint_test(
    file: ModelFile,
    devices: Mapping[str, Device],
    numbers: Mapping[str, float],
    test: str,
    settings: ProtocolSettings,
    *,
    dt: float = 5e-4,
    backend: str = "auto",
    progress: ProgressCallback = lambda fraction, stage: None,
) -> JointTestResult:
    """Run ``test`` on the model ``file`` with ``devices`` (tendon -> device) and changed ``numbers``.

    Raises InputError when the model has not exactly one joint (a hinge or a slide) or not one or two devices, when a
    device takes no pressures or has too little, or when the model lacks what the test needs.
    """
    if not 0.0 < dt <= MAX_TIME_STEP:
        raise InputError(f"the time step is {1e3 * dt:g} ms; allowed: above 0, up to {1e3 * MAX_TIME_STEP:g} ms")
    joint, unit = find_joint(file)
    if len(devices) not in (1, 2):
        raise InputError(f"{len(devices)} devices; a test needs one, or two antagonists")
    trials = plan_test(test, settings)
    check_pressures(devices, trials)
    results = []
    for index, trial in enumerate(trials):
        progress(index / len(trials), "testing")
        recording = _simulate_trial(file, devices, numbers, trial, joint, unit, dt, backend)
        trial_metrics = _measure(test, trial, recording, devices, joint, unit)
        step = -(-len(recording) // MAX_RECORDED_SAMPLES)
        results.append(
            JointTrialResult(trial.name, trial.conditions, trial_metrics, recording.select(slice(0, None, step)))
        )
    progress(1.0, "testing")
    return JointTestResult(file, dict(devices), dict(numbers), test, settings, joint, unit, dt, tuple(results))


def find_joint(file: ModelFile) -> tuple[str, str]:
    """Return the name of the only joint of the model and the unit of its position.

    Raises InputError when the model has not exactly one joint, a hinge or a slide.
    """
    joints = list(file.make_spec().joints)
    kinds = {mujoco.mjtJoint.mjJNT_HINGE: "deg", mujoco.mjtJoint.mjJNT_SLIDE: "mm"}
    if len(joints) != 1 or joints[0].type not in kinds or not joints[0].name:
        raise InputError(
            f"{file.path} has {len(joints)} joints; a test needs a model with one joint, a hinge or a slide with a name"
        )
    return str(joints[0].name), kinds[joints[0].type]


def check_pressures(devices: Mapping[str, Device], trials: Sequence[JointTrial]) -> None:
    """Raise InputError when a device takes no pressures, or has less than ``trials`` need."""
    for device in devices.values():
        check_accepts_pressure(device, "the test")
        available = device.parameters.supply.max_pressure
        needed = max(t.mean_pressure + np.abs(t.difference(np.linspace(0.0, t.duration, 2001))).max() for t in trials)
        if needed > available * (1.0 + 1e-9):
            raise InputError(
                f"the test needs {needed / BAR:.4g} bar, but the supply of '{device.name}' has {available / BAR:g} "
                "bar; lower the mean pressure or the difference"
            )


def _simulate_trial(
    file: ModelFile,
    devices: Mapping[str, Device],
    numbers: Mapping[str, float],
    trial: JointTrial,
    joint: str,
    unit: str,
    dt: float,
    backend: str,
) -> Recording:
    time: Array = dt * np.arange(round(trial.duration / dt) + 1, dtype=np.float64)
    inputs = make_inputs(trial, devices, joint, unit, time, has_load=trial.load is not None)
    mechanism = Mechanism(file, tuple(devices), tuple(inputs))
    parameters = {name: device.parameters for name, device in devices.items()}
    rollout = simulate_mechanism(mechanism, parameters, inputs, dt, numbers=numbers, backend=backend)
    return record_mechanism(rollout, devices, {"trial": trial.name, "numbers": dict(numbers)})


def make_inputs(
    trial: JointTrial, devices: Mapping[str, Device], joint: str, unit: str, time: Array, *, has_load: bool
) -> dict[str, Array]:
    """Return the prescribed channels [SI] of ``trial`` at ``time`` [s], with a load (of 0 without one) if asked for."""
    difference = trial.difference(time)
    names = [f"pressure_command_{normalize_name(name)}" for name in devices]
    inputs = {name: trial.mean_pressure + sign * difference for name, sign in zip(names, (1.0, -1.0), strict=False)}
    if has_load:
        quantity = "external_moment" if unit == "deg" else "external_force"
        load = np.zeros(len(time)) if trial.load is None else trial.load(time)
        inputs[f"{quantity}_{normalize_name(joint)}"] = load
    return inputs


def _measure(
    test: str, trial: JointTrial, recording: Recording, devices: Mapping[str, Device], joint: str, unit: str
) -> dict[str, float]:
    """Return the metrics of ``test``, and the air and the largest energy residual of each device."""
    time, events = recording["time"], trial.events
    value = recording[f"{'angle' if unit == 'deg' else 'position'}_{normalize_name(joint)}"]
    difference = trial.difference(time) / BAR
    result: dict[str, float]
    if test == "steps":
        result = metrics.measure_step(time, value, events["begin"], events["end"], unit)
    elif test == "sines":
        result = metrics.measure_sine(time, value, difference, events, unit)
    elif test == "multisine":
        result = metrics.measure_multisine(time, value, difference, events, unit)
    elif test == "co-contraction":
        result = metrics.measure_stiffness(time, value, trial.conditions["load"], events["begin"], unit)
    else:
        result = metrics.measure_release(time, value, events["begin"], events["end"], unit)
    return result | _measure_devices(recording, devices)


def _measure_devices(recording: Recording, devices: Mapping[str, Device]) -> dict[str, float]:
    dt = float(recording["time"][1] - recording["time"][0])
    result: dict[str, Any] = {}
    for name in map(normalize_name, devices):
        unit_length, force = 1e-3 * recording[f"unit_length_{name}"], recording[f"force_{name}"]
        work = float(-np.trapezoid(force, unit_length))
        terms = sum(float(recording[f"{term}_{name}"][1:].sum()) * dt for term in POWER_TERMS)
        result[f"work_{name}_j"] = work
        result[f"ledger_residual_{name}_j"] = work - terms
        result[f"air_drawn_{name}_g"] = 1e3 * float(recording[f"air_drawn_{name}"][-1])
    return result
