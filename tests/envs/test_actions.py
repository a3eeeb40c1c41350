"""What an action means: pressures, openings, changes of a base profile."""

import numpy as np
import pytest

from klute_sim.controllers.pressure import PressureProfile, load_default_profile
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.tasks.actions import ACTION_KINDS
from klute_sim.errors import InputError
from klute_sim.units import BAR


def opening_device() -> Device:
    text = load_device("klute-1-1-4-pair-valve").content.decode()
    text = text.replace('takes = "pressure"\ngain_per_bar = 5.0\n', 'takes = "opening"\n')
    return parse_device(text.replace('"valve.gain_per_bar" =', "#").encode(), "opens")


def phase(observed: np.ndarray) -> float:
    return float(np.arctan2(observed[6], observed[7]) / (2 * np.pi) % 1.0)


def test_the_documented_table_is_what_there_is() -> None:
    text = AnkleGaitEnv.__doc__ or ""
    for name, meaning in ACTION_KINDS.items():
        assert f"| ``{name}`` | {meaning} |" in text


def test_a_residual_changes_the_profile_at_the_estimated_phase() -> None:
    env = AnkleGaitEnv(action="residual", residual_bar=1.5, strides=2)
    observed, _ = env.reset(seed=1)
    random = np.random.default_rng(0)
    clipped = 0
    for _ in range(219):
        chosen = random.uniform(-1, 1)
        wanted = load_default_profile().pressure_at(phase(observed)) / BAR + 1.5 * np.float32(chosen)
        clipped += wanted < 0.0
        observed, _, terminated, _, info = env.step(np.array([chosen], dtype=np.float32))
        assert not terminated
        assert info["pressure_command_bar"] == pytest.approx(np.clip(wanted, 0.0, 5.0), abs=1e-4)
    assert clipped > 5


def test_a_residual_of_nothing_costs_no_smoothness_and_walks_like_the_profile() -> None:
    env = AnkleGaitEnv(action="residual")
    env.reset(seed=1)
    told = [env.step(np.zeros(1, dtype=np.float32)) for _ in range(550)]
    assert all(info["reward_smoothness"] == 0.0 for *_, info in told)
    assert 500.0 < sum(reward for _, reward, *_ in told) < 560.0


def test_another_profile_is_the_base_of_another_walk() -> None:
    flat = PressureProfile("flat", (0.0, 50.0), (2.0, 2.0))
    env = AnkleGaitEnv(action="residual", profile=flat)
    env.reset(seed=1)
    for value, bar in ((0.0, 2.0), (1.0, 3.0), (-0.5, 1.5)):
        assert env.step(np.array([value], dtype=np.float32))[4]["pressure_command_bar"] == pytest.approx(bar)


def test_openings_are_the_only_actions_of_a_device_that_takes_them() -> None:
    env = AnkleGaitEnv(device=opening_device(), action="valve")
    env.reset(seed=0)
    assert env.step(np.array([0.25], dtype=np.float32))[4]["valve_command"] == 0.25
    for action in ("pressure", "residual"):
        with pytest.raises(InputError, match=rf"action is '{action}', and 'klute-1-1-4-pair-valve' takes openings"):
            AnkleGaitEnv(device=opening_device(), action=action)
    with pytest.raises(InputError, match=r"'klute-1-1-4-pair' takes pressures; allowed: pressure, residual"):
        AnkleGaitEnv(action="valve")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"action": "force"}, "action is 'force'; allowed: pressure, valve, residual"),
        ({"residual_bar": 0.0}, "residual_bar is 0; allowed: above 0"),
        ({"residual_bar": np.nan}, "residual_bar is nan"),
    ],
)
def test_what_cannot_be_is_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        AnkleGaitEnv(**options)
