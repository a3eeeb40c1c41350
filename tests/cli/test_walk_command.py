"""``klute-sim walk`` end to end, as a user types it, and the same through the Python API."""

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.recording import parquet
from klute_sim.walker.reflexes.walker_file import list_walkers, load_walker
from tests.command_line import run


@pytest.fixture(scope="module")
def machine_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    folder = tmp_path_factory.mktemp("walk")
    done = run("walk", "--seconds", "8", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def test_default_walk_is_predicted_adapted_and_upright(machine_run: tuple[Path, dict[str, object]]) -> None:
    folder, summary = machine_run
    assert summary["kind"] == "predicted (planar reflex model)"
    assert summary["prosthesis"] == "klute-1-1-4-pair"
    assert not summary["is_acute"]
    assert not summary["has_fallen"]
    assert 1.0 < float(str(summary["speed_m_per_s"])) < 1.5
    assert float(str(summary["device_work_net_j"])) > 5.0
    run_folder = folder / "runs" / "walk-001"
    expected = {"recording.parquet", "summary.json", "figure.png", "index.html", "walker.toml", "device.toml"}
    if find_spec("rerun"):
        expected.add("recording.rrd")
    assert {file.name for file in run_folder.iterdir()} == expected == set(summary["files"])  # type: ignore[call-overload]
    assert json.loads((run_folder / "summary.json").read_text()) == summary
    assert load_walker(run_folder / "walker.toml").digest == summary["walker"]["sha256"]  # type: ignore[index]


def test_recording_holds_both_legs_and_the_device(machine_run: tuple[Path, dict[str, object]]) -> None:
    folder, summary = machine_run
    recording = parquet.load_recording(folder / str(summary["run"]) / "recording.parquet")
    assert len(recording) == 8000
    assert recording.provenance["rig"] == "walk"
    weight = recording.provenance["options"]["mass_kg"] * 9.81
    load = recording["grf_vertical_left"] + recording["grf_vertical_right"]
    assert load[2000:].mean() == pytest.approx(weight, rel=0.03)
    assert recording["grf_forward_left"].mean() + recording["grf_forward_right"].mean() == pytest.approx(
        0.0, abs=0.03 * weight
    )
    assert recording["pressure_command"].max() == pytest.approx(4.4)
    assert "activation_soleus_left" in recording
    assert "activation_soleus_right" not in recording


def test_same_walk_through_the_api_gives_the_same_bits(machine_run: tuple[Path, dict[str, object]]) -> None:
    folder, summary = machine_run
    walked = ks.simulate_walk(seconds=8.0)
    stored = parquet.load_recording(folder / str(summary["run"]) / "recording.parquet")
    for name in stored.channels:
        np.testing.assert_array_equal(walked.recording[name], stored[name], err_msg=name)
    assert "klute-1-1-4-pair" in repr(walked)
    assert "<table>" in walked._repr_html_()


def test_table_says_what_it_is_and_what_it_is_not(tmp_path: Path) -> None:
    done = run("walk", "--intact", "--seconds", "6", "--out", "r", "--csv", cwd=tmp_path, COLUMNS="90")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("intact person: walks 6 s and ")
    assert "predicted (planar reflex model)" in done.stdout
    assert "Bhargava" in done.stdout
    assert "adapted to this condition" in done.stdout
    assert "nothing is said about balance sideways" in done.stdout
    assert not (tmp_path / "r" / "device.toml").exists()
    lines = (tmp_path / "r" / "recording.csv").read_text().splitlines()
    assert len(lines) == 6001


@pytest.mark.slow
def test_other_command_is_acute_and_a_fall_is_reported(tmp_path: Path) -> None:
    done = run("walk", "--controller", "constant:5", "--walker", "machine-1", "--out", "r", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    assert summary["is_acute"]
    assert "The walk is acute" in done.stdout
    if summary["has_fallen"]:
        assert done.stdout.startswith("klute-1-1-4-pair: falls after ")
        assert len(parquet.load_recording(tmp_path / "r" / "recording.parquet")) < 20_000


def test_disturbances_reach_the_walk() -> None:
    free = ks.simulate_walk(intact=True, seconds=7.0)
    pushed = ks.simulate_walk(intact=True, seconds=7.0, push=(5.0, 30.0))
    assert pushed.recording["push"].max() == pytest.approx(50.0)
    assert "Push on the hip: +5 N·s at 30 % of the right leg's first stride after 5 s." in pushed.format_summary()
    short = list(ks.simulate_walk(intact=True, seconds=3.0).format_summary())
    assert all(isinstance(item, str) for item in short)  # no table without a stride
    assert short[1].startswith("No stride is complete after the first 3 s")
    same = free.recording["time"] < 5.0
    assert (free.recording["hip_x"][same[: len(free.recording)]] == pushed.recording["hip_x"][same]).all()
    uphill = ks.simulate_walk(intact=True, seconds=4.0, slope=2.0)
    assert uphill.recording["hip_x"][-1] < free.recording["hip_x"][3999]
    uneven = ks.simulate_walk(intact=True, seconds=4.0, uneven=5.0, seed=1)
    assert uneven.recording["hip_z"][3000] != free.recording["hip_z"][3000]


def test_spring_foot_has_no_command_and_no_device() -> None:
    walked = ks.simulate_walk(spring_foot=8.0, seconds=2.0)
    assert "pressure_command" not in walked.recording
    assert walked.summary["controller"] is None
    assert walked.device is None


def test_comparison_names_no_sign_from_one_walker_and_lists_falls() -> None:
    arguments = ("--walker", "machine-1", "--seconds", "5")
    done = run("walk", "compare", "machine", "machine", *arguments, "--json")
    assert done.returncode == 0, done.stderr
    same = json.loads(done.stdout)
    assert same["acute"] == same["falls"] == [[], []]
    assert all(d["difference"] == 0.0 and d["sign"] == 0 for d in same["differences"].values())
    done = run("walk", "compare", "machine", "spring-foot:40", *arguments)
    assert "Acute with spring-foot:40, not adapted to it: machine-1." in done.stdout
    assert "A sign is named only where" in done.stdout
    refused = run("walk", "compare", "machine", "spring-foot:soft", *arguments)
    assert refused.returncode == 2
    assert "needs a stiffness in N·m/deg, as in spring-foot:8" in refused.stderr


@pytest.mark.slow
def test_adapted_walkers_are_compared_as_groups_unless_the_change_is_acute() -> None:
    adapted = ks.compare_walks("machine", "off", seconds=4.0)
    assert not adapted.is_paired
    assert adapted.acute == ((), ())
    assert [len(names) for names in adapted.walkers] == [10, 10]
    assert not {*adapted.walkers[0]} & {*adapted.walkers[1]}
    acute = ks.compare_walks("machine", "off", walkers=adapted.walkers[0][:1], seconds=4.0)
    assert acute.is_paired
    assert acute.acute == ((), adapted.walkers[0][:1])
    assert "The same walkers walked under both conditions." in str(acute)
    assert "by the walkers that have adapted to it" in str(adapted)


def test_list_shows_all_shipped_walkers() -> None:
    done = run("walk", "list")
    assert done.returncode == 0
    for name in list_walkers():
        assert name in done.stdout


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--intact", "--spring-foot", "8"), "an intact person has no prosthesis; leave out the spring foot"),
        (("--spring-foot", "8", "--controller", "off"), "a spring foot replaces the device and takes no command"),
        (("--walker", "nobody"), "there is no walker 'nobody'"),
        (("--walker", "intact-1"), "walker intact-1 walks with two legs of flesh, not with a prosthesis"),
        (("--seconds", "0.1"), "duration is 0.1; allowed: 1 to 200 s"),
        (("--step", "2"), "time step is 2 ms; allowed: 0.01 to 1 ms"),
        (("--push", "hard"), "'hard' is no push; write the impulse"),
        (("--uneven", "80"), "unevenness is 80; allowed: 0 to 50 mm"),
        (("--device", "klute-1-1-4"), "cannot be built into an ankle"),
    ],
)
def test_refusal_is_one_sentence(arguments: tuple[str, ...], sentence: str, tmp_path: Path) -> None:
    done = run("walk", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert sentence in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_adaptation_writes_a_walker_that_walks_and_resumes(tmp_path: Path) -> None:
    arguments = ("walk", "adapt", "--intact", "--sigma", "0.02", "--jobs", "1", "--out", "mine", "--json")
    done = run(*arguments, "--evaluations", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    first = json.loads(done.stdout)
    costs = (tmp_path / "mine" / "costs.csv").read_text()
    assert first["search"]["evaluations"] == len(costs.splitlines()) - 1 == 16
    assert set(first["files"]) == {"adaptation.json", "costs.csv", "adapted.toml", "figure.png", "index.html"}
    again = json.loads(run(*arguments, "--evaluations", "16", cwd=tmp_path).stdout)
    assert again == first
    assert (tmp_path / "mine" / "costs.csv").read_text() == costs
    other = run(*arguments, "--seed", "5", cwd=tmp_path)
    assert other.returncode == 2
    assert "holds another adapt (other seed)" in other.stderr
    walked = run("walk", "--intact", "--walker", "mine/adapted.toml", "--seconds", "3", "--out", "r", cwd=tmp_path)
    assert walked.returncode == 0
    assert "Walker: adapted, adapted to this condition." in walked.stdout


def test_adaptation_refuses_before_a_folder_is_made(tmp_path: Path) -> None:
    done = run("walk", "adapt", "--speed", "4", cwd=tmp_path)
    assert done.returncode == 2
    assert "target speed is 4; allowed: 0.8 to 1.8 m/s" in done.stderr
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", list_walkers())
def test_every_shipped_walker_walks_a_minute_in_its_condition(name: str) -> None:
    condition = load_walker(name).condition
    arguments: dict[str, object] = {"intact": condition["prosthesis"] == "none"}
    if condition["prosthesis"] == "spring-foot":
        arguments["spring_foot"] = condition["stiffness_nm_per_deg"]
    elif condition["prosthesis"] == "device":
        arguments["controller"] = {"machine": "machine", "constant": "off"}[json.loads(condition["controller"])["kind"]]
    walked = ks.simulate_walk(walker=name, seconds=60.0, **arguments)  # type: ignore[arg-type]
    assert not walked.summary["is_acute"]
    assert not walked.outcomes.has_fallen
    assert walked.outcomes.speed_m_per_s == pytest.approx(1.25, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "condition"),
    [
        ("intact-1", {"intact": True}),
        ("machine-1", {}),
        ("off-1", {"controller": "off"}),
        ("spring-foot-1", {"spring_foot": 6.0}),
    ],
)
def test_shipped_walkers_bear_pushes_and_blocks(name: str, condition: dict[str, object]) -> None:
    """At least 9 of 10: pushes of 10 N.s forward and backward at four phases, and two grounds with 10 mm blocks."""
    disturbances: list[dict[str, object]] = [{"push": (i, p)} for i in (10.0, -10.0) for p in (0.0, 25.0, 50.0, 75.0)]
    disturbances += [{"uneven": 10.0, "seed": seed} for seed in (0, 1)]
    walks = [ks.simulate_walk(walker=name, seconds=15.0, **condition, **d) for d in disturbances]  # type: ignore[arg-type]
    assert sum(not walk.outcomes.has_fallen for walk in walks) >= 9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "bounds"),
    [
        ("intact-1", {"hip": 0.94, "knee": 0.97, "ankle": 0.85, "grf_vertical": 0.93, "grf_forward": 0.87}),
        ("machine-1", {"hip": 0.95, "knee": 0.95, "ankle": 0.85, "grf_vertical": 0.92, "grf_forward": 0.84}),
    ],
)
def test_intact_leg_of_a_shipped_walker_is_human_like(name: str, bounds: dict[str, float]) -> None:
    walked = ks.simulate_walk(walker=name, intact=name.startswith("intact"), seconds=30.0)
    likeness = walked.outcomes.legs["left"].likeness
    assert {curve: likeness[curve].correlation >= bound for curve, bound in bounds.items()} == dict.fromkeys(
        bounds, True
    )
