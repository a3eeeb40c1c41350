"""Tests of joints and free loads: metrics of known signals, mounted devices, and responses that physics demands."""

import numpy as np
import pytest

from klute_sim.api.joint import JointRun, simulate_joint
from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.mechanism import metrics
from klute_sim.mechanism.mounting import _measure_lengths, mount_devices
from klute_sim.mechanism.protocols import MULTISINE_PERIOD, REST_TIME, TESTS, ProtocolSettings, plan_test
from klute_sim.plant.mjcf.model_file import MODEL_NAMES, load_model_file

SETTINGS = ProtocolSettings(2.5e5, 1e5, -2.0)
STEP = 2e-3


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_mounted_muscles_have_their_neutral_length(name: str) -> None:
    file = load_model_file(name)
    device = load_device("klute-1-1-4-pair")
    devices = {tendon.name: device for tendon in file.make_spec().tendons}
    lengths = _measure_lengths(file, mount_devices(file, devices))
    expected = device.parameters.tendon.slack_length + 0.88 * device.parameters.muscle.resting_length
    assert [*lengths.values()] == pytest.approx([expected] * len(devices), abs=1e-8)


def test_step_metrics_of_a_second_order_response() -> None:
    time = np.arange(0.0, 6.0, 1e-3)
    damping, frequency = 0.4, 2.0 * np.pi * 2.0
    damped, t = frequency * np.sqrt(1.0 - damping**2), np.maximum(time - 1.0, 0.0)
    wave = np.cos(damped * t) + damping / np.sqrt(1.0 - damping**2) * np.sin(damped * t)
    value = 10.0 + 5.0 * (1.0 - np.exp(-damping * frequency * t) * wave)
    result = metrics.measure_step(time, value, 1.0, 6.0, "deg")
    assert result["change_deg"] == pytest.approx(5.0, rel=1e-3)
    overshoot = 100.0 * np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2))
    assert result["overshoot_pct"] == pytest.approx(overshoot, rel=0.01)
    assert result["settling_s"] == pytest.approx(4.0 / (damping * frequency), rel=0.2)


def test_sine_metrics_of_a_first_order_lag() -> None:
    time = np.arange(0.0, 5.0, 1e-3)
    frequency, time_constant = 1.0, 0.2
    ratio = 3.0 / (1.0 + 2j * np.pi * frequency * time_constant)
    command = np.sin(2.0 * np.pi * frequency * time)
    value = 7.0 + np.imag(ratio * np.exp(2j * np.pi * frequency * time))
    events = {"begin": 1.0, "end": 4.0, "frequency_hz": frequency}
    result = metrics.measure_sine(time, value, command, events, "deg")
    assert result["gain_deg_per_bar"] == pytest.approx(abs(ratio), rel=1e-6)
    assert result["phase_deg"] == pytest.approx(np.degrees(np.angle(ratio)), abs=1e-3)
    assert result["coherence"] == pytest.approx(1.0, abs=1e-9)


def test_multisine_metrics_of_a_first_order_lag() -> None:
    trial = plan_test("multisine", SETTINGS)[0]
    time = np.arange(0.0, trial.duration, 1e-2)
    difference, time_constant = trial.difference(time), 0.2
    value = np.zeros(len(time))
    fine = np.arange(0.0, trial.duration, 1e-4)
    state, states = 0.0, np.zeros(len(fine))
    for k, u in enumerate(trial.difference(fine)):
        states[k] = state
        state += 1e-4 * (u - state) / time_constant
    value = np.interp(time, fine, states)
    result = metrics.measure_multisine(time, value, difference / 1e5, trial.events, "deg")
    assert result["gain_deg_per_bar"] == pytest.approx(1e5, rel=0.02)
    assert result["bandwidth_hz"] == pytest.approx(1.0 / (2.0 * np.pi * time_constant), rel=0.15)
    assert abs(result["nonlinear_pct"]) < 0.5


def test_multisine_repeats_after_its_period_and_keeps_its_amplitude() -> None:
    trial = plan_test("multisine", SETTINGS)[0]
    time = REST_TIME + np.linspace(0.0, MULTISINE_PERIOD, 5001)
    first, second = trial.difference(time), trial.difference(time + MULTISINE_PERIOD)
    assert first == pytest.approx(second, abs=1e-6 * 1e5)
    assert np.abs(first).max() == pytest.approx(1e5, rel=1e-3)
    assert first[0] == 0.0


@pytest.mark.parametrize("test", [name for name in TESTS if name != "multisine"])
def test_every_test_runs_and_its_energy_closes(test: str) -> None:
    run = simulate_joint(test=test, time_step=STEP)
    for row in run.table:
        for name in ("flexor", "extensor"):
            assert abs(row[f"ledger_residual_{name}_j"]) < 0.15 + 0.05 * abs(row[f"work_{name}_j"])
    assert "antagonist_joint" in str(run)


def test_larger_differences_turn_the_joint_further() -> None:
    rows = {row["difference_bar"]: row["change_deg"] for row in simulate_joint(time_step=STEP).table}
    assert rows[-1.0] < rows[-0.5] < 0.0 < rows[0.5] < rows[1.0]


def test_co_contraction_stiffens_the_joint() -> None:
    stiffness = [row["stiffness_n_m_per_deg"] for row in simulate_joint(test="co-contraction", time_step=STEP).table]
    assert np.all(np.diff(stiffness) > 0.0)


def test_gain_falls_and_lag_grows_with_frequency() -> None:
    rows = simulate_joint(test="sines", time_step=STEP).table
    assert rows[-1]["gain_deg_per_bar"] < 0.5 * rows[0]["gain_deg_per_bar"]
    assert np.all(np.diff([row["phase_deg"] for row in rows]) < 0.0)


def test_a_heavier_lever_sinks_and_slows() -> None:
    light = simulate_joint(time_step=STEP)
    heavy = simulate_joint(time_step=STEP, numbers={"model.geom.load.mass": 3.0})
    assert heavy.table[0]["rise_s"] > light.table[0]["rise_s"]
    start = [run.recordings["step_up_50pct"]["angle_joint"][0] for run in (light, heavy)]
    assert start[1] < start[0]


def test_run_can_be_saved(tmp_path: object) -> None:
    run: JointRun = simulate_joint(model="hanging_mass", test="quick-release", time_step=STEP)
    folder = run.save(f"{tmp_path}/run")
    names = {path.name for path in folder.iterdir()}
    assert {"summary.json", "results.csv", "figure.png", "index.html", "model.xml", "muscle.toml"} <= names
    reloaded = load_model_file(folder / "model.xml").make_spec().compile()
    assert reloaded.ntendon == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"test": "step"}, "did you mean 'steps'"),
        ({"device": {"flexor": "klute-3-4"}}, "tendon 'extensor' has no device"),
        ({"device": {"biceps": "klute-3-4"}}, "no tendon 'biceps'"),
        ({"difference_bar": 3.0}, "0 up to the mean pressure"),
        ({"mean_pressure_bar": 4.5}, "has 5 bar; lower the mean"),
        ({"numbers": {"model.geom.laod.mass": 1.0}}, "did you mean 'model.geom.load.mass'"),
        ({"time_step": 0.1}, "the time step is 100 ms"),
    ],
)
def test_inputs_are_refused_in_one_sentence(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as error:
        simulate_joint(**arguments)  # type: ignore[arg-type]
    assert message in str(error.value)
