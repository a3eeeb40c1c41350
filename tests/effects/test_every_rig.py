"""Every effect of the device, switched on in a device file: in the gait, on the bench, in the environment."""

from functools import cache

import numpy as np
import pytest

from klute_sim import bench
from klute_sim.controllers import pressure
from klute_sim.device.device import DEFAULT_DEVICE, Device, load_device, parse_device
from klute_sim.device.energy.ledger import POWER_TERMS, SOLVER_TERM, format_effect_channel
from klute_sim.effects import catalogue
from klute_sim.effects.chain import EffectSlot
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.recording.recording import Recording

STEP = 1e-3
TIME = np.arange(600) * STEP
LENGTH = 0.362 + 0.005 * np.sin(12 * TIME)
COMMAND = np.where(TIME % 0.4 < 0.2, 4e5, 1e5)
VALVE = "klute-1-1-4-pair-valve"
SLOTS = pytest.mark.parametrize("slot", catalogue.get_device_slots(), ids=lambda s: f"{s.effect}-{s.form.name}")


def switched_on(slot: EffectSlot) -> tuple[str, Device]:
    """The preset it is put on, and the device: a leak is behind a valve, where it shows."""
    preset = VALVE if slot.effect == "leak" else DEFAULT_DEVICE
    text = load_device(preset).content.decode()
    off = catalogue.get_effects()[slot.effect].replaces_switch
    if off:
        text = text.replace("[muscle]\n", f"[muscle]\n{off} = false\n")
    if slot.effect == "leak":
        text = text.replace("[leak]\nconductance_dm3_per_s_bar = 0.001\n", "")
        text = "\n".join(line for line in text.splitlines() if not line.startswith('"leak.')) + "\n"
    numbers = "".join(f"{p.key} = {float(p.typical)}\n" for p in slot.form.parameters)
    return preset, parse_device(
        f'{text}\n[effects.{slot.effect}]\nform = "{slot.form.name}"\n{numbers}'.encode(), slot.effect
    )


@cache
def plain(preset: str) -> tuple[Recording, Recording]:
    device = load_device(preset)
    return simulate_gait(
        device, pressure.load_default_profile(), GaitOptions(strides=1, dt=STEP)
    ), bench.simulate_tester(device, LENGTH, COMMAND, STEP)


@SLOTS
def test_it_acts_in_the_gait_on_the_bench_and_in_the_environment_and_its_ledger_closes(slot: EffectSlot) -> None:
    preset, device = switched_on(slot)
    walked = simulate_gait(device, pressure.load_default_profile(), GaitOptions(strides=1, dt=STEP))
    pulled = bench.simulate_tester(device, LENGTH, COMMAND, STEP)
    for found, base in zip((walked, pulled), plain(preset), strict=True):
        assert np.isfinite(found["force"]).all()
        apart = max(np.abs(found[name] - base[name]).max() for name in ("force", "pressure", "air_drawn"))
        # The dissertation's bladder, in place of the device's own, is the same again.
        assert (apart > 1e-9) == (slot.effect != "bladder")
        power = found[format_effect_channel(slot.effect)]
        assert found["effects_power"] == pytest.approx(power)
        if catalogue.get_effects()[slot.effect].acts_in_supply:
            assert not power.any()  # its work is the gas's
        given = np.sum([found[line] for line in POWER_TERMS if line != SOLVER_TERM], axis=0)
        apart = abs((given - found["delivered_power"]).sum())
        assert apart < 2e-3 * np.abs(found["delivered_power"]).sum()
    env = AnkleGaitEnv(device=device, time_step=STEP)
    env.reset(seed=3)
    told = [env.step(np.array([0.2], dtype=np.float32))[4] for _ in range(20)]
    assert all(np.isfinite(info["work_delivered_j"]) for info in told)
    own = sum(abs(info[f"work_effect_{slot.effect}_j"]) for info in told)
    assert (own > 0.0) != catalogue.get_effects()[slot.effect].acts_in_supply
