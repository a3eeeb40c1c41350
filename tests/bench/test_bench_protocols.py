"""Protocols on the bench: what is read is what physics says, with MuJoCo and without."""

from typing import Any

import numpy as np
import pytest

from klute_sim.bench import device_only, tester
from klute_sim.bench.limits import unit_length
from klute_sim.bench.metrics import select_closed_interval, select_half_open_interval
from klute_sim.bench.protocols import library as protocols_library
from klute_sim.bench.protocols.pressure_step import compute_step_response
from klute_sim.bench.run import MAX_RECORDED_SAMPLES, BenchTrial, decimate_recording, plan_protocol, run_protocol
from klute_sim.device.device import Device, list_presets, load_device, parse_device
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.recording.recording import Recording
from klute_sim.recording.sinusoid import fit_sinusoid
from klute_sim.report.bench.table import collect_remarks

PAIR, BARE = load_device("klute-3-4-pair"), load_device("klute-3-4")
RELAXING = b"[effects.bladder_relaxation]\nstiffness_n_per_mm = 3.0\ntime_constant_s = 1.0\n"


def trials(device: Device, name: str, *, mujoco: bool = False, step: float = 5e-4, **update: Any) -> list[BenchTrial]:
    protocol = protocols_library.load_protocol(name).model_copy(update=update)
    return list(run_protocol(device, protocol, use_mujoco=mujoco, dt=step).trials)


def of(found: list[BenchTrial], reading: str, **setting: float) -> list[float]:
    return [t.metrics[reading] for t in found if setting.items() <= t.conditions.items()]


@pytest.mark.parametrize(
    ("device", "protocol", "remark"),
    [
        (BARE, "isokinetic", "the force does not depend on velocity"),
        (PAIR, "isometric", "the tendon is slack at this length"),
    ],
)
def test_forces_that_surprise_are_explained(device: Device, protocol: str, remark: str) -> None:
    def collect(device: Device) -> str:
        plan = protocols_library.load_protocol(protocol)
        return " ".join(collect_remarks(run_protocol(device, plan, dt=5e-3)))

    other = BARE if device is PAIR else PAIR
    assert remark in collect(device)
    assert remark not in collect(other)


def remove_friction(device: Device) -> Device:
    text = device.content.decode().replace("[damper]", "friction = false\n[damper]", 1)
    if "[damper]" not in text:
        text = text.replace("[supply]", "friction = false\n\n[supply]", 1)
    return parse_device(text.encode(), "remove_friction")


@pytest.fixture(scope="module")
def isokinetic() -> list[BenchTrial]:
    return trials(PAIR, "isokinetic")


@pytest.fixture(scope="module")
def loops() -> list[BenchTrial]:
    return trials(PAIR, "workloop")


@pytest.mark.long
@pytest.mark.parametrize("name", protocols_library.list_protocols())
def test_protocols_run_on_all_devices_and_conserve_energy(name: str) -> None:
    slow = {"concentric_mm_per_s": [100], "eccentric_mm_per_s": [100]} if name == "isokinetic" else {}
    slow = {"velocities_mm_per_s": [200]} if name == "workloop" else slow
    for device in (load_device(preset) for preset in list_presets()):
        if name == "isokinetic-unit" and device.parameters.tendon.is_rigid:
            continue  # its lengths are those of the pair
        for trial in trials(device, name, **slow):
            time = trial.recording["time"]
            turned = sum(np.trapezoid(np.abs(trial.recording[k]), time) for k in ("gas_power", "delivered_power"))
            assert abs(trial.metrics["ledger_residual_j"]) < 1e-3 * turned + 1e-3, trial.name


def test_numeric_keys_of_protocols_have_sources() -> None:
    for name in protocols_library.list_protocols():
        protocol = protocols_library.load_protocol(name)
        written = {key for key in protocol.model_fields_set if key in protocol.numeric_keys()} - {"activations"}
        assert written == set(protocol.sources), name
        assert protocol.list_assumptions()


def test_isometric_force_equals_the_mckibben_law() -> None:
    for trial in trials(BARE, "isometric"):
        muscle, pressure = BARE.parameters.muscle, 1e5 * trial.conditions["pressure_bar"]
        wanted = mckibben.force(muscle, pressure, trial.conditions["muscle_ratio"] * muscle.resting_length)
        assert trial.metrics["force_n"] == pytest.approx(wanted, abs=1e-9)
    for trial in trials(PAIR, "isometric", muscle_ratios=[0.9, 0.96]):
        assert trial.metrics["muscle_ratio_reached"] == pytest.approx(trial.conditions["muscle_ratio"], abs=1e-9)


def test_bare_muscle_force_is_736_newton_at_any_velocity() -> None:
    forces = of(trials(BARE, "isokinetic", pressures_bar=[5]), "force_n")
    assert len(forces) == 15
    assert forces == pytest.approx([736] * 15, abs=0.5)
    assert np.ptp(forces) < 0.01


def test_force_increases_with_pressure_and_decreases_with_shortening(isokinetic: list[BenchTrial]) -> None:
    for bar in (2, 3, 4, 5):
        forces = of(isokinetic, "force_n", pressure_bar=bar)  # from fast shortening to fast lengthening
        assert all(np.diff(forces) > 0)
    for velocity in {t.conditions["velocity_mm_per_s"] for t in isokinetic}:
        forces = of(isokinetic, "force_n", velocity_mm_per_s=velocity)
        assert all(np.diff(forces) > 0)
    slow = of(isokinetic, "force_ratio", velocity_mm_per_s=1, pressure_bar=5)[0]
    assert slow == pytest.approx(1.0, abs=1e-3)


def test_force_increases_with_unit_length() -> None:
    found = trials(PAIR, "isokinetic-unit", concentric_mm_per_s=[50], eccentric_mm_per_s=[50])
    for velocity in (50, -50):
        assert all(np.diff(of(found, "force_n", velocity_mm_per_s=velocity)) > 0)
    assert all(t.metrics["unit_length_mm"] == pytest.approx(t.conditions["unit_length_mm"], abs=1e-6) for t in found)


def test_metrics_are_nan_without_full_speed() -> None:
    found = trials(BARE, "isokinetic", pressures_bar=[5], muscle_ratios=[0.994], concentric_mm_per_s=[300])
    assert np.isnan(of(found, "force_n", velocity_mm_per_s=300)).all()


def test_work_is_positive_concentric_and_negative_eccentric(loops: list[BenchTrial]) -> None:
    assert len(loops) == 32
    for trial in loops:
        sign = 1.0 if trial.conditions["phase_pct"] == 0.0 else -1.0
        assert sign * trial.metrics["work_j"] > 1.0, trial.name
        assert trial.metrics["overlap_pct"] > 99.9
    for phase in (0.0, 50.0):
        for velocity in (1, 50, 100, 200):
            work = of(loops, "work_j", phase_pct=phase, velocity_mm_per_s=velocity)
            assert all(np.diff(np.abs(work)) > 0)  # it grows with activation
    for bar in (2, 3, 4, 5):
        assert all(np.diff(of(loops, "work_j", phase_pct=0.0, pressure_bar=bar)) < 0)  # the damper takes more


def test_work_equals_loop_area_and_energy_balance(loops: list[BenchTrial]) -> None:
    for trial in loops:
        time, read = trial.recording["time"], trial.metrics
        begin = time[-1] - (time[-1] - 0.5) / 2
        cycle = trial.recording.select(time >= begin - 1e-9)
        force, length = cycle["force"], 1e-3 * cycle["length"]
        area = -(0.5 * (force[1:] + force[:-1]) * np.diff(length)).sum()
        assert read["work_j"] == pytest.approx(area, rel=1e-3)
        assert read["work_j"] == pytest.approx(read["work_shortening_j"] + read["work_lengthening_j"], rel=1e-6)
        lines = ("gas", "friction", "damper", "stop", "bladder", "tendon", "effects")
        assert read["work_j"] == pytest.approx(sum(read[f"{k}_work_j"] for k in lines), rel=1e-3)
        assert 0.0 < abs(read["ledger_residual_j"]) < 1e-3 * abs(read["work_j"])


def test_work_of_both_halves_and_power_match_the_loop(loops: list[BenchTrial]) -> None:
    for trial in loops:
        time, read = trial.recording["time"], trial.metrics
        period = (time[-1] - 0.5) / 2
        cycle = trial.recording.select(time >= 0.5 + period - 1e-9)
        way, force = np.diff(1e-3 * cycle["length"]), cycle["force"]
        done = -0.5 * (force[1:] + force[:-1]) * way
        assert read["work_shortening_j"] == pytest.approx(done[way < 0.0].sum(), rel=2e-3, abs=1e-3)
        assert read["work_lengthening_j"] == pytest.approx(done[way > 0.0].sum(), rel=2e-3, abs=1e-3)
        assert read["mean_power_w"] == pytest.approx(read["work_j"] / period, rel=1e-3)


def test_halving_the_time_step_converges(loops: list[BenchTrial]) -> None:
    fine = trials(PAIR, "workloop", step=2.5e-4, velocities_mm_per_s=[50, 100, 200])
    by_name = {trial.name: trial.metrics for trial in loops}
    for trial in fine:
        coarse = by_name[trial.name]
        assert trial.metrics["work_j"] == pytest.approx(coarse["work_j"], rel=5e-3)
        assert abs(trial.metrics["ledger_residual_j"]) < 1.2e-4 * abs(trial.metrics["work_j"])
        assert abs(coarse["ledger_residual_j"]) < 4e-4 * abs(coarse["work_j"])


def test_frictionless_cycle_at_constant_pressure_has_no_net_work() -> None:
    for device in (PAIR, load_device("klute-1-1-4-pair"), BARE):
        passive = remove_friction(device)
        assert passive.parameters.muscle.friction_slope == 0.0
        muscle, slack = passive.parameters.muscle, passive.parameters.tendon.slack_length
        time = np.arange(6001) * 2.5e-4
        length = slack + muscle.resting_length * (0.94 - 0.04 * np.cos(2 * np.pi * 2 * time))
        recording = device_only.simulate_device_only(
            passive,
            length,
            np.full(len(time), 3e5),
            2.5e-4,
            initial_state=compute_equilibrium_state(passive.parameters, float(length[0]), 3e5),
        )
        whole = recording.select(slice(4000, 6001))  # one period, settled
        work = -np.trapezoid(whole["force"], 1e-3 * whole["length"])
        assert work <= 1e-3
        assert (work < -0.5) == (passive.parameters.damper.concentric_coefficient > 0.0)


def test_short_dwell_reduces_overlap() -> None:
    found = trials(PAIR, "workloop", velocities_mm_per_s=[200], pressures_bar=[5], dwell_s=0.0)
    assert max(of(found, "overlap_pct")) < 80


def test_work_changes_sign_with_phase() -> None:
    found = trials(PAIR, "workloop-phased", dwell_s=0.3, phases_pct=[0, 50])
    halves = trials(PAIR, "workloop", velocities_mm_per_s=[100], pressures_bar=[5], cycles=3)
    assert of(found, "work_j") == pytest.approx(of(halves, "work_j"), rel=1e-9)


def test_rise_time_follows_the_supply_rate() -> None:
    for trial in trials(BARE, "step"):
        bar = trial.conditions["pressure_bar"]
        assert trial.metrics["pressure_up_rise_s"] == pytest.approx(0.8 * bar / 100, abs=1e-3)
        assert trial.metrics["pressure_down_rise_s"] == pytest.approx(0.8 * bar / 100, abs=1e-3)
        assert trial.metrics["force_up_overshoot_pct"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("step", [5e-4, 2e-3, 1e-2])
def test_step_response_ends_before_the_next_step(step: float) -> None:
    (trial,) = trials(BARE, "step", pressures_bar=[5], step=step)
    assert trial.metrics["force_up_n"] == pytest.approx(736, abs=0.5)
    assert trial.metrics["force_down_n"] == pytest.approx(-121.7, abs=0.5)
    for way in ("up", "down"):
        assert trial.metrics[f"pressure_{way}_delay_s"] == pytest.approx(0.005, abs=1e-9)
        assert trial.metrics[f"pressure_{way}_rise_s"] == pytest.approx(0.04, abs=1e-9)
        assert trial.metrics[f"pressure_{way}_settling_s"] == pytest.approx(0.0475, abs=1.01 * step)
        assert trial.metrics[f"force_{way}_overshoot_pct"] == pytest.approx(0.0, abs=1e-6)


def test_half_open_interval_excludes_its_end() -> None:
    time = np.arange(11) * 0.1
    whole = Recording({"time": time}, {"time": "s"})
    assert select_half_open_interval(whole, 0.2, 0.6)["time"] == pytest.approx([0.2, 0.3, 0.4, 0.5])
    assert select_half_open_interval(whole, 0.15, 0.65)["time"] == pytest.approx([0.2, 0.3, 0.4, 0.5, 0.6])
    assert select_closed_interval(whole, 0.2, 0.6)["time"] == pytest.approx([0.2, 0.3, 0.4, 0.5, 0.6])
    assert select_closed_interval(whole, 0.16, 0.64)["time"] == pytest.approx([0.2, 0.3, 0.4, 0.5, 0.6])


def test_step_response_metrics_follow_their_definitions() -> None:
    time = np.linspace(0.0, 2.0, 20001)
    told = compute_step_response(time, 3.0 - 2.0 * np.exp(-time / 0.1))
    assert told["rise_s"] == pytest.approx(0.1 * np.log(9), rel=1e-3)
    assert told["delay_s"] == pytest.approx(0.1 * np.log(1 / 0.9), rel=1e-2)
    assert told["settling_s"] == pytest.approx(0.1 * np.log(20), rel=1e-3)
    over = compute_step_response(time, 1.0 - np.exp(-time / 0.1) * np.cos(20 * time))
    assert over["overshoot_pct"] > 10
    assert np.isnan(compute_step_response(time, np.ones(len(time)))["rise_s"])


def test_first_order_lag_has_its_frequency_response() -> None:
    lagging = parse_device(BARE.content + b"[effects.pressure_lag]\ntime_constant_s = 0.05\n", "lagging")
    for trial in trials(lagging, "frequency", frequencies_hz=[1, 5, 10], step=1e-4):
        pace = 2 * np.pi * trial.conditions["frequency_hz"] * 0.05
        assert trial.metrics["pressure_gain"] == pytest.approx(1 / np.hypot(1, pace), rel=0.01)
        assert trial.metrics["pressure_phase_deg"] == pytest.approx(-np.degrees(np.arctan(pace)), abs=1.0)
        assert trial.metrics["pressure_coherence"] > 0.999
    for trial in trials(BARE, "frequency", frequencies_hz=[1, 10]):
        assert trial.metrics["pressure_gain"] == pytest.approx(1.0, abs=1e-6)
        assert trial.metrics["force_phase_deg"] == pytest.approx(0.0, abs=1e-3)


def test_sinusoid_fit_ignores_drift() -> None:
    time = np.arange(3000) * 1e-3
    found = fit_sinusoid(time, 2.0 + 0.5 * time + 3.0 * np.sin(2 * np.pi * 2 * time + 0.4), 2.0)
    assert (abs(found.phasor), np.angle(found.phasor), found.coherence) == pytest.approx((3.0, 0.4, 1.0))


def test_creep_needs_a_relaxing_element() -> None:
    short = {"times_s": [0.1, 1.0, 10.0], "pressures_bar": [3]}
    for device in (PAIR, BARE):
        assert of(trials(device, "creep", **short), "creep_pct_per_decade") == pytest.approx([0.0], abs=1e-6)
    (trial,) = trials(parse_device(BARE.content + RELAXING, "relaxing"), "creep", **short)
    assert abs(trial.metrics["creep_pct_per_decade"]) > 1.0
    # Of one decade it is what the force changes by.
    (trial,) = trials(parse_device(BARE.content + RELAXING, "relaxing"), "creep", times_s=[0.1, 1.0], pressures_bar=[3])
    first, second = (trial.metrics[f"force_at_{time}_s_n"] for time in ("0.1", "1"))
    assert trial.metrics["creep_pct_per_decade"] == pytest.approx(100.0 * (second - first) / first)


def test_release_stiffness_is_that_of_the_tendon() -> None:
    found = trials(PAIR, "quick-release", pressures_bar=[5])
    for trial in found:
        assert trial.metrics["force_lowest_n"] < trial.metrics["force_after_n"] < trial.metrics["force_before_n"]
        assert trial.metrics["recovery_s"] > 0.0
    assert all(np.diff(of(found, "force_lowest_n")) < 0)
    assert 60 < found[0].metrics["stiffness_n_per_mm"] < 200  # of the tendon's springs


def test_recovery_time_ends_at_90_percent() -> None:
    released = {
        plan.name: plan.event_times["released"]
        for plan in protocols_library.load_protocol("quick-release").plan_trials(PAIR)
    }
    for trial in trials(PAIR, "quick-release"):
        low, last = trial.metrics["force_lowest_n"], trial.metrics["force_after_n"]
        time, force = trial.recording["time"], trial.recording["force"]
        share = (force - low) / (last - low)
        back = int(np.searchsorted(time, released[trial.name] + trial.metrics["recovery_s"] - 1e-9))
        assert share[back - 1] < 0.9 <= share[back], trial.name


def test_different_trials_have_different_names() -> None:
    update = {"pressures_bar": [5], "release_ratios": [0.04, 0.0401, 0.04000001]}
    assert len({trial.name for trial in trials(PAIR, "quick-release", **update)}) == 3
    assert {t.name for t in trials(PAIR, "quick-release", pressures_bar=[5], release_ratios=[0.04])} == {"5bar_10mm"}


@pytest.mark.parametrize("device", [PAIR, BARE], ids=lambda d: d.name)
def test_mujoco_and_device_only_agree_at_the_reached_length(device: Device) -> None:
    p, step = device.parameters, 5e-4
    time = np.arange(1600) * step
    long = p.tendon.slack_length + 0.98 * p.muscle.resting_length
    length = long - 0.015 * np.sin(np.pi * np.minimum(time / 0.4, 1.0)) ** 2
    command = np.where(time < 0.3, 4e5, 1.5e5)
    start = compute_equilibrium_state(p, float(length[0]), 4e5)
    rig = tester.simulate_tester(device, length, command, step, initial_state=start)
    assert 1e-4 < np.abs(rig["length"] - rig["length_command"]).max() < 0.1
    same = device_only.simulate_device_only(device, 1e-3 * rig["length"], command, step, initial_state=start)
    for channel in ("force", "pressure", "muscle_length", "muscle_force", "damper_force", "gas_power", "damper_power"):
        scale = np.abs(rig[channel]).max()
        assert np.abs(rig[channel] - same[channel]).max() <= 1e-6 * scale, channel
    assert np.abs(rig["load_cell"] - rig["force"]).max() < 1e-6 * np.abs(rig["force"]).max()


def test_tester_metrics_agree_with_device_only() -> None:
    update = {"velocities_mm_per_s": [200], "pressures_bar": [4]}
    pairs = zip(trials(PAIR, "workloop", **update), trials(PAIR, "workloop", mujoco=True, **update), strict=True)
    for one, other in pairs:
        assert other.metrics["work_j"] == pytest.approx(one.metrics["work_j"], rel=5e-3)
        assert other.metrics["work_j"] != one.metrics["work_j"]
        assert abs(other.metrics["ledger_residual_j"]) < 0.02 * abs(other.metrics["work_j"])


def test_unit_length_gives_the_requested_muscle_length() -> None:
    for device in (PAIR, load_device("klute-1-1-4-pair")):
        for bar in (0.0, 2.0, 5.0):
            state = compute_equilibrium_state(device.parameters, unit_length(device, 0.95, bar * 1e5), bar * 1e5)
            if bar:
                assert state.length == pytest.approx(0.95 * device.parameters.muscle.resting_length, abs=1e-8)
    slack, rest = PAIR.parameters.tendon.slack_length, PAIR.parameters.muscle.resting_length
    assert unit_length(PAIR, 0.95, 0.0) == pytest.approx(slack + 0.95 * rest, abs=1e-12)


def test_decimation_keeps_ends_and_jumps() -> None:
    time = np.arange(20001) * 5e-4
    whole = device_only.simulate_device_only(BARE, np.full(20001, 0.17), np.where(time < 3.3335, 1e5, 4e5), 5e-4)
    kept = decimate_recording(whole)
    assert MAX_RECORDED_SAMPLES / 2 < len(kept) <= MAX_RECORDED_SAMPLES + 4
    assert kept["time"][[0, -1]].tolist() == whole["time"][[0, -1]].tolist()
    jump = np.flatnonzero(np.diff(kept["pressure_command"]))
    assert np.diff(kept["time"])[jump] == pytest.approx([5e-4])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("kind = ", "kind = 'stretch' #"), "kind = 'stretch' is refused; allowed: isometric, isokinetic"),
        (("dwell_s", "dwel_s"), r"unknown key 'dwel_s'; did you mean 'dwell_s'\? Allowed here: kind, name"),
        (("low_bar = 0.0\n", ""), "key 'low_bar' is missing"),
        (("velocities_mm_per_s = [1, 50, 100, 200]", "velocities_mm_per_s = [1, -5]"), "velocities_mm_per_s.2 = -5 is"),
        (("pressures_bar = [2, 3, 4, 5]", "pressures_bar = []"), r"pressures_bar = \[\] is refused"),
        (('["concentric", "eccentric"]', '["phased"]'), "phases_pct and the activation 'phased' need each other"),
        (("short_muscle_ratio = 0.91", "short_muscle_ratio = 0.999"), "short_muscle_ratio must be less"),
        (("[sources]", '[sources]\nspeed = "x"'), r"\[sources\] refers to 'speed'"),
        (("kind", "kind ="), "is not valid TOML"),
    ],
)
def test_invalid_protocol_is_refused(change: tuple[str, str], says: str) -> None:
    text = protocols_library.read_protocol_bytes("workloop").decode().replace(*change, 1)
    with pytest.raises(InputError, match=says):
        protocols_library.parse_protocol(text.encode(), "mine.toml")


@pytest.mark.parametrize(
    ("name", "update", "says"),
    [
        ("workloop", {"pressures_bar": [6]}, "needs 6 bar, but the supply of 'klute-3-4-pair' has 5 bar"),
        ("workloop", {"velocities_mm_per_s": [900]}, "a velocity is 900 mm/s, but over 20 mm at 20 m/s2"),
        ("workloop", {"low_bar": 2}, "low_bar is 2; allowed: less than"),
        ("isometric", {"muscle_ratios": [0.5]}, r"muscle_ratio is 0\.5; allowed for 'klute-3-4-pair': 0\.608 to 1"),
        ("step", {"low_bar": 3.0}, "which changes nothing"),
        ("frequency", {"amplitude_bar": 4.0}, "needs 7 bar"),
        ("frequency", {"pressures_bar": [0.2]}, r"amplitude_bar is 0\.5"),
        ("quick-release", {"release_ratios": [0.04, 0.02, 0.04]}, "2 trials '3bar_10mm'; allowed: every value once"),
        ("isometric", {"pressures_bar": [3, 3.0]}, "the protocol has 2 trials '3bar_"),
        ("creep", {"times_s": [1.0, 1e5]}, "steps of 0.5 ms; allowed"),
    ],
)
def test_impossible_protocol_is_refused(name: str, update: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        trials(PAIR, name, **update)


@pytest.mark.parametrize("ratio", [0.1, 0.85, 0.995, 1.0])
def test_measurement_length_outside_the_stroke_is_refused(ratio: float) -> None:
    text = (
        protocols_library.read_protocol_bytes("isokinetic")
        .decode()
        .replace("muscle_ratios = [0.96]", f"muscle_ratios = [0.9, {ratio}]")
    )
    with pytest.raises(InputError, match=rf"a muscle_ratio is {ratio:g}.*\(0\.85 to 0\.995\)"):
        protocols_library.parse_protocol(text.encode(), "mine.toml")


def test_sinusoid_needs_ten_samples_per_period() -> None:
    says = r"time step is 10 ms, which is 2 samples per period at 50 Hz; allowed: up to 2 ms \(10 samples\)"
    with pytest.raises(InputError, match=says):
        trials(BARE, "frequency", step=1e-2)
    # At the limit the regulator's 100 bar/s show: 0.5 bar at 50 Hz requires 157 bar/s.
    for step in (1e-4, 2e-3):
        (trial,) = trials(BARE, "frequency", frequencies_hz=[50], step=step)
        assert trial.metrics["pressure_gain"] < 0.9


def test_progress_reaches_one() -> None:
    fractions: list[float] = []
    protocol = protocols_library.load_protocol("step")
    run_protocol(PAIR, protocol, use_mujoco=True, progress=lambda fraction, stage: fractions.append(fraction))
    assert fractions == sorted(fractions)
    assert fractions[-1] == pytest.approx(1.0)


def test_endless_protocol_is_refused() -> None:
    protocol = protocols_library.load_protocol("workloop-phased").model_copy(update={"velocities_mm_per_s": [1e-320]})
    with pytest.raises(InputError, match=r"the protocol takes inf time steps of 0\.5 ms; allowed: up to"):
        plan_protocol(PAIR, protocol, 5e-4)
