"""Effects of the hydraulic damper in the device: their sizes, and loops of a closed form."""

import math

import numpy as np
import pytest

from klute_sim.device import dynamics
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.effects import catalogue
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE
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
        state = dynamics.step_internal_state(device, state, 0.0, length, length + 0.1, dt)
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


@pytest.mark.parametrize("air_volume", [0.5, 1.0, 4.0])
def test_trapped_air_loses_the_area_of_a_maxwell_element(air_volume: float) -> None:
    """Small strokes in the laminar range: ``pi X^2 k wt/(1 + (wt)^2)`` with ``k = A^2 pa/Va``; oil takes below 1 %."""
    sections = {
        ("trapped_air", "isothermal"): {"air_volume_cm3": air_volume},
        ("laminar_orifice", "smooth"): {"transition_speed_mm_per_s": 500.0},
    }
    device = PAIR.parameters._replace(effects=catalogue.pack_effects(sections))
    stiffness = AREA**2 * ATMOSPHERIC_PRESSURE / (air_volume * 1e-6)
    damping = 0.5 * (BASE.concentric_coefficient + BASE.eccentric_coefficient) * 0.5
    device = device._replace(
        damper=BASE._replace(concentric_coefficient=damping / 0.5, eccentric_coefficient=damping / 0.5)
    )
    n, amplitude = 1000, 2e-6
    omega = stiffness / damping
    time = 2.0 * math.pi / omega / n * np.arange(3 * n + 1)
    x = -0.02 + amplitude * np.sin(omega * time)
    force = move_muscle(device, x, time[1])[-n - 1 :]
    area = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(x[-n - 1 :]))
    assert area == pytest.approx(0.5 * math.pi * amplitude**2 * stiffness, rel=0.02)


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


@pytest.mark.parametrize("diameter", [5.0, 10.0])
def test_rod_reduces_the_loop_of_a_slow_cycle_on_its_side(diameter: float) -> None:
    """Loop area of ``x = X sin wt`` by the quadratic law: ``4/3 X^3 w^2 (c_in + c_out r^3)``."""
    device = add_effect("rod_side_area", "single_rod", rod_diameter_mm=diameter)
    omega, amplitude, n = 6.0, 8e-3, 2000
    time = 2.0 * math.pi / omega / n * np.arange(n + 1)
    x = -0.02 + amplitude * np.sin(omega * time)
    force = move_muscle(device, x, time[1])
    area = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(x))
    ratio = 1.0 - (diameter / 20.0) ** 2
    per_stroke = 4.0 / 3.0 * amplitude**3 * omega**2
    assert area == pytest.approx(
        per_stroke * (BASE.concentric_coefficient + BASE.eccentric_coefficient * ratio**3), rel=0.02
    )


@pytest.mark.parametrize("inverse_charge", [0.25, 0.8])
def test_cavitation_loses_the_work_of_its_charge(inverse_charge: float) -> None:
    """Strokes X at speed v: ``(A p0 + c_out v^2)(X - s)`` is lost, with a dead stroke ``s = X (v - w)/(v + w)``."""
    device = add_effect("cavitation", "charge", inverse_charge_per_bar=inverse_charge)
    speed, stroke, dt = 0.3, 0.01, 2e-5
    n = round(stroke / speed / dt)
    x = speed * dt * np.concatenate([-np.arange(n + 1), np.arange(-n + 1, 1)])
    force = move_muscle(device, x, dt)
    limit = AREA * 1e5 / inverse_charge
    w = math.sqrt(limit / BASE.concentric_coefficient)
    dead = stroke * (speed - w) / (speed + w)
    work = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(x))
    assert work == pytest.approx((limit + BASE.eccentric_coefficient * speed**2) * (stroke - dead), rel=0.02)
