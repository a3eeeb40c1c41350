"""Every effect of the device, switched on in a device file: in the gait, on the bench, in the environment."""

from functools import cache

import numpy as np
import pytest

from klute_sim.control import pressure
from klute_sim.device.files import DEFAULT_PROSTHESIS, Device, load, read
from klute_sim.device.ledger import LINES, SOLVER, of_effect
from klute_sim.effects import catalogue
from klute_sim.effects.hooks import Slot
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.recording.recording import Recording
from klute_sim.rigs import bench
from klute_sim.rigs.gait.assembly import GaitOptions
from klute_sim.rigs.gait.rig import walk

STEP = 1e-3
TIME = np.arange(600) * STEP
LENGTH = 0.362 + 0.005 * np.sin(12 * TIME)
COMMAND = np.where(TIME % 0.4 < 0.2, 4e5, 1e5)
VALVE = "klute-1-1-4-pair-valve"
SLOTS = pytest.mark.parametrize("slot", catalogue.device_slots(), ids=lambda s: f"{s.effect}-{s.form.name}")


def switched_on(slot: Slot) -> tuple[str, Device]:
    """The preset it is put on, and the device: a leak is behind a valve, where it shows."""
    preset = VALVE if slot.effect == "leak" else DEFAULT_PROSTHESIS
    text = load(preset).content.decode()
    off = catalogue.effects()[slot.effect].instead_of
    if off:
        text = text.replace("[muscle]\n", f"[muscle]\n{off} = false\n")
    if slot.effect == "leak":
        text = text.replace("[leak]\nconductance_dm3_per_s_bar = 0.001\n", "")
        text = "\n".join(line for line in text.splitlines() if not line.startswith('"leak.')) + "\n"
    numbers = "".join(f"{p.key} = {float(p.typical)}\n" for p in slot.form.parameters)
    return preset, read(f'{text}\n[effects.{slot.effect}]\nform = "{slot.form.name}"\n{numbers}'.encode(), slot.effect)


@cache
def plain(preset: str) -> tuple[Recording, Recording]:
    device = load(preset)
    return walk(device, pressure.tuned(), GaitOptions(strides=1, step=STEP)), bench.pull(device, LENGTH, COMMAND, STEP)


@SLOTS
def test_it_acts_in_the_gait_on_the_bench_and_in_the_environment_and_its_ledger_closes(slot: Slot) -> None:
    preset, device = switched_on(slot)
    walked = walk(device, pressure.tuned(), GaitOptions(strides=1, step=STEP))
    pulled = bench.pull(device, LENGTH, COMMAND, STEP)
    for found, base in zip((walked, pulled), plain(preset), strict=True):
        assert np.isfinite(found["force"]).all()
        apart = max(np.abs(found[name] - base[name]).max() for name in ("force", "pressure", "air_drawn"))
        # The dissertation's bladder, in place of the device's own, is the same again.
        assert (apart > 1e-9) == (slot.effect != "bladder")
        power = found[of_effect(slot.effect)]
        assert found["effects_power"] == pytest.approx(power)
        if catalogue.effects()[slot.effect].supply:
            assert not power.any()  # its work is the gas's
        given = np.sum([found[line] for line in LINES if line != SOLVER], axis=0)
        apart = abs((given - found["delivered_power"]).sum())
        assert apart < 2e-3 * np.abs(found["delivered_power"]).sum()
    env = AnkleGaitEnv(device=device, step=STEP)
    env.reset(seed=3)
    told = [env.step(np.array([0.2], dtype=np.float32))[4] for _ in range(20)]
    assert all(np.isfinite(info["work_delivered_j"]) for info in told)
    own = sum(abs(info[f"work_effect_{slot.effect}_j"]) for info in told)
    assert (own > 0.0) != catalogue.effects()[slot.effect].supply
