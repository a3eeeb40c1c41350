"""A device behind a valve: gas law, enclosed air, both backends, MuJoCo, gait, and the sections of a file."""

from functools import cache

import numpy as np
import pytest

from klute_sim import bench
from klute_sim.controllers import pressure as control
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.device.dynamics import DeviceParameters, DeviceState
from klute_sim.device.energy.ledger import POWER_TERMS
from klute_sim.device.equilibrium import compute_equilibrium_state, compute_taut_state
from klute_sim.device.recorded_rollout import RolloutRecord, record_rollout
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.errors import InputError
from klute_sim.gait.metrics import compute_gait_metrics
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.laws import mckibben, pneumatic_step, supply_valve
from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT, ATMOSPHERIC_PRESSURE
from klute_sim.recording.recording import Recording
from klute_sim.units import BAR

VALVE = load_device("klute-1-1-4-pair-valve")
STEP = 5e-4
TIME = np.arange(3000) * STEP
LENGTH = 0.36 + 0.006 * np.sin(9 * TIME) + 0.001 * np.sin(31 * TIME)
COMMAND = np.where(TIME % 0.5 < 0.25, 4e5, 0.5e5)
HYSTERESIS = b'\n[effects.braid_hysteresis]\nform = "maxwell_slip"\nslope_n_per_bar = 10.0\nstiffness_n_per_mm = 60.0\n'


def edit_preset(*changes: tuple[str, str], suffix: bytes = b"") -> Device:
    text = VALVE.content.decode()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    return parse_device(text.encode() + suffix, "test")


ISOTHERMAL = ("exponent = 1.2", "exponent = 1.0")
OPENS = ('command = "pressure"\ngain_per_bar = 5.0\n', 'command = "opening"\n'), ('"valve.gain_per_bar" =', "#")
PULSES = ('drive = "proportional"\n', 'drive = "on-off"\npwm_period_s = 0.02\nmin_pulse_s = 0.002\n')
TIGHT = ("conductance_dm3_per_s_bar = 0.001", "conductance_dm3_per_s_bar = 0.0")


def total_volume(parameters: DeviceParameters, length: np.ndarray) -> np.ndarray:
    """Return the volume of muscle and dead volume [m3]."""
    return (
        np.array([mckibben.gas_volume(parameters.muscle, x) for x in length.tolist()]) + parameters.supply.dead_volume
    )


def gas_law(parameters: DeviceParameters, pressure: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Return the mass of the enclosed air [kg] by the gas law, at the temperature of the supply."""
    return (
        (pressure + ATMOSPHERIC_PRESSURE)
        * total_volume(parameters, length)
        / (AIR_GAS_CONSTANT * parameters.supply.temperature)
    )


@pytest.mark.parametrize("changes", [(), (PULSES,)], ids=["proportional", "pulses"])
def test_isothermal_air_obeys_the_gas_law(changes: tuple) -> None:
    p = edit_preset(ISOTHERMAL, *changes, suffix=HYSTERESIS).parameters
    record: RolloutRecord = record_rollout(p, LENGTH, COMMAND, STEP)
    assert record.energy_balance.air_mass == pytest.approx(gas_law(p, record.pressure, record.length), rel=1e-9)
    assert record.energy_balance.air_drawn[-1] > 1e-3
    let_out = (
        record.energy_balance.air_drawn
        - record.energy_balance.air_leaked
        - (record.energy_balance.air_mass - record.energy_balance.air_mass[0])
    )
    assert np.diff(let_out).min() > -1e-15
    assert let_out[-1] > 1e-3
    assert record.energy_balance.air_leaked[-1] > 0.0


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
def test_enclosed_air_is_polytropic(exponent: float) -> None:
    changes = (
        ("exponent = 1.2", f"exponent = {exponent}"),
        ("thermal_time_constant_s = 0.3", "thermal_time_constant_s = 0.0"),
        TIGHT,
    )
    p = edit_preset(*OPENS, *changes).parameters
    start = compute_taut_state(p, LENGTH[0], 0.0)
    start = DeviceState(3e5, start.length, start.internal_state)
    record = record_rollout(p, LENGTH, np.zeros(len(TIME)), STEP, initial_state=start)
    constant = (record.pressure + ATMOSPHERIC_PRESSURE) * total_volume(p, record.length) ** exponent
    assert constant == pytest.approx(
        (3e5 + ATMOSPHERIC_PRESSURE) * total_volume(p, np.array([start.length]))[0] ** exponent, rel=1e-9
    )
    assert np.ptp(record.pressure) > 1e4
    assert record.energy_balance.air_drawn[-1] == record.energy_balance.air_leaked[-1] == 0.0


def test_enclosed_air_is_a_spring_and_a_large_valve_is_a_regulator() -> None:
    wide = (
        ("fill_dm3_per_s_bar = 2.0", "fill_dm3_per_s_bar = 900.0"),
        ("exhaust_dm3_per_s_bar = 2.0", "exhaust_dm3_per_s_bar = 900.0"),
    )
    line = ("length_m = 0.5", "length_m = 0.001"), ("inner_diameter_mm = 6.0", "inner_diameter_mm = 40.0")
    p = edit_preset(*wide, *line, ("gain_per_bar = 5.0", "gain_per_bar = 500.0"), TIGHT).parameters
    ideal = load_device("klute-1-1-4-pair").parameters
    ideal = ideal._replace(supply=ideal.supply._replace(max_pressure_rate=1e9, max_pressure=p.supply.max_pressure))
    open_valve, regulator = (record_rollout(parameters, LENGTH, COMMAND, STEP) for parameters in (p, ideal))
    late = TIME % 0.25 > 0.02
    assert open_valve.pressure[late] == pytest.approx(regulator.pressure[late], abs=5e3)
    assert open_valve.tension[late] == pytest.approx(regulator.tension[late], abs=30.0)
    shut = record_rollout(
        edit_preset(*OPENS, TIGHT).parameters,
        LENGTH,
        np.zeros(len(TIME)),
        STEP,
        initial_state=compute_taut_state(p, 0.36, 3e5),
    )
    held = record_rollout(
        ideal, LENGTH, np.full(len(TIME), 3e5), STEP, initial_state=compute_taut_state(ideal, 0.36, 3e5)
    )
    assert np.ptp(shut.tension[500:]) > 1.02 * np.ptp(held.tension[500:])


@pytest.mark.parametrize("changes", [(), (PULSES,), OPENS, (*OPENS, PULSES)], ids=["", "pulses", "openings", "both"])
def test_backends_are_bit_identical_without_and_with_mujoco(changes: tuple) -> None:
    device = edit_preset(*changes, suffix=HYSTERESIS)
    command = np.where(TIME % 0.5 < 0.25, 0.7, -0.4) if device.parameters.supply.command_is_opening else COMMAND
    p = device.parameters
    compiled, python = (
        record_rollout(p, LENGTH[:1000], command[:1000], STEP, backend=backend) for backend in ("compiled", "python")
    )
    for a, b in zip(
        [*compiled[:4], *compiled.energy_balance[:-1]],
        [*python[:4], *python.energy_balance[:-1]],
        strict=True,
    ):
        assert np.array_equal(a, b)
    assert np.array_equal(simulate_rollouts(device.parameters, LENGTH, command, STEP).tension[:1000], compiled.tension)
    compiled_recording, python_recording = (
        bench.simulate_tester(device, LENGTH[:400], command[:400], STEP, backend=backend)
        for backend in ("compiled", "python")
    )
    for name in compiled_recording.channels:
        assert np.array_equal(compiled_recording[name], python_recording[name], equal_nan=True), name
    start = compute_taut_state(device.parameters, LENGTH[0], command[0])
    alone = record_rollout(
        device.parameters, 1e-3 * compiled_recording["length"], command[:400], STEP, initial_state=start
    )
    # MuJoCo integrates rates, so the last bits differ. Pulses amplify this, because they switch at an instant.
    tolerance = 1e-4 if PULSES in changes else 1e-8
    assert compiled_recording["force"] == pytest.approx(alone.tension, rel=tolerance, abs=1e3 * tolerance)
    assert compiled_recording["pressure"] * BAR == pytest.approx(alone.pressure, rel=tolerance)
    assert compiled_recording["air_drawn"] == pytest.approx(alone.energy_balance.air_drawn, rel=tolerance, abs=1e-11)
    assert ("valve_command" in compiled_recording) == bool(device.parameters.supply.command_is_opening)
    assert ("pressure_command" in compiled_recording) != bool(device.parameters.supply.command_is_opening)


def test_step_response_converges_with_the_time_step() -> None:
    p = VALVE.parameters
    fine = record_rollout(
        p, np.full(16_000, 0.36), np.full(16_000, 4e5), 1.25e-5, initial_state=compute_taut_state(p, 0.36, 0.0)
    ).pressure
    errors = []
    for step in (4e-4, 2e-4, 1e-4):
        n, k = round(0.2 / step), round(step / 1.25e-5)
        record = record_rollout(
            p, np.full(n, 0.36), np.full(n, 4e5), step, initial_state=compute_taut_state(p, 0.36, 0.0)
        ).pressure
        errors.append(np.abs(record - fine[k - 1 :: k]).max())
    assert errors[2] < 5e3
    assert errors[0] > 1.6 * errors[1] > 2.6 * errors[2]


@pytest.mark.parametrize("preset", ["klute-1-1-4-pair", "klute-1-1-4-pair-valve"])
def test_work_at_the_default_step_is_right_within_three_per_mille(preset: str) -> None:
    """A flow that met the air of the start of a step would be off by 6 per mille."""
    p = load_device(preset).parameters

    def work_of_a_cycle(step: float) -> np.ndarray:
        time = np.arange(round(2.0 / step) + 1) * step
        length = p.tendon.slack_length + p.muscle.resting_length * (0.92 + 0.05 * np.sin(2 * np.pi * time))
        balance = record_rollout(p, length, 2.5e5 + 1.5e5 * np.sin(2 * np.pi * time + 0.7), step).energy_balance
        return step * np.array([x[time > 1.0].sum() for x in (balance.gas_power, balance.delivered_power)])

    assert work_of_a_cycle(5e-4) == pytest.approx(work_of_a_cycle(2e-5), rel=3e-3)


@cache
def simulate_reference_run(step: float = STEP) -> tuple[Recording, DeviceParameters]:
    device = edit_preset(ISOTHERMAL, suffix=HYSTERESIS)
    return simulate_gait(device, control.load_default_profile(), GaitOptions(strides=3, dt=step)), device.parameters


@pytest.mark.slow
def test_energy_residual_of_a_stride_is_of_first_order_in_the_step() -> None:
    """Measured in the first and in a steady stride: 0.23 and 0.21 % at 1 ms, 0.12 and 0.10 % at 0.5 ms."""
    coarse, fine = (
        np.array([s.ledger_residual_pct for s in compute_gait_metrics(simulate_reference_run(step)[0]).strides])
        for step in (2.0 * STEP, STEP)
    )
    assert coarse == pytest.approx(2.0 * fine, rel=0.05)
    assert np.abs(fine).max() < 0.13


@pytest.mark.slow
def test_energy_and_air_balances_of_a_stride_close() -> None:
    recording, p = simulate_reference_run()
    step = recording["time"][1]
    for number, stride in enumerate(compute_gait_metrics(recording).strides, start=1):
        last = recording.select(recording["stride"] == number)
        power_sum = np.sum([last[line] for line in POWER_TERMS], axis=0)
        assert power_sum + last["residual_power"] == pytest.approx(last["delivered_power"], abs=1e-6)
        assert np.abs(last["force_residual"]).max() < 1e-6
        mass = gas_law(p, last["pressure"] * BAR, last["muscle_length"])
        gained = float(mass[-1] - mass[0])
        counted = float(last["air_mass"][-1] - last["air_mass"][0])
        drawn = float(last["air_drawn"][-1] - last["air_drawn"][0])
        assert counted == pytest.approx(gained, abs=1e-9 * drawn)
        assert 1e3 * drawn == pytest.approx(stride.air_g, rel=1e-12)
        assert last["effect_braid_hysteresis_power"].sum() < -1.0
        assert not last["stop_power"].any()
        volume = np.array([mckibben.gas_volume(p.muscle, x) for x in last["muscle_length"].tolist()])
        work = float(np.trapezoid(last["pressure"] * BAR, volume))
        assert step * last["gas_power"][1:].sum() == pytest.approx(work, rel=1e-4)
        lost = [supply_valve.leak_flow(p.supply, x * BAR, p.supply.temperature) for x in last["pressure"].tolist()]
        leaked = last["air_leaked"][-1] - last["air_leaked"][0]
        assert leaked == pytest.approx(step * np.sum(lost[1:]), rel=1e-2)
        assert 1e3 * leaked == pytest.approx(stride.air_leaked_g, rel=1e-9)
    assert 1.0 < stride.air_g < 2.5
    assert not compute_gait_metrics(recording).has_swing_contact


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            [("gain_per_bar = 5.0\n", ""), ('"valve.gain_per_bar" =', "#")],
            "command = 'pressure' .the default. needs gain_per_bar",
        ),
        ([('drive = "proportional"', 'drive = "on-off"')], "drive = 'on-off' needs pwm_period_s and min_pulse_s"),
        ([("[leak]", "[effects.leak]")], "leak.conductance_dm3_per_s_bar', which is not a numeric key"),
        (
            [('drive = "proportional"', 'drive = "on-off"\npwm_period_s = 0.02\nmin_pulse_s = 0.03')],
            "min_pulse_s must be at most half of pwm_period_s",
        ),
        ([("dead_volume_cm3 = 5.0", "dead_volume_cm3 = 1e300")], "supply.dead_volume_cm3 = 1e[+]300 is refused"),
        ([('command = "pressure"', 'command = "opening"')], "gain_per_bar is not allowed with command = 'opening'"),
        ([('drive = "proportional"', "pwm_period_s = 0.02")], "pwm_period_s and min_pulse_s need drive = 'on-off'"),
        ([("exponent = 1.2", "exponent = 2.0")], "chamber.exponent = 2.0 is refused"),
        (
            [("volume_l = 1.5", "volume = 1.5")],
            r"unknown key 'tank.volume'; did you mean 'volume_l'\? Allowed here: volume_l, pressure_bar",
        ),
    ],
)
def test_invalid_supply_sections_are_refused(changes: list, message: str) -> None:
    with pytest.raises(InputError, match=message):
        edit_preset(*changes)


def test_line_needs_a_valve_and_duplicate_causes_are_refused() -> None:
    plain = load_device("klute-1-1-4-pair").content.decode()
    line = "[line]\nlength_m = 1.0\ninner_diameter_mm = 4.0\n"
    with pytest.raises(InputError, match=r"\[line\] needs a \[valve\]"):
        parse_device(plain.replace("[sources]", line + "\n[sources]").encode(), "x")
    with pytest.raises(InputError, match=r"\[effects.pressure_lag\] and \[valve\] describe the same cause"):
        edit_preset(suffix=b"\n[effects.pressure_lag]\ntime_constant_s = 0.05\n")


def test_regulator_lag_does_not_act_on_pumping() -> None:
    suffix = b"\n[effects.pressure_lag]\ntime_constant_s = 0.05\n"
    suffix += b"[effects.volume_coupling]\nrecovery_s = 0.05\nexponent = 1.2\n"
    device = parse_device(load_device("klute-1-1-4-pair").content + suffix, "both").parameters
    final_pressures = []
    for step in (1e-3, 2.5e-4):
        time = np.arange(round(2.0 / step)) * step
        record = record_rollout(device, 0.36 + 0.005 * np.sin(9 * time), np.full(len(time), 3e5), step)
        final_pressures.append(record.pressure[time > 1.0])
    assert final_pressures[0].mean() == pytest.approx(3e5, rel=0.02)
    assert final_pressures[0].max() == pytest.approx(final_pressures[1].max(), rel=5e-3)


@pytest.mark.parametrize("command", [7.05e5, -0.1e5])
def test_commands_are_clipped_to_the_supply(command: float) -> None:
    neutral = edit_preset(suffix=b"\n[effects.regulator_error]\ngain = 1.0\n").parameters
    commands = np.full(400, command)
    plain, same = (record_rollout(p, LENGTH[:400], commands, STEP) for p in (VALVE.parameters, neutral))
    assert np.array_equal(plain.pressure, same.pressure)
    assert np.array_equal(plain.tension, same.tension)


def test_pressure_rigs_refuse_valve_openings() -> None:
    opens = edit_preset(*OPENS)
    with pytest.raises(
        InputError, match=r"the controller commands pressures, but the commands of .* are openings of its valve"
    ):
        simulate_gait(opens, control.load_default_profile(), GaitOptions(strides=1))
    from klute_sim.bench.protocols import library as protocols_library
    from klute_sim.bench.run import run_protocol

    with pytest.raises(InputError, match="the protocol commands pressures"):
        run_protocol(opens, protocols_library.load_protocol("isometric"))
    from klute_sim.diagnosis.planning import identifiability

    with pytest.raises(InputError, match="a protocol commands pressures"):
        identifiability.prepare_experiments(opens)
    with pytest.raises(InputError, match=r"\[effects.regulator_error\] needs pressure commands"):
        edit_preset(*OPENS, suffix=b"\n[effects.regulator_error]\ngain = 0.9\n")


def test_effect_described_by_a_section_cannot_be_added() -> None:
    from klute_sim.diagnosis.planning import identifiability
    from klute_sim.effects import catalogue

    known = catalogue.get_effects()
    assert not VALVE.spec.can_add_effect(known["choked_valve"])
    assert not VALVE.spec.can_add_effect(known["leak"])
    assert VALVE.spec.can_add_effect(known["regulator_error"])
    assert load_device("klute-1-1-4-pair").spec.can_add_effect(known["choked_valve"])
    with pytest.raises(InputError, match=r"\[effects.leak\] and \[leak\] describe the same cause"):
        identifiability.remove_base_effect(VALVE, known["leak"])


def test_every_key_reaches_the_parameters() -> None:
    supply = VALVE.parameters.supply
    assert 0 < supply.fill_conductance < 2e-8  # less than that of the valve, because the line is in series
    assert supply.dead_volume == pytest.approx(5e-6 + np.pi / 4 * 36e-6 * 0.5)
    assert (supply.valve_gain, supply.tank_volume, supply.tank_pressure) == pytest.approx((5 / BAR, 1.5e-3, 200e5))
    assert supply.leak_conductance == pytest.approx(0.001e-8)
    throttled = ("exhaust_dm3_per_s_bar = 2.0", "exhaust_dm3_per_s_bar = 0.5")
    other = edit_preset(throttled, ("exhaust_critical_ratio = 0.3", "exhaust_critical_ratio = 0.1"))
    assert other.parameters.supply.fill_conductance == supply.fill_conductance
    assert 0.49e-8 < other.parameters.supply.exhaust_conductance < 0.5e-8
    assert other.parameters.supply.exhaust_critical_ratio == pytest.approx(0.1, abs=0.02)
    assert not pneumatic_step.is_ideal(supply)
    assert VALVE.spec.collect_assumptions().keys() >= {"valve.fill_dm3_per_s_bar", "tank.volume_l", "chamber.exponent"}
    assert not VALVE.spec.list_unsourced_keys()


@pytest.mark.parametrize("leak", [1e-3, 0.1])
def test_equilibrium_of_a_pulsed_valve_is_the_mean_of_its_rollout(leak: float) -> None:
    """Pulses follow the error of the pressure, so a leak empties no muscle; the ripple shifts the mean a little."""
    leaky = ("conductance_dm3_per_s_bar = 0.001", f"conductance_dm3_per_s_bar = {leak}")
    p = edit_preset(PULSES, leaky).parameters
    unit_length = 0.9 * p.muscle.resting_length + p.tendon.slack_length
    equilibrium = compute_equilibrium_state(p, unit_length, 3e5)
    count = 4000
    record = record_rollout(p, np.full(count, unit_length), np.full(count, 3e5), STEP, initial_state=equilibrium)
    held = record.pressure[count // 2 :]
    assert equilibrium.pressure == pytest.approx(held.mean(), abs=0.02 * BAR + 0.5 * np.ptp(held))
    assert equilibrium.length == pytest.approx(record.length[count // 2 :].mean(), abs=1e-3)
    assert np.ptp(held) < 1.0 * BAR
