"""A tester whose length has a wrong zero, and a muscle without a tendon, whose slack length would have its error."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import Device, load_device
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.number_error import LENGTH_ZERO, list_bench_error_candidates
from klute_sim.diagnosis.result import DiagnosisOptions
from klute_sim.diagnosis.transfer import predict_dataset
from klute_sim.diagnosis.workflow import diagnose
from klute_sim.report.diagnosis.text import describe_verdict, format_term

BARE, WITH_TENDON = load_device("klute-3-4"), load_device("klute-3-4-pair")
ZERO = EffectTerm("number_error", "value", number=LENGTH_ZERO)
INTERVAL = 0.01


def write_loops(folder: Path, zero: float) -> Path:
    """Write slow loops of length at three pressures, whose length reads ``zero`` [m] too much."""
    rng = np.random.default_rng(0)
    folder.mkdir()
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', 'device = "klute-3-4"']
    time, resting = np.arange(0.0, 4.0, INTERVAL), BARE.parameters.muscle.resting_length
    for pressure in (2e5, 3.5e5, 5e5):
        length = resting * (0.94 - 0.04 * np.cos(0.5 * np.pi * time))
        tension = simulate_rollouts(BARE.parameters, length, np.full(len(time), pressure), INTERVAL).tension
        for repeat in range(2):
            name = f"{1e-5 * pressure:g}_{repeat}.csv"
            columns = {"time [s]": time, "length [mm]": 1e3 * (length + zero)}
            columns |= {"pressure_command [bar]": np.full(len(time), 1e-5 * pressure)}
            write_trial(folder / name, columns | {"force [N]": tension + rng.normal(0.0, 1.0, len(time))})
            lines += ["[[trial]]", f'files = ["{name}"]', f'group = "{pressure:g}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


def list_numbers(rig: str, *devices: Device) -> dict[str, float]:
    trials = [SimpleNamespace(device=device) for device in devices]
    return list_bench_error_candidates(cast(Any, SimpleNamespace(rig=rig, trials=trials)))


def test_zero_is_a_candidate_for_one_muscle_without_a_tendon() -> None:
    assert list_numbers("bench", BARE, BARE) == {LENGTH_ZERO: 0.0}
    assert list_numbers("bench", WITH_TENDON) == {}  # the slack length is the same
    assert list_numbers("mjcf", BARE) == {}
    assert list_numbers("bench", BARE, BARE.with_changes({"muscle.resting_length_mm": 200.0})) == {}
    cylinder = SimpleNamespace(spec=SimpleNamespace(muscle=None, tendon=None))
    assert list_numbers("bench", cast(Any, cylinder)) == {}


def test_length_that_reads_too_much_is_a_shorter_muscle() -> None:
    length = np.linspace(0.95, 0.9, 50) * BARE.parameters.muscle.resting_length
    trial = BenchExperiment("a", "g", "fit", BARE, 0.0, 0.01, np.full(50, 4e5), {}, unit_length=length)
    hypothesis = Hypothesis(BARE, (), (), (ZERO,), rig_numbers=((LENGTH_ZERO, 0.0),))
    (setup,) = hypothesis.build_setups(np.array([0.7]), [trial])  # of 1 mm
    (plain,) = hypothesis.build_setups(np.zeros(1), [trial])
    assert plain.parameters == BARE.parameters
    found = simulate_rollouts(setup.parameters, length, trial.command, trial.dt).tension
    true = simulate_rollouts(BARE.parameters, length - 0.7e-3, trial.command, trial.dt).tension
    assert found == pytest.approx(true)
    assert hypothesis.list_fitted_keys(None) == set()  # no number of the device file
    assert format_term(ZERO) == "zero of the prescribed length"


@pytest.mark.slow
def test_wrong_zero_is_named_and_stays_with_its_machine(tmp_path: Path) -> None:
    """It was taken for a longer muscle with tapered ends."""
    result = diagnose(load_dataset(write_loops(tmp_path / "data", 0.8e-3)), DiagnosisOptions(n_jobs=1))
    assert describe_verdict(result) == "An instrument has a fault: zero of the prescribed length."
    assert result.final_fit is not None
    assert result.final_fit.values == pytest.approx([0.8], abs=0.02)
    assert result.fitted_device is not None
    assert result.fitted_device.parameters == BARE.parameters
    other = load_dataset(write_loops(tmp_path / "other", 0.0))  # a machine with a right zero
    prediction = predict_dataset(result, other, n_jobs=1)
    (force,) = prediction.channels.values()
    assert force.with_effects == pytest.approx(1.0, rel=0.1)
