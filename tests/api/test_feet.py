"""The option for the foot reaches every command that simulates gait."""

from pathlib import Path

import pytest

import klute_sim as ks
from klute_sim.api.baselines import select_baselines
from klute_sim.envs.ankle_gait import AnkleGaitEnv


def test_baselines_have_the_foot() -> None:
    baselines = select_baselines(["hand-tuned"], [("klute-1-1-4-pair", "off")], "sach")
    assert [baseline.device.spec.describe_foot()["name"] for baseline in baselines] == ["sach", "sach"]


@pytest.mark.slow
@pytest.mark.usefixtures("in_process_runner")
def test_sweep_simulates_every_foot(tmp_path: Path) -> None:
    result = ks.sweep(feet=["rigid", "sach"], strides=1, time_step=1e-3, n_jobs=1, folder=tmp_path / "s")
    assert [row["device"] for row in result.rows] == ["klute-1-1-4-pair, rigid", "klute-1-1-4-pair, sach"]
    moments = [row["ankle_moment_peak [N*m/kg]"] for row in result.rows]
    assert moments[1] < moments[0] - 0.02


@pytest.mark.slow
def test_assessment_of_a_foot_differs() -> None:
    runs = [
        ks.assess(only=["spring-foot-6"], foot=foot, strides=1, time_step=1e-3).persons[0].controllers[0].run
        for foot in (None, "sach")
    ]
    assert [run.summary["foot"] for run in runs if run] == ["rigid", "sach"]


@pytest.mark.slow
def test_environment_has_the_foot() -> None:
    env = AnkleGaitEnv(foot="sach", strides=1, time_step=1e-3)
    env.reset(seed=1)
    assert env.step(env.action_space.sample())[0].shape == (8,)
    env.close()


@pytest.mark.parametrize("function", [ks.simulate_gait, ks.tune, ks.train, ks.simulate_baselines, ks.assess])
def test_unknown_foot_is_refused(function: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ks.InputError, match="there is no foot 'sash'"):
        function(foot="sash")  # type: ignore[operator]
