"""The shipped baselines: their data, their conditions, their gait, and the table of the command."""

import json
import math
from functools import cache
from pathlib import Path

import pytest

from klute_sim.api.baselines import select_baselines
from klute_sim.baselines.library import load_baselines
from klute_sim.baselines.table import (
    FAST_SPEED_RATIO,
    SLOW_SPEED_RATIO,
    WalkingCondition,
    compute_strides_per_tank,
    create_conditions,
    plan_runs,
)
from klute_sim.cli.common import pair_devices_with_controllers
from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import DEFAULT_DEVICE, load_device
from klute_sim.errors import InputError
from klute_sim.gait.metrics import GaitMetrics, StrideMetrics, compute_gait_metrics
from klute_sim.gait.reference import MAX_GRF_TRACKING_RMS_BW
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.gait.subject import Subject
from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT
from klute_sim.parameter_sweep.evaluate import evaluate_case
from klute_sim.parameter_sweep.store import RESULTS_FOLDER
from tests.command_line import run
from tests.gait.reference_files import write_reference_folder

QUICK = ("--strides", "2", "--step", "1")


def test_every_baseline_has_a_description_and_an_origin() -> None:
    baselines = load_baselines()
    assert len({baseline.name for baseline in baselines}) == len(baselines) >= 8
    for baseline in baselines:
        assert baseline.description.endswith(".")
        assert len(baseline.origin) > 10
        assert (baseline.foot_stiffness is None) or baseline.controller.describe()["kind"] == "constant"
    stiffnesses = [baseline.foot_stiffness for baseline in baselines if baseline.foot_stiffness is not None]
    assert (min(stiffnesses), max(stiffnesses)) == (3.0, 15.0)
    with pytest.raises(InputError, match="there is no baseline 'x'; allowed: spring-foot-3"):
        load_baselines(("x",))


def test_conditions_are_ratios_of_the_reference_speed_and_slopes() -> None:
    (hand,) = load_baselines(("hand-tuned",))
    runs = plan_runs([hand], Subject(), 2, 1e-3)
    assert [planned.condition for planned in runs] == list(create_conditions())
    level, slower, faster, down, up = (planned.case.subject for planned in runs)
    assert level.speed is None
    assert level.slope_deg == 0.0
    assert slower.speed is not None
    assert faster.speed is not None
    assert faster.speed / slower.speed == pytest.approx(FAST_SPEED_RATIO / SLOW_SPEED_RATIO, rel=1e-4)
    options = simulate_gait(
        load_device(DEFAULT_DEVICE), load_default_profile(), GaitOptions(strides=1, dt=1e-3)
    ).provenance["options"]
    assert slower.speed == pytest.approx(SLOW_SPEED_RATIO * options["speed_m_per_s"], rel=1e-3)
    assert (down.slope_deg, up.slope_deg) == (-5.0, 5.0)


@pytest.mark.slow
def test_baseline_equals_a_gait_run_of_its_device_and_controller() -> None:
    (hand,) = load_baselines(("hand-tuned",))
    (planned,) = plan_runs([hand], Subject(), 2, 1e-3, [WalkingCondition("level")])
    metrics = evaluate_case(planned.case).metrics
    direct = compute_gait_metrics(
        simulate_gait(load_device(DEFAULT_DEVICE), load_default_profile(), GaitOptions(strides=2, dt=1e-3))
    )
    assert metrics["ankle_work_net [J/kg]"] == direct.mean(lambda s: s.ankle_work_net_j_per_kg)
    assert metrics["moment_distance [sd]"] == direct.mean(lambda s: s.moment_distance_sd.stance_rms)


def test_strides_per_tank_follow_from_the_usable_air() -> None:
    usable_g = 1e3 * (30e5 - 6e5) * 1e-3 / (AIR_GAS_CONSTANT * 293.15)
    assert compute_strides_per_tank(1.5) == math.floor(usable_g / 1.5)
    assert compute_strides_per_tank(0.0) is None
    assert compute_strides_per_tank(None) is None


@cache
def simulate_baseline(name: str) -> GaitMetrics:
    """Return the metrics at the fine time step, at which no search evaluated its points."""
    (baseline,) = load_baselines((name,))
    return compute_gait_metrics(simulate_gait(baseline.device, baseline.controller, GaitOptions(strides=2)))


def compute_objective(stride: StrideMetrics) -> float:
    """Return the objective of ``tune`` without its penalties, which are 0 here."""
    distances = [
        distance.stance_rms
        for distance in (stride.moment_distance_sd, stride.angle_distance_sd, stride.power_distance_sd)
    ]
    return sum(distance**2 for distance in distances if distance is not None) + 0.1 * stride.air_g


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hand-tuned", "tuned", "tuned-with-device"])
def test_actuated_ankle_is_closer_to_the_human_one_than_without_pressure(name: str) -> None:
    """Compare under equal load: the rig learns the path of each until its foot carries that of the reference."""
    metrics, passive = simulate_baseline(name), simulate_baseline("off")
    stride, passive_stride = metrics.strides[-1], passive.strides[-1]
    assert compute_objective(stride) < 0.67 * compute_objective(passive_stride)
    assert stride.ankle_work_net_j_per_kg > 0.1 > 0.0 > passive_stride.ankle_work_net_j_per_kg
    assert stride.ankle_power_peak_w_per_kg > 1.5 * passive_stride.ankle_power_peak_w_per_kg
    assert stride.muscle_ratio_max is not None
    assert stride.muscle_ratio_max < 0.99  # clear of the rest-length stop
    for each in (stride, passive_stride):
        assert each.grf_vertical_tracking_rms_bw < MAX_GRF_TRACKING_RMS_BW
        assert not each.touches_in_swing
        assert not each.contact_lost_in_stance


@pytest.mark.slow
def test_tuned_profile_is_closer_to_the_human_ankle_than_the_hand_tuned_one() -> None:
    tuned, hand = (simulate_baseline(name).strides[-1] for name in ("tuned", "hand-tuned"))
    assert compute_objective(tuned) < 0.8 * compute_objective(hand)


@pytest.mark.slow
def test_device_and_profile_that_were_tuned_together_reach_their_goals_but_for_the_last_of_the_moment() -> None:
    """The lever of a rigid sole grows in push-off, so the moment cannot come as close as the goal of 0.39."""
    tuned, hand = (simulate_baseline(name).strides[-1] for name in ("tuned-with-device", "hand-tuned"))
    assert tuned.moment_distance_sd.stance_rms is not None
    assert hand.moment_distance_sd.stance_rms is not None
    assert tuned.moment_distance_sd.stance_rms < min(0.45, 0.8 * hand.moment_distance_sd.stance_rms)
    assert tuned.ankle_power_peak_w_per_kg > 3.31
    assert tuned.ankle_work_net_j_per_kg > 0.218
    assert tuned.ankle_plantarflexion_deg > 15.0


def test_device_of_the_tuning_uses_the_supply_of_the_preset() -> None:
    (baseline,) = load_baselines(("tuned-with-device",))
    assert baseline.device.parameters.supply.max_pressure <= 5e5


@pytest.mark.slow
@pytest.mark.usefixtures("in_process_runner")
def test_command_writes_the_table_and_can_be_resumed(tmp_path: Path) -> None:
    arguments = ("--only", "spring-foot-6", "--only", "machine", *QUICK, "--out", "b")
    done = run("baselines", *arguments, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["rows"]
    assert len(rows) == 2 * len(create_conditions())
    level = {row["baseline"]: row for row in rows if row["condition"] == "level"}
    assert level["machine"]["ankle_work_net [J/kg]"] > 0.1
    assert level["spring-foot-6"]["ankle_work_net [J/kg]"] < 0.0
    assert level["spring-foot-6"]["strides_per_tank [1]"] is None
    assert all(row["moment_distance [sd]"] is None for row in rows if row["condition"] != "level")
    assert not any(row["failure"] for row in rows)
    remarks = {row["baseline"]: row["remark"] for row in rows if row["condition"] == "level"}
    assert remarks == {"spring-foot-6": None, "machine": None}
    assert level["spring-foot-6"]["muscle_ratio_max [1]"] is None
    files = sorted((tmp_path / "b" / RESULTS_FOLDER).iterdir())
    resumed = run("baselines", *arguments, cwd=tmp_path)
    assert resumed.returncode == 0, resumed.stderr
    assert "5 degrees uphill" in resumed.stdout
    assert "strides" in resumed.stdout
    assert sorted((tmp_path / "b" / RESULTS_FOLDER).iterdir()) == files


@pytest.mark.slow
@pytest.mark.usefixtures("in_process_runner")
def test_own_controllers_of_an_imported_subject_stand_beside_the_baselines(tmp_path: Path) -> None:
    write_reference_folder(tmp_path / "me", mass=62.0, stature=1.66)
    load_device(DEFAULT_DEVICE).with_changes({"tendon.stiffness_1_n_per_mm": 90.0}).save(tmp_path / "my.toml")
    arguments = ("--reference", "me", "--only", "spring-foot-6", "--device", "my.toml", "--controller", "constant:2")
    arguments = (*arguments, "--slope", "3", "--strides", "1", "--step", "1", "--jobs", "1", "--out", "b")
    done = run("baselines", *arguments, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    names = ["spring-foot-6", "my.toml, constant:2"]
    assert list(dict.fromkeys(row["baseline"] for row in output["rows"])) == names
    assert sorted({row["slope [deg]"] for row in output["rows"]}) == [-3.0, 0.0, 3.0]
    assert (output["subject"]["mass_kg"], output["subject"]["stature_m"]) == (62.0, 1.66)
    refused = run("baselines", *arguments, "--mass", "70", cwd=tmp_path)
    assert refused.returncode == 2
    assert "output folder b holds another baselines (other mass, cases)" in refused.stderr


def test_own_alone_simulates_no_shipped_baseline() -> None:
    selected = select_baselines(["own"], [(DEFAULT_DEVICE, "off"), (load_device(DEFAULT_DEVICE), "profile")])
    assert [baseline.name for baseline in selected] == [f"{DEFAULT_DEVICE}, off", f"{DEFAULT_DEVICE}, profile"]
    assert [baseline.name for baseline in select_baselines(["own", "off"], [(DEFAULT_DEVICE, "machine")])] == [
        "off",
        f"{DEFAULT_DEVICE}, machine",
    ]


def test_devices_and_controllers_are_paired_in_order() -> None:
    assert pair_devices_with_controllers((), ()) == []
    assert pair_devices_with_controllers(("a", "b"), ("x", "y")) == [("a", "x"), ("b", "y")]
    assert pair_devices_with_controllers(("a",), ("x", "y")) == [("a", "x"), ("a", "y")]
    assert pair_devices_with_controllers(("a", "b"), ()) == [("a", "profile"), ("b", "profile")]
    assert pair_devices_with_controllers((), ("x",)) == [(DEFAULT_DEVICE, "x")]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "own"], "only 'own' is selected, but there is none"),
        (["--device", "a", "--device", "b", *(3 * ["--controller", "x"])], "allowed: equal numbers, or one of them"),
        (["--slope", "0"], "slope is 0; allowed: above 0, up to 10 degrees"),
        (["--reference", "nobody"], "reference nobody cannot be read"),
        (["--controller", "constant:9"], "the controller commands 9 bar"),
        (["--only", "x"], "there is no baseline 'x'"),
        (["--mass", "7"], "mass is 7; allowed: 20 to 250 kg"),
        (["--step", "0"], "step is 0; allowed: 0.01 to 1 ms"),
        (["--step", "nan"], "step is nan"),
        (["--strides", "0"], "strides is 0; allowed: 1 to 200"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_no_file(arguments: list[str], message: str, tmp_path: Path) -> None:
    done = run("baselines", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
