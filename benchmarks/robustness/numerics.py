"""Run random devices under both backends: equal ends, positive absolute pressure, no error that is not a sentence.

    python -m benchmarks.robustness.numerics --devices 100000 --jobs 2
    python -m benchmarks.robustness.numerics --seed 4711 --devices 1      # one device again

Each device has its own seed, so a difference can be repeated alone. The exit code is 1 if any device fails.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import numpy as np
from benchmarks.robustness.random_devices import RandomRun, draw_run
from rich.console import Console
from rich.table import Table

from klute_sim.device.rollout import RolloutTrace, simulate_rollouts
from klute_sim.errors import SimulationError
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE

CHUNK = 250
"""Number of devices of one task of a worker."""
MAX_LISTED = 20
"""Maximum number of listed failures."""


class Outcome(NamedTuple):
    """End of one random device under both backends."""

    seed: int
    kind: str
    """``equal``, ``same error``, or the kind of failure."""
    detail: str
    """What differs; '' without a failure."""
    min_pressure: float
    """Smallest absolute pressure [Pa]; infinite after an error."""
    n_steps: int


OK_KINDS = ("equal", "same error")
"""Kinds of outcomes that are no failure."""


def simulate_run(run: RandomRun, backend: str) -> RolloutTrace | str:
    """Return the trace, or the sentence of the SimulationError."""
    try:
        return simulate_rollouts(
            run.device.parameters, run.unit_length, run.command, run.time_step, n_jobs=1, backend=backend
        )
    except SimulationError as error:
        return str(error)


def compare_backends(seed: int) -> Outcome:
    """Return how the random device of this ``seed`` ends."""
    run = draw_run(seed)
    n_steps = len(run.command)
    try:
        compiled, python = (simulate_run(run, backend) for backend in ("compiled", "python"))
    except Exception as error:
        return Outcome(seed, "leaked exception", f"{type(error).__name__}: {error}", np.inf, n_steps)
    if isinstance(compiled, str) or isinstance(python, str):
        if compiled == python:
            return Outcome(seed, "same error", str(compiled), np.inf, n_steps)
        texts = [end if isinstance(end, str) else "a result" for end in (compiled, python)]
        return Outcome(seed, "different ends", f"compiled: {texts[0]}; python: {texts[1]}", np.inf, n_steps)
    lowest = ATMOSPHERIC_PRESSURE + float(min(compiled.pressure.min(), python.pressure.min()))
    for name, a, b in zip(RolloutTrace._fields, compiled, python, strict=True):
        if a.tobytes() != b.tobytes():
            k = int(np.argmax(a != b))
            return Outcome(seed, "different bits", f"{name}[{k}]: {a[k]!r} and {b[k]!r}", lowest, n_steps)
    if not lowest > 0.0:
        return Outcome(seed, "negative pressure", f"{lowest:.6g} Pa absolute", lowest, n_steps)
    return Outcome(seed, "equal", "", lowest, n_steps)


def _compare_chunk(seeds: range) -> list[Outcome]:
    return [compare_backends(seed) for seed in seeds]


def run_campaign(first_seed: int, n_devices: int, n_jobs: int) -> Iterator[Outcome]:
    """Yield the outcome of each device, in the order of the seeds."""
    end = first_seed + n_devices
    chunks = [range(start, min(start + CHUNK, end)) for start in range(first_seed, end, CHUNK)]
    if n_jobs == 1:
        for chunk in chunks:
            yield from _compare_chunk(chunk)
        return
    with ProcessPoolExecutor(n_jobs) as pool:
        for outcomes in pool.map(_compare_chunk, chunks):
            yield from outcomes


def main() -> int:
    """Run the campaign and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--devices", type=int, default=1000, help="number of random devices")
    parser.add_argument("--jobs", type=int, default=1, help="number of processes")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first device")
    arguments = parser.parse_args()
    start, counts, lowest, n_steps = time.monotonic(), Counter[str](), np.inf, 0
    failures: list[Outcome] = []
    for outcome in run_campaign(arguments.seed, arguments.devices, arguments.jobs):
        counts[outcome.kind] += 1
        lowest, n_steps = min(lowest, outcome.min_pressure), n_steps + outcome.n_steps
        if outcome.kind not in OK_KINDS:
            failures.append(outcome)
            if len(failures) <= MAX_LISTED:
                print(f"seed {outcome.seed}: {outcome.kind}: {outcome.detail}", file=sys.stderr, flush=True)
    table = Table("random devices", "count", title="Python and compiled law")
    table.add_row("devices", str(counts.total()))
    table.add_row("time steps", str(n_steps))
    table.add_row("equal to the bit", str(counts["equal"]))
    table.add_row("same SimulationError", str(counts["same error"]))
    for kind in sorted(set(counts) - set(OK_KINDS)):
        table.add_row(kind, str(counts[kind]))
    table.add_row("smallest absolute pressure [Pa]", f"{lowest:.6g}")
    table.add_row("failures", str(len(failures)))
    table.add_row("seconds", f"{time.monotonic() - start:.0f}")
    Console().print(table)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
