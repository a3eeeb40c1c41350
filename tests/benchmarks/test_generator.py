"""Tests of the generator: its device, integrator, instruments and files."""

import csv
import json
import math
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from benchmarks.hidden_effects import air, catalogue, device, generate, inputs, plan, set_up, simulate, truth
from benchmarks.hidden_effects import law as laws
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

pytestmark = pytest.mark.slow

HOME = Path(__file__).parents[2] / "benchmarks" / "hidden_effects"

FORMS = {**catalogue.EFFECTS, **catalogue.OTHER_FORMS, **catalogue.LATER_FORMS}
LAW, AIR = device.build_neutral_law(device.load_device())
PROGRAM = inputs.generate_programs(np.random.default_rng(7))[2]


def device_with(effects: list[dict], known: bool) -> tuple[laws.Law, air.AirSupply]:
    """The device with ``effects``, and with the known valve."""
    return device.add_effects(LAW, AIR, [*([catalogue.KNOWN_VALVE] if known else []), *effects])


@pytest.fixture(scope="module")
def behind_valve() -> dict[str, np.ndarray]:
    return simulate.simulate_trace(PROGRAM, *device_with([], known=True))


@pytest.fixture(scope="module")
def plain() -> dict[str, np.ndarray]:
    return simulate.simulate_trace(PROGRAM, LAW, AIR)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def files(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}


@pytest.mark.parametrize(
    ("ratio", "geometric", "bladder", "total"),
    [(0.7, 209, 111, 9), (0.8, 470, 354, 252), (0.9, 765, 629, 527), (0.96, 959, 838, 736), (1.0, 1096, 1096, 994)],
)
def test_static_force_equals_published_force(ratio: float, geometric: float, bladder: float, total: float) -> None:
    """The 3/4 in actuator at 5 bar; the preset's are the same braid and bladder, only longer."""
    hard = LAW._replace(friction_slope=0.0, friction_offset=0.0)
    for law, force in ((hard._replace(bladder_gain=0.0), geometric), (hard, bladder), (LAW, total)):
        assert laws.static_muscle_tension(5e5, ratio * law.resting_length, law) / law.n_muscles == pytest.approx(
            force, abs=1.0
        )


def test_damper_meets_design_points() -> None:
    assert laws.rate_dependent_tension(5e5, -0.3, LAW) == pytest.approx(-1472.0, rel=2e-3)
    assert laws.rate_dependent_tension(5e5, 0.15, LAW) == pytest.approx(400.0, rel=2e-3)


@pytest.mark.parametrize("key", FORMS, ids="/".join)
def test_effects_show_at_typical_size_and_vanish_at_neutral(
    key: tuple[str, str], plain: dict[str, np.ndarray], behind_valve: dict[str, np.ndarray]
) -> None:
    effect, known = plan.draw_effect(FORMS, key, None), key[0] in catalogue.VALVE_EFFECTS
    plain = behind_valve if known else plain
    shown = simulate.simulate_trace(PROGRAM, *device_with([effect], known))
    assert np.isfinite(shown["force"]).all()
    assert rms(shown["force"] - plain["force"]) > 1.0
    neutral = {n: p.typical if p.neutral is None else p.neutral for n, p in FORMS[key].items()}
    without = simulate.simulate_trace(PROGRAM, *device_with([{**effect, "parameters": neutral}], known))
    for channel, values in plain.items():
        np.testing.assert_array_equal(without[channel], values)


@pytest.mark.parametrize(
    "names",
    [
        [("braid_hysteresis", "maxwell_slip"), ("seal_friction", "coulomb"), ("tendon_hysteresis", "slip")],
        [("choked_valve", "asymmetric"), ("supply_droop", "tank"), ("leak", "crack"), ("trapped_air", "isothermal")],
        [("volume_coupling", "polytropic"), ("supply_droop", "tank"), ("pressure_lag", "first_order")],
        [("seal_friction", "lugre"), ("braid_hysteresis", "prandtl_ishlinskii"), ("bladder_relaxation", "log_time")],
    ],
    ids=lambda names: names[0][0],
)
def test_solution_is_converged(names: list[tuple[str, str]]) -> None:
    """With effects that are hard to integrate, several at once; the noise is hundred times as large."""
    laden = device.add_effects(LAW, AIR, [plan.draw_effect(FORMS, key, None) for key in names])
    usual, tighter = (simulate.simulate_trace(PROGRAM, *laden, tolerance=t) for t in (1e-9, 1e-10))
    assert rms(usual["force"] - tighter["force"]) < 0.03


def test_solution_agrees_with_scipy_radau(plain: dict[str, np.ndarray]) -> None:
    """An unrelated integrator, on a device whose law is smooth at rest (the v|v| law is not Lipschitz there)."""
    law = LAW._replace(transition=0.04, viscous=300.0, relax_stiffness=3e3, relax_time=0.3)
    pieces, end = PROGRAM.spline_coefficients(), 1.5
    n = (len(PROGRAM.length) - 1) * 20 + 1
    pressure = np.maximum(air.simulate_pressure(PROGRAM.command, inputs.SAMPLE_INTERVAL, n, AIR), 2.0e5)
    given = truth.DeviceInputs(pieces, pressure, PROGRAM.command, inputs.SAMPLE_INTERVAL)
    _, length, _, _ = truth.integrate_device(given, law, AIR, 1e-9)

    def rate(t: float, state: np.ndarray) -> list[float]:
        L, s = state
        p = air.interpolate_on_grid(t, pressure, air.AIR_STEP)
        pull = laws.elastic_tendon_tension(truth.evaluate_length_spline(t, pieces) - L - law.slack, law)
        held = (
            laws.static_muscle_tension(p, L, law)
            + law.n_muscles * law.relax_stiffness * (L - law.resting_length - s)
            - pull
        )
        v = brentq(lambda u: held + laws.rate_dependent_tension(p, u, law), -2.0, 2.0, xtol=1e-12)
        return [v, (L - law.resting_length - s) / law.relax_time]

    start = [length[0], length[0] - law.resting_length]
    at = np.arange(0.0, end, 0.01)
    found = solve_ivp(rate, (0.0, end), start, "Radau", at, rtol=1e-7, atol=1e-9, max_step=0.005)
    assert length.max() < law.resting_length
    np.testing.assert_allclose(found.y[0], length[::10][: len(at)], atol=2e-6)


def test_pressure_follows_its_laws() -> None:
    command = np.r_[np.full(20, 2e5), np.full(181, 4e5)]  # a step that ends at 0.1 s
    t = np.arange(20001) * air.AIR_STEP
    plain = air.simulate_pressure(command, 5e-3, len(t), AIR)
    assert np.diff(plain).max() <= AIR.max_rate * air.AIR_STEP * (1 + 1e-9)
    np.testing.assert_allclose(plain[t > 0.12], 4e5)
    lagged = air.simulate_pressure(command, 5e-3, len(t), AIR._replace(lag_time=0.05))
    late = t > 0.1
    start = lagged[np.flatnonzero(late)[0]]
    decay = np.exp(-(t[late] - t[late][0]) / 0.05)
    np.testing.assert_allclose(lagged[late], 4e5 + (start - 4e5) * decay, rtol=1e-9)
    delayed = air.simulate_pressure(command, 5e-3, len(t), AIR._replace(dead_time=0.04))
    np.testing.assert_allclose(delayed[800:], plain[:-800], atol=1e-3)


@pytest.mark.parametrize("channel", catalogue.BENCH_CHANNELS)
def test_instrument_fault_changes_only_its_channel(channel: str, plain: dict[str, np.ndarray]) -> None:
    forms = catalogue.instrument_forms(channel)
    for key in forms:
        fault = {**plan.draw_effect(forms, key, None), "channel": channel}
        read = simulate.apply_faults(plain, [fault])
        for name, values in plain.items():
            shown = simulate.quantise(name, read[name], [fault])
            assert np.array_equal(shown, values) == (name != channel)
        fault["parameters"] = {name: parameter.neutral for name, parameter in forms[key].items()}
        read = simulate.apply_faults(plain, [fault])
        np.testing.assert_array_equal(simulate.quantise(channel, read[channel], [fault]), plain[channel])


def test_noise_is_coloured() -> None:
    noise = simulate.draw_coloured_noise(np.random.default_rng(0), 200_000, 3.0)
    assert rms(noise) == pytest.approx(3.0, rel=0.05)
    assert 0.010 < -inputs.SAMPLE_INTERVAL / math.log(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.031


def test_inputs_are_feasible_on_a_bench() -> None:
    for seed in range(20):
        for program in inputs.generate_programs(np.random.default_rng(seed)):
            v = np.gradient(program.length, truth.TRACE_STEP)
            assert 3.0 <= program.duration <= 6.0
            assert np.abs(v).max() < 0.31
            assert np.abs(np.gradient(v, truth.TRACE_STEP)).max() < 30.0
            assert v.max() > 0.02
            assert v.min() < -0.02
            assert (
                inputs.MIN_UNIT_LENGTH - 1e-9
                <= program.length.min()
                <= program.length.max()
                <= inputs.MAX_UNIT_LENGTH + 1e-9
            )
            assert np.ptp(program.length[:300]) == 0.0
            assert np.ptp(program.command[:60]) == 0.0
            assert program.command.min() < 2e5
            assert 0.0 <= program.command.min() <= program.command.max() <= 5e5
            assert np.abs(np.diff(program.command)).max() > 0.5e5
            assert len(program.length) == 5 * (len(program.command) - 1) + 1


def test_seed_determines_dataset_bytes(tmp_path: Path) -> None:
    effects = [plan.draw_effect(FORMS, ("pressure_lag", "first_order"), None)]
    first = generate.make_dataset(tmp_path / "a", 1, effects=effects, muscle_length=True)
    generate.make_dataset(tmp_path / "b", 1, effects=effects, muscle_length=True)
    generate.make_dataset(tmp_path / "c", 2, effects=effects, muscle_length=True)
    assert files(tmp_path / "a") == files(tmp_path / "b")
    assert not set(files(tmp_path / "a").values()) & {
        v for k, v in files(tmp_path / "c").items() if k != "dataset.toml"
    }
    assert first == json.loads((tmp_path / "a.truth.json").read_text("utf-8"))
    assert first["effects"] == effects
    assert first["raw_size"] > 1.0
    for key, share in catalogue.RELATIVE_UNCERTAINTIES.items():
        assert abs(first["base"][key] / first["nominal"][key] - 1.0) <= 2.0 * share

    document = tomllib.loads((tmp_path / "a" / "dataset.toml").read_text("utf-8"))
    assert document["format"] == "klute-sim-dataset/2"
    assert document["device"] == "klute-3-4-pair"
    assert document["uncertain"]["tendon.slack_length_mm"] == "1 %"
    uses = [(trial["group"], trial["use"]) for trial in document["trial"]]
    assert [use for _, use in uses] == ["fit"] * 6 + ["validation"] * 2 + ["test"] * 2
    assert all(uses.count(pair) == 2 for pair in uses)
    for trial in document["trial"]:
        with (tmp_path / "a" / trial["files"][0]).open(encoding="utf-8") as stream:
            header, *rows = csv.reader(stream)
        units = [
            "time [s]",
            "length [mm]",
            "pressure_command [bar]",
            "force [N]",
            "pressure [bar]",
            "muscle_length [mm]",
        ]
        assert header == units
        values = np.array(rows, float)
        np.testing.assert_allclose(np.diff(values[:, 0]), 0.005, atol=1e-9)
        assert 600 < len(values) <= 1201
        assert np.isfinite(values).all()
    assert len(document["trial"]) + 1 == len(files(tmp_path / "a"))


def test_leak_is_hidden_behind_known_valve(tmp_path: Path) -> None:
    spec = next(s for s in plan.plan_datasets("single", 60, 1, typical=True) if s["effects"][0]["name"] == "leak")
    spec.pop("name")
    sealed = generate.make_dataset(tmp_path / "leak", **spec)
    assert [e["name"] for e in sealed["effects"]] == ["leak"]
    assert sealed["known"] == [catalogue.KNOWN_VALVE]
    document = tomllib.loads((tmp_path / "leak" / "device.toml").read_text("utf-8"))
    assert document["effects"] == {"choked_valve": {"form": "symmetric", **catalogue.KNOWN_VALVE["parameters"]}}
    assert tomllib.loads((tmp_path / "leak" / "dataset.toml").read_text("utf-8"))["device"] == "device.toml"
    assert device.load_device(tmp_path / "leak" / "device.toml") == device.load_device()


def test_quantization_follows_noise(tmp_path: Path) -> None:
    fault = {"name": "quantisation", "form": "linear", "channel": "force", "parameters": {"step": 12.0}}
    sealed = generate.make_dataset(tmp_path / "steps", 5, instruments=[fault])
    assert 0.7 < sealed["raw_size"] < 1.6  # evenly spread over a step of four times the noise: 4 / sqrt(12)
    with (tmp_path / "steps" / "fit_1_a.csv").open(encoding="utf-8") as stream:
        force = np.array([row["force [N]"] for row in csv.DictReader(stream)], float)
    np.testing.assert_allclose(force / 12.0, np.round(force / 12.0), atol=1e-9)
    assert len(np.unique(force)) > 10


@pytest.mark.long
def test_defects_damage_their_data(tmp_path: Path) -> None:
    def column(folder: str, name: str) -> list[np.ndarray]:
        out = []
        for file in sorted((tmp_path / folder).glob("*.csv")):
            with file.open(encoding="utf-8") as stream:
                out.append(np.array([row[name] for row in csv.DictReader(stream)], float))
        return out

    for defect in plan.DEFECTS:
        generate.make_dataset(tmp_path / defect, 3, defect=defect, block="defective")
    assert all(np.ptp(force) == 0.0 for force in column("dead_channel", "force [N]"))
    assert len(column("no_repeats", "time [s]")) == 5
    assert all(np.ptp(length) < 0.2 for length in column("no_excitation", "length [mm]"))
    assert sum(np.diff(time).min() < 0.0 for time in column("clock_backwards", "time [s]")) == 1
    highest = max(force.max() for force in column("saturated_force", "force [N]"))
    assert sum((force == highest).sum() for force in column("saturated_force", "force [N]")) > 50


def test_plans_cover_catalogue_and_extend() -> None:
    for block in plan.BLOCK_SIZES:
        assert plan.plan_datasets(block, 9, 1)[:4] == plan.plan_datasets(block, 4, 1)
        assert plan.plan_datasets(block, 9, 1) != plan.plan_datasets(block, 9, 2)
    singles = plan.plan_datasets("single", len(catalogue.EFFECTS), 1)
    assert {(e["name"], e["form"]) for s in singles for e in s["effects"]} == set(catalogue.EFFECTS)
    for spec in (
        plan.plan_datasets("pair", 50, 1)
        + plan.plan_datasets("wrong_form", 20, 1)
        + plan.plan_datasets("single", 60, 1)
    ):
        device.add_effects(LAW, AIR, spec["effects"])  # refuses what is out of range
    assert all(len({e["name"] for e in spec["effects"]}) == 2 for spec in plan.plan_datasets("pair", 50, 1))
    faults = [s["instruments"][0] for s in plan.plan_datasets("instrument", 18, 1)]
    assert len({(fault["name"], fault["channel"]) for fault in faults}) == 18
    assert len(catalogue.OTHER_FORMS) >= 6
    assert not set(catalogue.LATER_FORMS) & (set(catalogue.EFFECTS) | set(catalogue.OTHER_FORMS))


def test_generator_is_independent_of_package_and_resumes(tmp_path: Path) -> None:
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); from benchmarks.hidden_effects import generate;"
        "generate.main([sys.argv[2], '--block', 'instrument', '--count', '1', '--typical']);"
        "assert not [m for m in sys.modules if m.split('.')[0] == 'klute_sim']"
    )
    for word in ("raw size", "is there"):
        command = [sys.executable, "-c", code, str(HOME.parents[1]), str(tmp_path)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert word in done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["instrument_1_000", "instrument_1_000.truth.json"]


@pytest.mark.parametrize(("index", "interval", "first"), [(0, 0.02, 0.0), (1, 0.005, 0.7), (2, 0.005, 0.0)])
def test_logs_are_slow_begin_late_or_have_a_noisy_repeat(
    index: int, interval: float, first: float, tmp_path: Path
) -> None:
    spec = plan.plan_datasets("logging", 3, 1)[index]
    name = spec.pop("name")
    sealed = generate.make_dataset(tmp_path / name, **spec)
    plain = generate.make_dataset(tmp_path / "plain", spec["seed"], block="clean")
    assert sealed["logging"] == spec["logging"]
    assert plain["base"] == sealed["base"]
    file = min(path.name for path in (tmp_path / name).glob("*_a.csv"))
    logged, usual = (np.loadtxt(tmp_path / folder / file, delimiter=",", skiprows=1) for folder in (name, "plain"))
    assert logged[0, 0] == pytest.approx(first)
    assert np.diff(logged[:, 0]) == pytest.approx(interval)
    common = usual[np.isin(usual[:, 0].round(3), logged[:, 0].round(3))]
    np.testing.assert_array_equal(logged[:, 1:3], common[:, 1:3])
    assert (rms(logged[:, 3] - common[:, 3]) > 0.0) == (index == 2)


def test_later_logs_have_a_hum_a_filter_steps_repeated_readings_or_a_late_command(tmp_path: Path) -> None:
    first = plan.FIRST_LOGGING_DATASETS
    specs = plan.plan_datasets("logging", first + len(set_up.LATER_LOGGINGS), 1)
    assert plan.plan_datasets("logging", first, 1) == specs[:first]
    changed_columns = []
    for spec in specs[first:]:
        name = spec.pop("name")
        generate.make_dataset(tmp_path / name, **spec)
        generate.make_dataset(tmp_path / f"{name}_plain", spec["seed"], block="clean")
        file = min(path.name for path in (tmp_path / name).glob("*_a.csv"))
        logged, usual = (
            np.loadtxt(tmp_path / folder / file, delimiter=",", skiprows=1) for folder in (name, f"{name}_plain")
        )
        changes = [rms(a - b) for a, b in zip(logged.T, usual.T, strict=True)]
        changed_columns.append(["-+"[int(change > 0.0)] for change in changes[:5]])
        kind = next(iter(spec["logging"]))
        if kind == "length_step_mm":
            assert changes[1] == pytest.approx(0.05 / 12.0**0.5, rel=0.1)
        if kind == "length_samples":
            assert np.count_nonzero(np.diff(logged[:, 1])) <= len(logged) / 4
        if kind == "command_samples":
            np.testing.assert_array_equal(logged[1:, 2], usual[:-1, 2])
        if kind == "hum":
            assert changes[3] == pytest.approx(0.5**0.5 * catalogue.BENCH_CHANNELS["force"].noise, rel=0.05)
    # time, length, command, force and pressure
    assert ["".join(row) for row in changed_columns] == ["---++", "---++", "-+---", "-+---", "--+--"]


def test_wrong_number_changes_the_device_and_not_its_file(tmp_path: Path) -> None:
    specs = plan.plan_datasets("wrong_number", 8, 1)
    assert {spec["numbers"][0]["number"] for spec in specs} == set(set_up.NUMBER_ERRORS)
    nominal, usual = device.load_device(), set_up.NUMBER_ERRORS
    for spec in specs:
        ((key, value),) = spec["numbers"][0]["parameters"].items()
        size = usual[key].absolute + usual[key].relative * abs(nominal[key])
        assert 0.99 <= abs(value - nominal[key]) / size <= 3.01
    name = specs[0].pop("name")
    sealed = generate.make_dataset(tmp_path / name, **specs[0])
    generate.make_dataset(tmp_path / "plain", specs[0]["seed"], block="clean")
    assert sealed["size"] > 0.0
    texts = [(tmp_path / folder / "dataset.toml").read_text("utf-8") for folder in (name, "plain")]
    assert texts[0] == texts[1]
    file = min(path.name for path in (tmp_path / name).glob("*_a.csv"))
    wrong, right = (np.loadtxt(tmp_path / folder / file, delimiter=",", skiprows=1) for folder in (name, "plain"))
    assert rms(wrong[:, 3] - right[:, 3]) > 1.0
