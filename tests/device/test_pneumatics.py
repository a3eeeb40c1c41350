"""A device behind a valve: the gas law, closed air, both installations, MuJoCo, the gait, and what a file may say."""

from functools import cache

import numpy as np
import pytest

from klute_sim.control import pressure as control
from klute_sim.device import step as unit
from klute_sim.device.account import Account, account
from klute_sim.device.files import Device, load, read
from klute_sim.device.ledger import LINES, SOLVER
from klute_sim.device.rollout import rollout
from klute_sim.device.step import Parameters, State
from klute_sim.errors import InputError
from klute_sim.laws import charging, mckibben
from klute_sim.laws.pneumatics import AIR_CONSTANT, ATMOSPHERE
from klute_sim.recording.recording import Recording
from klute_sim.report.outcomes import outcomes
from klute_sim.rigs import bench
from klute_sim.rigs.gait.assembly import GaitOptions
from klute_sim.rigs.gait.rig import walk
from klute_sim.units import BAR

VALVE = load("klute-1-1-4-pair-valve")
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
    return read(text.encode() + more, "test")


ISOTHERMAL = ("exponent = 1.2", "exponent = 1.0")
OPENS = ('takes = "pressure"\ngain_per_bar = 5.0\n', 'takes = "opening"\n'), ('"valve.gain_per_bar" =', "#")
PULSES = ('drive = "proportional"\n', 'drive = "on-off"\nperiod_s = 0.02\nshortest_pulse_s = 0.002\n')
TIGHT = ("conductance_dm3_per_s_bar = 0.001", "conductance_dm3_per_s_bar = 0.0")


def whole(parameters: Parameters, length: np.ndarray) -> np.ndarray:
    """Volume of muscle and dead volume [m3]."""
    return np.array([mckibben.volume(parameters.muscle, x) for x in length.tolist()]) + parameters.supply.dead_volume


def gas_law(parameters: Parameters, pressure: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Air [kg] that the gas law finds in there at the supply's temperature."""
    return (pressure + ATMOSPHERE) * whole(parameters, length) / (AIR_CONSTANT * parameters.supply.temperature)


@pytest.mark.parametrize("changes", [(), (PULSES,)], ids=["proportional", "pulses"])
def test_at_constant_temperature_pressure_length_and_counted_air_obey_the_gas_law(changes: tuple) -> None:
    p = edited(ISOTHERMAL, *changes, more=HYSTERESIS).parameters
    told: Account = account(p, LENGTH, COMMAND, STEP)
    assert told.ledger.air_mass == pytest.approx(gas_law(p, told.pressure, told.length), rel=1e-9)
    assert told.ledger.air_drawn[-1] > 1e-3
    let_out = told.ledger.air_drawn - told.ledger.air_leaked - (told.ledger.air_mass - told.ledger.air_mass[0])
    assert np.diff(let_out).min() > -1e-15
    assert let_out[-1] > 1e-3
    assert told.ledger.air_leaked[-1] > 0.0


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
def test_closed_air_follows_its_polytrope_while_the_muscle_moves(exponent: float) -> None:
    changes = ("exponent = 1.2", f"exponent = {exponent}"), ("warming_s = 0.3", "warming_s = 0.0"), TIGHT
    p = edited(*OPENS, *changes).parameters
    start = unit.taut(p, LENGTH[0], 0.0)
    start = State(3e5, start.length, start.memory)
    told = account(p, LENGTH, np.zeros(len(TIME)), STEP, start=start)
    constant = (told.pressure + ATMOSPHERE) * whole(p, told.length) ** exponent
    assert constant == pytest.approx((3e5 + ATMOSPHERE) * whole(p, np.array([start.length]))[0] ** exponent, rel=1e-9)
    assert np.ptp(told.pressure) > 1e4
    assert told.ledger.air_drawn[-1] == told.ledger.air_leaked[-1] == 0.0


def test_closed_air_is_a_spring_and_a_valve_that_is_wide_open_is_a_regulator() -> None:
    wide = (
        ("fill_dm3_per_s_bar = 2.0", "fill_dm3_per_s_bar = 900.0"),
        ("exhaust_dm3_per_s_bar = 2.0", "exhaust_dm3_per_s_bar = 900.0"),
    )
    line = ("length_m = 0.5", "length_m = 0.001"), ("inner_diameter_mm = 6.0", "inner_diameter_mm = 40.0")
    p = edited(*wide, *line, ("gain_per_bar = 5.0", "gain_per_bar = 500.0"), TIGHT).parameters
    ideal = load("klute-1-1-4-pair").parameters
    ideal = ideal._replace(supply=ideal.supply._replace(rate=1e9, pressure=p.supply.pressure))
    fast, slow = (account(each, LENGTH, COMMAND, STEP) for each in (p, ideal))
    late = TIME % 0.25 > 0.02
    assert fast.pressure[late] == pytest.approx(slow.pressure[late], abs=5e3)
    assert fast.tension[late] == pytest.approx(slow.tension[late], abs=30.0)
    shut = account(edited(*OPENS, TIGHT).parameters, LENGTH, np.zeros(len(TIME)), STEP, start=unit.taut(p, 0.36, 3e5))
    held = account(ideal, LENGTH, np.full(len(TIME), 3e5), STEP, start=unit.taut(ideal, 0.36, 3e5))
    assert np.ptp(shut.tension[500:]) > 1.02 * np.ptp(held.tension[500:])


@pytest.mark.parametrize("changes", [(), (PULSES,), OPENS, (*OPENS, PULSES)], ids=["", "pulses", "openings", "both"])
def test_compiled_and_python_agree_to_the_bit_alone_and_in_mujoco(changes: tuple) -> None:
    device = edited(*changes, more=HYSTERESIS)
    command = np.where(TIME % 0.5 < 0.25, 0.7, -0.4) if device.parameters.supply.opens else COMMAND
    p = device.parameters
    fast, slow = (account(p, LENGTH[:1000], command[:1000], STEP, law=law) for law in ("compiled", "python"))
    for a, b in zip([*fast[:4], *fast.ledger[:-1]], [*slow[:4], *slow.ledger[:-1]], strict=True):
        assert np.array_equal(a, b)
    assert np.array_equal(rollout(device.parameters, LENGTH, command, STEP).tension[:1000], fast.tension)
    one, two = (bench.pull(device, LENGTH[:400], command[:400], STEP, law=x) for x in ("compiled", "python"))
    for name in one.channels:
        assert np.array_equal(one[name], two[name], equal_nan=True), name
    start = unit.taut(device.parameters, LENGTH[0], command[0])
    alone = account(device.parameters, 1e-3 * one["length"], command[:400], STEP, start=start)
    # MuJoCo adds up rates, so the last bits differ, and pulses make more of them: they begin and end at an instant.
    near = 1e-4 if PULSES in changes else 1e-8
    assert one["force"] == pytest.approx(alone.tension, rel=near, abs=1e3 * near)
    assert one["pressure"] * BAR == pytest.approx(alone.pressure, rel=near)
    assert one["air_drawn"] == pytest.approx(alone.ledger.air_drawn, rel=near, abs=1e-11)
    assert ("valve_command" in one) == bool(device.parameters.supply.opens)
    assert ("pressure_command" in one) != bool(device.parameters.supply.opens)


def test_a_step_response_converges_with_the_step() -> None:
    p = VALVE.parameters
    fine = account(p, np.full(16_000, 0.36), np.full(16_000, 4e5), 1.25e-5, start=unit.taut(p, 0.36, 0.0)).pressure
    errors = []
    for step in (4e-4, 2e-4, 1e-4):
        n, k = round(0.2 / step), round(step / 1.25e-5)
        found = account(p, np.full(n, 0.36), np.full(n, 4e5), step, start=unit.taut(p, 0.36, 0.0)).pressure
        errors.append(np.abs(found - fine[k - 1 :: k]).max())
    assert errors[2] < 5e3
    assert errors[0] > 1.6 * errors[1] > 2.6 * errors[2]


@cache
def walked() -> tuple[Recording, Parameters]:
    device = edited(ISOTHERMAL, more=HYSTERESIS)
    return walk(device, control.tuned(), GaitOptions(strides=3)), device.parameters


def test_energy_and_air_of_a_stride_close_with_everything_on() -> None:
    recording, p = walked()
    step = recording["time"][1]
    for number, stride in enumerate(outcomes(recording).strides, start=1):
        assert abs(stride.ledger_residual_pct) < 0.1
        last = recording.select(recording["stride"] == number)
        given = np.sum([last[line] for line in LINES], axis=0)
        assert given == pytest.approx(last["delivered_power"], abs=1e-6)
        assert np.abs(last[SOLVER]).sum() < 2e-3 * np.abs(last["delivered_power"]).sum()
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
        lost = [charging.leakage(p.supply, x * BAR, p.supply.temperature) for x in last["pressure"].tolist()]
        leaked = last["air_leaked"][-1] - last["air_leaked"][0]
        assert leaked == pytest.approx(step * np.sum(lost[1:]), rel=1e-2)
        assert 1e3 * leaked == pytest.approx(stride.air_leaked_g, rel=1e-9)
    assert 1.0 < stride.air_g < 2.5
    assert not outcomes(recording).trips


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
    plain = load("klute-1-1-4-pair").content.decode()
    line = "[line]\nlength_m = 1.0\ninner_diameter_mm = 4.0\n"
    with pytest.raises(InputError, match=r"\[line\] needs a \[valve\]"):
        read(plain.replace("[sources]", line + "\n[sources]").encode(), "x")
    with pytest.raises(InputError, match=r"\[effects.pressure_lag\] and \[valve\] say the same twice"):
        edited(more=b"\n[effects.pressure_lag]\ntime_constant_s = 0.05\n")


def test_pumping_is_no_part_of_what_a_regulator_is_late_with() -> None:
    more = b"\n[effects.pressure_lag]\ntime_constant_s = 0.05\n"
    more += b"[effects.volume_coupling]\nrecovery_s = 0.05\nexponent = 1.2\n"
    device = read(load("klute-1-1-4-pair").content + more, "both").parameters
    ends = []
    for step in (1e-3, 2.5e-4):
        time = np.arange(round(2.0 / step)) * step
        told = account(device, 0.36 + 0.005 * np.sin(9 * time), np.full(len(time), 3e5), step)
        ends.append(told.pressure[time > 1.0])
    assert ends[0].mean() == pytest.approx(3e5, rel=0.02)
    assert ends[0].max() == pytest.approx(ends[1].max(), rel=5e-3)


@pytest.mark.parametrize("command", [7.05e5, -0.1e5])
def test_commands_beyond_the_supply_are_clipped_with_and_without_effects(command: float) -> None:
    neutral = edited(more=b"\n[effects.regulator_error]\ngain = 1.0\n").parameters
    commands = np.full(400, command)
    plain, same = (account(p, LENGTH[:400], commands, STEP) for p in (VALVE.parameters, neutral))
    assert np.array_equal(plain.pressure, same.pressure)
    assert np.array_equal(plain.tension, same.tension)


def test_rigs_that_command_pressures_refuse_openings() -> None:
    opens = edited(*OPENS)
    with pytest.raises(InputError, match=r"the controller commands pressures, and .* takes openings of its valve"):
        walk(opens, control.tuned(), GaitOptions(strides=1))
    from klute_sim.rigs.bench import protocols
    from klute_sim.rigs.bench.run import run

    with pytest.raises(InputError, match="the protocol commands pressures"):
        run(opens, protocols.load("isometric"))
    from klute_sim.diagnose import confusable

    with pytest.raises(InputError, match="a protocol commands pressures"):
        confusable.experiments(opens)
    with pytest.raises(InputError, match=r"\[effects.regulator_error\] needs commands that are pressures"):
        edited(*OPENS, more=b"\n[effects.regulator_error]\ngain = 0.9\n")


def test_what_a_section_says_is_no_effect_to_look_for() -> None:
    from klute_sim.diagnose import confusable
    from klute_sim.effects import catalogue

    known = catalogue.effects()
    assert not VALVE.spec.may_lack(known["choked_valve"])
    assert not VALVE.spec.may_lack(known["leak"])
    assert VALVE.spec.may_lack(known["regulator_error"])
    assert load("klute-1-1-4-pair").spec.may_lack(known["choked_valve"])
    with pytest.raises(InputError, match=r"\[effects.leak\] and \[leak\] say the same twice"):
        confusable.bare(VALVE, known["leak"])


def test_the_whole_file_reaches_the_law() -> None:
    supply = VALVE.parameters.supply
    assert 0 < supply.fill < 2e-8  # less than the valve's own: the line is in series
    assert supply.dead_volume == pytest.approx(5e-6 + np.pi / 4 * 36e-6 * 0.5)
    assert (supply.gain, supply.tank, supply.tank_pressure) == pytest.approx((5 / BAR, 1.5e-3, 200e5))
    assert supply.leak == pytest.approx(0.001e-8)
    throttled = ("exhaust_dm3_per_s_bar = 2.0", "exhaust_dm3_per_s_bar = 0.5")
    other = edited(throttled, ("exhaust_critical_ratio = 0.3", "exhaust_critical_ratio = 0.1"))
    assert other.parameters.supply.fill == supply.fill
    assert 0.49e-8 < other.parameters.supply.exhaust < 0.5e-8
    assert other.parameters.supply.exhaust_ratio == pytest.approx(0.1, abs=0.02)
    assert not charging.plain(supply)
    assert VALVE.spec.assumed().keys() >= {"valve.fill_dm3_per_s_bar", "tank.volume_l", "chamber.exponent"}
    assert not VALVE.spec.without_source()
