"""Every effect: neutral changes no bit, typical sizes show as they should, and only the supply may give energy."""

import math
import os
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
from klute_sim.effects.effect import EffectForm
from klute_sim.effects.families import instrument
from klute_sim.effects.smoothing import SIGN_TRANSITION_SPEED
from klute_sim.errors import InputError
from klute_sim.laws import mckibben, valve
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE, Supply
from klute_sim.plant import batch, callbacks, models
from klute_sim.units import BAR

PAIR = load_device("klute-3-4-pair")
STEP = 2e-4
TIME = np.arange(5000) * STEP
LENGTH = 0.338 + 0.012 * np.sin(9 * TIME) + 0.002 * np.sin(31 * TIME)
COMMAND = np.where(TIME % 0.5 < 0.25, 4e5, 1e5)
FORMS = pytest.mark.parametrize("slot", catalogue.get_device_slots(), ids=lambda s: f"{s.effect}-{s.form.name}")


def numbers(form: EffectForm, size: float | None = None) -> dict[str, float]:
    """Typical parameters; with ``size`` 0 the neutral ones."""
    return {p.key: p.neutral if size == 0.0 and p.neutral is not None else p.typical for p in form.parameters}


def having(
    slot: EffectSlot, parameters: dict[str, float], device: DeviceParameters = PAIR.parameters
) -> DeviceParameters:
    return device._replace(effects=catalogue.pack_effects({(slot.effect, slot.form.name): parameters}))


def base(slot: EffectSlot) -> DeviceParameters:
    """The device that shows the effect: a leak shows behind a valve only, a regulator makes up for it."""
    return VALVE_FED if slot.effect == "leak" else PAIR.parameters


def run(device: DeviceParameters, law: str = "compiled", count: int = len(TIME)) -> RolloutTrace:
    return simulate_rollouts(device, LENGTH[:count], COMMAND[:count], STEP, backend=law)


def same(a: RolloutTrace, b: RolloutTrace) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@FORMS
def test_a_device_at_rest_stays_where_it_is(slot: EffectSlot) -> None:
    """Three times as much of the effect as is typical: what was remembered has settled there, too."""
    large = {
        p.key: p.typical if p.neutral is None else min(max(p.neutral + 3.0 * (p.typical - p.neutral), p.lower), p.upper)
        for p in slot.form.parameters
    }
    device = having(slot, large)
    begin = unit.compute_equilibrium_state(device, 0.34, 3e5)
    state = begin
    for _ in range(300):
        state = unit.advance_state(device, state, 0.34, 3e5, 1e-3)
    assert state.length == pytest.approx(begin.length, abs=2e-6)
    held, later = (unit.compute_tension(device, each, 0.34, 0.0) for each in (begin, state))
    assert later == pytest.approx(held, abs=0.3)
    if slot.effect in ("braid_hysteresis", "tendon_hysteresis"):  # nothing pulls at what has let go
        plain = unit.compute_tension(
            PAIR.parameters, unit.compute_equilibrium_state(PAIR.parameters, 0.34, 3e5), 0.34, 0.0
        )
        assert held == pytest.approx(plain, abs=1e-6)


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
def test_neutral_changes_no_bit_in_either_installation(slot: EffectSlot) -> None:
    device = base(slot)
    neutral = having(slot, numbers(slot.form, 0.0), device)
    assert neutral.effects[0] == 1.0
    assert same(run(neutral), BASES[device])
    assert same(run(neutral, "python", 800), RolloutTrace(*(x[:800] for x in BASES[device])))


@FORMS
def test_typical_shows_and_is_the_same_in_both_installations(slot: EffectSlot) -> None:
    device = having(slot, numbers(slot.form), base(slot))
    typical = run(device)
    assert np.sqrt(np.mean((typical.tension - BASES[base(slot)].tension) ** 2)) > 4.0
    python = run(device, "python", 1500)
    assert same(python, RolloutTrace(*(x[:1500] for x in typical)))


SIGNATURES = {
    # What the effect does to the tension while the muscle shortens and while it lengthens, at constant pressure.
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
    "bladder_softening": (1, 1),  # the bladder takes less of the gas's tension
    "trapped_air": (1, -1),  # the damper brakes less
    "tendon_stiffening": (1, 1),
}


@FORMS
def test_its_signature_is_its_own(slot: EffectSlot) -> None:
    if slot.effect not in SIGNATURES:
        pytest.skip("acts in the supply, or is data-driven")
    time = np.arange(40_000) * STEP
    length, command = 0.338 + 0.008 * np.sin(2 * np.pi * time), np.full(len(time), 3e5)
    change = []
    for device in (PAIR.parameters, having(slot, numbers(slot.form))):
        change.append(simulate_rollouts(device, length, command, STEP).tension)
    more = change[1] - change[0]
    speed = np.cos(2 * np.pi * time)
    settled = time > 6.0
    shortening, lengthening = more[settled & (speed < -0.7)].mean(), more[settled & (speed > 0.7)].mean()
    wanted = SIGNATURES[slot.effect]
    assert np.sign([shortening, lengthening]).tolist() == list(wanted)
    assert min(abs(shortening), abs(lengthening)) > 0.2


def test_supply_effects_do_to_the_pressure_what_they_say() -> None:
    def pressure(effect: str, form: str, value: float) -> np.ndarray:
        slot = catalogue.find_slot(effect, form)
        return run(having(slot, {slot.form.parameters[0].key: value})).pressure

    settled = (TIME % 0.25 > 0.2) & (TIME > 0.3)
    assert pressure("regulator_error", "gain", 0.9)[settled] == pytest.approx(0.9 * BASE.pressure[settled])
    assert pressure("regulator_error", "offset", 0.2)[settled] == pytest.approx(BASE.pressure[settled] + 0.2e5)
    late = pressure("pressure_delay", "dead_time", 0.04)
    assert late[200:] == pytest.approx(BASE.pressure[:-200])
    slow = pressure("pressure_lag", "first_order", 0.05)
    rise = slow[round(0.5 / STEP) : round(0.75 / STEP)]
    after = np.arange(1, len(rise) + 1) * STEP
    # Faster than the supply's rate it cannot be; a lag of 50 ms on 3 bar is not.
    wanted = 4e5 + (rise[0] - 4e5) * np.exp(-(after - after[0]) / 0.05)
    assert rise == pytest.approx(wanted, abs=0.01 * 3e5)


def test_a_choked_valve_fills_as_slowly_as_its_conductance_lets_it() -> None:
    """A clamped muscle, and sonic flow: the closed form of a constant volume."""
    bare = load_device("klute-3-4").parameters
    bare = bare._replace(supply=bare.supply._replace(max_pressure=15e5, max_pressure_rate=1e9))
    slot = catalogue.find_slot("choked_valve", "symmetric")
    device = having(slot, {"resistance_s_bar_per_dm3": 8.0, "critical_ratio": 0.3}, bare)
    length = 0.9 * bare.muscle.resting_length
    volume = mckibben.volume(bare.muscle, length)
    restriction = valve.Restriction(1.0 / (8.0 * 1e3 * BAR), 0.3)
    high = 15e5 + ATMOSPHERIC_PRESSURE
    time = valve.filling_time(restriction, 1.0, bare.supply.temperature, volume, high, ATMOSPHERIC_PRESSURE, 0.3 * high)
    found = simulate_rollouts(
        device,
        np.full(4000, length),
        np.full(4000, 14e5),
        STEP,
        initial_state=unit.compute_taut_state(device, length, 0.0),
    )
    assert np.interp(0.3 * high - ATMOSPHERIC_PRESSURE, found.pressure, STEP * np.arange(1, 4001)) == pytest.approx(
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
    wanted = valve.venting_time(restriction, 1.0, bare.supply.temperature, volume, 8e5 + ATMOSPHERIC_PRESSURE, low)
    crossed = STEP * (1 + np.argmax(empty.pressure < low - ATMOSPHERIC_PRESSURE))
    assert crossed == pytest.approx(wanted, rel=5e-3)


def test_a_regulator_that_recovers_slowly_feels_the_muscle_pump() -> None:
    slot = catalogue.find_slot("volume_coupling", "polytropic")
    command = np.full(len(TIME), 3e5)
    found = simulate_rollouts(having(slot, numbers(slot.form)), LENGTH, command, STEP)
    rate = np.gradient(found.length, STEP)
    late = TIME > 0.2
    # A muscle that is pulled long gets thin: its air is squeezed.
    assert np.corrcoef(found.pressure[late], rate[late])[0, 1] > 0.8
    assert 0.05e5 < np.ptp(found.pressure[late]) < 2e5
    fast, slow = (
        np.ptp(
            simulate_rollouts(having(slot, {"recovery_s": s, "exponent": 1.2}), LENGTH, command, STEP).pressure[late]
        )
        for s in (0.005, 0.05)
    )
    assert slow > 5 * fast


def test_a_leak_costs_air_and_behind_a_valve_pressure() -> None:
    slot = catalogue.find_slot("leak", "orifice")
    held = np.full(len(TIME), 0.338), np.full(len(TIME), 4e5)
    tight, leaky = (record_rollout(p, *held, STEP) for p in (PAIR.parameters, having(slot, numbers(slot.form))))
    assert leaky.pressure[-1] == tight.pressure[-1]
    lost = 0.02e-8 * 1.185 * (4e5 + ATMOSPHERIC_PRESSURE)  # sonic, at the reference temperature
    assert leaky.energy_balance.air_leaked[-1] == pytest.approx(lost * TIME[-1], rel=1e-3)
    assert leaky.energy_balance.air_drawn[-1] - tight.energy_balance.air_drawn[-1] == pytest.approx(
        lost * TIME[-1], rel=0.02
    )
    sound, sagging = (record_rollout(p, *held, STEP) for p in (VALVE_FED, having(slot, numbers(slot.form), VALVE_FED)))
    assert sagging.pressure[-1] < sound.pressure[-1] - 5e3


def test_a_tank_sinks_with_every_filling() -> None:
    slot = catalogue.find_slot("supply_droop", "tank")
    command = np.where(TIME % 0.2 < 0.1, 5e5, 0.0)
    found = simulate_rollouts(having(slot, numbers(slot.form)), np.full(len(TIME), 0.338), command, STEP)
    tops = [found.pressure[(0.2 * k <= TIME) & (0.2 * k + 0.1 > TIME)].max() for k in range(5)]
    assert np.diff(tops).max() < -0.2e5


def work_taken(device: DeviceParameters, path: np.ndarray, pressure: np.ndarray) -> float:
    """Work [J] that went into the unit along ``path`` [m], by the trapezium rule, from rest and back."""
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
def test_at_constant_pressure_a_closed_path_gives_nothing(slot: EffectSlot, seed: int, size: float) -> None:
    """Passivity: whatever the path, the effect's device takes at least nothing over a cycle."""
    random = np.random.default_rng(seed)
    turns = np.arange(10_000) * STEP * np.pi  # one round in two seconds
    wave = sum(random.normal() / k * np.sin(k * turns + random.uniform(0, 6.3)) for k in range(1, 7))
    path = 0.34 + 0.008 * wave / np.abs(wave).max()
    path = np.concatenate([path, path, path])
    parameters = numbers(slot.form)
    first = slot.form.parameters[0]
    neutral = first.neutral or 0.0
    parameters[first.key] = min(max(neutral + size * (first.typical - neutral), first.lower), first.upper)
    device = having(
        slot, parameters, PAIR.parameters._replace(damper=PAIR.parameters.damper._replace(concentric_coefficient=3e3))
    )
    pressure = np.full(len(path), random.uniform(1e5, 5e5))
    twice, thrice = (work_taken(device, path[:n], pressure[:n]) for n in (20_001, 30_000))
    assert thrice - twice > -2e-3


@pytest.mark.parametrize("form", ["coulomb", "maxwell_slip", "bouc_wen"])
def test_braid_friction_takes_energy_whatever_the_pressure_does(form: str) -> None:
    """The hysteresis alone: pressing harder in one direction must not make it give."""
    slot = catalogue.find_slot("braid_hysteresis", form)
    law, remember = slot.form.laws["muscle_force"], slot.form.laws.get("remember")
    own = [p.to_si(p.typical) for p in slot.form.parameters]
    random = np.random.default_rng(3)
    for _ in range(20):
        memory, x, given = (0.0,) * slot.form.n_states, 0.0, 0.0
        rest = PAIR.parameters.muscle.resting_length
        for _ in range(2000):
            dx, pressure = random.normal(0.0, 2e-4), random.uniform(0.0, 5e5)
            x += dx
            if remember:
                memory = remember(own, memory, PAIR.parameters.muscle, pressure, rest + x, 0.0, 1e-3)
            force = law(own, memory, 0.0, PAIR.parameters.muscle, pressure, rest + x, dx / 1e-3)
            given -= force * dx
        assert given < 0.0


def test_slip_starts_stiff_and_ends_at_its_friction() -> None:
    slot = catalogue.find_slot("braid_hysteresis", "maxwell_slip")
    own = [p.to_si(p.typical) for p in slot.form.parameters]
    muscle, pressure, memory = PAIR.parameters.muscle, 3e5, (0.0, 0.0, 0.0)
    forces = []
    for x in np.linspace(0.0, 5e-3, 500):
        memory = slot.form.laws["remember"](own, memory, muscle, pressure, muscle.resting_length + x, 0.0, 1e-3)
        forces.append(slot.form.laws["muscle_force"](own, memory, 0.0, muscle, pressure, muscle.resting_length + x, 0))
    assert forces[1] / 1.002e-5 == pytest.approx(2 * 40e3, rel=0.01)
    assert forces[-1] == pytest.approx(2 * 8.0 * 3.0)
    assert all(b >= a - 1e-9 for a, b in pairwise(forces))


def test_dry_friction_is_smooth_and_saturates() -> None:
    from klute_sim.effects.smoothing import smooth_sign

    assert smooth_sign(0.0) == 0.0
    assert smooth_sign(SIGN_TRANSITION_SPEED) == -smooth_sign(-SIGN_TRANSITION_SPEED) == pytest.approx(math.sqrt(0.5))
    assert smooth_sign(1.0) == pytest.approx(1.0, abs=1e-6)


def test_mujoco_steps_an_effect_that_remembers_as_the_device_does() -> None:
    sections = {"braid_hysteresis": {"form": "maxwell_slip", "slope_n_per_bar": 10.0, "stiffness_n_per_mm": 60.0}}
    sections |= {"bladder_relaxation": {"stiffness_n_per_mm": 4.0, "time_constant_s": 0.2}}
    sections |= {"tendon_hysteresis": {"loss_fraction": 0.1}, "pressure_lag": {"time_constant_s": 0.03}}
    device = with_effects(sections)
    for law in ("compiled", "python"):
        recording = bench.simulate_tester(device, LENGTH[:2000], COMMAND[:2000], STEP, backend=law)
        start = unit.compute_taut_state(device.parameters, LENGTH[0], COMMAND[0])
        reached = 1e-3 * recording["length"]
        alone = simulate_rollouts(device.parameters, reached, COMMAND[:2000], STEP, initial_state=start)
        assert recording["force"] == pytest.approx(alone.tension, rel=1e-9, abs=1e-6)
        assert recording["pressure"] * BAR == pytest.approx(alone.pressure)
    spec = models.load_spec("bench")
    model = models.attach_devices(spec, {"muscle_tendon": device.parameters})
    assert model.na == 2 + unit.N_INTERNAL_STATES
    assert models.attach_devices(models.load_spec("bench"), {"muscle_tendon": PAIR.parameters}).na == 2


def test_a_dead_time_reaches_the_bench_in_mujoco() -> None:
    device = with_effects({"pressure_delay": {"delay_s": 0.0301}})
    alone = simulate_rollouts(device.parameters, LENGTH, COMMAND, STEP)
    recording = bench.simulate_tester(device, LENGTH, COMMAND, STEP)
    assert recording["pressure"] * BAR == pytest.approx(alone.pressure)


def test_a_batch_carries_different_effects() -> None:
    model = models.attach_devices(
        models.load_spec("bench"), {"muscle_tendon": PAIR.parameters}, reserve_internal_states=True
    )
    slots = [catalogue.find_slot("braid_hysteresis", "maxwell_slip"), catalogue.find_slot("seal_friction", "coulomb")]
    devices = [PAIR.parameters, *(having(s, numbers(s.form)) for s in slots)]
    simulations = batch.create_batch(model, 3, n_threads=2)
    batch.set_parameters(simulations, "muscle_tendon", devices)
    simulations.bind("qpos")[:], simulations.bind("qvel")[:] = 0.345, -0.05
    simulations.bind("ctrl")[:] = 3.0
    batch.step_batch(simulations, n_steps=100)
    for device, act in zip(devices, simulations.bind("act"), strict=True):
        own = models.attach_devices(models.load_spec("bench"), {"muscle_tendon": device}, reserve_internal_states=True)
        data = mujoco.MjData(own)
        data.qpos[:], data.qvel[:], data.ctrl[:] = 0.345, -0.05, 3.0
        with callbacks.device_callbacks():
            callbacks.step_model(own, data, 100)
        assert np.array_equal(act, data.act)
    assert simulations.bind("act")[1, 2:5].any()
    small = models.attach_devices(models.load_spec("bench"), {"muscle_tendon": PAIR.parameters})
    with pytest.raises(InputError, match="remembers needs a model made with"):
        batch.set_parameters(batch.create_batch(small, 3), "muscle_tendon", devices)


def with_effects(sections: dict[str, dict[str, float | str]]) -> object:
    text = PAIR.content.decode()
    for name, content in sections.items():
        text += f"\n[effects.{name}]\n" + "".join(f"{k} = {v!r}\n".replace("'", '"') for k, v in content.items())
    return parse_device(text.encode(), "test")


@pytest.mark.parametrize(
    ("sections", "words"),
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
def test_what_a_device_file_may_not_say_of_effects(sections: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        with_effects(sections)


def test_a_device_file_says_which_effects() -> None:
    device = with_effects({"muscle_damping": {"form": "pressure", "coefficient_n_s_per_m": 55.0}})
    place = catalogue.find_slot("muscle_damping", "pressure")
    assert device.parameters.effects[0] == device.parameters.effects[place.switch_index] == 1.0
    assert device.parameters.effects[place.switch_index + 1] == 55.0
    assert device.spec.numbers()["effects.muscle_damping.coefficient_n_s_per_m"] == 55.0
    assert "effects.muscle_damping.coefficient_n_s_per_m" in device.spec.without_source()


def test_instruments_show_what_they_say() -> None:
    time, value = TIME, np.sin(7 * TIME)
    read_ = {e.name: e.forms[0].laws["reading"] for e in catalogue.get_effects().values() if e.kind == "instrument"}
    for effect in (e for e in catalogue.get_effects().values() if e.kind == "instrument"):
        neutral = [effect.forms[0].parameters[0].neutral]
        assert np.array_equal(read_[effect.name](neutral, time, value), value), effect.name
    assert read_["sensor_gain"]([1.1], time, value) == pytest.approx(1.1 * value)
    assert read_["sensor_offset"]([0.3], time, value) == pytest.approx(value + 0.3)
    assert read_["sensor_drift"]([0.5], time + 3.0, value) == pytest.approx(value + 0.5 * time)
    assert read_["clock_skew"]([0.02], time, value)[200:] == pytest.approx(np.sin(7 * (time - 0.02))[200:], abs=1e-5)
    # A ramp lags by the time constant, once the start is forgotten.
    assert instrument.apply_lag([0.05], time, 3.0 * time)[3000:] == pytest.approx(3.0 * (time - 0.05)[3000:], abs=1e-3)
    turned = instrument.apply_lag([0.05], time, value)
    assert np.abs(turned[2500:]).max() == pytest.approx(1 / math.hypot(1, 7 * 0.05), abs=2e-3)


def test_every_number_of_the_catalogue_makes_sense() -> None:
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


def in_fresh_process(code: str, **more: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, **more}
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)


USERS = (
    "import numpy as np; from klute_sim.device.device import load, read\n"
    "from klute_sim.device.rollout import rollout; from klute_sim.rigs import bench\n"
    "text = load('klute-3-4-pair').content + b'[effects.warming]\\ngain = 0.05\\ntime_constant_s = 0.2\\n'\n"
    "device, plain = read(text, 'mine'), load('klute-3-4-pair')\n"
    "length, command = np.full(2000, 0.345), np.full(2000, 3e5)\n"
    "traces = [rollout(d.parameters, length, command, 5e-4, law=law) for d in (device, plain)"
    " for law in ('compiled', 'python')]\n"
    "assert all(np.array_equal(a, b) for a, b in zip(traces[0], traces[1]))\n"
    "gain = traces[0].tension[-1] / traces[2].tension[-1]\n"
    "records = [bench.pull(device, length, command, 5e-4, law=law) for law in ('compiled', 'python')]\n"
    "assert np.array_equal(records[0]['force'], records[1]['force'])\n"
    "reached = rollout(device.parameters, 1e-3 * records[0]['length'], command, 5e-4)\n"
    "assert abs(records[0]['force'][-1] / reached.tension[-1] - 1) < 1e-9\n"
    "print(round(gain, 2))"
)


@pytest.mark.long
def test_a_users_effect_works_in_both_installations() -> None:
    file = HERE / "users.py"
    assert len(file.read_text("utf-8").splitlines()) < 40
    done = in_fresh_process(USERS, KLUTE_SIM_CATALOGUE=str(file))
    assert done.returncode == 0, done.stderr
    assert 1.05 < float(done.stdout) < 1.16


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "does not exist"),
        ("x = ", "cannot be run: SyntaxError"),
        ("x = 1", "has no EFFECTS"),
        ("EFFECTS = [3]", "EFFECTS holds 3"),
        (
            "from klute_sim.effects.families.muscle.end_taper import EFFECT\nEFFECTS = [EFFECT]",
            "there is an effect 'end_taper' already",
        ),
    ],
)
def test_a_catalogue_that_is_none_is_refused(content: str | None, words: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    if content is not None:
        file.write_text(content, "utf-8")
    done = in_fresh_process("import klute_sim.device.dynamics", KLUTE_SIM_CATALOGUE=str(file))
    assert words in done.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ("name", "form", "own", "others"),
    [
        ("leak", "orifice", (7.0,), {"leak": 7.0}),
        ("supply_droop", "tank", (4.0,), {"tank": 0.25, "tank_pressure": 0.5}),
        (
            "choked_valve",
            "symmetric",
            (4.0, 0.3),
            {"fill": 0.25, "fill_ratio": 0.3, "exhaust": 0.25, "exhaust_ratio": 0.3},
        ),
        (
            "choked_valve",
            "asymmetric",
            (4.0, 2.0, 0.3),
            {"fill": 0.25, "fill_ratio": 0.3, "exhaust": 0.125, "exhaust_ratio": 0.3},
        ),
    ],
)
def test_an_effect_of_the_air_changes_its_own_numbers_of_the_supply_only(
    name: str, form: str, own: tuple[float, ...], others: dict[str, float]
) -> None:
    supply = Supply(*(0.5 + k for k in range(len(Supply._fields))))  # no two alike
    law = catalogue.find_form(name, form)[1].laws["supply"]
    assert law(own, (), supply) == supply._replace(**others)
    assert law((0.0, *own[1:]), (), supply) == supply
