"""Run a protocol on a device, trial by trial."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from klute_sim.bench import device_only, tester
from klute_sim.bench.metrics import compute_ledger_residual
from klute_sim.bench.protocols.protocol import BenchProtocol, TrialPlan
from klute_sim.device.device import Device
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.device.rollout import MAX_TIME_STEP
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording
from klute_sim.types import ProgressCallback

MAX_RECORDED_SAMPLES = 4000
"""Approximate number of samples in a trial's recording; metrics are computed at the full rate before."""
COMMAND_JUMP_BAR = 0.1
"""Change of the pressure command between samples [bar] above which both samples are recorded."""
MAX_TIME_STEPS = 20_000_000
"""Maximum number of time steps of a run: some minutes without MuJoCo."""
MAX_TRIAL_TIME_STEPS = 2_000_000
"""Maximum number of time steps of a trial, whose recording is in memory at its full rate: 1000 s at 0.5 ms."""


@dataclass(frozen=True)
class BenchTrial:
    """Result of one trial."""

    name: str
    conditions: dict[str, float]
    """Set values by keys with units; shortening velocities are positive."""
    metrics: dict[str, float]
    """Values computed from the recording at its full rate, by keys with units; NaN where there is no value."""
    recording: Recording
    """Recording, decimated to about :data:`MAX_RECORDED_SAMPLES` samples."""


@dataclass(frozen=True)
class BenchResult:
    """Results of all trials of a protocol."""

    device: Device
    protocol: BenchProtocol
    use_mujoco: bool
    """Whether the MuJoCo tester with its servo and load cell was used; otherwise the device was simulated alone."""
    dt: float
    """Time step of the simulation [s]."""
    trials: tuple[BenchTrial, ...]


def run_protocol(
    device: Device,
    protocol: BenchProtocol,
    *,
    use_mujoco: bool = False,
    dt: float = 5e-4,
    progress: ProgressCallback = lambda fraction, stage: None,
) -> BenchResult:
    """Run every trial of ``protocol`` on ``device``, with a time step of ``dt`` [s]; each starts in equilibrium.

    Raises InputError when the device cannot run the protocol.
    """
    plans, sizes = plan_protocol(device, protocol, dt)
    completed, trials = 0, []
    for plan, size in zip(plans, sizes, strict=True):

        def report(fraction: float, stage: str, completed: int = completed, size: int = size) -> None:
            progress((completed + fraction * size) / sum(sizes), stage)

        recording = _simulate_trial(device, plan, dt, use_mujoco, report)
        metrics = {"ledger_residual_j": compute_ledger_residual(recording)}
        metrics |= protocol.compute_metrics(device, plan, recording)
        trials.append(BenchTrial(plan.name, dict(plan.conditions), metrics, decimate_recording(recording)))
        completed += size
    return BenchResult(device, protocol, use_mujoco, dt, tuple(trials))


def plan_protocol(device: Device, protocol: BenchProtocol, dt: float) -> tuple[Sequence[TrialPlan], list[int]]:
    """Return the plans of all trials of ``protocol`` and their numbers of time steps ``dt`` [s].

    Raises InputError when the device cannot run the protocol, or the protocol takes too many time steps.
    """
    if not 0.0 < dt <= MAX_TIME_STEP:
        raise InputError(f"the time step is {1e3 * dt:g} ms; allowed: above 0, up to {1e3 * MAX_TIME_STEP:g} ms")
    protocol.check_time_step(dt)
    plans = protocol.plan_trials(device)
    for name, count in Counter(plan.name for plan in plans).items():
        if count > 1:
            raise InputError(
                f"the protocol has {count} trials '{name}'; allowed: every value once in each of its lists"
            )
    durations = [plan.trajectory.end_time / dt for plan in plans]  # in time steps; infinite at minute velocities
    for what, size, limit in (
        ("the protocol", sum(durations), MAX_TIME_STEPS),
        ("the longest trial of the protocol", max(durations), MAX_TRIAL_TIME_STEPS),
    ):
        if size > limit:
            raise InputError(
                f"{what} takes {size:.3g} time steps of {1e3 * dt:g} ms; allowed: up to {limit:.0e} (make the protocol "
                "shorter or the time step longer)"
            )
    return plans, [plan.trajectory.count_samples(dt) for plan in plans]


def _simulate_trial(
    device: Device, plan: TrialPlan, dt: float, use_mujoco: bool, progress: ProgressCallback
) -> Recording:
    time, length = plan.trajectory.sample(dt)
    command = plan.command(time)
    initial_state = compute_equilibrium_state(device.parameters, float(length[0]), float(command[0]))
    simulate: Any = tester.simulate_tester if use_mujoco else device_only.simulate_device_only
    recording: Recording = simulate(device, length, command, dt, initial_state=initial_state, progress=progress)
    return recording


def decimate_recording(recording: Recording) -> Recording:
    """Return every n-th sample, the last one, and those on both sides of a jump of the pressure command."""
    count = len(recording)
    selected = np.zeros(count, dtype=np.bool_)
    selected[:: -(-count // MAX_RECORDED_SAMPLES)] = True
    selected[-1] = True
    jumps = np.flatnonzero(np.abs(np.diff(recording["pressure_command"])) > COMMAND_JUMP_BAR)
    selected[jumps] = selected[jumps + 1] = True
    return recording.select(selected)
