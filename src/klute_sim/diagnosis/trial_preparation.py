"""Preparation of the trials of a dataset, and what their recordings show of instruments and controllers."""

from collections.abc import Sequence

import numpy as np

from klute_sim.datasets.dataset import Dataset
from klute_sim.datasets.split import Split
from klute_sim.datasets.trial import Trial
from klute_sim.diagnosis.command_delay import is_pressure
from klute_sim.diagnosis.experiments.base import Experiment, SimulationSetup
from klute_sim.diagnosis.experiments.held_samples import describe_held_samples
from klute_sim.diagnosis.experiments.interpolated_samples import describe_interpolated_samples
from klute_sim.diagnosis.experiments.mains_hum import describe_mains_hum
from klute_sim.diagnosis.experiments.prepare import clean_recordings, prepare_experiments
from klute_sim.diagnosis.experiments.quantized_inputs import describe_quantized_inputs, has_quantized_commands
from klute_sim.diagnosis.experiments.simulator import Simulator

MAX_SQUARE_RATIO = 0.99
"""Mean square residual of the pressures with smooth commands, over that with the recorded steps, below which the steps
are those of the log (assumed: without any difference between them it is 1)."""


def prepare_trials(dataset: Dataset, split: Split, simulator: Simulator) -> tuple[list[Experiment], list[str]]:
    """Return the experiments of ``dataset``, used as ``split`` says, and sentences about its recordings.

    Commands in few steps are taken to be smooth where the measured pressures agree better with that: a log with few
    digits rounds a command, and a converter with few bits does make its steps.

    Raises InputError as :func:`~klute_sim.diagnosis.experiments.prepare.prepare_experiments` does.
    """
    experiments = prepare_experiments(dataset, split)
    has_smooth_commands = False
    cleaned = clean_recordings(dataset.trials)
    if has_quantized_commands(cleaned):
        smooth = prepare_experiments(dataset, split, smooths_commands=True)
        squares = [_compute_pressure_square(trials, simulator) for trials in (experiments, smooth)]
        has_smooth_commands = squares[1] < MAX_SQUARE_RATIO * squares[0]
        experiments = smooth if has_smooth_commands else experiments
    return experiments, [
        *describe_held_samples(dataset.trials),
        *describe_interpolated_samples(dataset.trials),
        *describe_mains_hum(dataset.trials),
        *describe_quantized_inputs(cleaned, with_commands=has_smooth_commands),
    ]


def collect_sampling_rates(trials: Sequence[Trial]) -> dict[str, float]:
    """Return measured channel -> its highest sampling rate in ``trials`` [Hz]."""
    rates: dict[str, float] = {}
    for trial in trials:
        for channel, series in trial.measured.items():
            rates[channel] = max(rates.get(channel, 0.0), 1.0 / series.sampling_interval)
    return rates


def _compute_pressure_square(experiments: list[Experiment], simulator: Simulator) -> float:
    """Return the sum of the squared residuals of the nominal device in the pressures of the trials to fit [Pa^2]."""
    fitted = [e for e in experiments if e.use == "fit" and any(map(is_pressure, e.measured))]
    setups = [SimulationSetup(e.device.parameters) for e in fitted]
    return float(
        sum(
            np.sum((e.measured[channel].value - values) ** 2)
            for e, reading in zip(fitted, simulator.simulate([setups], fitted, may_diverge=True)[0], strict=True)
            for channel, values in reading.items()
            if is_pressure(channel)
        )
    )
