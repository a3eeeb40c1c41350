"""Tests of the rig with another physics: its independence, its laws, its sensors and its datasets."""

import ast
import itertools
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from benchmarks.hidden_effects import metrics, plan, run
from benchmarks.hidden_effects.adversary import cases, dataset, muscle, protocol, sensors, series, setup, supply
from benchmarks.hidden_effects.adversary.friction import deflect
from benchmarks.hidden_effects.adversary.rig import ATMOSPHERE, Rig, build_rig, read_device_numbers
from benchmarks.hidden_effects.adversary.simulate import CREEP_TIMES, STEP, simulate
from benchmarks.hidden_effects.metrics import DatasetResult
from benchmarks.hidden_effects.score import score_verdict
from hypothesis import given, settings
from hypothesis import strategies as st

import klute_sim as ks
from klute_sim.effects import catalogue

FOLDER = Path(dataset.__file__).parent
NUMBERS = read_device_numbers(dataset.build_device_text(valve=False))
RIG = build_rig(NUMBERS)
SINGLE = RIG._replace(count=1.0)
HARD = SINGLE._replace(friction_slope=0.0, friction_offset=0.0)
PROGRAMS = protocol.draw_programs(np.random.default_rng(3))
SPECS = plan.plan_datasets("adversary", plan.BLOCK_SIZES["adversary"], 7)
DAMPING = {"name": "muscle_damping", "channel": None}
GAIN = {"name": "sensor_gain", "channel": "force"}
slow = pytest.mark.slow


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def hold(values: list[float], duration: float = 2.0) -> np.ndarray:
    return np.repeat(values, round(duration / STEP))


def truth(present: tuple = (), effects: tuple = ()) -> dict:
    found = {"effects": list(effects), "instruments": [], "numbers": [], "strangers": [], "deleted": False}
    return {**found, "defect": None, "size": 3.0, "block": "adversary", "present": list(present)}


def verdict(kind: str, *effects: dict, alternatives: tuple = ()) -> dict:
    gap = {"force": {"refitted": 9.0, "with_effects": 1.0, "noise_floor": 1.0}}
    told = {"verdict": kind, "effects": list(effects), "alternatives": list(alternatives)}
    return {**told, "gap": gap, "indistinguishable": [], "cpu_s": 1.0}


def test_nothing_of_the_program_or_of_the_other_blocks_is_imported() -> None:
    for file in FOLDER.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                assert not name.startswith("klute_sim"), f"{file.name} imports {name}"
                is_own = name.startswith("benchmarks.hidden_effects.adversary")
                assert is_own or not name.startswith("benchmarks"), f"{file.name} imports {name}"


def test_names_are_those_of_the_catalogue() -> None:
    departures = [name for departure in cases.DEPARTURES.values() for name in departure.names]
    hidden = [case.name for case in cases.HIDDEN_CASES]
    keys = {
        name.partition("@")[2] for name in [*departures, *cases.VALVE_NAMES] if name.startswith("number_error@")
    } | set(cases.NUMBER_RANGES)
    names = {name for name in [*departures, *hidden, *cases.VALVE_NAMES] if not name.startswith("number_error")}
    assert names <= set(catalogue.get_named_effects())
    assert keys <= set(NUMBERS) | {"valve." + key for key in dataset.VALVE_SECTIONS.split() if "_" in key}
    assert not keys & set(setup.DECLARED)


def test_a_third_of_the_block_has_no_strong_effect_and_the_others_differ() -> None:
    hidden = [spec["hidden"]["entry"] for spec in SPECS if spec["hidden"]]
    assert len(hidden) == 16
    assert len(SPECS) == 24
    assert len({(entry["name"], entry.get("channel"), entry.get("number")) for entry in hidden}) == 16
    assert {spec["rig"] for spec in SPECS if not spec["hidden"]} == {name for name, _, _ in cases.RIGS}
    for spec in SPECS:
        assert all(
            abs(error) <= cases.NUMBER_RANGES[key] and error != 0.0 for key, error in spec["number_errors"].items()
        )
        if spec["valve"]:
            assert not {"regulator", "droop"} & set(spec["departures"])


def test_strong_effect_takes_the_place_of_its_mild_departure() -> None:
    for seed in range(8):
        for spec in plan.plan_datasets("adversary", 24, seed):
            if spec["hidden"] and spec["hidden"]["kind"] == "effects":
                fields = {field for values in spec["departures"].values() for field in values}
                assert not fields & set(spec["hidden"]["entry"]["parameters"])


@given(st.floats(-1.25, 1.25), st.lists(st.floats(-0.01, 0.01), min_size=1, max_size=20), st.floats(1e-5, 3e-3))
@settings(max_examples=60, deadline=None)
def test_bristles_stay_bounded_and_return_no_more_than_they_store(
    start: float, travels: list[float], reach: float
) -> None:
    """Work on bristles is at least the change of the energy reach u²/2 that they store: they are passive."""
    bristle, work, deflections = start, 0.0, [start]
    for travel in [*travels, -sum(travels)]:
        for part in np.full(20, travel / 20):
            bristle = deflect.py_func(bristle, part, 1e-3, reach, 0.25)
            work += bristle * part
            deflections.append(bristle)
    assert max(np.abs(deflections)) <= 1.25 + 1e-12
    assert work >= 0.5 * reach * (bristle**2 - start**2) - 1e-12


def test_bristles_follow_the_direction_and_keep_still_at_rest() -> None:
    assert deflect.py_func(0.3, 0.0, 1e-3, 1e-3, 0.25) == 0.3
    fast = deflect.py_func(-1.0, 0.5, 1e-3, 1e-3, 0.25)
    slow_end = deflect.py_func(-1.0, 0.05, 1e3, 1e-3, 0.25)
    assert fast == pytest.approx(1.0)  # Stribeck: no excess at speed
    assert slow_end == pytest.approx(1.25, rel=1e-4)
    assert deflect.py_func(0.0, 1e-6, 1.0, 1e-3, 0.0) == pytest.approx(1e-3, rel=1e-2)  # a spring before it slips


def test_flow_of_the_nozzle_is_sonic_below_the_critical_ratio_and_ends_at_equal_pressures() -> None:
    flow = supply.nozzle_flow.py_func
    sonic = flow(1e-8, 6e5, 1e5)
    assert sonic == pytest.approx(1e-8 * 1.185 * 6e5)
    assert flow(1e-8, 6e5, 0.5 * 6e5) == sonic
    ends = [flow(1e-8, 6e5, 6e5 * ratio) for ratio in (0.55, 0.7, 0.9, 0.99, 1.0)]
    assert all(a > b for a, b in itertools.pairwise([sonic, *ends]))
    assert ends[-1] == pytest.approx(0.0, abs=1e-12)


def test_programs_begin_at_rest_and_stay_within_the_rig() -> None:
    assert [p.use for p in PROGRAMS] == ["fit", "fit", "fit", "validation", "test"]
    skipped = round(protocol.PREPARATION_S / STEP)
    durations = [(len(p.length) - 1 - skipped) * STEP for p in PROGRAMS]
    assert sum(durations) == pytest.approx(25.2, abs=0.1)
    for program in PROGRAMS:
        rest = slice(skipped - round(1.0 / STEP), skipped + round(0.7 / STEP))
        assert np.ptp(program.length[rest]) < 1e-9
        assert np.ptp(program.command[rest]) < 1e-6
        assert len(program.length) == len(program.command)
        assert program.length.min() > 0.313
        assert program.length.max() < 0.346
        assert program.command.min() > 1.1e5
        assert program.command.max() < 4.8e5
        assert np.abs(np.diff(program.length)).max() / STEP < 0.25


def test_sensor_faults_show_as_what_they_are() -> None:
    n = round((protocol.PREPARATION_S + 3.0) / STEP)
    ramp = 500.0 + 100.0 * np.arange(n) * STEP
    plain = sensors.read_channel("force", ramp, sensors.SensorFault())
    true = ramp[round(protocol.PREPARATION_S / STEP) :]
    np.testing.assert_allclose(true - plain, 100.0 * 2 * sensors.SENSORS["force"].time_constant, rtol=0.4)
    late = sensors.read_channel("force", ramp, sensors.SensorFault(slow_time=10e-3))
    np.testing.assert_allclose(plain - late, 100.0 * 20e-3, rtol=0.02)
    np.testing.assert_allclose(sensors.read_channel("force", ramp, sensors.SensorFault(gain=0.9)), 0.9 * plain)
    drift = sensors.read_channel("force", ramp, sensors.SensorFault(warm_up=30.0)) - plain
    assert drift[0] == 0.0
    assert drift[-1] == pytest.approx(30.0)
    assert drift[len(drift) // 2] > 18.0  # it warms up fast and then slowly


def test_log_has_the_stated_noise_and_resolution() -> None:
    program = PROGRAMS[2]
    still = {"force": np.full(len(program.length), 600.0), "pressure": np.full(len(program.length), 3e5)}
    table = sensors.record_trial(np.random.default_rng(4), program, still, {}, 0.3e-3)
    assert np.diff(table["time"]) == pytest.approx(1.0 / sensors.SAMPLE_RATE)
    for channel, mean in (("force", 600.0), ("pressure", 3.0)):
        assert table[channel].std() == pytest.approx(sensors.noise_level(channel), rel=0.12)
        assert table[channel].mean() == pytest.approx(mean, abs=4.0 * sensors.SENSORS[channel].tare)
        steps = table[channel] / sensors.SENSORS[channel].resolution
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    expected = 1e3 * (program.length[round(protocol.PREPARATION_S / STEP)] - 0.3e-3)
    assert table["length"][0] == pytest.approx(expected, abs=0.06)


def test_pink_noise_has_more_power_at_low_frequencies() -> None:
    spectrum = np.abs(np.fft.rfft(sensors.draw_pink(np.random.default_rng(1), 8192))) ** 2
    ratio = spectrum[10:100].mean() / spectrum[100:1000].mean()
    assert 5.0 < ratio < 20.0


def test_names_of_departures_are_present_only_where_they_show() -> None:
    shown = setup.list_present({"cones": 2.0, "braid": 0.05, "number_error@muscle.c01_kpa": 0.7}, has_valve=False)
    assert shown == ["end_taper", "number_error@muscle.c01_kpa"]
    assert "choked_valve" in setup.list_present({}, has_valve=True)


@pytest.mark.parametrize(
    ("hidden", "found", "outcome"),
    [
        (truth(("end_taper",)), verdict("unexplained"), "right"),
        (truth(("end_taper",)), verdict("identified", {"name": "end_taper", "channel": None}), "right"),
        (truth(("end_taper",)), verdict("identified-in-part", GAIN), "false-alarm"),
        (truth(("end_taper",)), verdict("indistinguishable", GAIN, alternatives=(["end_taper"],)), "right"),
        (truth(()), verdict("indistinguishable", GAIN, alternatives=(["end_taper"],)), "false-alarm"),
        (
            truth(("end_taper",), (DAMPING,)),
            verdict("identified", {"name": "end_taper", "channel": None}, DAMPING),
            "right",
        ),
        (truth(("end_taper",), (DAMPING,)), verdict("identified", {"name": "end_taper", "channel": None}), "missed"),
        (truth(("end_taper",), (DAMPING,)), verdict("identified", GAIN), "wrong"),
        (truth(("muscle_damping",), (DAMPING,)), verdict("identified", DAMPING), "right"),
        (truth(("end_taper",), (DAMPING,)), verdict("unexplained", GAIN), "flagged"),
    ],
)
def test_names_of_what_is_present_count_neither_for_nor_against(hidden: dict, found: dict, outcome: str) -> None:
    assert score_verdict(hidden, found) == outcome


def test_other_physics_has_metrics_of_its_own() -> None:
    rows = [
        DatasetResult("a", truth(effects=(DAMPING,)), verdict("identified", DAMPING), "right"),
        DatasetResult("b", truth(effects=(DAMPING,)), verdict("identified", GAIN), "wrong"),
        DatasetResult("c", truth(), verdict("identified", GAIN), "false-alarm"),
    ]
    values = {metric.name: metric for metric in metrics.compute_metrics(rows)}
    assert values["other physics: a wrong name alone"].value == 0.5
    assert values["other physics: names right, effect at least as large as the noise"].value == 0.5
    assert values["other physics: a name without a strong effect"].value == 1.0
    assert values["wrong name, at any size"].n == 0
    assert run.get_maker("adversary") is dataset.make_dataset
    assert run.get_maker("clean") is run.MAKERS["bench"]


def test_device_behind_the_valve_is_a_device_of_the_program(tmp_path: Path) -> None:
    file = tmp_path / "device.toml"
    file.write_text(dataset.build_device_text(valve=True), "utf-8")
    assert ks.load_device(file).name == "pair-behind-valve"
    rig = build_rig(read_device_numbers(dataset.build_device_text(valve=True)))
    assert rig.has_valve
    assert rig.supply_pressure == 7e5
    assert rig._replace(has_valve=False, supply_pressure=5e5, fill_conductance=2e-8, exhaust_conductance=2e-8) == (
        RIG._replace(fill_conductance=2e-8, exhaust_conductance=2e-8)
    )


@slow
@pytest.mark.parametrize(
    ("ratio", "geometric", "bladder", "total"),
    [(0.7, 209, 111, 9), (0.8, 470, 354, 252), (0.9, 765, 629, 527), (0.96, 959, 838, 736), (1.0, 1096, 1096, 994)],
)
def test_textbook_muscle_has_the_published_force(ratio: float, geometric: float, bladder: float, total: float) -> None:
    """The 3/4 in actuator of Table 3.1 at 5 bar."""
    length = ratio * RIG.resting_length
    rubber = muscle.rubber_tension(length, SINGLE)
    assert muscle.gas_tension(5e5, length, HARD) == pytest.approx(geometric, abs=1.0)
    assert muscle.gas_tension(5e5, length, HARD) + rubber == pytest.approx(bladder, abs=1.0)
    assert muscle.gas_tension(5e5, length, SINGLE) + rubber == pytest.approx(total, abs=1.0)


@slow
@pytest.mark.parametrize("cone_slope", [0.0, 0.3, 2.0])
def test_tension_of_the_gas_is_its_virtual_work(cone_slope: float) -> None:
    rig, h = RIG._replace(cone_slope=cone_slope), 1e-6
    for length in (0.2, 0.22, 0.24, 0.2499):
        slope = (muscle.braid_volume(length + h, 3e5, rig) - muscle.braid_volume(length - h, 3e5, rig)) / (2.0 * h)
        assert muscle.braid_area(length, 3e5, rig) == pytest.approx(slope, rel=1e-4)


@slow
def test_damper_meets_its_design_points() -> None:
    assert series.oil_tension(-0.3, RIG) == pytest.approx(-1472.0, rel=2e-3)
    assert series.oil_tension(0.15, RIG) == pytest.approx(400.0, rel=2e-3)


@slow
@pytest.mark.parametrize("name", ["sines", "steps", "ramps"])
def test_textbook_rig_agrees_with_the_program(name: str, tmp_path: Path) -> None:
    """The program as a black box: its bench, its log."""
    command = [sys.executable, "-m", "klute_sim", "bench", name, "klute-3-4-pair", "--out", str(tmp_path / name)]
    subprocess.run(command, check=True, capture_output=True)
    table = pyarrow.parquet.read_table(tmp_path / name / f"{name}.parquet").to_pydict()
    time = np.array(table["time [s]"])
    grid = np.arange(0.0, time[-1], STEP)
    length = np.interp(grid, time, table["length [mm]"]) * 1e-3
    pressure = np.interp(grid, time, table["pressure_command [bar]"]) * 1e5
    force = np.array(table["force [N]"])
    difference = (np.interp(time, grid, simulate(length, pressure, RIG).force) - force)[2:-2]
    assert rms(difference) < 2e-3 * np.ptp(force)
    assert np.abs(difference).max() < 5e-3 * np.ptp(force)


@slow
def test_half_the_step_changes_a_tenth_of_the_noise() -> None:
    program = PROGRAMS[0]
    rig = RIG._replace(cone_slope=0.3, braid_friction=8e-5, seal_friction=10.0, creep_per_decade=0.3)
    grid = np.arange(len(program.length)) * STEP
    fine = np.arange(2 * len(grid) - 1) * STEP / 2
    inputs = (np.interp(fine, grid, values) for values in (program.length, program.command))
    coarse, finer = simulate(program.length, program.command, rig), simulate(*inputs, rig, STEP / 2)
    assert rms(coarse.force - finer.force[::2]) < 0.1 * sensors.noise_level("force")


@slow
def test_bladder_relaxes_by_equal_amounts_in_each_decade() -> None:
    rig = RIG._replace(creep_per_decade=0.2)
    length = np.concatenate([hold([0.356], 1.0), np.full(round(20.0 / STEP), 0.33)])
    force = simulate(length, np.full(len(length), 2.5e5), rig).force
    at = [force[round((1.0 + seconds) / STEP)] for seconds in (1.0, 3.162, 10.0)]
    assert at[1] - at[0] > 2.0  # the bladder reduces the tension, and less after a while
    assert at[2] - at[1] == pytest.approx(at[1] - at[0], rel=0.25)
    assert len(CREEP_TIMES) == 11


@slow
def test_valve_fills_to_the_command_and_a_tank_gives_what_the_muscle_takes() -> None:
    numbers = {**NUMBERS, "supply.pressure_bar": 7.0, "valve.gain_per_bar": 5.0}
    numbers |= {"valve.fill_dm3_per_s_bar": 1.0, "valve.exhaust_dm3_per_s_bar": 1.0}
    length, command = np.full(round(6.0 / STEP), 0.335), hold([2e5, 4e5, 3e5])
    plain = simulate(length, command, build_rig(numbers))
    for k, level in enumerate((2e5, 4e5, 3e5), start=1):
        assert plain.pressure[round(2.0 * k / STEP) - 1] == pytest.approx(level, abs=500.0)
    leaking = simulate(length, command, build_rig(numbers, leak_conductance=2e-9))
    assert (leaking.pressure - plain.pressure)[-1] < -1000.0
    small = simulate(length, command, build_rig(numbers, tank_volume=0.05e-3))
    assert small.pressure[round(4.0 / STEP) - 1] < 3.9e5
    hose = simulate(length, command, build_rig(numbers, hose_length=2.0))
    late = slice(round(2.0 / STEP), round(2.05 / STEP))
    assert (hose.pressure - plain.pressure)[late].min() < -0.1e5
    assert hose.pressure[round(4.0 / STEP) - 1] == pytest.approx(4e5, abs=3000.0)


@slow
def test_tank_and_muscle_keep_the_mass_of_the_air() -> None:
    rig = RIG._replace(has_valve=True, supply_pressure=7e5, fill_conductance=1e-8, tank_volume=0.5e-3)
    volume = muscle.air_volume(0.23, 2e5, rig)
    air = supply.rest_air(2e5, volume, rig)
    mass, tank = air[5], air[7]
    for _ in range(2000):
        supply.step_air(air, 4e5, volume, 0.0, STEP, rig)
    given = (tank - air[7]) * rig.tank_volume / (supply.GAS_CONSTANT * rig.gas_temperature * supply.TANK_EXPONENT)
    assert air[5] - mass == pytest.approx(given, rel=1e-6)
    assert air[4] == pytest.approx(air[5] * supply.GAS_CONSTANT * air[6] / volume - ATMOSPHERE, rel=1e-9)


@slow
@pytest.mark.parametrize(
    "field", ["braid_friction", "seal_friction", "rubber_damping", "tendon_loss", "creep_per_decade"]
)
def test_a_stretch_shorten_cycle_costs_more_with_a_loss(field: str) -> None:
    strong = {field: end for case in cases.HIDDEN_CASES for field, (_, end) in case.ranges.items()}
    time = np.arange(round(6.0 / STEP)) * STEP
    length = 0.335 + 0.006 * np.sin(2.0 * math.pi * 0.5 * time)
    cycle = slice(-round(2.0 / STEP) - 1, None)

    def measure_loss(rig: Rig) -> float:
        force = simulate(length, np.full(len(time), 3e5), rig).force[cycle]
        return float(np.trapezoid(force, length[cycle]))

    assert measure_loss(RIG._replace(**{field: strong[field]})) > 1.01 * measure_loss(RIG)


@slow
def test_dataset_is_reproducible_and_complete(tmp_path: Path) -> None:
    spec = next(s for s in SPECS if s["hidden"] and s["hidden"]["entry"]["name"] == "braid_hysteresis")
    arguments = {key: value for key, value in spec.items() if key != "name"}
    sealed = [dataset.make_dataset(tmp_path / name / "d", **arguments) for name in "xy"]
    assert sealed[0] == sealed[1] == json.loads((tmp_path / "x" / "d.truth.json").read_text("utf-8"))
    files = [{f.name: f.read_bytes() for f in (tmp_path / name / "d").iterdir()} for name in "xy"]
    assert files[0] == files[1]
    assert len(ks.load_dataset(tmp_path / "x" / "d").trials) == 10
    assert sealed[0]["effects"][0]["name"] == "braid_hysteresis"
    assert sealed[0]["size"] > 3.0
    assert sealed[0]["raw_size"] >= sealed[0]["size"] > sealed[0]["contributions"].get("braid", 0.0)
