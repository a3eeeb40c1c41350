"""Running a protocol on a device, trial by trial."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from klute_sim.bench import device_only, tester
from klute_sim.bench.metrics import compute_ledger_residual
from klute_sim.bench.protocols.protocol import BenchProtocol, TrialPlan
from klute_sim.device.device import Device
from klute_sim.device.dynamics import compute_equilibrium_state
from klute_sim.device.rollout import MAX_TIME_STEP
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording

MAX_RECORDED_SAMPLES = 4000
"""Kept of a trial, beside those at jumps of the command; readings are made before, from all."""
COMMAND_JUMP_BAR = 0.1
"""Of the pressure command from one sample to the next [bar]."""
MAX_TIME_STEPS = 20_000_000
"""Of a whole run: some minutes without MuJoCo."""


@dataclass(frozen=True)
class BenchTrial:
    """One trial, done."""

    name: str
    conditions: dict[str, float]
    """What was set, keys with units; shortening velocities are positive."""
    metrics: dict[str, float]
    """What was read off the recording at its full rate, keys with units; NaN where there was nothing to read."""
    recording: Recording
    """Thinned to about :data:`MOST_SAMPLES`."""


@dataclass(frozen=True)
class BenchResult:
    """A protocol, done."""

    device: Device
    protocol: BenchProtocol
    use_mujoco: bool
    """In the MuJoCo tester, with its servo and load cell; otherwise the device alone."""
    dt: float
    """Of the simulation [s]."""
    trials: tuple[BenchTrial, ...]


def run_protocol(
    device: Device,
    protocol: BenchProtocol,
    *,
    use_mujoco: bool = False,
    dt: float = 5e-4,
    progress: Callable[[float], None] = lambda fraction: None,
) -> BenchResult:
    """Run every trial of ``protocol`` on ``device``, a sample every ``step`` [s]; ``told`` hears the finished fraction.

    Each begins in equilibrium. Raises InputError for what the device cannot do.
    """
    if not 0.0 < dt <= MAX_TIME_STEP:
        raise InputError(f"step is {1e3 * dt:g} ms; allowed: above 0, up to {1e3 * MAX_TIME_STEP:g} ms")
    protocol.check_time_step(dt)
    plans = protocol.plan_trials(device)
    for name, count in Counter(plan.name for plan in plans).items():
        if count > 1:
            raise InputError(
                f"the protocol has {count} trials '{name}'; allowed: every value once in each of its lists"
            )
    sizes = [plan.trajectory.count_samples(dt) for plan in plans]
    if sum(sizes) > MAX_TIME_STEPS:
        raise InputError(
            f"the protocol takes {sum(sizes):.3g} steps of {1e3 * dt:g} ms; allowed: up to {MAX_TIME_STEPS:.0e} "
            "(make it shorter or the step longer)"
        )
    done, trials = 0, []
    for plan, size in zip(plans, sizes, strict=True):
        before = done

        def heard(fraction: float, before: int = before, size: int = size) -> None:
            progress((before + fraction * size) / sum(sizes))

        recording = _simulate_trial(device, plan, dt, use_mujoco, heard)
        readings = {"ledger_residual_j": compute_ledger_residual(recording)} | protocol.compute_metrics(
            device, plan, recording
        )
        trials.append(BenchTrial(plan.name, dict(plan.conditions), readings, decimate_recording(recording)))
        done += size
    return BenchResult(device, protocol, use_mujoco, dt, tuple(trials))


def _simulate_trial(
    device: Device, plan: TrialPlan, dt: float, use_mujoco: bool, progress: Callable[[float], None]
) -> Recording:
    time, length = plan.trajectory.sample(dt)
    command = plan.command(time)
    start = compute_equilibrium_state(device.parameters, float(length[0]), float(command[0]))
    pull: Any = tester.simulate_tester if use_mujoco else device_only.simulate_device_only
    found: Recording = pull(device, length, command, dt, start=start, told=progress)
    return found


def decimate_recording(recording: Recording) -> Recording:
    """Every n-th sample, the last, and those on either side of a jump of the pressure command."""
    count = len(recording)
    keep = np.zeros(count, dtype=np.bool_)
    keep[:: -(-count // MAX_RECORDED_SAMPLES)] = True
    keep[-1] = True
    jumps = np.flatnonzero(np.abs(np.diff(recording["pressure_command"])) > COMMAND_JUMP_BAR)
    keep[jumps] = keep[jumps + 1] = True
    return recording.select(keep)
