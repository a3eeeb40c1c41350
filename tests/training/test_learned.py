"""Tests of a learned policy as a controller: it acts on the rig as in its environment."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.controllers import parse
from klute_sim.controllers.feedback import SensorReadings
from klute_sim.controllers.learned import PolicyController, build_policy_controller
from klute_sim.controllers.policy import Policy
from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import load_device
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.ankle_walk import AnkleWalkEnv
from klute_sim.errors import InputError
from klute_sim.gait.code_digest import POLICY_KEY, compute_code_digest
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.units import BAR
from klute_sim.walker.person.build import Prosthesis
from klute_sim.walker.reflexes.walker_file import load_walker
from klute_sim.walker.simulation.simulate import WalkOptions, simulate_walk


def make_policy(inputs: int = 8, **environment: Any) -> Policy:
    rng = np.random.default_rng(4)
    layers = [
        (rng.normal(size=(6, inputs)).astype(np.float32), np.zeros(6, np.float32)),
        (rng.normal(size=(1, 6)).astype(np.float32), np.zeros(1, np.float32)),
    ]
    metadata = {"config": {"environment": {"action": "residual", "residual_bar": 0.7, **environment}}}
    return Policy(np.ones(inputs, np.float32), layers, "tanh", tanh_output=False, metadata=metadata)


def make_walking_policy(**environment: Any) -> Policy:
    policy = make_policy(**environment)
    return replace(policy, metadata={**policy.metadata, "environment": "klute_sim/AnkleWalk-v0"})


def test_command_is_profile_plus_residual() -> None:
    trained_policy = make_policy()
    controller = build_policy_controller(trained_policy, "mine.npz")
    controller.reset()
    readings = SensorReadings(0.1, -2.0, 0.3, 1.5, 0.9, 2.5e5, 0.42)
    phase_angle = 2.0 * math.pi * 0.42
    action = float(trained_policy([0.1, -2.0, 0.3, 1.5, 0.9, 2.5, math.sin(phase_angle), math.cos(phase_angle)])[0])
    assert abs(action) > 0.01
    assert controller.command(readings) == pytest.approx(load_default_profile().pressure_at(0.42) + 0.7 * BAR * action)


def test_sensor_delay_equals_that_of_training() -> None:
    delayed, undelayed = (
        build_policy_controller(make_policy(sensor_delay=2), "a"),
        build_policy_controller(make_policy(), "b"),
    )
    delayed.reset()
    undelayed.reset()
    readings = [SensorReadings(0.05 * k, 0.0, 0.1 * k, 0.0, 0.5, 1e5, 0.3) for k in range(5)]
    delayed_commands, commands = [delayed.command(r) for r in readings], [undelayed.command(r) for r in readings]
    assert delayed_commands == [commands[0], commands[0], commands[0], commands[1], commands[2]]


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0, 4])
def test_controller_acts_on_rig_as_in_environment(delay: int) -> None:
    """Compare after a stride, because the initial pressures differ slightly."""
    trained_policy, device = make_policy(sensor_delay=delay), load_device("klute-1-1-4-pair")
    env = AnkleGaitEnv(action="residual", residual_bar=0.7, strides=3, reset_noise=0.0, sensor_delay=delay)
    observation, _ = env.reset(seed=0)
    pressures, ended = [], False
    while not ended:
        observation, _, terminated, ended, _ = env.step(trained_policy(observation))
        assert not terminated
        pressures.append(float(env.data.act[env.model.actuator("prosthesis_muscle_tendon").actadr[0]]))
    env.close()
    recording = simulate_gait(device, build_policy_controller(trained_policy, "mine"), GaitOptions(strides=3))
    rig_pressures = recording["pressure"][20::20][: len(pressures)]
    env_pressures = np.array(pressures[: len(rig_pressures)])
    last_third = slice(2 * len(rig_pressures) // 3, None)
    assert np.corrcoef(rig_pressures[last_third], env_pressures[last_third])[0, 1] > 0.99
    assert np.abs(rig_pressures[last_third] - env_pressures[last_third]).mean() < 0.1


@pytest.mark.parametrize("options", [{}, {"sensor_delay": 2}, {"base": "profile"}], ids=["machine", "late", "profile"])
def test_controller_acts_on_a_predicted_walk_as_in_its_environment(options: dict[str, Any]) -> None:
    policy = make_walking_policy(**options)
    env = AnkleWalkEnv(action="residual", residual_bar=0.7, walkers=["machine-1"], duration=2.0, **options)
    observation, _ = env.reset(seed=0)
    positions = []
    for _ in range(199):
        observation, _, terminated, *_ = env.step(policy(observation))
        positions.append(float(env.data.qpos[0]))
        assert not terminated
    prosthesis = Prosthesis(device=load_device("klute-1-1-4-pair"))
    controller = build_policy_controller(policy, "mine")
    recording = simulate_walk(load_walker("machine-1"), prosthesis, controller, WalkOptions(seconds=2.0))
    walked = recording["hip_x"][10::10]
    assert np.abs(walked - np.array(positions)[: len(walked)]).max() < 1e-3


def test_policy_file_is_a_controller(tmp_path: Path) -> None:
    make_policy().save(tmp_path / "p.npz")
    controller = parse.parse_controller(str(tmp_path / "p.npz"))
    assert isinstance(controller, PolicyController)
    commands = controller.describe()
    assert commands["kind"] == "policy"
    assert commands["residual_bar"] == pytest.approx(0.7)
    assert commands["sha256"] == build_policy_controller(make_policy(), "again").describe()["sha256"]


@pytest.mark.parametrize(
    ("invalid_policy", "message"),
    [
        (make_policy(inputs=5), "the policy has 5 inputs and 1 outputs; allowed: 8 and 1"),
        (make_policy(action="pressure"), "has the action 'pressure'; allowed: residual"),
        (make_policy(residual_bar=float("nan")), "residual_bar = nan"),
        (make_policy(residual_bar=-5.0), "residual_bar = -5"),
        (make_policy(sensor_delay=-3), "sensor_delay = -3"),
        (make_walking_policy(base="off"), "changes the base 'off'; allowed: machine, profile"),
        (make_policy(sensor_delay=float("inf")), "does not state its training configuration"),
    ],
)
def test_incompatible_policy_is_refused(invalid_policy: Policy, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_policy_controller(invalid_policy, "x.npz")


def test_policy_without_metadata_is_refused() -> None:
    trained_policy = make_policy()
    with pytest.raises(InputError, match=r"x\.npz does not state its training configuration"):
        build_policy_controller(
            Policy(
                trained_policy.observation_scale,
                trained_policy.layers,
                trained_policy.activation,
                trained_policy.tanh_output,
                {},
            ),
            "x.npz",
        )


@pytest.mark.parametrize(
    ("digest", "note"),
    [
        (None, r"not recorded"),
        ("0" * 64, r"trained in a simulation with other code \(digest 00000000\) than the installed one"),
        (compute_code_digest(), None),
    ],
)
def test_gait_notes_a_policy_of_other_code(digest: str | None, note: str | None, tmp_path: Path) -> None:
    policy = make_policy()
    metadata = {**policy.metadata} if digest is None else {**policy.metadata, POLICY_KEY: digest}
    Policy(policy.observation_scale, policy.layers, "tanh", tanh_output=False, metadata=metadata).save(
        tmp_path / "p.npz"
    )
    run = ks.simulate_gait(controller=str(tmp_path / "p.npz"), strides=1, time_step=1e-3)
    notes = [warning for warning in run.warnings if "policy" in warning]
    assert len(notes) == (note is not None)
    if note:
        assert re.search(note, notes[0])
