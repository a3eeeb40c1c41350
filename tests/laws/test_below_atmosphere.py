"""A muscle whose air has less than room pressure: its bladder leaves the braid, which cannot push."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.device.device import load_device
from klute_sim.device.dynamics import ZERO_INTERNAL_STATE, compute_muscle_force, step_internal_state
from klute_sim.device.recorded_rollout import record_rollout
from klute_sim.effects import catalogue
from klute_sim.effects.chain import EffectSlot
from klute_sim.laws import mckibben
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE
from klute_sim.units import BAR

MUSCLE = load_device("klute-3-4").parameters.muscle
BARE = load_device("klute-3-4")
suctions = st.floats(-ATMOSPHERIC_PRESSURE, -1e-9)
ratios = st.floats(0.62, 1.0)
MUSCLE_FORMS = tuple(
    slot
    for slot in catalogue.get_device_slots()
    if {"muscle_force", "acting_pressure"} & set(slot.form.laws) and not slot.effect.startswith("unknown")
)


@given(suctions, ratios)
def test_gas_and_friction_vanish_and_the_rubber_stays(suction: float, ratio: float) -> None:
    length = ratio * MUSCLE.resting_length
    assert mckibben.gas_force(MUSCLE, suction, length) == 0.0
    assert mckibben.friction_force(MUSCLE, suction) == 0.0
    assert mckibben.force(MUSCLE, suction, length) == mckibben.force(MUSCLE, 0.0, length)
    assert mckibben.force(MUSCLE, suction, length) == mckibben.bladder_force(MUSCLE, length)


@given(st.floats(-ATMOSPHERIC_PRESSURE, 6e5), st.floats(1.0, 1e5), ratios)
def test_braid_never_pushes_and_more_pressure_never_pulls_less(pressure: float, more: float, ratio: float) -> None:
    length = max(ratio * MUSCLE.resting_length, mckibben.lock_length(MUSCLE))
    assert 0.0 <= mckibben.gas_force(MUSCLE, pressure, length) <= mckibben.gas_force(MUSCLE, pressure + more, length)


def test_force_is_continuous_at_room_pressure() -> None:
    length = 0.9 * MUSCLE.resting_length
    below, above = (mckibben.force(MUSCLE, pressure, length) for pressure in (-1e-3, 1e-3))
    assert above == pytest.approx(below, abs=1e-5)
    assert math.isnan(mckibben.gas_force(MUSCLE, math.nan, length))


@given(st.floats(0.0, 6e5))
def test_not_a_bit_changes_above_room_pressure(pressure: float) -> None:
    assert mckibben.contact_pressure(pressure) == pressure


@pytest.mark.parametrize("slot", MUSCLE_FORMS, ids=lambda slot: f"{slot.effect}-{slot.form.name}")
def test_suction_changes_no_effect_of_the_muscle(slot: EffectSlot) -> None:
    """Braid, threads and bladder feel no difference between a vented and an evacuated muscle, at any speed."""
    values = catalogue.pack_effects({(slot.effect, slot.form.name): {p.key: p.typical for p in slot.form.parameters}})
    parameters = BARE.parameters._replace(effects=values)
    for velocity in (-0.1, 0.1):
        forces = []
        for pressure in (0.0, -0.4 * BAR):
            state, length = ZERO_INTERNAL_STATE, 0.9 * MUSCLE.resting_length
            for _ in range(20):
                length += velocity * 1e-3
                state = step_internal_state(parameters, state, pressure, 0.0, length, length, 1e-3)
            forces.append(compute_muscle_force(parameters, state, pressure, length, velocity))
        assert forces[0] == forces[1]


@pytest.mark.parametrize("exponent", [1.0, 1.4])
def test_air_that_is_drawn_below_atmosphere_gains_and_loses_no_work(exponent: float) -> None:
    """A sealed muscle of 0.1 bar is shortened by a tenth and lengthened again: its air neither gains nor loses work."""
    device = BARE.with_effect("volume_coupling", recovery_s=5.0, exponent=exponent).parameters
    device = device._replace(supply=device.supply._replace(max_pressure_rate=1e-3))
    time = np.arange(4001) * 1e-5
    length = device.muscle.resting_length * (0.99 - 0.05 * (1.0 - np.cos(2.0 * np.pi * time / time[-1])))
    record = record_rollout(device, length, np.full(len(time), 0.1 * BAR), 1e-5, backend="python")
    pressure = np.asarray(record.pressure)
    gas = np.array([mckibben.gas_force(device.muscle, p, x) for p, x in zip(pressure, record.length, strict=True)])
    assert -ATMOSPHERIC_PRESSURE < pressure.min() < -0.3 * BAR
    assert (gas[pressure <= 0.0] == 0.0).all()
    assert (gas >= 0.0).all()
    assert gas.max() > 5.0
    work = np.trapezoid(gas, record.length)
    stroke = length.max() - length.min()
    assert abs(work) < 0.02 * gas.max() * stroke
    assert pressure[-1] + ATMOSPHERIC_PRESSURE == pytest.approx(pressure[0] + ATMOSPHERIC_PRESSURE, rel=0.02)
