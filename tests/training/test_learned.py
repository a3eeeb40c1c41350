"""A learned policy as a controller: it does on the rig what it did in the environment."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from klute_sim.controllers import parse
from klute_sim.controllers.feedback import SensorReadings
from klute_sim.controllers.learned import PolicyController, build_policy_controller
from klute_sim.controllers.policy import Policy
from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import load_device
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.errors import InputError
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.units import BAR


def policy(inputs: int = 8, **environment: Any) -> Policy:
    random = np.random.default_rng(4)
    layers = [
        (random.normal(size=(6, inputs)).astype(np.float32), np.zeros(6, np.float32)),
        (random.normal(size=(1, 6)).astype(np.float32), np.zeros(1, np.float32)),
    ]
    made = {"config": {"environment": {"action": "residual", "residual_bar": 0.7, **environment}}}
    return Policy(np.ones(inputs, np.float32), layers, "tanh", tanh_output=False, metadata=made)


def test_it_asks_for_the_profile_and_its_change_of_it() -> None:
    own = policy()
    controller = build_policy_controller(own, "mine.npz")
    controller.reset()
    sensed = SensorReadings(0.1, -2.0, 0.3, 1.5, 0.9, 2.5e5, 0.42)
    turn = 2.0 * math.pi * 0.42
    action = float(own([0.1, -2.0, 0.3, 1.5, 0.9, 2.5, math.sin(turn), math.cos(turn)])[0])
    assert abs(action) > 0.01
    assert controller.command(sensed) == pytest.approx(load_default_profile().pressure_at(0.42) + 0.7 * BAR * action)


def test_late_sensors_are_as_late_as_in_training() -> None:
    late, prompt = build_policy_controller(policy(sensor_delay=2), "a"), build_policy_controller(policy(), "b")
    late.reset()
    prompt.reset()
    readings = [SensorReadings(0.05 * k, 0.0, 0.1 * k, 0.0, 0.5, 1e5, 0.3) for k in range(5)]
    told_late, told = [late.command(r) for r in readings], [prompt.command(r) for r in readings]
    assert told_late == [told[0], told[0], told[0], told[1], told[2]]


def test_it_walks_on_the_rig_as_in_its_environment() -> None:
    """Both begin a little apart in pressure; a stride later they are the same walk."""
    own, device = policy(), load_device("klute-1-1-4-pair")
    env = AnkleGaitEnv(action="residual", residual_bar=0.7, strides=3, reset_noise=0.0)
    seen, _ = env.reset(seed=0)
    pressures, ended = [], False
    while not ended:
        seen, _, terminated, ended, _ = env.step(own(seen))
        assert not terminated
        pressures.append(float(seen[5]))
    env.close()
    walked = simulate_gait(device, build_policy_controller(own, "mine"), GaitOptions(strides=3))
    here = walked["pressure"][20::20][: len(pressures)]
    there = np.array(pressures[: len(here)])
    last = slice(2 * len(here) // 3, None)
    assert np.corrcoef(here[last], there[last])[0, 1] > 0.99
    assert np.abs(here[last] - there[last]).mean() < 0.1


def test_a_file_is_a_controller_on_the_command_line(tmp_path: Path) -> None:
    policy().save(tmp_path / "p.npz")
    controller = parse.parse_controller(str(tmp_path / "p.npz"))
    assert isinstance(controller, PolicyController)
    told = controller.describe()
    assert told["kind"] == "policy"
    assert told["residual_bar"] == pytest.approx(0.7)
    assert told["sha256"] == build_policy_controller(policy(), "again").describe()["sha256"]


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (policy(inputs=5), "the policy has 5 inputs and 1 outputs; allowed: 8 and 1"),
        (policy(action="pressure"), "commands 'pressure'; allowed: residual"),
        (policy(residual_bar=float("nan")), "changes nan bar"),
        (policy(residual_bar=-5.0), "changes -5 bar"),
        (policy(sensor_delay=-3), "-3 intervals late"),
        (policy(sensor_delay=float("inf")), "does not say how it was trained"),
    ],
)
def test_a_policy_of_something_else_is_refused(given: Policy, says: str) -> None:
    with pytest.raises(InputError, match=says):
        build_policy_controller(given, "x.npz")


def test_a_policy_that_does_not_say_how_it_was_trained_is_refused() -> None:
    own = policy()
    with pytest.raises(InputError, match=r"x\.npz does not say how it was trained"):
        build_policy_controller(Policy(own.observation_scale, own.layers, own.activation, own.tanh_output, {}), "x.npz")
