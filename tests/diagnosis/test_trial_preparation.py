"""The steps of a command are those of its log, or those of a converter, as the measured pressures show."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.trial_preparation import prepare_trials

DEVICE = "klute-3-4-pair"
TIME = np.arange(0.0, 6.0, 2e-3)
STEP_BAR = 0.05


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    simulator = Simulator(1)
    yield simulator
    simulator.close()


def write_dataset(folder: Path, *, acts_in_steps: bool, has_pressure: bool = True) -> Path:
    """Write trials with commands in steps of 50 mbar, which the log makes, or with ``acts_in_steps`` a converter."""
    folder.mkdir()
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', f'device = "{DEVICE}"']
    rng = np.random.default_rng(0)
    for group, rate in (("fit_1", 2.0), ("fit_2", 1.3), ("test_1", 1.7)):
        command = 2.0 + np.sin(rate * TIME)
        logged = STEP_BAR * np.round(command / STEP_BAR)
        length = 340.0 + 5.0 * np.sin(1.5 * rate * TIME)
        response = ks.simulate_response(
            DEVICE, TIME, length, logged if acts_in_steps else command, zero_order_hold=acts_in_steps
        )
        channels = ("force", "pressure") if has_pressure else ("force",)
        for repeat in "ab":
            columns = {"time [s]": TIME, "length [mm]": length, "pressure_command [bar]": logged}
            for name in channels:
                noise = {"force": 3.0, "pressure": 0.01}[name] * rng.normal(size=len(TIME))
                columns[response.format_heading(name)] = response[name] + noise
            write_trial(folder / f"{group}_{repeat}.csv", columns)
            lines += ["", "[[trial]]", f'files = ["{group}_{repeat}.csv"]', f'group = "{group}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


def measure_steps(command: np.ndarray) -> float:
    """Return the largest change of ``command`` [Pa] in a time step [bar]."""
    return float(np.abs(np.diff(command)).max()) / 1e5


@pytest.mark.parametrize("acts_in_steps", [False, True])
def test_pressures_decide(tmp_path: Path, simulator: Simulator, acts_in_steps: bool) -> None:
    dataset = load_dataset(write_dataset(tmp_path / "data", acts_in_steps=acts_in_steps))
    experiments, remarks = prepare_trials(dataset, split_dataset(dataset), simulator)
    steps = [measure_steps(e.command) for e in experiments]
    assert max(steps) < 0.05 * STEP_BAR or acts_in_steps
    assert min(steps) > 0.2 * STEP_BAR or not acts_in_steps  # linear between two samples
    assert any("'pressure_command' (40 steps in its range)" in remark for remark in remarks) != acts_in_steps


def test_without_pressures_steps_stay(tmp_path: Path, simulator: Simulator) -> None:
    dataset = load_dataset(write_dataset(tmp_path / "data", acts_in_steps=False, has_pressure=False))
    experiments, remarks = prepare_trials(dataset, split_dataset(dataset), simulator)
    assert measure_steps(experiments[0].command) > 0.2 * STEP_BAR
    assert remarks == []
