"""All effects: neutral parameters change no bit, typical ones show the right sign, all but the supply are passive."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim import bench
from klute_sim.device import dynamics as unit
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.equilibrium import compute_equilibrium_state, compute_taut_state
from klute_sim.device.rollout import RolloutTrace, simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.effects.chain import EffectSlot
from klute_sim.errors import InputError
from klute_sim.plant import batch, callbacks, models
from klute_sim.units import BAR
from tests.effects.devices import (
    COMMAND,
    FORMS,
    LENGTH,
    PAIR,
    STEP,
    VALVE_FED,
    activate,
    are_identical,
    load_with_effects,
    parameters_of,
    run,
    run_base,
)


def device_showing(slot: EffectSlot) -> DeviceParameters:
    """Return a device that shows the effect: a regulator compensates a leak, so the leak needs a valve."""
    return VALVE_FED if slot.effect == "leak" else PAIR.parameters


@FORMS
def test_equilibrium_state_is_stationary(slot: EffectSlot) -> None:
    """Three times the typical effect; its internal states are in equilibrium too."""
    parameters = {
        p.key: p.typical if p.neutral is None else min(max(p.neutral + 3.0 * (p.typical - p.neutral), p.lower), p.upper)
        for p in slot.form.parameters
    }
    device = activate(slot, parameters)
    initial = compute_equilibrium_state(device, 0.34, 3e5)
    state = initial
    for _ in range(300):
        state = unit.advance_state(device, state, 0.34, 3e5, 1e-3)
    assert state.length == pytest.approx(initial.length, abs=2e-6)
    initial_tension, tension = (unit.compute_tension(device, s, 0.34, 0.0) for s in (initial, state))
    assert tension == pytest.approx(initial_tension, abs=0.3)
    is_virgin = slot.effect == "tendon_hysteresis" and slot.form.name == "maxwell_slip"
    if slot.effect in ("braid_hysteresis", "tendon_hysteresis") and not is_virgin:  # relaxed sliders give no force
        plain = unit.compute_tension(PAIR.parameters, compute_equilibrium_state(PAIR.parameters, 0.34, 3e5), 0.34, 0.0)
        # In its last step of 1e9 s a muscle with smooth Coulomb friction still moves at 1e-11 m/s.
        assert initial_tension == pytest.approx(plain, abs=1e-4)


@FORMS
def test_neutral_parameters_change_no_bit_in_either_backend(slot: EffectSlot) -> None:
    device = device_showing(slot)
    neutral = activate(slot, parameters_of(slot.form, 0.0), device)
    assert neutral.effects[0] == 1.0
    assert are_identical(run(neutral), run_base(device))
    assert are_identical(run(neutral, "python", 800), RolloutTrace(*(x[:800] for x in run_base(device))))


@FORMS
def test_typical_parameters_are_visible_and_identical_in_both_backends(slot: EffectSlot) -> None:
    device = activate(slot, parameters_of(slot.form), device_showing(slot))
    typical = run(device)
    assert np.sqrt(np.mean((typical.tension - run_base(device_showing(slot)).tension) ** 2)) > 4.0
    python = run(device, "python", 1500)
    assert are_identical(python, RolloutTrace(*(x[:1500] for x in typical)))


SIGNATURES = {
    # Sign of the change of tension while the muscle shortens and lengthens, at constant pressure.
    "threshold_pressure": (-1, -1),
    "end_taper": (-1, -1),
    "braid_hysteresis": (-1, 1),
    "muscle_damping": (-1, 1),
    "bladder_relaxation": (-1, 1),
    "discharge_loss": (-1, 1),
    "laminar_orifice": (-1, 1),
    "oil_temperature": (-1, 1),
    "seal_friction": (-1, 1),
    "tendon_hysteresis": (-1, 1),
    "tendon_slack": (-1, -1),
    "bladder": (-1, -1),
    "friction_offset": (-1, -1),
    "passive_tension": (-1, -1),
    "braid_extensibility": (-1, -1),
    "thick_wall_bladder": (-1, -1),
    "bladder_softening": (1, 1),  # the bladder opposes the gas less
    "trapped_air": (1, -1),  # the damper acts less
    "tendon_stiffening": (1, 1),
}


@pytest.mark.parametrize(
    "slot",
    # A spring that joins gradually changes the tension near its engagement only.
    [s for s in catalogue.get_device_slots() if s.effect in SIGNATURES and s.form.name != "gradual_engagement"],
    ids=lambda s: f"{s.effect}-{s.form.name}",
)
def test_effect_has_its_signature_while_shortening_and_lengthening(slot: EffectSlot) -> None:
    time = np.arange(40_000) * STEP
    length, command = 0.338 + 0.008 * np.sin(2 * np.pi * time), np.full(len(time), 3e5)
    change = []
    for device in (PAIR.parameters, activate(slot, parameters_of(slot.form))):
        change.append(simulate_rollouts(device, length, command, STEP).tension)
    difference = change[1] - change[0]
    speed = np.cos(2 * np.pi * time)
    settled = time > 6.0
    shortening, lengthening = difference[settled & (speed < -0.7)].mean(), difference[settled & (speed > 0.7)].mean()
    signature = SIGNATURES[slot.effect]
    assert np.sign([shortening, lengthening]).tolist() == list(signature)
    assert min(abs(shortening), abs(lengthening)) > 0.2


def compute_absorbed_work(device: DeviceParameters, path: np.ndarray, pressure: np.ndarray, start: int) -> float:
    """Return the work [J] done on the device along ``path`` [m] from sample ``start`` on, by the trapezoidal rule."""
    tension = simulate_rollouts(device, path, pressure, STEP).tension[start:]
    return float(np.sum(0.5 * (tension[1:] + tension[:-1]) * np.diff(path[start:])))


PASSIVE = [
    s
    for s in catalogue.get_device_slots()
    if s.effect in catalogue.get_named_effects() and not catalogue.get_effects()[s.effect].acts_in_supply
]


@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 10**6), size=st.floats(0.1, 4.0))
@pytest.mark.parametrize("slot", PASSIVE, ids=lambda s: f"{s.effect}-{s.form.name}")
def test_closed_path_at_constant_pressure_dissipates_energy(slot: EffectSlot, seed: int, size: float) -> None:
    """Passivity: the device absorbs energy over a cycle of any path."""
    random = np.random.default_rng(seed)
    phase = np.arange(10_000) * STEP * np.pi  # one cycle in two seconds
    wave = sum(random.normal() / k * np.sin(k * phase + random.uniform(0, 6.3)) for k in range(1, 7))
    path = 0.34 + 0.008 * wave / np.abs(wave).max()
    path = np.concatenate([path, path, path])
    parameters = parameters_of(slot.form)
    first = slot.form.parameters[0]
    neutral = first.neutral or 0.0
    parameters[first.key] = min(max(neutral + size * (first.typical - neutral), first.lower), first.upper)
    device = activate(
        slot, parameters, PAIR.parameters._replace(damper=PAIR.parameters.damper._replace(concentric_coefficient=3e3))
    )
    pressure = np.full(len(path), random.uniform(1e5, 5e5))
    third_cycle = compute_absorbed_work(device, path, pressure, start=20_000)
    assert third_cycle > -2e-3


@pytest.mark.parametrize("form", ["coulomb", "maxwell_slip", "dahl", "bouc_wen"])
def test_braid_friction_dissipates_energy_under_varying_pressure(form: str) -> None:
    """The hysteresis alone must not create energy when the pressure rises in one direction only."""
    slot = catalogue.find_slot("braid_hysteresis", form)
    law, next_state = slot.form.laws["muscle_force"], slot.form.laws.get("next_state")
    p = slot.form.pack(parameters_of(slot.form))
    random = np.random.default_rng(3)
    for _ in range(20):
        state, x, energy = slot.form.make_zero_state(), 0.0, 0.0
        rest = PAIR.parameters.muscle.resting_length
        for _ in range(2000):
            dx, pressure = random.normal(0.0, 2e-4), random.uniform(0.0, 5e5)
            x += dx
            if next_state:
                state = slot.form.state_type(
                    *next_state(p, state, PAIR.parameters.muscle, pressure, 0.0, rest + x, 0.0, 1e-3)
                )
            force = law(p, state, 0.0, PAIR.parameters.muscle, pressure, rest + x, dx / 1e-3)
            energy -= force * dx
        assert energy < 0.0


def test_mujoco_steps_internal_states_as_the_device_does() -> None:
    sections = {"braid_hysteresis": {"form": "maxwell_slip", "slope_n_per_bar": 10.0, "stiffness_n_per_mm": 60.0}}
    sections |= {"bladder_relaxation": {"stiffness_n_per_mm": 4.0, "time_constant_s": 0.2}}
    sections |= {"tendon_hysteresis": {"loss_fraction": 0.1}, "pressure_lag": {"time_constant_s": 0.03}}
    sections |= {"trapped_air": {"air_volume_cm3": 1.0}, "cavitation": {"inverse_charge_per_bar": 0.5}}
    device = load_with_effects(sections)
    for backend, count in (("compiled", 2000), ("python", 400)):
        recording = bench.simulate_tester(device, LENGTH[:count], COMMAND[:count], STEP, backend=backend)
        start = compute_taut_state(device.parameters, LENGTH[0], COMMAND[0])
        reached = 1e-3 * recording["length"]
        alone = simulate_rollouts(device.parameters, reached, COMMAND[:count], STEP, initial_state=start)
        assert recording["force"] == pytest.approx(alone.tension, rel=1e-9, abs=1e-6)
        assert recording["pressure"] * BAR == pytest.approx(alone.pressure)
    spec = models.load_spec("bench")
    model = models.attach_devices(spec, {"muscle_tendon": device.parameters})
    assert model.na == 2 + unit.N_INTERNAL_STATES
    assert models.attach_devices(models.load_spec("bench"), {"muscle_tendon": PAIR.parameters}).na == 2


def test_dead_time_applies_on_the_mujoco_bench() -> None:
    device = load_with_effects({"pressure_delay": {"delay_s": 0.0301}})
    alone = simulate_rollouts(device.parameters, LENGTH, COMMAND, STEP)
    recording = bench.simulate_tester(device, LENGTH, COMMAND, STEP)
    assert recording["pressure"] * BAR == pytest.approx(alone.pressure)


def test_batch_runs_devices_with_different_effects() -> None:
    model = models.attach_devices(
        models.load_spec("bench"), {"muscle_tendon": PAIR.parameters}, reserve_internal_states=True
    )
    slots = [catalogue.find_slot("braid_hysteresis", "maxwell_slip"), catalogue.find_slot("seal_friction", "coulomb")]
    devices = [PAIR.parameters, *(activate(s, parameters_of(s.form)) for s in slots)]
    simulations = batch.create_batch(model, 3, n_threads=2)
    batch.set_parameters(simulations, "muscle_tendon", devices)
    simulations.bind("qpos")[:], simulations.bind("qvel")[:] = 0.345, -0.05
    simulations.bind("ctrl")[:] = 3.0
    batch.step_batch(simulations, n_steps=100)
    for device, act in zip(devices, simulations.bind("act"), strict=True):
        model = models.attach_devices(
            models.load_spec("bench"), {"muscle_tendon": device}, reserve_internal_states=True
        )
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = 0.345, -0.05, 3.0
        with callbacks.device_callbacks():
            callbacks.step_model(model, data, 100)
        assert np.array_equal(act, data.act)
    assert simulations.bind("act")[1, 2:5].any()
    small = models.attach_devices(models.load_spec("bench"), {"muscle_tendon": PAIR.parameters})
    with pytest.raises(InputError, match="internal states needs a model made with"):
        batch.set_parameters(batch.create_batch(small, 3), "muscle_tendon", devices)
