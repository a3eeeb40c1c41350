"""Lengths of the units in a trial of a mechanism follow the positions of its joints."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.api.diagnosis import load_dataset
from klute_sim.datasets.dataset import split_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.diagnosis.experiments.mechanism import MechanismExperiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.mechanism.assembly import compute_unit_lengths
from tests.diagnosis import synthetic_joint_dataset as joint


def test_length_of_a_long_trial_follows_a_quick_motion(tmp_path: Path) -> None:
    """A motion of 2 Hz over a minute."""
    time = 0.005 * np.arange(12_000)
    angle = 20.0 * np.sin(2.0 * np.pi * 2.0 * time)
    columns = {"time [s]": time, "angle_joint [deg]": angle}
    write_trial(tmp_path / "a.csv", columns | {f"{name} [bar]": np.full(len(time), 2.0) for name in joint.INPUTS})
    lines = [
        'format = "klute-sim-dataset/2"',
        'rig = "mjcf"',
        'model = "antagonist_joint"',
        'device = "klute-3-4-pair"',
    ]
    lines += [f"prescribed = {list(joint.INPUTS)}", 'measured = ["angle_joint"]', "[numbers]"]
    lines += [*(f'"{name}" = {value}' for name, value in joint.NUMBERS.items()), "[[trial]]", 'files = ["a.csv"]']
    (tmp_path / "dataset.toml").write_text("\n".join(lines), "utf-8")
    dataset = load_dataset(tmp_path)
    (experiment,) = prepare_experiments(dataset, split_dataset(dataset))
    assert isinstance(experiment, MechanismExperiment)
    assert experiment.unit_length is not None
    grid = experiment.start_time + experiment.dt * np.arange(1, 4001)
    positions = np.interp(grid, time, np.radians(angle))
    lengths = compute_unit_lengths(experiment.mechanism, joint.NUMBERS, {"joint": positions})["flexor"]
    error = experiment.unit_length[:4000] - lengths
    assert np.sqrt(np.mean(error**2)) < 0.01 * np.std(lengths)
    assert experiment.length_range == pytest.approx(np.ptp(lengths), rel=0.01)
