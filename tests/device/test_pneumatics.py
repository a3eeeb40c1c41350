"""A device behind a valve: the gas law, closed air, both installations, MuJoCo, the gait, and what a file may say."""

from functools import cache

import numpy as np
import pytest

from klute_sim import bench
from klute_sim.controllers import pressure as control
from klute_sim.device import dynamics as unit
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.device.dynamics import DeviceParameters, DeviceState
from klute_sim.device.energy.ledger import POWER_TERMS, SOLVER_TERM
from klute_sim.device.recorded_rollout import RolloutRecord, record_rollout
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.errors import InputError
from klute_sim.gait.metrics import compute_gait_metrics
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.laws import mckibben, pneumatic_step
from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT, ATMOSPHERIC_PRESSURE
from klute_sim.recording.recording import Recording
from klute_sim.units import BAR

VALVE = load_device("klute-1-1-4-pair-valve")
STEP = 5e-4
TIME = np.arange(3000) * STEP
LENGTH = 0.36 + 0.006 * np.sin(9 * TIME) + 0.001 * np.sin(31 * TIME)
COMMAND = np.where(TIME % 0.5 < 0.25, 4e5, 0.5e5)
HYSTERESIS = b'\n[effects.braid_hysteresis]\nform = "maxwell_slip"\nslope_n_per_bar = 10.0\nstiffness_n_per_mm = 60.0\n'


def edited(*changes: tuple[str, str], more: bytes = b"") -> Device:
    text = VALVE.content.decode()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    return parse_device(text.encode() + more, "test")


ISOTHERMAL = ("exponent = 1.2", "exponent = 1.0")
OPENS = ('takes = "pressure"\ngain_per_bar = 5.0\n', 'takes = "opening"\n'), ('"valve.gain_per_bar" =', "#")
PULSES = ('drive = "proportional"\n', 'drive = "on-off"\nperiod_s = 0.02\nshortest_pulse_s = 0.002\n')
TIGHT = ("conductance_dm3_per_s_bar = 0.001", "conductance_dm3_per_s_bar = 0.0")


def whole(parameters: DeviceParameters, length: np.ndarray) -> np.ndarray:
    """Volume of muscle and dead volume [m3]."""
    return np.array([mckibben.volume(parameters.muscle, x) for x in length.tolist()]) + parameters.supply.dead_volume


def gas_law(parameters: DeviceParameters, pressure: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Air [kg] that the gas law finds in there at the supply's temperature."""
    return (
        (pressure + ATMOSPHERIC_PRESSURE)
        * whole(parameters, length)
        / (AIR_GAS_CONSTANT * parameters.supply.temperature)
    )


@pytest.mark.parametrize("changes", [(), (PULSES,)], ids=["proportional", "pulses"])
def test_at_constant_temperature_pressure_length_and_counted_air_obey_the_gas_law(changes: tuple) -> None:
    p = edited(ISOTHERMAL, *changes, more=HYSTERESIS).parameters
    told: RolloutRecord = record_rollout(p, LENGTH, COMMAND, STEP)
    assert told.energy_balance.air_mass == pytest.approx(gas_law(p, told.pressure, told.length), rel=1e-9)
    assert told.energy_balance.air_drawn[-1] > 1e-3
    let_out = (
        told.energy_balance.air_drawn
        - told.energy_balance.air_leaked
        - (told.energy_balance.air_mass - told.energy_balance.air_mass[0])
    )
    assert np.diff(let_out).min() > -1e-15
    assert let_out[-1] > 1e-3
    assert told.energy_balance.air_leaked[-1] > 0.0


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
def test_closed_air_follows_its_polytrope_while_the_muscle_moves(exponent: float) -> None:
    changes = ("exponent = 1.2", f"exponent = {exponent}"), ("warming_s = 0.3", "warming_s = 0.0"), TIGHT
    p = edited(*OPENS, *changes).parameters
    start = unit.compute_taut_state(p, LENGTH[0], 0.0)
    start = DeviceState(3e5, start.length, start.internal_state)
    told = record_rollout(p, LENGTH, np.zeros(len(TIME)), STEP, initial_state=start)
    constant = (told.pressure + ATMOSPHERIC_PRESSURE) * whole(p, told.length) ** exponent
    assert constant == pytest.approx(
        (3e5 + ATMOSPHERIC_PRESSURE) * whole(p, np.array([start.length]))[0] ** exponent, rel=1e-9
    )
    assert np.ptp(told.pressure) > 1e4
    assert told.energy_balance.air_drawn[-1] == told.energy_balance.air_leaked[-1] == 0.0


def test_closed_air_is_a_spring_and_a_valve_that_is_wide_open_is_a_regulator() -> None:
    wide = (
        ("fill_dm3_per_s_bar = 2.0", "fill_dm3_per_s_bar = 900.0"),
        ("exhaust_dm3_per_s_bar = 2.0", "exhaust_dm3_per_s_bar = 900.0"),
    )
    line = ("length_m = 0.5", "length_m = 0.001"), ("inner_diameter_mm = 6.0", "inner_diameter_mm = 40.0")
    p = edited(*wide, *line, ("gain_per_bar = 5.0", "gain_per_bar = 500.0"), TIGHT).parameters
    ideal = load_device("klute-1-1-4-pair").parameters
    ideal = ideal._replace(supply=ideal.supply._replace(max_pressure_rate=1e9, max_pressure=p.supply.max_pressure))
    fast, slow = (record_rollout(each, LENGTH, COMMAND, STEP) for each in (p, ideal))
    late = TIME % 0.25 > 0.02
    assert fast.pressure[late] == pytest.approx(slow.pressure[late], abs=5e3)
    assert fast.tension[late] == pytest.approx(slow.tension[late], abs=30.0)
    shut = record_rollout(
        edited(*OPENS, TIGHT).parameters,
        LENGTH,
        np.zeros(len(TIME)),
        STEP,
        initial_state=unit.compute_taut_state(p, 0.36, 3e5),
    )
    held = record_rollout(
        ideal, LENGTH, np.full(len(TIME), 3e5), STEP, initial_state=unit.compute_taut_state(ideal, 0.36, 3e5)
    )
    assert np.ptp(shut.tension[500:]) > 1.02 * np.ptp(held.tension[500:])


@pytest.mark.parametrize("changes", [(), (PULSES,), OPENS, (*OPENS, PULSES)], ids=["", "pulses", "openings", "both"])
def test_compiled_and_python_agree_to_the_bit_alone_and_in_mujoco(changes: tuple) -> None:
    device = edited(*changes, more=HYSTERESIS)
    command = np.where(TIME % 0.5 < 0.25, 0.7, -0.4) if device.parameters.supply.command_is_opening else COMMAND
    p = device.parameters
    fast, slow = (record_rollout(p, LENGTH[:1000], command[:1000], STEP, backend=law) for law in ("compiled", "python"))
    for a, b in zip([*fast[:4], *fast.energy_balance[:-1]], [*slow[:4], *slow.energy_balance[:-1]], strict=True):
        assert np.array_equal(a, b)
    assert np.array_equal(simulate_rollouts(device.parameters, LENGTH, command, STEP).tension[:1000], fast.tension)
    one, two = (
        bench.simulate_tester(device, LENGTH[:400], command[:400], STEP, backend=x) for x in ("compiled", "python")
    )
    for name in one.channels:
        assert np.array_equal(one[name], two[name], equal_nan=True), name
    start = unit.compute_taut_state(device.parameters, LENGTH[0], command[0])
    alone = record_rollout(device.parameters, 1e-3 * one["length"], command[:400], STEP, initial_state=start)
    # MuJoCo adds up rates, so the last bits differ, and pulses make more of them: they begin and end at an instant.
    near = 1e-4 if PULSES in changes else 1e-8
    assert one["force"] == pytest.approx(alone.tension, rel=near, abs=1e3 * near)
    assert one["pressure"] * BAR == pytest.approx(alone.pressure, rel=near)
    assert one["air_drawn"] == pytest.approx(alone.energy_balance.air_drawn, rel=near, abs=1e-11)
    assert ("valve_command" in one) == bool(device.parameters.supply.command_is_opening)
    assert ("pressure_command" in one) != bool(device.parameters.supply.command_is_opening)


def test_a_step_response_converges_with_the_step() -> None:
    p = VALVE.parameters
    fine = record_rollout(
        p, np.full(16_000, 0.36), np.full(16_000, 4e5), 1.25e-5, initial_state=unit.compute_taut_state(p, 0.36, 0.0)
    ).pressure
    errors = []
    for step in (4e-4, 2e-4, 1e-4):
        n, k = round(0.2 / step), round(step / 1.25e-5)
        found = record_rollout(
            p, np.full(n, 0.36), np.full(n, 4e5), step, initial_state=unit.compute_taut_state(p, 0.36, 0.0)
        ).pressure
        errors.append(np.abs(found - fine[k - 1 :: k]).max())
    assert errors[2] < 5e3
    assert errors[0] > 1.6 * errors[1] > 2.6 * errors[2]


@cache
def walked() -> tuple[Recording, DeviceParameters]:
    device = edited(ISOTHERMAL, more=HYSTERESIS)
    return simulate_gait(device, control.load_default_profile(), GaitOptions(strides=3)), device.parameters


def test_energy_and_air_of_a_stride_close_with_everything_on() -> None:
    recording, p = walked()
    step = recording["time"][1]
    for number, stride in enumerate(compute_gait_metrics(recording).strides, start=1):
        assert abs(stride.ledger_residual_pct) < 0.1
        last = recording.select(recording["stride"] == number)
        given = np.sum([last[line] for line in POWER_TERMS], axis=0)
        assert given == pytest.approx(last["delivered_power"], abs=1e-6)
        assert np.abs(last[SOLVER_TERM]).sum() < 2e-3 * np.abs(last["delivered_power"]).sum()
        mass = gas_law(p, last["pressure"] * BAR, last["muscle_length"])
        gained = float(mass[-1] - mass[0])
        counted = float(last["air_mass"][-1] - last["air_mass"][0])
        drawn = float(last["air_drawn"][-1] - last["air_drawn"][0])
        assert counted == pytest.approx(gained, abs=1e-9 * drawn)
        assert 1e3 * drawn == pytest.approx(stride.air_g, rel=1e-12)
        assert last["effect_braid_hysteresis_power"].sum() < -1.0
        # Stops are what is left over in a balance of forces: they must be nothing where none is touched.
        assert np.abs(last["stop_power"]).sum() < 1e-5 * np.abs(last["delivered_power"]).sum()
        volume = np.array([mckibben.volume(p.muscle, x) for x in last["muscle_length"].tolist()])
        work = float(np.trapezoid(last["pressure"] * BAR, volume))
        assert step * last["gas_power"][1:].sum() == pytest.approx(work, rel=1e-4)
        lost = [pneumatic_step.leak_flow(p.supply, x * BAR, p.supply.temperature) for x in last["pressure"].tolist()]
        leaked = last["air_leaked"][-1] - last["air_leaked"][0]
        assert leaked == pytest.approx(step * np.sum(lost[1:]), rel=1e-2)
        assert 1e3 * leaked == pytest.approx(stride.air_leaked_g, rel=1e-9)
    assert 1.0 < stride.air_g < 2.5
    assert not compute_gait_metrics(recording).has_swing_contact


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            [("gain_per_bar = 5.0\n", ""), ('"valve.gain_per_bar" =', "#")],
            "takes = 'pressure' .also when left out. needs gain_per_bar",
        ),
        ([('drive = "proportional"', 'drive = "on-off"')], "drive = 'on-off' needs period_s and shortest_pulse_s"),
        ([("[leak]", "[effects.leak]")], "leak.conductance_dm3_per_s_bar', which is no number"),
        (
            [('drive = "proportional"', 'drive = "on-off"\nperiod_s = 0.02\nshortest_pulse_s = 0.03')],
            "shortest_pulse_s must be at most half of period_s",
        ),
        ([("dead_volume_cm3 = 5.0", "dead_volume_cm3 = 1e300")], "chamber.dead_volume_cm3 = 1e[+]300 is refused"),
        ([('takes = "pressure"', 'takes = "opening"')], "gain_per_bar is of no use to takes = 'opening'"),
        ([('drive = "proportional"', "period_s = 0.02")], "period_s and shortest_pulse_s need drive = 'on-off'"),
        ([("exponent = 1.2", "exponent = 2.0")], "chamber.exponent = 2.0 is refused"),
        ([("volume_l = 1.5", "volume = 1.5")], "unknown key 'tank.volume'; allowed here: volume_l, pressure_bar"),
    ],
)
def test_what_a_device_file_may_not_say_of_air(changes: list, words: str) -> None:
    with pytest.raises(InputError, match=words):
        edited(*changes)


def test_a_line_needs_a_valve_and_nothing_is_said_twice() -> None:
    plain = load_device("klute-1-1-4-pair").content.decode()
    line = "[line]\nlength_m = 1.0\ninner_diameter_mm = 4.0\n"
    with pytest.raises(InputError, match=r"\[line\] needs a \[valve\]"):
        parse_device(plain.replace("[sources]", line + "\n[sources]").encode(), "x")
    with pytest.raises(InputError, match=r"\[effects.pressure_lag\] and \[valve\] say the same twice"):
        edited(more=b"\n[effects.pressure_lag]\ntime_constant_s = 0.05\n")


def test_pumping_is_no_part_of_what_a_regulator_is_late_with() -> None:
    more = b"\n[effects.pressure_lag]\ntime_constant_s = 0.05\n"
    more += b"[effects.volume_coupling]\nrecovery_s = 0.05\nexponent = 1.2\n"
    device = parse_device(load_device("klute-1-1-4-pair").content + more, "both").parameters
    ends = []
    for step in (1e-3, 2.5e-4):
        time = np.arange(round(2.0 / step)) * step
        told = record_rollout(device, 0.36 + 0.005 * np.sin(9 * time), np.full(len(time), 3e5), step)
        ends.append(told.pressure[time > 1.0])
    assert ends[0].mean() == pytest.approx(3e5, rel=0.02)
    assert ends[0].max() == pytest.approx(ends[1].max(), rel=5e-3)


@pytest.mark.parametrize("command", [7.05e5, -0.1e5])
def test_commands_beyond_the_supply_are_clipped_with_and_without_effects(command: float) -> None:
    neutral = edited(more=b"\n[effects.regulator_error]\ngain = 1.0\n").parameters
    commands = np.full(400, command)
    plain, same = (record_rollout(p, LENGTH[:400], commands, STEP) for p in (VALVE.parameters, neutral))
    assert np.array_equal(plain.pressure, same.pressure)
    assert np.array_equal(plain.tension, same.tension)


def test_rigs_that_command_pressures_refuse_openings() -> None:
    opens = edited(*OPENS)
    with pytest.raises(InputError, match=r"the controller commands pressures, and .* takes openings of its valve"):
        simulate_gait(opens, control.load_default_profile(), GaitOptions(strides=1))
    from klute_sim.bench.protocols import library as protocols_library
    from klute_sim.bench.run import run_protocol

    with pytest.raises(InputError, match="the protocol commands pressures"):
        run_protocol(opens, protocols_library.load_protocol("isometric"))
    from klute_sim.diagnosis.planning import identifiability

    with pytest.raises(InputError, match="a protocol commands pressures"):
        identifiability.prepare_experiments(opens)
    with pytest.raises(InputError, match=r"\[effects.regulator_error\] needs commands that are pressures"):
        edited(*OPENS, more=b"\n[effects.regulator_error]\ngain = 0.9\n")


def test_what_a_section_says_is_no_effect_to_look_for() -> None:
    from klute_sim.diagnosis.planning import identifiability
    from klute_sim.effects import catalogue

    known = catalogue.get_effects()
    assert not VALVE.spec.can_add_effect(known["choked_valve"])
    assert not VALVE.spec.can_add_effect(known["leak"])
    assert VALVE.spec.can_add_effect(known["regulator_error"])
    assert load_device("klute-1-1-4-pair").spec.can_add_effect(known["choked_valve"])
    with pytest.raises(InputError, match=r"\[effects.leak\] and \[leak\] say the same twice"):
        identifiability.remove_base_effect(VALVE, known["leak"])


def test_the_whole_file_reaches_the_law() -> None:
    supply = VALVE.parameters.supply
    assert 0 < supply.fill_conductance < 2e-8  # less than the valve's own: the line is in series
    assert supply.dead_volume == pytest.approx(5e-6 + np.pi / 4 * 36e-6 * 0.5)
    assert (supply.valve_gain, supply.tank_volume, supply.tank_pressure) == pytest.approx((5 / BAR, 1.5e-3, 200e5))
    assert supply.leak_conductance == pytest.approx(0.001e-8)
    throttled = ("exhaust_dm3_per_s_bar = 2.0", "exhaust_dm3_per_s_bar = 0.5")
    other = edited(throttled, ("exhaust_critical_ratio = 0.3", "exhaust_critical_ratio = 0.1"))
    assert other.parameters.supply.fill_conductance == supply.fill_conductance
    assert 0.49e-8 < other.parameters.supply.exhaust_conductance < 0.5e-8
    assert other.parameters.supply.exhaust_critical_ratio == pytest.approx(0.1, abs=0.02)
    assert not pneumatic_step.is_ideal(supply)
    assert VALVE.spec.collect_assumptions().keys() >= {"valve.fill_dm3_per_s_bar", "tank.volume_l", "chamber.exponent"}
    assert not VALVE.spec.list_unsourced_keys()
