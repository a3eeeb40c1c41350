"""All effects: neutral parameters change no bit, typical ones show the right sign, all but the supply are passive."""

import math
import os
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim import bench
from klute_sim.device import dynamics as unit
from klute_sim.device.device import load_device, parse_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.recorded_rollout import record_rollout
from klute_sim.device.rollout import RolloutTrace, simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.effects.chain import EffectSlot
from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.effects.smoothing import SIGN_TRANSITION_SPEED
from klute_sim.errors import InputError
from klute_sim.laws import mckibben, valve
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE, SupplyParameters
from klute_sim.plant import batch, callbacks, models
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


def device_showing(slot: EffectSlot) -> DeviceParameters:
    """Return a device that shows the effect: a regulator compensates a leak, so the leak needs a valve."""
    return VALVE_FED if slot.effect == "leak" else PAIR.parameters


def run(device: DeviceParameters, backend: str = "compiled", count: int = len(TIME)) -> RolloutTrace:
    return simulate_rollouts(device, LENGTH[:count], COMMAND[:count], STEP, backend=backend)


def are_identical(a: RolloutTrace, b: RolloutTrace) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@FORMS
def test_equilibrium_state_is_stationary(slot: EffectSlot) -> None:
    """Three times the typical effect; its internal states are in equilibrium too."""
    parameters = {
        p.key: p.typical if p.neutral is None else min(max(p.neutral + 3.0 * (p.typical - p.neutral), p.lower), p.upper)
        for p in slot.form.parameters
    }
    device = activate(slot, parameters)
    initial = unit.compute_equilibrium_state(device, 0.34, 3e5)
    state = initial
    for _ in range(300):
        state = unit.advance_state(device, state, 0.34, 3e5, 1e-3)
    assert state.length == pytest.approx(initial.length, abs=2e-6)
    initial_tension, tension = (unit.compute_tension(device, s, 0.34, 0.0) for s in (initial, state))
    assert tension == pytest.approx(initial_tension, abs=0.3)
    if slot.effect in ("braid_hysteresis", "tendon_hysteresis"):  # relaxed sliders give no force
        plain = unit.compute_tension(
            PAIR.parameters, unit.compute_equilibrium_state(PAIR.parameters, 0.34, 3e5), 0.34, 0.0
        )
        assert initial_tension == pytest.approx(plain, abs=1e-6)


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
BASE = run(PAIR.parameters)
BASES = {PAIR.parameters: BASE, VALVE_FED: run(VALVE_FED)}


@FORMS
def test_neutral_parameters_change_no_bit_in_either_backend(slot: EffectSlot) -> None:
    device = device_showing(slot)
    neutral = activate(slot, parameters_of(slot.form, 0.0), device)
    assert neutral.effects[0] == 1.0
    assert are_identical(run(neutral), BASES[device])
    assert are_identical(run(neutral, "python", 800), RolloutTrace(*(x[:800] for x in BASES[device])))


@FORMS
def test_typical_parameters_are_visible_and_identical_in_both_backends(slot: EffectSlot) -> None:
    device = activate(slot, parameters_of(slot.form), device_showing(slot))
    typical = run(device)
    assert np.sqrt(np.mean((typical.tension - BASES[device_showing(slot)].tension) ** 2)) > 4.0
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
    "seal_friction": (-1, 1),
    "tendon_hysteresis": (-1, 1),
    "tendon_slack": (-1, -1),
    "bladder": (-1, -1),
    "friction_offset": (-1, -1),
    "braid_extensibility": (-1, -1),
    "thick_wall_bladder": (-1, -1),
    "bladder_softening": (1, 1),  # the bladder opposes the gas less
    "trapped_air": (1, -1),  # the damper acts less
    "tendon_stiffening": (1, 1),
}


@FORMS
def test_effect_has_its_signature_while_shortening_and_lengthening(slot: EffectSlot) -> None:
    if slot.effect not in SIGNATURES:
        pytest.skip("acts in the supply, or is data-driven")
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


def test_regulator_effects_match_their_equations() -> None:
    def pressure(effect: str, form: str, value: float) -> np.ndarray:
        slot = catalogue.find_slot(effect, form)
        return run(activate(slot, {slot.form.parameters[0].key: value})).pressure

    settled = (TIME % 0.25 > 0.2) & (TIME > 0.3)
    assert pressure("regulator_error", "gain", 0.9)[settled] == pytest.approx(0.9 * BASE.pressure[settled])
    assert pressure("regulator_error", "offset", 0.2)[settled] == pytest.approx(BASE.pressure[settled] + 0.2e5)
    late = pressure("pressure_delay", "dead_time", 0.04)
    assert late[200:] == pytest.approx(BASE.pressure[:-200])
    slow = pressure("pressure_lag", "first_order", 0.05)
    rise = slow[round(0.5 / STEP) : round(0.75 / STEP)]
    after = np.arange(1, len(rise) + 1) * STEP
    # The supply's maximum rate does not limit a lag of 50 ms on 3 bar.
    expected = 4e5 + (rise[0] - 4e5) * np.exp(-(after - after[0]) / 0.05)
    assert rise == pytest.approx(expected, abs=0.01 * 3e5)


def test_choked_valve_fills_in_the_closed_form_time() -> None:
    """A clamped muscle, and sonic flow: the closed form of a constant volume."""
    bare = load_device("klute-3-4").parameters
    bare = bare._replace(supply=bare.supply._replace(max_pressure=15e5, max_pressure_rate=1e9))
    slot = catalogue.find_slot("choked_valve", "symmetric")
    device = activate(slot, {"resistance_s_bar_per_dm3": 8.0, "critical_ratio": 0.3}, bare)
    length = 0.9 * bare.muscle.resting_length
    volume = mckibben.volume(bare.muscle, length)
    restriction = valve.Restriction(1.0 / (8.0 * 1e3 * BAR), 0.3)
    high = 15e5 + ATMOSPHERIC_PRESSURE
    time = valve.filling_time(restriction, 1.0, bare.supply.temperature, volume, high, ATMOSPHERIC_PRESSURE, 0.3 * high)
    trace = simulate_rollouts(
        device,
        np.full(4000, length),
        np.full(4000, 14e5),
        STEP,
        initial_state=unit.compute_taut_state(device, length, 0.0),
    )
    assert np.interp(0.3 * high - ATMOSPHERIC_PRESSURE, trace.pressure, STEP * np.arange(1, 4001)) == pytest.approx(
        time, rel=1e-3
    )
    empty = simulate_rollouts(
        device,
        np.full(9000, length),
        np.full(9000, 0.0),
        STEP,
        initial_state=unit.compute_taut_state(device, length, 8e5),
    )
    low = ATMOSPHERIC_PRESSURE / 0.3
    expected = valve.venting_time(restriction, 1.0, bare.supply.temperature, volume, 8e5 + ATMOSPHERIC_PRESSURE, low)
    crossed = STEP * (1 + np.argmax(empty.pressure < low - ATMOSPHERIC_PRESSURE))
    assert crossed == pytest.approx(expected, rel=5e-3)


def test_volume_coupling_raises_the_pressure_of_a_lengthening_muscle() -> None:
    slot = catalogue.find_slot("volume_coupling", "polytropic")
    command = np.full(len(TIME), 3e5)
    trace = simulate_rollouts(activate(slot, parameters_of(slot.form)), LENGTH, command, STEP)
    rate = np.gradient(trace.length, STEP)
    late = TIME > 0.2
    # A lengthening muscle becomes thinner, which compresses its air.
    assert np.corrcoef(trace.pressure[late], rate[late])[0, 1] > 0.8
    assert 0.05e5 < np.ptp(trace.pressure[late]) < 2e5
    fast, slow = (
        np.ptp(
            simulate_rollouts(activate(slot, {"recovery_s": s, "exponent": 1.2}), LENGTH, command, STEP).pressure[late]
        )
        for s in (0.005, 0.05)
    )
    assert slow > 5 * fast


def test_leak_draws_air_and_lowers_the_pressure_behind_a_valve() -> None:
    slot = catalogue.find_slot("leak", "orifice")
    inputs = np.full(len(TIME), 0.338), np.full(len(TIME), 4e5)
    tight, leaky = (
        record_rollout(p, *inputs, STEP) for p in (PAIR.parameters, activate(slot, parameters_of(slot.form)))
    )
    assert leaky.pressure[-1] == tight.pressure[-1]
    lost = 0.02e-8 * 1.185 * (4e5 + ATMOSPHERIC_PRESSURE)  # sonic, at the reference temperature
    assert leaky.energy_balance.air_leaked[-1] == pytest.approx(lost * TIME[-1], rel=1e-3)
    assert leaky.energy_balance.air_drawn[-1] - tight.energy_balance.air_drawn[-1] == pytest.approx(
        lost * TIME[-1], rel=0.02
    )
    sound, sagging = (
        record_rollout(p, *inputs, STEP) for p in (VALVE_FED, activate(slot, parameters_of(slot.form), VALVE_FED))
    )
    assert sagging.pressure[-1] < sound.pressure[-1] - 5e3


def test_tank_pressure_falls_with_each_filling() -> None:
    slot = catalogue.find_slot("supply_droop", "tank")
    command = np.where(TIME % 0.2 < 0.1, 5e5, 0.0)
    trace = simulate_rollouts(activate(slot, parameters_of(slot.form)), np.full(len(TIME), 0.338), command, STEP)
    tops = [trace.pressure[(0.2 * k <= TIME) & (0.2 * k + 0.1 > TIME)].max() for k in range(5)]
    assert np.diff(tops).max() < -0.2e5


def compute_absorbed_work(device: DeviceParameters, path: np.ndarray, pressure: np.ndarray) -> float:
    """Return the work [J] done on the device along ``path`` [m], by the trapezoidal rule."""
    trace = simulate_rollouts(device, path, pressure, STEP)
    return float(np.sum(0.5 * (trace.tension[1:] + trace.tension[:-1]) * np.diff(path)))


PASSIVE = [
    s
    for s in catalogue.get_device_slots()
    if s.effect in catalogue.get_named_effects() and not catalogue.get_effects()[s.effect].acts_in_supply
]


@settings(max_examples=8, deadline=None)
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
    two_cycles, three_cycles = (compute_absorbed_work(device, path[:n], pressure[:n]) for n in (20_001, 30_000))
    assert three_cycles - two_cycles > -2e-3


@pytest.mark.parametrize("form", ["coulomb", "maxwell_slip", "bouc_wen"])
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
                    *next_state(p, state, PAIR.parameters.muscle, pressure, rest + x, 0.0, 1e-3)
                )
            force = law(p, state, 0.0, PAIR.parameters.muscle, pressure, rest + x, dx / 1e-3)
            energy -= force * dx
        assert energy < 0.0


def test_maxwell_slip_starts_at_its_stiffness_and_saturates_at_its_friction() -> None:
    slot = catalogue.find_slot("braid_hysteresis", "maxwell_slip")
    laws, p, state = slot.form.laws, slot.form.pack(parameters_of(slot.form)), slot.form.make_zero_state()
    muscle, pressure = PAIR.parameters.muscle, 3e5
    forces = []
    for x in np.linspace(0.0, 5e-3, 500):
        length = muscle.resting_length + x
        state = slot.form.state_type(*laws["next_state"](p, state, muscle, pressure, length, 0.0, 1e-3))
        forces.append(laws["muscle_force"](p, state, 0.0, muscle, pressure, length, 0))
    assert forces[1] / 1.002e-5 == pytest.approx(2 * 40e3, rel=0.01)
    assert forces[-1] == pytest.approx(2 * 8.0 * 3.0)
    assert all(b >= a - 1e-9 for a, b in pairwise(forces))


def test_smooth_sign_is_odd_and_saturates() -> None:
    from klute_sim.effects.smoothing import smooth_sign

    assert smooth_sign(0.0) == 0.0
    assert smooth_sign(SIGN_TRANSITION_SPEED) == -smooth_sign(-SIGN_TRANSITION_SPEED) == pytest.approx(math.sqrt(0.5))
    assert smooth_sign(1.0) == pytest.approx(1.0, abs=1e-6)


def test_mujoco_steps_internal_states_as_the_device_does() -> None:
    sections = {"braid_hysteresis": {"form": "maxwell_slip", "slope_n_per_bar": 10.0, "stiffness_n_per_mm": 60.0}}
    sections |= {"bladder_relaxation": {"stiffness_n_per_mm": 4.0, "time_constant_s": 0.2}}
    sections |= {"tendon_hysteresis": {"loss_fraction": 0.1}, "pressure_lag": {"time_constant_s": 0.03}}
    device = load_with_effects(sections)
    for backend in ("compiled", "python"):
        recording = bench.simulate_tester(device, LENGTH[:2000], COMMAND[:2000], STEP, backend=backend)
        start = unit.compute_taut_state(device.parameters, LENGTH[0], COMMAND[0])
        reached = 1e-3 * recording["length"]
        alone = simulate_rollouts(device.parameters, reached, COMMAND[:2000], STEP, initial_state=start)
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


def load_with_effects(sections: dict[str, dict[str, float | str]]) -> object:
    text = PAIR.content.decode()
    for name, content in sections.items():
        text += f"\n[effects.{name}]\n" + "".join(f"{k} = {v!r}\n".replace("'", '"') for k, v in content.items())
    return parse_device(text.encode(), "test")


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"braid": {"slope_n_per_bar": 1.0}}, "no effect 'braid'; there are: threshold_pressure, "),
        ({"end_taper": {"form": "cube", "factor": 1.0}}, "'end_taper' has no form 'cube'; it has: cone, strain"),
        ({"end_taper": {}}, r"\[effects.end_taper\] key 'tip_length_mm' is missing"),
        ({"end_taper": {"tip_length_mm": -1.0}}, r"tip_length_mm = -1.0 is refused; allowed: 0 to 40"),
        ({"end_taper": {"tip_length_mm": 1.0, "tip": 2.0}}, "unknown key 'tip'; allowed here: form, tip_length_mm"),
        ({"end_taper": {"tip_length_mm": "long"}}, "tip_length_mm = 'long' is refused"),
        ({"sensor_gain": {"gain": 1.1}}, "'sensor_gain' is an effect of instruments"),
    ],
)
def test_invalid_effect_section_is_refused(sections: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_with_effects(sections)


def test_device_file_activates_effects() -> None:
    device = load_with_effects({"muscle_damping": {"form": "pressure", "coefficient_n_s_per_m": 55.0}})
    slot = catalogue.find_slot("muscle_damping", "pressure")
    assert device.parameters.effects[0] == device.parameters.effects[slot.switch_index] == 1.0
    assert device.parameters.effects[slot.switch_index + 1] == 55.0
    assert device.spec.collect_values()["effects.muscle_damping.coefficient_n_s_per_m"] == 55.0
    assert "effects.muscle_damping.coefficient_n_s_per_m" in device.spec.list_unsourced_keys()


def test_instrument_laws_match_their_equations() -> None:
    time, value = TIME, np.sin(7 * TIME)

    def read(effect: str, parameter: float, time: np.ndarray = time, value: np.ndarray = value) -> np.ndarray:
        form = catalogue.get_effects()[effect].forms[0]
        return form.laws["reading"](form.parameter_type(parameter), time, value)

    for effect in (e for e in catalogue.get_effects().values() if e.kind == "instrument"):
        assert np.array_equal(read(effect.name, effect.forms[0].parameters[0].neutral), value), effect.name
    assert read("sensor_gain", 1.1) == pytest.approx(1.1 * value)
    assert read("sensor_offset", 0.3) == pytest.approx(value + 0.3)
    assert read("sensor_drift", 0.5, time + 3.0) == pytest.approx(value + 0.5 * time)
    assert read("clock_skew", 0.02)[200:] == pytest.approx(np.sin(7 * (time - 0.02))[200:], abs=1e-5)
    # A ramp lags by the time constant after the initial transient.
    ramp = read("sensor_lag", 0.05, value=3.0 * time)
    assert ramp[3000:] == pytest.approx(3.0 * (time - 0.05)[3000:], abs=1e-3)
    lagged = read("sensor_lag", 0.05)
    assert np.abs(lagged[2500:]).max() == pytest.approx(1 / math.hypot(1, 7 * 0.05), abs=2e-3)


def test_catalogue_parameters_are_consistent() -> None:
    for effect in catalogue.get_effects().values():
        assert effect.description.endswith(".")
        for form in effect.forms:
            assert form.equation
            for p in form.parameters:
                assert p.lower <= p.typical <= p.upper
                assert (
                    p.lower > 0.0 if p.neutral is None else p.lower <= p.neutral <= p.upper
                )  # shapes are fitted as logs
                assert p.source


HERE = Path(__file__).parent


def run_in_new_process(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, **variables}
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)


USER_SCRIPT = (
    "import numpy as np; from klute_sim.device.device import load_device, parse_device\n"
    "from klute_sim.device.rollout import simulate_rollouts; from klute_sim import bench\n"
    "plain = load_device('klute-3-4-pair')\n"
    "text = plain.content + b'[effects.warming]\\ngain = 0.05\\ntime_constant_s = 0.2\\n'\n"
    "device = parse_device(text, 'mine')\n"
    "length, command = np.full(2000, 0.345), np.full(2000, 3e5)\n"
    "traces = [simulate_rollouts(d.parameters, length, command, 5e-4, backend=backend) for d in (device, plain)"
    " for backend in ('compiled', 'python')]\n"
    "assert all(np.array_equal(a, b) for a, b in zip(traces[0], traces[1]))\n"
    "gain = traces[0].tension[-1] / traces[2].tension[-1]\n"
    "records = [bench.simulate_tester(device, length, command, 5e-4, backend=backend)"
    " for backend in ('compiled', 'python')]\n"
    "assert np.array_equal(records[0]['force'], records[1]['force'])\n"
    "reached = simulate_rollouts(device.parameters, 1e-3 * records[0]['length'], command, 5e-4)\n"
    "assert abs(records[0]['force'][-1] / reached.tension[-1] - 1) < 1e-9\n"
    "print(round(gain, 2))"
)


@pytest.mark.long
def test_catalogue_file_runs_in_both_backends() -> None:
    path = HERE / "user_effects.py"
    assert len(path.read_text("utf-8").splitlines()) < 40
    process = run_in_new_process(USER_SCRIPT, KLUTE_SIM_CATALOGUE=str(path))
    assert process.returncode == 0, process.stderr
    assert 1.05 < float(process.stdout) < 1.16


@pytest.mark.long
def test_effect_registered_in_a_script_runs_in_both_backends(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text((HERE / "user_effects.py").read_text("utf-8") + USER_SCRIPT, "utf-8")
    process = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr
    assert 1.05 < float(process.stdout) < 1.16


def make_effect(**changes: object) -> Effect:
    parameter = EffectParameter(key="gain", neutral=0.0, lower=0.0, upper=1.0, typical=0.5, source="assumed")
    form = {"name": "default", "equation": "F (1 + gain)", "parameters": (parameter,)}
    form |= {"laws": {"damper_force": lambda p, state, force, velocity: force * (1.0 + p.gain)}}
    return Effect(name="mine", description="Mine.", kind="device", forms=(EffectForm(**(form | changes)),))


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        (3, "cannot register 3; allowed: klute_sim.Effect"),
        (catalogue.BUILT_IN_EFFECTS[0], "'threshold_pressure': an effect of that name exists"),
        (make_effect(laws={"force": len}), "unknown hook 'force'; allowed: acting_pressure, "),
        (make_effect(states=("warmth",)), "internal states need a law at 'next_state'"),
        (make_effect(parameters=()), "the first parameter must have a neutral value"),
        (make_effect(laws={"damper_force": lambda p, state, force, velocity: p.slope}), "fails: AttributeError"),
        (make_effect(laws={"damper_force": lambda p, state, force, velocity: "1"}), "returns '1'; allowed: a float"),
        (make_effect(), "after the first device is loaded"),
    ],
)
def test_invalid_registration_is_refused(effect: object, message: str) -> None:
    catalogue.get_effects.cache_clear() if "device" not in message else catalogue.get_effects()
    try:
        with pytest.raises(InputError, match=re.escape(message)):
            catalogue.register_effect(effect)
    finally:
        catalogue.get_effects()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "does not exist"),
        ("x = ", "cannot be run: SyntaxError"),
        ("x = 1", "registers no effect"),
        (
            "import klute_sim as ks\nfrom klute_sim.effects.families.muscle.end_taper import END_TAPER\n"
            "ks.register_effect(END_TAPER)",
            "cannot register effect 'end_taper': an effect of that name exists",
        ),
    ],
)
def test_invalid_catalogue_file_is_refused(content: str | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    if content is not None:
        path.write_text(content, "utf-8")
    process = run_in_new_process("import klute_sim.device.dynamics", KLUTE_SIM_CATALOGUE=str(path))
    assert message in process.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ("effect", "form", "parameters", "changed_fields"),
    [
        ("leak", "orifice", (7.0,), {"leak_conductance": 7.0}),
        ("supply_droop", "tank", (4.0,), {"tank_volume": 0.25, "tank_pressure": 0.5}),
        (
            "choked_valve",
            "symmetric",
            (4.0, 0.3),
            {
                "fill_conductance": 0.25,
                "fill_critical_ratio": 0.3,
                "exhaust_conductance": 0.25,
                "exhaust_critical_ratio": 0.3,
            },
        ),
        (
            "choked_valve",
            "asymmetric",
            (4.0, 2.0, 0.3),
            {
                "fill_conductance": 0.25,
                "fill_critical_ratio": 0.3,
                "exhaust_conductance": 0.125,
                "exhaust_critical_ratio": 0.3,
            },
        ),
    ],
)
def test_supply_effect_changes_only_its_fields(
    effect: str, form: str, parameters: tuple[float, ...], changed_fields: dict[str, float]
) -> None:
    supply = SupplyParameters(*(0.5 + k for k in range(len(SupplyParameters._fields))))  # all fields differ
    effect_form = catalogue.find_form(effect, form)[1]
    law, state = effect_form.laws["supply"], effect_form.make_zero_state()
    assert law(effect_form.parameter_type(*parameters), state, supply) == supply._replace(**changed_fields)
    assert law(effect_form.parameter_type(0.0, *parameters[1:]), state, supply) == supply
