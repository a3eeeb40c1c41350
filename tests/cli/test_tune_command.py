"""``klute-sim tune`` end to end with few short evaluations."""

import json
from pathlib import Path

import pytest

from klute_sim.controllers.pressure import load_profile
from klute_sim.device.device import load_device
from klute_sim.parameter_sweep.store import RESULTS_FOLDER
from klute_sim.viewer.layouts.tuning import EVALUATIONS_FILE
from tests.command_line import run
from tests.gait.reference_files import write_reference_folder

pytest.importorskip("cma")
SEARCH_FILES = RESULTS_FOLDER, "tuning.json"
"""Results of every search, whatever it tunes."""
pytestmark = pytest.mark.usefixtures("in_process_runner")


@pytest.mark.slow
def test_few_evaluations_reduce_the_objective_and_the_search_can_be_resumed(tmp_path: Path) -> None:
    arguments = ("tune", "--budget", "12", "--also", "tendon.stiffness_1_n_per_mm", "--jobs", "1", "--out", "t")
    done = run(*arguments, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert output["cost"]["tuned"] < output["cost"]["before"]
    assert output["evaluations"] >= 12
    assert output["files"] == sorted(
        ["device.toml", EVALUATIONS_FILE, "figure.png", "index.html", "tuned.csv", *SEARCH_FILES, "tune.json"]
    )
    assert {file.name for file in (tmp_path / "t").iterdir()} == set(output["files"])
    for key in ("before", "tuned"):
        assert sum(row[key] for row in output["objective"]) == pytest.approx(output["cost"][key], rel=1e-9)
    # The hand-tuned profile peaks 9 % too high, and the penalty of that is the first thing to fall.
    assert ", because the penalty of the peak moment" in output["headline"]
    variables = output["design_variables"]
    pressures = [variable["tuned"] for name, variable in variables.items() if name.startswith("pressure at")]
    assert sorted(load_profile(tmp_path / "t" / "tuned.csv").pressure_bar) == pytest.approx(sorted(pressures), abs=1e-4)
    device = load_device(tmp_path / "t" / "device.toml")
    tuned = device.spec.collect_values()["tendon.stiffness_1_n_per_mm"]
    assert tuned == pytest.approx(variables["tendon.stiffness_1_n_per_mm"]["tuned"], rel=1e-4)
    assert device.spec.sources["tendon.stiffness_1_n_per_mm"].startswith("assumed: found by klute-sim tune")
    rows = {row["name"]: row for row in output["table"]}
    for row in rows.values():
        assert row["before"] != row["tuned"]
    # So few evaluations correct the peak moment of the hand-tuned profile, which is too large and costs most.
    peak = rows["peak net moment [N·m/kg]"]
    assert abs(peak["tuned"] / peak["human"] - 1.0) < abs(peak["before"] / peak["human"] - 1.0)
    assert rows["peak net power [W/kg]"]["human"] == pytest.approx(3.29, abs=0.02)
    n_results = len(list((tmp_path / "t" / RESULTS_FOLDER).iterdir()))
    resumed = run(*arguments, cwd=tmp_path)
    assert resumed.returncode == 0, resumed.stderr
    assert len(list((tmp_path / "t" / RESULTS_FOLDER).iterdir())) == n_results
    assert "The objective fell by" in resumed.stdout
    assert "peak plantarflexion [deg]" in resumed.stdout


@pytest.mark.slow
def test_walks_are_tuned_and_options_of_the_other_rig_are_refused(tmp_path: Path) -> None:
    arguments = ("--rig", "walk", "--only", "push_off_bar", "--walker", "machine-1", "--seconds", "5", "--speed", "1.3")
    done = run("tune", *arguments, "--budget", "2", "--jobs", "1", "--out", "t", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert output["files"] == sorted(
        ["figure.png", "index.html", "tuned.toml", "walk_evaluations.csv", *SEARCH_FILES, "tune-walk.json"]
    )
    assert list(output["design_variables"]) == ["push_off_bar"]
    for arguments, message in (
        (("--rig", "walk", "--goal-human"), "--goal-human belongs to --rig gait; leave it out with --rig walk"),
        (("--rig", "walk", "--weight", "air=1"), "there is no weight 'air'; allowed: effort, speed, symmetry"),
        (("--walker", "machine-1"), "--walker belongs to --rig walk; leave it out with --rig gait"),
    ):
        refused = run("tune", *arguments, cwd=tmp_path)
        assert refused.returncode == 2
        assert message in refused.stderr
        assert len(refused.stderr.splitlines()) == 1


def test_gains_of_the_joint_are_tuned(tmp_path: Path) -> None:
    arguments = ("--rig", "joint", "--only", "proportional", "--gain", "integral=10", "--seconds", "0.1")
    options = ("--episodes", "1", "--budget", "2", "--jobs", "1", "--out", "t", "--json")
    done = run("tune", *arguments, *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert output["files"] == sorted(
        ["figure.png", "index.html", "joint_evaluations.csv", "tuned.toml", *SEARCH_FILES, "tune-joint.json"]
    )
    assert list(output["design_variables"]) == ["proportional"]
    assert "integral = 10" in (tmp_path / "t" / "tuned.toml").read_text()
    for arguments, message in (
        (("--rig", "joint", "--foot", "sach"), "--foot belongs to --rig gait or walk; leave it out with --rig joint"),
        (("--rig", "joint", "--gain", "integral"), "--gain is 'integral'; allowed: a name and a number"),
        (("--rig", "joint", "--only", "lean_deg"), "the PID controller has no gain 'lean_deg'"),
    ):
        refused = run("tune", *arguments, cwd=tmp_path)
        assert refused.returncode == 2
        assert message in refused.stderr


@pytest.mark.slow
def test_search_for_an_imported_subject_uses_its_numbers_and_refuses_another_subject(tmp_path: Path) -> None:
    write_reference_folder(tmp_path / "me", mass=62.0, stature=1.66, load_ratio=1.05)
    arguments = ("tune", "--reference", "me", "--budget", "1", "--jobs", "1", "--out", "t")
    done = run(*arguments, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert output["subject"]["reference"]["name"] == "me"
    assert (output["subject"]["mass_kg"], output["subject"]["stature_m"]) == (62.0, 1.66)
    assert len(output["assumptions"]) == 1
    assert "the reference states none" in output["assumptions"][0]
    rows = {row["name"]: row for row in output["table"]}
    assert rows["moment to human, stance rms [sd]"]["tuned"] > 0.0
    assert rows["peak net power [W/kg]"]["human"] == pytest.approx(1.05 * 3.29, abs=0.02)
    for options, names in (
        (["--mass", "70"], "other mass"),
        (["--stature", "1.7"], "other stature"),
        (["--speed", "1.1"], "other speed"),
        (["--slope", "2"], "other slope"),
        (["--stride-time", "1.2"], "other reference"),
    ):
        refused = run(*arguments, *options, cwd=tmp_path)
        assert refused.returncode == 2
        assert f"output folder t holds another tune ({names})" in refused.stderr


@pytest.mark.slow
def test_search_at_another_speed_on_a_slope_states_that_its_target_is_assumed(tmp_path: Path) -> None:
    done = run("tune", "--speed", "1.4", "--slope", "3", "--budget", "1", "--jobs", "1", "--out", "t", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Assumed: at 1.4 m/s and on a slope of 3 degrees" in done.stdout
    assert "no distance to the reference" not in done.stdout
    content = json.loads((tmp_path / "t" / "tuning.json").read_text())
    assert content["table"][0]["tuned"] is not None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--reference", "nobody"], "reference nobody cannot be read"),
        (["--stride-time", "1"], "a stride time requires a reference file"),
        (["--height", "1.8"], "there is no option --height"),
        (["--weight", "air"], "--weight is 'air'; allowed: a name and a number, such as air=0.5"),
        (["--weight", "oil=1"], "the objective has no term 'oil' to weight"),
        (["--also", "damper.colour"], "has no number 'damper.colour'"),
        (["--profile", "none.csv"], "pressure profile none.csv cannot be read"),
        (["--device", "nobody"], "no device 'nobody'"),
        (["--device", "klute-3-4"], "its file has no [tendon] section"),
        (
            ["--weight", "moment=0", "--weight", "angle=0", "--weight", "power=0", "--weight", "air=0"],
            "all weights are 0",
        ),
        (["--mass", "7"], "mass is 7; allowed: 20 to 250 kg"),
        (["--budget", "0"], "0"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_no_file(arguments: list[str], message: str, tmp_path: Path) -> None:
    done = run("tune", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
