"""Sweeps of the controlled joint: cases, metrics, resumption, table and refusals."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import klute_sim as ks
from klute_sim.device.device import load_device
from klute_sim.envs.antagonist_joint import AntagonistJointEnv
from klute_sim.envs.joint_pid import DEFAULT_GAINS, PidController
from klute_sim.errors import InputError
from klute_sim.parameter_sweep.evaluate import evaluate_case
from klute_sim.parameter_sweep.joint_metrics import JOINT_METRIC_COLUMNS
from klute_sim.parameter_sweep.joint_plan import JointCase, JointSweepPlan
from klute_sim.parameter_sweep.table import JOINT_COLUMN_TYPES
from klute_sim.viewer.layouts import sweep as layout

pytestmark = pytest.mark.usefixtures("in_process_runner")
DEVICE = load_device("klute-3-4-pair")
SHORT: dict[str, Any] = {"seconds": 0.5, "episodes": 2, "n_jobs": 1}


def make_case(**changes: Any) -> JointCase:
    return JointCase(**({"device_name": "a", "device": DEVICE, "seconds": 0.5, "episodes": 2} | changes))


def test_metrics_are_those_of_single_episodes() -> None:
    metrics = evaluate_case(make_case(seed=3)).metrics
    assert tuple(metrics) == JOINT_METRIC_COLUMNS
    errors, rewards = [], []
    for seed in (3, 4):
        env, controller = AntagonistJointEnv(duration=0.5), PidController()
        observation, _ = env.reset(seed=seed)
        for _ in range(50):
            observation, reward, *_, info = env.step(controller.act(observation))
            errors.append(info["angle_error_deg"])
            rewards.append(reward)
    assert metrics["angle_error_rms [deg]"] == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=1e-9)
    assert metrics["angle_error_max [deg]"] == pytest.approx(np.max(np.abs(errors)), rel=1e-9)
    assert metrics["reward [1]"] == pytest.approx(np.mean(rewards), rel=1e-6)


def test_more_co_contraction_means_more_force_and_no_control_more_error() -> None:
    usual, stiff, none = (
        evaluate_case(make_case(gains={**DEFAULT_GAINS, **change})).metrics
        for change in ({}, {"mean": 0.5}, {"proportional": 0.0, "integral": 0.0, "derivative": 0.0})
    )
    assert float(stiff["force_flexor_mean [N]"] or 0.0) > 1.1 * float(usual["force_flexor_mean [N]"] or 0.0)
    assert float(none["angle_error_rms [deg]"] or 0.0) > 2.0 * float(usual["angle_error_rms [deg]"] or 0.0)
    assert none["action_change_rms [1]"] == 0.0


def test_key_depends_on_every_input_and_on_no_name() -> None:
    case = make_case()
    changes: list[dict[str, Any]] = [
        *({"gains": {**DEFAULT_GAINS, name: 0.5}} for name in DEFAULT_GAINS),
        *({"load_kg": 2.0}, {"episodes": 3}, {"seconds": 2.0}, {"seed": 1}, {"dt": 1e-3}),
        {"software": {**case.software, "mujoco": "0.1"}},
        {"device": load_device("klute-1-1-4-pair")},
    ]
    keys = {case.key, *(replace(case, **change).key for change in changes)}
    assert len(keys) == 1 + len(changes)
    assert replace(case, device_name="b").key == case.key


def test_sweep_of_the_joint_resumes_and_writes_its_table(tmp_path: Path) -> None:
    options: dict[str, Any] = {"gains": {"proportional": [2.0, 4.0]}, "loads": [0.5, 2.0], "folder": tmp_path / "s"}
    result = ks.sweep_joint(**options, **SHORT)
    assert (len(result.rows), result.n_failed, result.n_resumed) == (4, 0, 0)
    assert [row["proportional [1/rad]"] for row in result.rows] == [2.0, 2.0, 4.0, 4.0]
    assert [row["load [kg]"] for row in result.rows] == [0.5, 2.0, 0.5, 2.0]
    assert len({row["angle_error_rms [deg]"] for row in result.rows}) == 4
    assert ks.sweep_joint(**options, **SHORT).n_resumed == 4
    text = str(result)
    for phrase in ("4 cases", "proportional", "rms error", "mean over 2 episodes of 0.5 s"):
        assert phrase in text
    table = pq.read_table(result.save(with_csv=True) / "sweep.parquet")
    assert table.column_names == list(JOINT_COLUMN_TYPES)
    assert table.to_pylist() == result.rows
    assert result.plot().axes[0].get_xlabel() == "proportional [1/rad]"
    charts = layout.build_charts(result.rows)
    assert list(charts) == ["proportional [1/rad]", "load [kg]"]
    assert "angle_error_rms" in layout.format_page(result.rows)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gains": {"proportionl": (1.0,)}}, "did you mean 'proportional'"),
        ({"gains": {"proportional": (-1.0,)}}, "the gain proportional is -1; allowed: 0 to 10000"),
        ({"gains": {"mean": (1.0,)}}, "the mean action is 1"),
        ({"loads_kg": (0.0,)}, "load is 0 kg; allowed: 0.01 to 100 kg"),
        ({"episodes": 0}, "the number of episodes is 0"),
        ({"seconds": 0.0}, "duration is 0 s"),
        ({"dt": 3e-4}, "divisors of 10 ms"),
    ],
)
def test_invalid_values_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        JointSweepPlan(**({"devices": {"a": DEVICE}} | changes))
