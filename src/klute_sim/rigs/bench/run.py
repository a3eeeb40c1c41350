"""Running a protocol on a device, trial by trial."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from klute_sim.device.files import Device
from klute_sim.device.rollout import LONGEST_STEP
from klute_sim.device.step import settled
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording
from klute_sim.rigs.bench import alone, tester
from klute_sim.rigs.bench.plan import Plan, Protocol
from klute_sim.rigs.bench.reading import ledger_residual

MOST_SAMPLES = 4000
"""Kept of a trial, beside those at jumps of the command; readings are made before, from all."""
JUMP = 0.1
"""Of the pressure command from one sample to the next [bar]."""
MOST_STEPS = 20_000_000
"""Of a whole run: some minutes without MuJoCo."""


@dataclass(frozen=True)
class Trial:
    """One trial, done."""

    name: str
    setting: dict[str, float]
    """What was set, keys with units; shortening velocities are positive."""
    readings: dict[str, float]
    """What was read off the recording at its full rate, keys with units; NaN where there was nothing to read."""
    recording: Recording
    """Thinned to about :data:`MOST_SAMPLES`."""


@dataclass(frozen=True)
class Result:
    """A protocol, done."""

    device: Device
    protocol: Protocol
    mujoco: bool
    """In the MuJoCo tester, with its servo and load cell; otherwise the device alone."""
    step: float
    """Of the simulation [s]."""
    trials: tuple[Trial, ...]


def run(
    device: Device,
    protocol: Protocol,
    *,
    mujoco: bool = False,
    step: float = 5e-4,
    told: Callable[[float], None] = lambda fraction: None,
) -> Result:
    """Run every trial of ``protocol`` on ``device``, a sample every ``step`` [s]; ``told`` hears the finished fraction.

    Each begins in equilibrium. Raises InputError for what the device cannot do.
    """
    if not 0.0 < step <= LONGEST_STEP:
        raise InputError(f"step is {1e3 * step:g} ms; allowed: above 0, up to {1e3 * LONGEST_STEP:g} ms")
    protocol.check_step(step)
    plans = protocol.plans(device)
    for name, count in Counter(plan.name for plan in plans).items():
        if count > 1:
            raise InputError(
                f"the protocol has {count} trials '{name}'; allowed: every value once in each of its lists"
            )
    sizes = [plan.path.samples(step) for plan in plans]
    if sum(sizes) > MOST_STEPS:
        raise InputError(
            f"the protocol takes {sum(sizes):.3g} steps of {1e3 * step:g} ms; allowed: up to {MOST_STEPS:.0e} "
            "(make it shorter or the step longer)"
        )
    done, trials = 0, []
    for plan, size in zip(plans, sizes, strict=True):
        before = done

        def heard(fraction: float, before: int = before, size: int = size) -> None:
            told((before + fraction * size) / sum(sizes))

        recording = _pull(device, plan, step, mujoco, heard)
        readings = {"ledger_residual_j": ledger_residual(recording)} | protocol.readings(device, plan, recording)
        trials.append(Trial(plan.name, dict(plan.setting), readings, thinned(recording)))
        done += size
    return Result(device, protocol, mujoco, step, tuple(trials))


def _pull(device: Device, plan: Plan, step: float, mujoco: bool, told: Callable[[float], None]) -> Recording:
    time, length = plan.path.sampled(step)
    command = plan.command(time)
    start = settled(device.parameters, float(length[0]), float(command[0]))
    pull: Any = tester.pull if mujoco else alone.pull
    found: Recording = pull(device, length, command, step, start=start, told=told)
    return found


def thinned(recording: Recording) -> Recording:
    """Every n-th sample, the last, and those on either side of a jump of the pressure command."""
    count = len(recording)
    keep = np.zeros(count, dtype=np.bool_)
    keep[:: -(-count // MOST_SAMPLES)] = True
    keep[-1] = True
    jumps = np.flatnonzero(np.abs(np.diff(recording["pressure_command"])) > JUMP)
    keep[jumps] = keep[jumps + 1] = True
    return recording.select(keep)
