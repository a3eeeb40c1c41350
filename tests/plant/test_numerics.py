"""The device in MuJoCo at all orifices and time steps: stability, convergence and the shown damping."""

import itertools

import mujoco
import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.plant import callbacks, models
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.coupling import DAMPING_INDEX

BASE = load_device("klute-1-1-4-pair").parameters
NEUTRAL = 0.3574
"""Distance of the Achilles' sites at a neutral ankle [m]."""


def damped(coefficient: float) -> DeviceParameters:
    return BASE._replace(
        damper=BASE.damper._replace(concentric_coefficient=coefficient, eccentric_coefficient=coefficient)
    )


def tied(coefficient: float, ratio: float = 1.0) -> DeviceParameters:
    """Return a muscle on a rigid tendon, as long as the shank."""
    muscle = BASE.muscle
    longer = NEUTRAL / 0.93 / muscle.resting_length
    muscle = muscle._replace(
        resting_length=longer * muscle.resting_length,
        braid_length=longer * muscle.braid_length,
        braid_turns=longer * muscle.braid_turns,
    )
    tie = BASE.tendon._replace(is_rigid=True, slack_length=0.0)
    damper = BASE.damper._replace(concentric_coefficient=coefficient, eccentric_coefficient=ratio * coefficient)
    return BASE._replace(muscle=muscle, tendon=tie, damper=damper)


def in_the_air(
    parameters: DeviceParameters, step: float, integrator: str = "implicitfast"
) -> tuple[mujoco.MjModel, mujoco.MjData, DeviceActuator]:
    """Return the ankle without floor, weight and heel spring: only the device is stiff."""
    spec = models.load_spec("ankle")
    spec.option.timestep = step
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model = models.attach_devices(spec, {"muscle_tendon": parameters})
    model.opt.gravity[:], model.geom_contype[:] = 0.0, 0
    model.jnt_stiffness[model.joint("heel").id] = 0.0
    data, actuator = mujoco.MjData(model), DeviceActuator(model, "muscle_tendon")
    mujoco.mj_forward(model, data)
    actuator.set_state(data, compute_taut_state(parameters, actuator.get_unit_length(data), 0.0))
    return model, data, actuator


@pytest.mark.parametrize("coefficient", [0.0, 1.0, 1e3, 3e4, 1e7, 1e12])
@pytest.mark.parametrize("step", [1e-4, 5e-4, 5e-3])
def test_ankle_does_not_chatter_for_any_orifice_and_step(coefficient: float, step: float) -> None:
    model, data, actuator = in_the_air(damped(coefficient), step)
    angles = []
    with callbacks.device_callbacks():
        for k in range(round(1.5 / step)):
            actuator.set_command(data, [0.0, 3e5, 0.0, 5e5, 1e5, 4e5][int(4 * k * step)])
            callbacks.step_model(model, data)
            angles.append(float(data.qpos[0]))
    assert np.abs(angles).max() < 0.45
    last = np.diff(angles[-round(0.05 / step) :])
    ripple = np.abs(np.diff(np.sign(last[np.abs(last) > 1e-7]))).sum()
    assert ripple <= 2 * (0.05 / 0.015)  # no faster than the ankle swings on the tendon


@pytest.mark.parametrize("coefficient", [3e4, 1e6, 1e8, 1e10])
@pytest.mark.parametrize("step", [1e-4, 1e-3])
def test_nearly_closed_orifice_on_a_rigid_tendon_stops_the_ankle(coefficient: float, step: float) -> None:
    def kicked(hidden: bool) -> float:
        model, data, actuator = in_the_air(tied(coefficient), step)
        if hidden:
            model.tendon_dampingpoly[:] = 0.0
            model.actuator_user[actuator.id, DAMPING_INDEX] = 0.0
            actuator = DeviceActuator(model, "muscle_tendon")
        data.qvel[0] = 20.0
        moved = 0.0
        with callbacks.device_callbacks():
            for _ in range(round(0.03 / step)):
                mujoco.mj_step(model, data)
                moved = max(moved, abs(float(data.qpos[0])))
                if not moved < 1e3:
                    return moved
        return moved

    # Each step halves the speed; afterwards a quadratic damper of 3e4 or more lets the ankle creep.
    assert kicked(hidden=False) < 20.0 * 2.1 * step + 0.09
    if coefficient * step > 50.0:
        assert kicked(hidden=True) > 1.0


def test_shown_damping_affects_only_the_solution_of_the_step() -> None:
    tensions = []
    for shown in (True, False):
        model, data, actuator = in_the_air(tied(3e3, ratio=0.3), 1e-5)
        if not shown:
            model.tendon_dampingpoly[:] = 0.0
            model.actuator_user[actuator.id, DAMPING_INDEX] = 0.0
            actuator = DeviceActuator(model, "muscle_tendon")
        actuator.set_command(data, 3e5)
        seen = []
        with callbacks.device_callbacks():
            for _ in range(3000):
                callbacks.step_model(model, data)
                seen.append(actuator.get_tension(data))
        tensions.append(seen)
        moment = float(data.qfrc_actuator[0] + data.qfrc_passive[0])
        spring = 130.0 * (-0.085 - float(data.qpos[0])) - float(data.qvel[0])
    assert np.abs(np.subtract(*tensions)).max() < 0.003 * np.abs(tensions).max()
    assert moment == pytest.approx(seen[-1] * 0.048 + spring, rel=0.02)


def test_convergence_order_in_the_ankle_is_one() -> None:
    def angle(step: float) -> float:
        model, data, actuator = in_the_air(BASE, step)
        with callbacks.device_callbacks():
            for k in range(round(0.1 / step)):
                actuator.set_command(data, 2e5 + 1.5e5 * np.sin(20 * k * step))
                callbacks.step_model(model, data)
        return float(data.qpos[0])

    errors = [abs(angle(h) - angle(h / 2)) for h in (1e-3, 5e-4, 2.5e-4, 1.25e-4)]
    orders = [np.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert all(0.8 < order < 1.25 for order in orders), orders


def test_device_alone_reproduces_mujoco() -> None:
    model, data, actuator = in_the_air(BASE, 5e-4)
    begin = actuator.get_state(data)
    lengths, commands, seen = [], [], []
    with callbacks.device_callbacks():
        for k in range(2000):
            commands.append(3e5 * (k // 300 % 2))
            actuator.set_command(data, commands[-1])
            callbacks.step_model(model, data)
            lengths.append(actuator.get_unit_length(data))
            seen.append((actuator.get_tension(data), *actuator.get_state(data)[:2]))
    trace = simulate_rollouts(BASE, lengths, commands, 5e-4, initial_state=begin)
    assert np.max(trace.tension) > 500.0
    assert np.abs(np.array(seen) - np.stack(trace, axis=1)).max(axis=0) == pytest.approx([0, 0, 0], abs=1e-6)


def test_rigid_device_starts_at_its_length() -> None:
    model, data, actuator = in_the_air(tied(3e4), 5e-4)
    assert actuator.get_state(data)[:2] == pytest.approx((0.0, NEUTRAL), abs=1e-4)
    assert model.tendon_dampingpoly[0, 0] == 3e4
