"""Measure what the diagnosis leaves of noise-free data when it is told the truth.

    python -m benchmarks.hidden_effects.simulation_error --seed 4242
    python -m benchmarks.hidden_effects.simulation_error --seed 4242 --walks

For each form of the catalogue a dataset without noise is made: of the bench with the effect in the device file, or of
walks with the effect in the rig. The device with the true numbers is simulated as in ``klute-sim diagnose``. What
remains is its error: time step, the interpolation of the inputs, and differences between the two programs. It
is stated over the noise of the benchmark's instruments; a misfit is relevant from a quarter of the noise on.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.hidden_effects import walks
from benchmarks.hidden_effects.catalogue import (
    BENCH_CHANNELS,
    BODY_EFFECTS,
    EFFECTS,
    GAIT_CHANNELS,
    KNOWN_VALVE,
    VALVE_EFFECTS,
    Channel,
)
from benchmarks.hidden_effects.generate import make_dataset
from benchmarks.hidden_effects.plan import draw_effect
from benchmarks.hidden_effects.simulate import Noise

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData

NO_NOISE = Noise(force=1e-6, pressure=1e-9, muscle_length=1e-7, wander=0.0, logged_length=0.0, logged_command=0.0)
"""Noise that only the decimals of the files exceed; 0 would stand for the usual one."""

WALK_NOISE_FRACTION = 1e-6
"""Noise of a walk over the usual one: only the decimals of the files exceed it."""


def list_known_effects(key: tuple[str, str]) -> list[dict[str, Any]]:
    """Return the effects of a device with form ``key`` of typical size, and with a valve where it needs one."""
    valve = [KNOWN_VALVE] if key[0] in VALVE_EFFECTS else []
    return [*valve, draw_effect(EFFECTS, key, None)]


def measure_bench_error(key: tuple[str, str] | None, seed: int, simulator: Simulator) -> dict[str, float]:
    """Return channel -> root mean square error over the noise, the largest of all trials.

    ``key`` is effect and form; None for a device without effects.
    """
    known = [] if key is None else list_known_effects(key)
    with tempfile.TemporaryDirectory() as folder:
        truth = make_dataset(
            Path(folder) / "data", seed, noise=NO_NOISE, muscle_length=True, block="clean", repeats=1, known=known
        )
        return _compare_with_truth(Path(folder) / "data", truth["base"], None, BENCH_CHANNELS, simulator)


def measure_walk_error(key: tuple[str, str] | None, seed: int, simulator: Simulator) -> dict[str, float]:
    """Return channel -> root mean square error over the noise, the largest of all walks.

    ``key`` is effect and form; None for a prosthesis without effects.
    """
    effect = None if key is None else draw_effect(EFFECTS | BODY_EFFECTS, key, None)
    with tempfile.TemporaryDirectory() as folder:
        truth = walks.make_dataset(
            Path(folder) / "data",
            seed,
            truth=Path(folder) / "truth.json",
            effects=[] if effect is None else [effect],
            noise={name: WALK_NOISE_FRACTION * value for name, value in walks.CHANNEL_NOISE.items()},
        )
        return _compare_with_truth(Path(folder) / "data", truth["base"], effect, GAIT_CHANNELS, simulator)


def _compare_with_truth(
    folder: Path,
    base: Mapping[str, float],
    effect: Mapping[str, Any] | None,
    channels: Mapping[str, Channel],
    simulator: Simulator,
) -> dict[str, float]:
    """Return the errors of a device with the numbers ``base`` and ``effect`` on the dataset ``folder``."""
    dataset = load_dataset(folder)
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    terms = () if effect is None else (EffectTerm(effect["name"], effect["form"]),)
    hypothesis = Hypothesis(dataset.device, tuple(dataset.uncertainties.items()), (), terms)
    true_values = {**base, **({} if effect is None else effect["parameters"])}
    x = np.array([parameter.normalize(true_values[parameter.name]) for parameter in hypothesis.parameters])
    (residuals,) = WeightedData(simulator, experiments, {}).compute_residuals(hypothesis, [x])
    return {
        channel: max(float(np.sqrt(np.mean(row[channel] ** 2))) for row in residuals)
        / (instrument.noise * CHANNEL_UNITS[channel][1])
        for channel, instrument in channels.items()
    }


def measure_all(seed: int, *, is_walk: bool) -> Iterator[tuple[str, Mapping[str, float]]]:
    """Yield name and error of the device without effects, and of each form of the catalogue."""
    simulator = Simulator()
    measure, forms = (measure_walk_error, BODY_EFFECTS) if is_walk else (measure_bench_error, EFFECTS)
    for key in (None, *forms):
        yield "no effect" if key is None else f"{key[0]} ({key[1]})", measure(key, seed, simulator)
    simulator.close()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=4242, help="seed of bench and inputs  [default: 4242]")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the errors")
    parser.add_argument("--walks", action="store_true", help="measure walks and effects of the body")
    arguments = parser.parse_args()
    errors = {}
    for name, error in measure_all(arguments.seed, is_walk=arguments.walks):
        errors[name] = dict(error)
        print(f"{name:40}" + "".join(f"  {channel} {value:.3f}" for channel, value in error.items()), flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(errors, indent=1), "utf-8")


if __name__ == "__main__":
    main()
