"""All device effects, activated in a device file: in a gait run, on the bench and in the environment."""

from functools import cache

import numpy as np
import pytest

from klute_sim import bench
from klute_sim.controllers import pressure
from klute_sim.device.device import DEFAULT_DEVICE, Device, load_device, parse_device
from klute_sim.device.energy.ledger import POWER_TERMS, format_effect_channel
from klute_sim.effects import catalogue
from klute_sim.effects.chain import EffectSlot
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.tasks import domain_randomization
from klute_sim.gait.rig.learning import prepare_gait_rig
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.recording.recording import Recording

STEP = 1e-3
TIME = np.arange(600) * STEP
LENGTH = 0.362 + 0.005 * np.sin(12 * TIME)
COMMAND = np.where(TIME % 0.4 < 0.2, 4e5, 1e5)
VALVE = "klute-1-1-4-pair-valve"
SLOTS = pytest.mark.parametrize(
    "slot",
    [
        pytest.param(slot, id=f"{slot.effect}-{slot.form.name}", marks=pytest.mark.slow if index % 2 else [])
        for index, slot in enumerate(catalogue.get_device_slots())
    ],
)
"""All forms of device effects; every second one is slow."""


def make_device(slot: EffectSlot) -> tuple[str, Device]:
    """Return the preset and the device with the effect; a leak shows only behind a valve."""
    preset = VALVE if slot.effect == "leak" else DEFAULT_DEVICE
    text = load_device(preset).content.decode()
    switch = catalogue.get_effects()[slot.effect].replaces_switch
    if switch:
        text = text.replace("[muscle]\n", f"[muscle]\n{switch} = false\n")
    if slot.effect == "leak":
        text = text.replace("[leak]\nconductance_dm3_per_s_bar = 0.001\n", "")
        text = "\n".join(line for line in text.splitlines() if not line.startswith('"leak.')) + "\n"
    parameters = "".join(f"{p.key} = {float(p.typical)}\n" for p in slot.form.parameters)
    return preset, parse_device(
        f'{text}\n[effects.{slot.effect}]\nform = "{slot.form.name}"\n{parameters}'.encode(), slot.effect
    )


@cache
def prepare_preset(preset: str) -> GaitOptions:
    """Return the options with the path of the preset, on which its variants walk, too: only the effect differs."""
    options = GaitOptions(strides=1, dt=STEP)
    return prepare_gait_rig(load_device(preset), pressure.load_default_profile(), options).options


@cache
def simulate_preset(preset: str) -> tuple[Recording, Recording]:
    device = load_device(preset)
    gait = simulate_gait(device, pressure.load_default_profile(), prepare_preset(preset))
    return gait, bench.simulate_tester(device, LENGTH, COMMAND, STEP)


@SLOTS
def test_effect_acts_on_every_rig_and_its_energy_balance_closes(
    slot: EffectSlot, monkeypatch: pytest.MonkeyPatch
) -> None:
    preset, device = make_device(slot)
    gait = simulate_gait(device, pressure.load_default_profile(), prepare_preset(preset))
    test = bench.simulate_tester(device, LENGTH, COMMAND, STEP)
    for recording, reference in zip((gait, test), simulate_preset(preset), strict=True):
        assert np.isfinite(recording["force"]).all()
        difference = max(np.abs(recording[name] - reference[name]).max() for name in ("force", "pressure", "air_drawn"))
        # The bladder of the dissertation replaces the same bladder of the device.
        assert (difference > 1e-9) == (slot.effect != "bladder")
        power = recording[format_effect_channel(slot.effect)]
        assert recording["effects_power"] == pytest.approx(power)
        if catalogue.get_effects()[slot.effect].acts_in_supply:
            assert not power.any()  # its work belongs to the gas
        total_power = np.sum([recording[line] for line in POWER_TERMS], axis=0)
        residual = recording["delivered_power"] - total_power
        assert recording["residual_power"] == pytest.approx(residual, abs=1e-9)
        assert np.abs(recording["force_residual"]).max() < 1e-5
        # The implicit step loses energy of first order in the step, here mostly at steps of 3 bar within one of 1 ms:
        # at most 1.3 % (tests/device/test_dynamics.py measures the order).
        assert abs(residual.sum()) < 0.02 * np.abs(recording["delivered_power"]).sum()
    monkeypatch.setattr(domain_randomization, "prepare_options", lambda *_: prepare_preset(preset))
    env = AnkleGaitEnv(device=device, time_step=STEP)
    env.reset(seed=3)
    infos = [env.step(np.array([0.2], dtype=np.float32))[4] for _ in range(20)]
    assert all(np.isfinite(info["work_delivered_j"]) for info in infos)
    work = sum(abs(info[f"work_effect_{slot.effect}_j"]) for info in infos)
    assert (work > 0.0) != catalogue.get_effects()[slot.effect].acts_in_supply
