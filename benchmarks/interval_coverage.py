"""Coverage of 95 % intervals of the parameters of compensating effects, over realizations of the noise.

    python3 scripts/env.py python -m benchmarks.interval_coverage                  # all cases, 60 realizations each
    python3 scripts/env.py python -m benchmarks.interval_coverage --case friction --draws 20 --json

Two groups of two repeats of 3 s on the bench are simulated with the effects of a case, at sizes near the noise. Each
realization adds correlated noise, estimates it from the repeats, and fits the effects and two uncertain numbers of the
device. The effects are known, so nothing is selected. Linear intervals follow from the Jacobian of the fit. Those of a
diagnosis reach at least as far as the profile of chi squared.
"""

import argparse
import json
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import lfilter

from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.confidence_intervals import compute_confidence_intervals, compute_noise_errors
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats

Effects = Mapping[tuple[str, str], Mapping[str, float]]
CASES: Mapping[str, Effects] = {
    "friction": {
        ("braid_hysteresis", "maxwell_slip"): {"slope_n_per_bar": 0.6, "stiffness_n_per_mm": 40.0},
        ("seal_friction", "coulomb"): {"force_n": 2.0},
    },
    "air": {
        ("hose", "tube"): {"length_m": 0.5, "inner_diameter_mm": 4.0},
        ("pressure_lag", "first_order"): {"time_constant_s": 0.004},
    },
    "bladder": {
        ("bladder_softening", "ogden_roxburgh"): {"share": 0.15, "energy_density_kpa": 20.0},
        ("passive_tension", "power"): {"rise_n": 60.0, "offset_n": 2.0},
    },
    "damper": {
        ("laminar_orifice", "smooth"): {"transition_speed_mm_per_s": 10.0},
        ("seal_friction", "stribeck"): {"force_n": 3.0, "stick_fraction": 0.5, "stribeck_speed_mm_per_s": 15.0},
    },
}
"""Case -> hidden effects with their parameters, each in its own unit."""
NOISE_STD = {"force": 3.0, "pressure": 1e3}
"""Standard deviation of the noise [SI]."""
NOISE_TIME = 0.02
"""Time constant of the noise [s]."""
UNCERTAINTIES = (("tendon.stiffness_1_n_per_mm", 6.0), ("muscle.friction_slope_n_per_bar", 2.8))
"""Uncertain numbers of the device and their standard deviations, each in the unit of the key."""
DURATION, TIME_STEP, SAMPLING_INTERVAL = 3.0, 1e-3, 5e-3
"""Duration of a trial, time step and sampling interval [s]."""
GROUPS, REPEATS = 2, 2


class Coverage(NamedTuple):
    """Intervals of one parameter over all realizations of the noise."""

    parameter: str
    """Effect and key of the parameter."""
    linear: float
    """Fraction of the linear intervals that cover the true value."""
    reported: float
    """Fraction of the intervals of a diagnosis that cover it."""
    linear_width: float
    """Median length of the linear interval [unit of the parameter]."""
    reported_width: float
    """Median length of the interval of a diagnosis [unit of the parameter]."""


def make_trials(rng: np.random.Generator) -> list[BenchExperiment]:
    """Return trials without readings: sums of sines in the length, steps in the command."""
    device, trials = load_device("klute-3-4-pair"), []
    grid = np.arange(TIME_STEP, DURATION, TIME_STEP)
    samples = np.arange(0.3, DURATION - TIME_STEP, SAMPLING_INTERVAL)
    for group in range(GROUPS):
        moving = np.clip(grid - 0.3, 0.0, None)
        waves = [
            a * np.sin(2.0 * np.pi * f * moving) for a, f in zip((6e-3, 3e-3), rng.uniform(0.3, 3.0, 2), strict=True)
        ]
        command = rng.uniform(0.5e5, 4.5e5, 8)[np.minimum(7, (grid / 0.4).astype(int))]
        readings = {channel: TimeSeries(samples, np.zeros(len(samples))) for channel in NOISE_STD}
        trials += [
            BenchExperiment(
                f"{group}_{repeat}",
                f"{group}",
                "fit",
                device,
                0.0,
                TIME_STEP,
                command,
                readings,
                unit_length=0.34 + sum(waves, np.zeros(len(grid))),
            )
            for repeat in range(REPEATS)
        ]
    return trials


def add_noise(trial: BenchExperiment, readings: Mapping[str, np.ndarray], rng: np.random.Generator) -> BenchExperiment:
    """Return ``trial`` with noisy ``readings``."""
    decay = float(np.exp(-SAMPLING_INTERVAL / NOISE_TIME))
    measured = {}
    for channel, value in readings.items():
        white = rng.normal(0.0, NOISE_STD[channel] * np.sqrt(1.0 - decay * decay), len(value) + 100)
        noise = lfilter([1.0], [1.0, -decay], white)[100:]
        measured[channel] = TimeSeries(trial.measured[channel].time, value + noise)
    return replace(trial, measured=measured)


def measure_coverage(effects: Effects, n_draws: int, seed: int) -> tuple[list[Coverage], float, float]:
    """Return the coverage of each parameter, and the processor time [s] of a fit and of its intervals."""
    rng, simulator = np.random.default_rng(seed), Simulator(1)
    trials = make_trials(rng)
    terms = tuple(EffectTerm(*key) for key in effects)
    hypothesis = Hypothesis(trials[0].device, UNCERTAINTIES, tuple(NOISE_STD.items()), terms)
    truth = np.array([p.initial for p in hypothesis.parameters])
    truth[len(UNCERTAINTIES) :] = [value for parameters in effects.values() for value in parameters.values()]
    x = np.array([p.normalize(value) for p, value in zip(hypothesis.parameters, truth, strict=True)])
    (true_readings,) = simulator.simulate([hypothesis.build_setups(x, trials)], trials)
    bounds = np.array([p.bounds for p in hypothesis.parameters]).T
    intervals, times = [], np.zeros(2)
    for _ in range(n_draws):
        noisy = [add_noise(trial, readings, rng) for trial, readings in zip(trials, true_readings, strict=True)]
        deviations = [
            {channel: series.value - readings[channel] for channel, series in trial.measured.items()}
            for trial, readings in zip(noisy, true_readings, strict=True)
        ]
        data = WeightedData(simulator, noisy, estimate_noise_from_repeats(noisy, deviations))
        start = time.process_time()
        fit = fit_hypothesis(data, hypothesis, x, fine=True)
        end = time.process_time()
        reported = compute_confidence_intervals(data, fit)
        times += end - start, time.process_time() - end
        error = compute_noise_errors(data, fit, np.linalg.pinv(fit.jacobian))
        ends = np.clip([fit.x - error, fit.x + error], *bounds)
        intervals.append([*np.array([hypothesis.values(row) for row in ends]), *np.transpose(reported)])
    simulator.close()
    ends = np.array(intervals)[:, :, len(UNCERTAINTIES) :]
    is_covered = (ends[:, ::2] <= truth[len(UNCERTAINTIES) :]) & (truth[len(UNCERTAINTIES) :] <= ends[:, 1::2])
    widths = np.median(ends[:, 1::2] - ends[:, ::2], axis=0)
    names = [f"{effect}.{key}" for (effect, _), parameters in effects.items() for key in parameters]
    columns = zip(names, *is_covered.mean(axis=0), *widths, strict=True)
    return [Coverage(name, *map(float, row)) for name, *row in columns], times[0] / n_draws, times[1] / n_draws


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", choices=tuple(CASES), action="append", help="may be repeated  [default: all]")
    parser.add_argument("--draws", type=int, default=60, help="realizations of the noise  [default: 60]")
    parser.add_argument("--seed", type=int, default=0, help="[default: 0]")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    results: dict[str, Any] = {}
    for case in arguments.case or CASES:
        rows, fit_time, interval_time = measure_coverage(CASES[case], arguments.draws, arguments.seed)
        results[case] = {"fit_s": fit_time, "intervals_s": interval_time, "rows": [row._asdict() for row in rows]}
        if not arguments.json:
            print(f"{case}: {fit_time:.2f} s per fit, {interval_time:.2f} s for its intervals")
            for row in rows:
                print(
                    f"  {row.parameter:48} linear {100.0 * row.linear:5.1f} %, {row.linear_width:.4g}   "
                    f"reported {100.0 * row.reported:5.1f} %, {row.reported_width:.4g}"
                )
    if arguments.json:
        print(json.dumps(results))


if __name__ == "__main__":
    main()
