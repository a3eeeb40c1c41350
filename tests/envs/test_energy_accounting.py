"""Work and air that an environment reports for a stride, against the energy balance of every step."""

import itertools
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from klute_sim.controllers import pressure
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.device.energy.ledger import EnergyBalance, EnergyRecorder
from klute_sim.device.energy.outputs import accumulate_effects
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.plant import callbacks
from klute_sim.units import BAR


def record_stride(
    device: Device, command: Callable[[float], float]
) -> tuple[list[dict[str, float]], EnergyBalance, float]:
    """Return the infos, the energy balance of every step and the time step [s] of a stride.

    ``command`` is the pressure [bar] at a phase of the stride.
    """
    env = AnkleGaitEnv(device=device, reset_noise=0.0, strides=1)
    env.reset(seed=0)
    rig = env._gait_rig
    actuator, dt, n = rig.actuator, rig.options.dt, rig.commands_per_stride
    recorder = EnergyRecorder(device.parameters, round(n * env.dt / dt) + 1)
    recorder.record_sample(0, actuator.get_state(env.data), actuator.get_unit_length(env.data), 0.0)
    samples, step = itertools.count(1), callbacks.step_model

    def record_steps(model: mujoco.MjModel, data: mujoco.MjData, count: int = 1) -> None:
        for _ in range(count):
            before = actuator.get_state(data)
            step(model, data)
            after = actuator.compute_state_after_step(model, data, before)
            velocity = (after.length - before.length) / dt
            recorder.record_sample(next(samples), after, actuator.get_unit_length(data), velocity)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(callbacks, "step_model", record_steps)
        actions = [np.array([2.0 * command(k / n) / 5.0 - 1.0], dtype=np.float32) for k in range(n)]
        infos = [env.step(action)[4] for action in actions]
    return infos, recorder.to_energy_balance(dt), dt


def follow_profile(phase: float) -> float:
    """Return the pressure of the default profile [bar]."""
    return pressure.load_default_profile().pressure_at(phase) / BAR


def load_leaky_device() -> Device:
    """Return a device with a valve, a leak, and an effect on the muscle and one on the tendon."""
    effects = (
        b"\n[effects.muscle_damping]\ncoefficient_n_s_per_m = 150.0\n[effects.tendon_hysteresis]\nloss_fraction = 0.1\n"
    )
    text = load_device("klute-1-1-4-pair-valve").content.replace(b"= 0.001", b"= 0.02")
    return parse_device(text + effects, "everything")


@pytest.mark.parametrize(
    ("device", "command", "tolerance"),
    [
        (load_device("klute-1-1-4-pair"), follow_profile, 0.01),
        (load_device("klute-1-1-4-pair-valve"), follow_profile, 0.01),
        (load_leaky_device(), lambda phase: 1.5 + 1.5 * np.sin(14.0 * phase), 0.02),
    ],
    ids=["regulator", "valve", "leaky valve with effects"],
)
def test_energy_and_air_of_a_stride_are_those_of_a_recording(
    device: Device, command: Callable[[float], float], tolerance: float
) -> None:
    """Work within 1 or 2 % of the work that the gas does and absorbs, air within rounding."""
    infos, ledger, dt = record_stride(device, command)
    names = ["gas", "friction", "damper", "bladder", "tendon", "delivered"]
    powers = {name: getattr(ledger, f"{name}_power") for name in names}
    powers |= {f"effect_{name}": power for name, power in ledger.effect_powers.items()}
    gas = dt * np.abs(ledger.gas_power).sum()
    for name, power in powers.items():
        total = sum(info[f"work_{name}_j"] for info in infos)
        assert total == pytest.approx(dt * power.sum(), abs=tolerance * gas), name
        if name.startswith("effect_"):
            assert abs(dt * power.sum()) > 0.0
            assert total == pytest.approx(dt * power.sum(), rel=0.2), name
    assert tuple(ledger.effect_powers) == accumulate_effects(device.parameters)[0]
    assert sum(info["air_g"] for info in infos) == pytest.approx(1e3 * ledger.air_drawn[-1], rel=1e-9)
    assert sum(info["air_leaked_g"] for info in infos) == pytest.approx(1e3 * ledger.air_leaked[-1], rel=1e-9)
    assert infos[-1]["air_mass_g"] == pytest.approx(1e3 * ledger.air_mass[-1], rel=1e-9)
