"""Effects of the hydraulic damper in the device: the damper that the device has with them.

``tests/effects/test_effect_sizes.py`` measures their loops.
"""

import math

import numpy as np
import pytest

from klute_sim.device import dynamics
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.effects import catalogue
from klute_sim.laws.damper import DamperParameters
from klute_sim.types import Array
from tests.effects.devices import PAIR, activate

AREA = 0.25 * math.pi * 0.02**2
"""Area [m2] of the device's bore of 20 mm."""
BASE = PAIR.parameters.damper


def add_effect(effect: str, form: str, **values: float) -> DeviceParameters:
    """Return the device with an effect, its parameters by key."""
    return activate(catalogue.find_slot(effect, form), values)


def get_damper(effect: str, form: str, **values: float) -> DamperParameters:
    return dynamics.apply_damper_effects(add_effect(effect, form, **values), dynamics.ZERO_INTERNAL_STATE)


def move_muscle(device: DeviceParameters, x: Array, dt: float) -> Array:
    """Return the damper's tension [N] while the unpressurised muscle moves along ``x`` [m] beyond resting length."""
    rest, state = device.muscle.resting_length, dynamics.ZERO_INTERNAL_STATE
    without = device._replace(damper=DamperParameters(0.0, 0.0), effects=dynamics.NO_EFFECTS)
    force = []
    for before, after in zip([x[0], *x[:-1]], x, strict=True):
        length, velocity = rest + after, (after - before) / dt
        state = dynamics.step_internal_state(device, state, 0.0, 0.0, length, length + 0.1, dt)
        force.append(dynamics.compute_muscle_force(device, state, 0.0, length, velocity))
        force[-1] -= dynamics.compute_muscle_force(without, state, 0.0, length, velocity)
    return np.array(force)


def test_device_file_gives_the_area_of_the_bore() -> None:
    assert BASE.piston_area == pytest.approx(AREA)


def test_orifice_effects_have_their_size() -> None:
    contracted = get_damper("discharge_loss", "constant", discharge_coefficient=0.5)
    assert contracted.concentric_coefficient == pytest.approx(4.0 * BASE.concentric_coefficient)
    assert contracted.eccentric_coefficient == pytest.approx(4.0 * BASE.eccentric_coefficient)
    laminar = add_effect("laminar_orifice", "smooth", transition_speed_mm_per_s=40.0)
    force = move_muscle(laminar, np.array([-0.02, -0.02 + 3e-5]), 1e-3)[-1]
    assert force == pytest.approx(BASE.eccentric_coefficient * 0.03 * 0.05)  # 3, 4, 5


def test_rod_without_a_damper_has_no_effect() -> None:
    device = add_effect("rod_side_area", "single_rod", rod_diameter_mm=8.0)
    bare = device._replace(damper=DamperParameters(0.0, 0.0))
    assert move_muscle(bare, np.array([-0.02, -0.01]), 1e-3)[-1] == 0.0


def test_trapped_air_needs_a_damper() -> None:
    device = add_effect("trapped_air", "isothermal", air_volume_cm3=1.0)
    assert dynamics.has_internal_state(device)
    bare = device._replace(damper=DamperParameters(0.0, 0.0))
    assert not dynamics.has_internal_state(bare)
    assert move_muscle(bare, np.array([-0.02, -0.01]), 1e-3)[-1] == 0.0


@pytest.mark.parametrize(("temperature", "ratio"), [(5.0, 229.02 / 86.278), (0.0, 336.0 / 86.278)])
def test_cold_oil_raises_laminar_force_by_viscosity_and_all_force_by_density(temperature: float, ratio: float) -> None:
    """Viscosities of ISO VG 32 by ASTM D341, worked out separately; 20 degrees is the reference."""
    sections = {
        ("laminar_orifice", "smooth"): {"transition_speed_mm_per_s": 40.0},
        ("oil_temperature", "walther"): {"temperature_c": temperature, "transition_speed_mm_per_s": 40.0},
    }
    device = PAIR.parameters._replace(effects=catalogue.pack_effects(sections))
    damper = dynamics.apply_damper_effects(device, dynamics.ZERO_INTERNAL_STATE)
    density = 1.0 + 6.5e-4 * (20.0 - temperature)
    assert damper.transition_speed == pytest.approx(0.04 * ratio, rel=1e-3)
    assert damper.concentric_coefficient == pytest.approx(density * BASE.concentric_coefficient)
    assert damper.eccentric_coefficient == pytest.approx(density * BASE.eccentric_coefficient)


def test_oil_temperature_needs_no_laminar_effect() -> None:
    cold = get_damper("oil_temperature", "walther", temperature_c=5.0, transition_speed_mm_per_s=40.0)
    assert cold.transition_speed == pytest.approx(0.04 * math.sqrt((229.02 / 86.278) ** 2 - 1.0), rel=1e-3)
    warm = get_damper("oil_temperature", "walther", temperature_c=60.0, transition_speed_mm_per_s=40.0)
    assert warm.transition_speed == 0.0
    assert warm.concentric_coefficient == pytest.approx((1.0 - 40.0 * 6.5e-4) * BASE.concentric_coefficient)
    neutral = get_damper("oil_temperature", "walther", temperature_c=20.0, transition_speed_mm_per_s=40.0)
    assert neutral == BASE
