"""Test the p-values of clean datasets, so that a false discovery rate can be stated.

    python -m benchmarks.hidden_effects.p_values --seed 101 707 --count 300  # fits the null distribution
    python -m benchmarks.hidden_effects.p_values --seed 1313 --json test.json  # tests its p-values

Each dataset is one of block ``clean``: nothing is hidden, and numbers, noise, drift and inputs are as in all blocks.
The device is fitted without effects, and the p-value of its misfit is computed as in ``klute-sim diagnose``. Nothing is
missing in any dataset, so every discovery is false, and the false discovery rate at a level is the fraction of p-values
up to it. Mean and spread of the irrelevant misfit, which the p-values need, are those of maximum likelihood.
"""

import argparse
import json
import tempfile
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from benchmarks.hidden_effects.generate import make_dataset
from benchmarks.hidden_effects.plan import SPLIT_SEEDS, DatasetSpec, plan_datasets
from scipy.optimize import minimize
from scipy.stats import binomtest, kstest, t
from threadpoolctl import threadpool_limits

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.diagnosis.data_quality import select_usable_data
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.noise.heteroscedastic import add_noise_scales
from klute_sim.diagnosis.noise.p_value import compute_null_distribution, convert_to_p_value
from klute_sim.diagnosis.noise.repeat_products import RepeatProducts, compute_repeat_products
from klute_sim.diagnosis.workflow import fit_base_device

DISCOVERY_RATE = 0.05
"""Level at which something is called missing."""


def measure_dataset(spec: DatasetSpec) -> RepeatProducts | None:
    """Make the dataset of ``spec`` and return the shared misfit of the device without effects."""
    arguments = {key: value for key, value in spec.items() if key != "name"}
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1):
        make_dataset(Path(folder) / "data", **arguments, truth=Path(folder) / "truth.json")
        dataset, simulator = load_dataset(Path(folder) / "data"), Simulator(1)
        experiments = prepare_experiments(dataset, split_dataset(dataset))
        experiments, fitted, *_ = select_usable_data(dataset, experiments, simulator)
        experiments, _ = add_noise_scales(experiments, fitted, simulator)
        fitted = [e for e in experiments if e.use == "fit" and e.measured]
        fit, data = fit_base_device(dataset, fitted, simulator)
        simulator.close()
        return compute_repeat_products(data, fit)


def fit_null_distribution(datasets: Sequence[RepeatProducts]) -> tuple[tuple[float, float], float]:
    """Return the mean squares of the irrelevant misfit and their spread (maximum likelihood)."""
    totals = np.array([shared.products.sum() for shared in datasets])

    def compute_loss(x: np.ndarray) -> float:
        nulls = [compute_null_distribution(shared, (x[0], x[1]), x[2]) for shared in datasets]
        mean, std, degrees_of_freedom = np.array(nulls).T
        return -float(t.logpdf(totals, degrees_of_freedom, mean, std).sum())

    load, motion, spread = minimize(compute_loss, [0.03, 0.1, 0.01], method="Nelder-Mead").x.tolist()
    return (load, motion), abs(spread)


def summarize_p_values(p_values: Sequence[float]) -> dict[str, float]:
    """Return a Kolmogorov-Smirnov test of uniformity, and the false discovery rate with its Wilson interval."""
    n_discoveries = sum(p <= DISCOVERY_RATE for p in p_values)
    interval = binomtest(n_discoveries, len(p_values)).proportion_ci(method="wilson")
    return {
        "datasets": len(p_values),
        "ks_p_value": float(kstest(p_values, "uniform").pvalue),
        "false_discovery_rate": n_discoveries / len(p_values),
        "low": interval.low,
        "high": interval.high,
    }


def main() -> None:
    """Compute, test and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=400, help="number of datasets of each seed  [default: 400]")
    parser.add_argument(
        "--seed",
        type=int,
        nargs="+",
        default=[SPLIT_SEEDS["development"]],
        help="seeds of the datasets  [default: that of the development split]",
    )
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="datasets at once  [default: 1]")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the p-values and their test")
    arguments = parser.parse_args()
    specs = [spec for seed in arguments.seed for spec in plan_datasets("clean", arguments.count, seed)]
    with get_context("spawn").Pool(arguments.at_once) as pool:
        datasets = [shared for shared in pool.imap(measure_dataset, specs) if shared is not None]
    p_values = [convert_to_p_value(shared) for shared in datasets]
    summary = summarize_p_values(p_values)
    (load, motion), spread = fit_null_distribution(datasets)
    summary |= {"irrelevant_load": load, "irrelevant_motion": motion, "irrelevant_spread": spread}
    print("\n".join(f"{name}: {value:.4g}" for name, value in summary.items()))
    if arguments.json:
        arguments.json.write_text(json.dumps({**summary, "p_values": p_values}, indent=1), "utf-8")


if __name__ == "__main__":
    main()
