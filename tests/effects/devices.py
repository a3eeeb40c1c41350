"""Devices with effects, and their rollouts, for the tests of effects."""

from functools import cache

import numpy as np
import pytest

from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.rollout import RolloutTrace, simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.effects.chain import EffectSlot
from klute_sim.effects.effect import EffectForm
from klute_sim.units import BAR

PAIR = load_device("klute-3-4-pair")


STEP = 2e-4


TIME = np.arange(5000) * STEP


LENGTH = 0.338 + 0.012 * np.sin(9 * TIME) + 0.002 * np.sin(31 * TIME)


COMMAND = np.where(TIME % 0.5 < 0.25, 4e5, 1e5)


FORMS = pytest.mark.parametrize("slot", catalogue.get_device_slots(), ids=lambda s: f"{s.effect}-{s.form.name}")


def parameters_of(form: EffectForm, size: float | None = None) -> dict[str, float]:
    """Return typical parameters; with ``size`` 0 the neutral ones."""
    return {p.key: p.neutral if size == 0.0 and p.neutral is not None else p.typical for p in form.parameters}


def activate(
    slot: EffectSlot, parameters: dict[str, float], device: DeviceParameters = PAIR.parameters
) -> DeviceParameters:
    return device._replace(effects=catalogue.pack_effects({(slot.effect, slot.form.name): parameters}))


def run(device: DeviceParameters, backend: str = "compiled", count: int = len(TIME)) -> RolloutTrace:
    return simulate_rollouts(device, LENGTH[:count], COMMAND[:count], STEP, backend=backend)


def are_identical(a: RolloutTrace, b: RolloutTrace) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


VALVE_FED = PAIR.parameters._replace(
    supply=PAIR.parameters.supply._replace(
        fill_conductance=1e-8,
        fill_critical_ratio=0.4,
        exhaust_conductance=1e-8,
        exhaust_critical_ratio=0.4,
        valve_gain=0.2 / BAR,
        polytropic_exponent=1.2,
        thermal_time_constant=0.3,
    )
)


@cache
def run_base(device: DeviceParameters = PAIR.parameters) -> RolloutTrace:
    """Return the rollout of a device without effects: once, and not at import, where every worker would compile it."""
    return run(device)


def load_with_effects(sections: dict[str, dict[str, float | str]]) -> Device:
    text = PAIR.content.decode()
    for name, content in sections.items():
        text += f"\n[effects.{name}]\n" + "".join(f"{k} = {v!r}\n".replace("'", '"') for k, v in content.items())
    return parse_device(text.encode(), "test")
