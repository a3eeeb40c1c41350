"""The baselines: data that say how they were made, and a table that is what their walks are."""

import json
import math
from pathlib import Path

import pytest

from klute_sim.baselines.library import load_baselines
from klute_sim.baselines.table import (
    CONDITIONS,
    FAST_SPEED_RATIO,
    SLOW_SPEED_RATIO,
    WalkingCondition,
    compute_strides_per_tank,
    plan_runs,
)
from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import DEFAULT_DEVICE, load_device
from klute_sim.errors import InputError
from klute_sim.gait.metrics import compute_gait_metrics
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT
from klute_sim.parameter_sweep.evaluate import evaluate_case as walk_combination
from klute_sim.report.gait.table import MAX_GRF_TRACKING_RMS_BW
from tests.command_line import run

QUICK = ("--strides", "2", "--step", "1")


def test_every_baseline_says_what_it_is_and_how_it_was_made() -> None:
    every = load_baselines()
    assert len({each.name for each in every}) == len(every) >= 8
    for each in every:
        assert each.description.endswith(".")
        assert len(each.origin) > 10
        assert (each.foot_stiffness is None) or each.controller.describe()["kind"] == "constant"
    stiffness = [each.foot_stiffness for each in every if each.foot_stiffness is not None]
    assert (min(stiffness), max(stiffness)) == (3.0, 15.0)
    with pytest.raises(InputError, match="there is no baseline 'x'; there are: spring-foot-3"):
        load_baselines(("x",))


def test_conditions_are_shares_of_the_own_speed_and_slopes_either_way() -> None:
    (hand,) = load_baselines(("hand-tuned",))
    found = plan_runs([hand], 75.0, 2, 1e-3)
    assert [each.condition for each in found] == list(CONDITIONS)
    level, slower, faster, down, up = (each.case for each in found)
    assert level.speed is None
    assert level.slope_deg == 0.0
    assert slower.speed is not None
    assert faster.speed is not None
    assert faster.speed / slower.speed == pytest.approx(FAST_SPEED_RATIO / SLOW_SPEED_RATIO, rel=1e-4)
    natural = simulate_gait(
        load_device(DEFAULT_DEVICE), load_default_profile(), GaitOptions(strides=1, dt=1e-3)
    ).provenance["options"]
    assert slower.speed == pytest.approx(SLOW_SPEED_RATIO * natural["speed_m_per_s"], rel=1e-3)
    assert (down.slope_deg, up.slope_deg) == (-5.0, 5.0)


def test_a_baseline_walks_as_its_device_does_under_its_controller() -> None:
    (hand,) = load_baselines(("hand-tuned",))
    (entry,) = plan_runs([hand], 75.0, 2, 1e-3, [WalkingCondition("level")])
    told = walk_combination(entry.case).metrics
    alone = compute_gait_metrics(
        simulate_gait(load_device(DEFAULT_DEVICE), load_default_profile(), GaitOptions(strides=2, dt=1e-3))
    )
    assert told["ankle_work_net [J/kg]"] == alone.mean(lambda s: s.ankle_work_net_j_per_kg)
    assert told["moment_distance [sd]"] == alone.mean(lambda s: s.moment_distance_sd.stance_rms)


def test_a_tank_holds_what_its_pressures_leave() -> None:
    held_g = 1e3 * (30e5 - 6e5) * 1e-3 / (AIR_GAS_CONSTANT * 293.15)
    assert compute_strides_per_tank(1.5) == math.floor(held_g / 1.5)
    assert compute_strides_per_tank(0.0) is None
    assert compute_strides_per_tank(None) is None


def test_the_tuned_profile_is_nearer_to_the_human_than_the_hand_tuned_by_a_third() -> None:
    """In squares of standard deviations, as the objective counts; at the fine step that nothing was tuned at."""
    found = {}
    for each in load_baselines(("hand-tuned", "tuned")):
        outcome = compute_gait_metrics(simulate_gait(each.device, each.controller, GaitOptions(strides=2)))
        distances = [
            outcome.mean(lambda s, n=name: getattr(s, n).stance_rms)  # type: ignore[misc]
            for name in ("moment_distance_sd", "angle_distance_sd", "power_distance_sd")
        ]
        air = outcome.mean(lambda s: s.air_g)
        assert air is not None
        found[each.name] = sum(d * d for d in distances if d is not None) + 0.1 * air
        assert not outcome.has_swing_contact
    assert found["tuned"] < 0.7 * found["hand-tuned"]


def test_tuned_with_its_device_the_ankle_is_the_humans() -> None:
    """The goals of ``tune --goal-human`` on at most 5 bar, at the fine step."""
    (each,) = load_baselines(("tuned-with-device",))
    outcome = compute_gait_metrics(simulate_gait(each.device, each.controller, GaitOptions(strides=2)))
    stride = outcome.strides[-1]
    assert stride.moment_distance_sd.stance_rms is not None
    assert stride.moment_distance_sd.stance_rms <= 0.4
    assert stride.ankle_power_peak_w_per_kg >= 3.3
    assert stride.ankle_work_net_j_per_kg >= 0.215
    assert stride.ankle_plantarflexion_deg >= 15.0
    assert each.device.parameters.supply.max_pressure <= 5e5
    assert stride.grf_vertical_tracking_rms_bw < MAX_GRF_TRACKING_RMS_BW
    assert stride.muscle_ratio_max is not None
    assert stride.muscle_ratio_max < 0.99  # it does not lean on its stop
    assert not outcome.has_swing_contact


def test_the_command_makes_the_table_and_goes_on(tmp_path: Path) -> None:
    asked = ("--only", "spring-foot-6", "--only", "machine", *QUICK, "--out", "b")
    done = run("baselines", *asked, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["rows"]
    assert len(rows) == 2 * len(CONDITIONS)
    level = {row["baseline"]: row for row in rows if row["condition"] == "level"}
    assert level["machine"]["ankle_work_net [J/kg]"] > 0.1
    assert level["spring-foot-6"]["ankle_work_net [J/kg]"] < 0.0
    assert level["spring-foot-6"]["strides_per_tank [1]"] is None
    assert all(row["moment_distance [sd]"] is None for row in rows if row["condition"] != "level")
    assert not any(row["failure"] for row in rows)
    followed = {row["baseline"]: row["remark"] for row in rows if row["condition"] == "level"}
    assert followed == {"spring-foot-6": "the load was not followed", "machine": None}
    assert level["spring-foot-6"]["muscle_ratio_max [1]"] is None
    kept = sorted((tmp_path / "b" / "walks").iterdir())
    shown = run("baselines", *asked, cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert "5 degrees uphill" in shown.stdout
    assert "strides" in shown.stdout
    assert sorted((tmp_path / "b" / "walks").iterdir()) == kept


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--only", "x"], "there is no baseline 'x'"),
        (["--mass", "7"], "mass is 7; allowed: 20 to 250 kg"),
        (["--step", "0"], "step is 0; allowed: 0.01 to 1 ms"),
        (["--step", "nan"], "step is nan"),
        (["--strides", "0"], "strides is 0; allowed: 1 to 200"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(arguments: list[str], says: str, tmp_path: Path) -> None:
    done = run("baselines", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
