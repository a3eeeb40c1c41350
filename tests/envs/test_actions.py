"""Tests of the action kinds: pressures, valve openings, and changes of a base profile."""

import numpy as np
import pytest

from klute_sim.controllers.pressure import PressureProfile, load_default_profile
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.tasks.actions import ACTION_KINDS
from klute_sim.errors import InputError
from klute_sim.units import BAR


def make_opening_device() -> Device:
    text = load_device("klute-1-1-4-pair-valve").content.decode()
    text = text.replace('command = "pressure"\ngain_per_bar = 5.0\n', 'command = "opening"\n')
    return parse_device(text.replace('"valve.gain_per_bar" =', "#").encode(), "opens")


def estimated_phase(observation: np.ndarray) -> float:
    return float(np.arctan2(observation[6], observation[7]) / (2 * np.pi) % 1.0)


def test_documented_table_matches_action_kinds() -> None:
    text = AnkleGaitEnv.__doc__ or ""
    for name, meaning in ACTION_KINDS.items():
        assert f"| ``{name}`` | {meaning} |" in text


def test_residual_changes_profile_at_estimated_phase() -> None:
    env = AnkleGaitEnv(action="residual", residual_bar=1.5, strides=2)
    observation, _ = env.reset(seed=1)
    rng = np.random.default_rng(0)
    clipped = 0
    for _ in range(219):
        action = rng.uniform(-1, 1)
        expected = load_default_profile().pressure_at(estimated_phase(observation)) / BAR + 1.5 * np.float32(action)
        clipped += expected < 0.0
        observation, _, terminated, _, info = env.step(np.array([action], dtype=np.float32))
        assert not terminated
        assert info["pressure_command_bar"] == pytest.approx(np.clip(expected, 0.0, 5.0), abs=1e-4)
    assert clipped > 5


def test_zero_residual_follows_profile_without_smoothness_cost() -> None:
    env = AnkleGaitEnv(action="residual")
    env.reset(seed=1)
    steps = [env.step(np.zeros(1, dtype=np.float32)) for _ in range(550)]
    assert all(info["reward_smoothness"] == 0.0 for *_, info in steps)
    assert 500.0 < sum(reward for _, reward, *_ in steps) < 560.0


def test_profile_option_replaces_base_profile() -> None:
    flat_profile = PressureProfile("flat", (0.0, 50.0), (2.0, 2.0))
    env = AnkleGaitEnv(action="residual", profile=flat_profile)
    env.reset(seed=1)
    for value, bar in ((0.0, 2.0), (1.0, 3.0), (-0.5, 1.5)):
        assert env.step(np.array([value], dtype=np.float32))[4]["pressure_command_bar"] == pytest.approx(bar)


def test_opening_device_allows_valve_actions_only() -> None:
    env = AnkleGaitEnv(device=make_opening_device(), action="valve")
    env.reset(seed=0)
    assert env.step(np.array([0.25], dtype=np.float32))[4]["valve_command"] == 0.25
    for action in ("pressure", "residual"):
        with pytest.raises(InputError, match=rf"action is '{action}', and 'klute-1-1-4-pair-valve' takes openings"):
            AnkleGaitEnv(device=make_opening_device(), action=action)
    with pytest.raises(InputError, match=r"'klute-1-1-4-pair' takes pressures; allowed: pressure, residual"):
        AnkleGaitEnv(action="valve")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"action": "force"}, "action is 'force'; allowed: pressure, valve, residual"),
        ({"residual_bar": 0.0}, "residual_bar is 0; allowed: above 0"),
        ({"residual_bar": np.nan}, "residual_bar is nan"),
    ],
)
def test_invalid_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        AnkleGaitEnv(**options)
