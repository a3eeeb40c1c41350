"""Influence of each assumed number of a device on metrics of the bench or of a gait run."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.device.rollout import RolloutTrace, simulate_rollouts
from klute_sim.errors import InputError
from klute_sim.gait.metrics import compute_gait_metrics
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.laws import mckibben, pneumatics
from klute_sim.laws import tendon as tendon_law
from klute_sim.types import Array, ProgressCallback

TEMPERATURE_CHANGE_K = 10.0
"""Change of a temperature [K]."""
RELATIVE_CHANGE = 0.1
"""Relative change of an assumed number; an integer is changed by 1."""
LENGTH_RATIO = 0.96
"""Muscle length over resting length at which forces are measured, as in Fig. 3.9."""
SHORTENING_SPEED, LENGTHENING_SPEED, WORK_LOOP_SPEED = 0.3, 0.15, 0.1
"""Speeds [m/s] of the force measurements and of the work loop."""
MAX_HALF_STROKE = 0.008
"""Travel to either side of the measured length [m]; smaller where the resting length of the muscle limits it."""
TIME_STEP = 2.5e-4
"""Simulation time step [s]."""
HOLD_DURATION = 0.6
"""Duration of a hold in which the pressure rises or falls [s]."""

MetricsFunction = Callable[[Device], Mapping[str, float]]
"""Function of a device that returns its metrics; the name of each metric includes its unit."""


class AssumptionEffect(NamedTuple):
    """Relative changes of the metrics when one assumed number changes."""

    key: str
    """Key of the number in the device file."""
    value: float
    """Assumed value."""
    reason: str
    """Reason for the assumption."""
    perturbed_value: float
    """Changed value."""
    relative_changes: dict[str, float]
    """Relative change of each metric; a metric that was 0 is left out."""


def perturb_assumptions(
    device: Device, compute_metrics: MetricsFunction, progress: ProgressCallback = lambda fraction, stage: None
) -> list[AssumptionEffect]:
    """Return the influence of every assumed number of ``device``, in the order of its file.

    ``compute_metrics`` returns the compared metrics of a device; ``progress`` receives the completed fraction.
    """
    nominal_metrics, values, assumptions = (
        compute_metrics(device),
        device.spec.collect_values(),
        device.spec.collect_assumptions(),
    )
    effects = []
    for count, (key, source) in enumerate(assumptions.items(), start=1):
        perturbed = _perturb(device, key, values[key])
        metrics = compute_metrics(perturbed)
        relative_changes = {
            name: metrics[name] / nominal_metrics[name] - 1.0 for name in nominal_metrics if nominal_metrics[name]
        }
        reason = source.removeprefix("assumed").lstrip(": ")
        effects.append(
            AssumptionEffect(key, values[key], reason, perturbed.spec.collect_values()[key], relative_changes)
        )
        progress(count / len(assumptions), key)
    return effects


def _perturb(device: Device, key: str, value: float) -> Device:
    """Return ``device`` with a larger value of ``key``, or a smaller one where a larger one is not allowed."""
    change: float = 1 if isinstance(value, int) else RELATIVE_CHANGE * (abs(value) or 1.0)
    if key.endswith("_c"):
        change = TEMPERATURE_CHANGE_K
    try:
        return device.with_changes({key: value + change}, "perturbed")
    except InputError:
        return device.with_changes({key: value - change}, "perturbed")


def make_bench_metrics(device: Device) -> MetricsFunction:
    """Return the function that measures devices on a tensile tester, at the lengths that suit ``device``."""
    nominal = device.parameters
    pressure, resting_length = nominal.supply.max_pressure, nominal.muscle.resting_length
    tension = max(0.0, mckibben.force(nominal.muscle, pressure, LENGTH_RATIO * resting_length))
    stretch = 0.0 if nominal.tendon.is_rigid else tendon_law.stretch_at_tension(nominal.tendon, tension)
    unit_length = nominal.tendon.slack_length + stretch + LENGTH_RATIO * resting_length
    half_stroke = min(MAX_HALF_STROKE, 0.9 * (1.0 - LENGTH_RATIO) * resting_length)

    def compute_metrics(perturbed: Device) -> Mapping[str, float]:
        return _compute_bench_metrics(perturbed.parameters, unit_length, half_stroke, pressure)

    return compute_metrics


def _compute_bench_metrics(
    parameters: DeviceParameters, unit_length: float, half_stroke: float, pressure: float
) -> Mapping[str, float]:
    n_hold = round(HOLD_DURATION / TIME_STEP)
    constant_length = np.full(2 * n_hold, unit_length)
    step_command = np.where(np.arange(2 * n_hold) < n_hold, 0.0, pressure)
    rise = _simulate(parameters, constant_length, step_command)
    force = float(rise.tension[-1])
    step_response = rise.tension[n_hold:]
    reached = np.flatnonzero(step_response >= 0.9 * force)
    metrics = {
        "isometric force": force,
        "time to 90 % of force": TIME_STEP * float(reached[0] + 1) if force > 0.0 and len(reached) else 0.0,
        f"force shortening at {1e3 * SHORTENING_SPEED:.0f} mm/s": _force_at_speed(
            parameters, unit_length, half_stroke, -SHORTENING_SPEED, pressure
        ),
        f"force lengthening at {1e3 * LENGTHENING_SPEED:.0f} mm/s": _force_at_speed(
            parameters, unit_length, half_stroke, LENGTHENING_SPEED, pressure
        ),
        "net work of a cycle": _net_work(parameters, unit_length, half_stroke, pressure),
    }
    muscle, temperature = parameters.muscle, parameters.supply.temperature
    volume = mckibben.gas_volume(muscle, float(rise.length[-1])) + parameters.supply.dead_volume
    metrics["air in the muscle"] = pneumatics.air_mass(float(rise.pressure[-1]), volume, temperature)
    return metrics


def _simulate(parameters: DeviceParameters, length: Array, command: Array) -> RolloutTrace:
    """Simulate ``length`` [m] and ``command`` [Pa], one sample per :data:`TIME_STEP`, from equilibrium at the first
    sample.
    """
    initial_state = compute_equilibrium_state(parameters, float(length[0]), float(command[0]))
    return simulate_rollouts(parameters, length, command, TIME_STEP, initial_state=initial_state, n_jobs=1)


def _force_at_speed(
    parameters: DeviceParameters, unit_length: float, half_stroke: float, speed: float, pressure: float
) -> float:
    """Return the force [N] at ``unit_length`` [m] and ``speed`` [m/s], positive while lengthening; 0 is at rest.

    The ramp begins and ends ``half_stroke`` [m] from the unit length.
    """
    if speed == 0.0:
        return float(_simulate(parameters, np.full(4, unit_length), np.full(4, pressure)).tension[-1])
    count = round(2.0 * half_stroke / abs(speed) / TIME_STEP)
    ramp = unit_length + np.sign(speed) * half_stroke * np.linspace(-1.0, 1.0, count + 1)
    trace = _simulate(parameters, ramp, np.full(len(ramp), pressure))
    return float(np.interp(0.0, np.sign(speed) * (ramp - unit_length), trace.tension))


def _net_work(parameters: DeviceParameters, unit_length: float, half_stroke: float, pressure: float) -> float:
    """Return the net work [J] of a cycle that is pressurized while shortening; the pressure changes during the
    holds.
    """
    n_hold, n_move = round(HOLD_DURATION / TIME_STEP), round(2.0 * half_stroke / WORK_LOOP_SPEED / TIME_STEP)
    down, up = np.linspace(half_stroke, -half_stroke, n_move), np.linspace(-half_stroke, half_stroke, n_move)
    length = unit_length + np.concatenate([np.full(n_hold, half_stroke), down, np.full(n_hold, -half_stroke), up])
    command = np.concatenate([np.full(n_hold + n_move, pressure), np.zeros(n_hold + n_move)])
    trace = _simulate(parameters, length, command)
    return float(-np.sum(0.5 * (trace.tension[1:] + trace.tension[:-1]) * np.diff(length)))


def merge_metrics(first: MetricsFunction, second: MetricsFunction) -> MetricsFunction:
    """Return the function that computes the metrics of both functions."""
    return lambda device: {**first(device), **second(device)}


def compute_gait_run_metrics(device: Device) -> Mapping[str, float]:
    """Return the metrics of a gait run of three strides under the tuned profile."""
    metrics = compute_gait_metrics(simulate_gait(device, load_default_profile(), GaitOptions(strides=3)))
    return {
        "gait: peak net moment": metrics.mean(lambda stride: stride.ankle_moment_peak_nm_per_kg) or 0.0,
        "gait: peak net power": metrics.mean(lambda stride: stride.ankle_power_peak_w_per_kg) or 0.0,
        "gait: positive work": metrics.mean(lambda stride: stride.ankle_work_positive_j_per_kg) or 0.0,
        "gait: air": metrics.mean(lambda stride: stride.air_g) or 0.0,
    }
