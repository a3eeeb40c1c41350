"""Test the p-values of clean datasets, so that a false discovery rate can be stated.

    python -m benchmarks.hidden_effects.p_values --count 400 --json p_values.json

Each dataset is one of block ``clean``: nothing is hidden, and numbers, noise, drift and inputs are as in all blocks.
The device is fitted without effects, and the p-value of its misfit is computed as in ``klute-sim diagnose``. Nothing is
missing in any dataset, so every discovery is false, and the false discovery rate at a level is the fraction of p-values
up to it. A p-value is valid if it is not smaller than a uniform one (one-sided Kolmogorov-Smirnov test).
"""

import argparse
import json
import tempfile
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path

from benchmarks.hidden_effects.generate import make_dataset
from benchmarks.hidden_effects.plan import HALF_SEEDS, DatasetSpec, plan_datasets
from scipy.stats import binomtest, kstest
from threadpoolctl import threadpool_limits

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.diagnosis.data_quality import select_usable_data
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.noise.heteroscedastic import add_noise_scales
from klute_sim.diagnosis.noise.randomization import compute_p_value
from klute_sim.diagnosis.workflow import fit_base_device

DISCOVERY_RATE = 0.05
"""Level at which something is called missing."""


def compute_dataset_p_value(spec: DatasetSpec) -> float | None:
    """Make the dataset of ``spec`` and return the p-value of the misfit of the device without effects."""
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
        return compute_p_value(data, fit)


def summarize_p_values(p_values: Sequence[float]) -> dict[str, float]:
    """Return Kolmogorov-Smirnov tests against a uniform distribution, and the false discovery rate (Wilson interval)."""
    n_discoveries = sum(p <= DISCOVERY_RATE for p in p_values)
    interval = binomtest(n_discoveries, len(p_values)).proportion_ci(method="wilson")
    uniform, smaller = (kstest(p_values, "uniform", alternative=side) for side in ("two-sided", "greater"))
    return {
        "datasets": len(p_values),
        "ks_p_value": float(uniform.pvalue),
        "ks_p_value_smaller_than_uniform": float(smaller.pvalue),
        "false_discovery_rate": n_discoveries / len(p_values),
        "low": interval.low,
        "high": interval.high,
    }


def main() -> None:
    """Compute, test and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=400, help="number of datasets  [default: 400]")
    parser.add_argument("--half", choices=tuple(HALF_SEEDS), default="development", help="[default: development]")
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="datasets at once  [default: 1]")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the p-values and their test")
    arguments = parser.parse_args()
    specs = plan_datasets("clean", arguments.count, HALF_SEEDS[arguments.half])
    with get_context("spawn").Pool(arguments.at_once) as pool:
        p_values = [p for p in pool.imap(compute_dataset_p_value, specs) if p is not None]
    summary = summarize_p_values(p_values)
    print("\n".join(f"{name}: {value:.4g}" for name, value in summary.items()))
    if arguments.json:
        arguments.json.write_text(json.dumps({**summary, "p_values": p_values}, indent=1), "utf-8")


if __name__ == "__main__":
    main()
