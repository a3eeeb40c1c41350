"""Fixtures of the diagnosis tests."""

import pytest

from klute_sim.datasets import dataset as datasets
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.workflow import fit_base_device
from tests.diagnosis.synthetic_dataset import write_dataset


@pytest.fixture(scope="module")
def fitted_data(tmp_path_factory: pytest.TempPathFactory) -> tuple[datasets.Dataset, WeightedData, Simulator]:
    """Return data of a device with a tendon 15 % stiffer than nominal and no effect."""
    nominal = load_device("klute-3-4-pair").parameters
    stiffer = nominal._replace(tendon=nominal.tendon._replace(stiffness_1=1.15 * nominal.tendon.stiffness_1))
    folder = write_dataset(tmp_path_factory.mktemp("data") / "d", base=stiffer)
    result, simulator = datasets.load_dataset(folder), Simulator(2)
    fit_experiments = [e for e in prepare_experiments(result, datasets.split_dataset(result)) if e.use == "fit"]
    return result, fit_base_device(result, fit_experiments, simulator)[1], simulator
