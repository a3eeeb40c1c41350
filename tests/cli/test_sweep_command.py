"""``klute-sim sweep`` end to end, as a user types it."""

import csv
import json
import math
import os
import subprocess
import sys
from importlib import resources
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from klute_sim.controllers.parse import parse_controller
from klute_sim.device.device import load_device
from klute_sim.gait.metrics import compute_gait_metrics
from klute_sim.gait.reference import MAX_GRF_TRACKING_RMS_BW
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.parameter_sweep.store import RESULTS_FOLDER
from tests.command_line import run
from tests.gait.reference_files import write_reference_folder

ARGUMENTS = (
    *("--device", "klute-3-4", "--device", "klute-1-1-4-pair"),
    *("--controller", "constant:2", "--controller", "profile", "--speed", "1.1,reference", "--slope", "-4,0"),
    *("--mass", "60", "--strides", "1", "--step", "1", "--jobs", "1", "--out", "s"),
)


@pytest.mark.slow
def test_walks_are_swept_and_options_of_the_other_rig_are_refused(tmp_path: Path) -> None:
    arguments = (
        "--rig",
        "walk",
        "--machine",
        "push_off_bar=4.4",
        "--controller",
        "constant:3",
        "--walker",
        "machine-1",
    )
    done = run("sweep", *arguments, "--seconds", "1", "--jobs", "1", "--out", "w", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["rows"]
    assert [(row["controller"], row["acute"]) for row in rows] == [
        ("constant:3", True),
        ("machine, push_off_bar 4.4", False),
    ]
    assert {row["time_step [s]"] for row in rows} == {1e-3}
    for arguments, message in (
        (("--rig", "walk", "--mass", "60"), "--mass belongs to --rig gait; leave it out with --rig walk"),
        (("--walker", "machine-1"), "--walker belongs to --rig walk; leave it out with --rig gait"),
        (("--rig", "walk", "--machine", "push_off_bar"), "is not of the form push_off_bar=3.4,4.4"),
        (("--rig", "walk", "--machine", "push_off_bar=a"), "'a' is not a number"),
    ):
        refused = run("sweep", *arguments, cwd=tmp_path)
        assert refused.returncode == 2
        assert message in refused.stderr
        assert len(refused.stderr.splitlines()) == 1


@pytest.mark.slow
def test_joint_is_swept_over_gains_and_loads(tmp_path: Path) -> None:
    arguments = (
        "--rig",
        "joint",
        "--gain",
        "proportional=2,4",
        "--gain",
        "integral=0",
        "--load",
        "2",
        "--seconds",
        "0.1",
    )
    done = run("sweep", *arguments, "--episodes", "1", "--jobs", "1", "--out", "j", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["rows"]
    assert [(r["device"], r["proportional [1/rad]"], r["integral [1/(rad*s)]"], r["load [kg]"]) for r in rows] == [
        ("klute-3-4-pair", 2.0, 0.0, 2.0),
        ("klute-3-4-pair", 4.0, 0.0, 2.0),
    ]
    for arguments, message in (
        (("--rig", "joint", "--slope", "1"), "--slope belongs to --rig gait or walk; leave it out with --rig joint"),
        (("--gain", "proportional=1"), "--gain belongs to --rig joint; leave it out with --rig gait"),
        (("--rig", "joint", "--gain", "proportional"), "is not of the form proportional=2,4"),
        (("--rig", "joint", "--gain", "mean=1"), "the mean action is 1; allowed: above -1, below 1"),
    ):
        refused = run("sweep", *arguments, cwd=tmp_path)
        assert refused.returncode == 2
        assert message in refused.stderr
        assert len(refused.stderr.splitlines()) == 1


@pytest.fixture(scope="module")
def finished_sweep(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("sweep")
    done = run("sweep", *ARGUMENTS, "--csv", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return folder, json.loads(done.stdout)


@pytest.mark.slow
def test_table_holds_the_metrics_of_single_runs_bit_for_bit(finished_sweep: tuple[Path, dict[str, Any]]) -> None:
    folder, output = finished_sweep
    rows = pq.read_table(folder / "s" / "sweep.parquet").to_pylist()
    assert rows == output["rows"]
    assert [r["device"] for r in rows] == ["klute-3-4"] * 8 + ["klute-1-1-4-pair"] * 8
    rows = rows[8:]
    inputs = [(r["controller"], r["speed_requested [m/s]"], r["slope [deg]"]) for r in rows]
    assert inputs == [(c, v, s) for c in ("constant:2", "profile") for v in (1.1, None) for s in (-4.0, 0.0)]
    for row, (controller, speed, slope) in zip(rows, inputs, strict=True):
        options = GaitOptions(mass=60.0, speed=speed, slope=math.radians(slope), strides=1, dt=1e-3)
        recording = simulate_gait(load_device("klute-1-1-4-pair"), parse_controller(controller), options)
        metrics = compute_gait_metrics(recording)
        (stride,) = metrics.strides
        has_distances = speed is None and slope == 0.0
        assert row["speed [m/s]"] == recording.provenance["options"]["speed_m_per_s"]
        assert row["angle_distance [sd]"] == (stride.angle_distance_sd.stance_rms if has_distances else None)
        assert row["moment_distance [sd]"] == (stride.moment_distance_sd.stance_rms if has_distances else None)
        assert row["power_distance [sd]"] == (stride.power_distance_sd.stance_rms if has_distances else None)
        assert row["ankle_power_peak [W/kg]"] == stride.ankle_power_peak_w_per_kg
        assert row["ankle_work_net [J/kg]"] == stride.ankle_work_net_j_per_kg
        assert row["ankle_work_positive [J/kg]"] == stride.ankle_work_positive_j_per_kg
        assert row["ankle_moment_peak [N*m/kg]"] == stride.ankle_moment_peak_nm_per_kg
        assert row["ankle_range [deg]"] == stride.ankle_range_deg
        assert row["ankle_plantarflexion [deg]"] == stride.ankle_plantarflexion_deg
        assert row["energy_return [1]"] == stride.energy_return
        assert row["quasi_stiffness [N*m/kg/deg]"] == stride.quasi_stiffness_nm_per_kg_deg
        assert row["muscle_ratio_max [1]"] == stride.muscle_ratio_max
        assert row["toe_off [%]"] == stride.toe_off_pct
        assert row["rollover_radius [m]"] == stride.rollover_radius_m
        assert row["grf_vertical_tracking_rms [1]"] == stride.grf_vertical_tracking_rms_bw
        assert row["air_per_stride [g]"] == stride.air_g
        assert row["short_of_supply [%]"] == stride.short_of_supply_pct
        assert row["trips"] is metrics.has_swing_contact
        assert row["failure"] is None


@pytest.mark.slow
def test_unsuitable_device_is_a_row_with_the_reason(finished_sweep: tuple[Path, dict[str, Any]]) -> None:
    assert finished_sweep[1]["failed"] == 8
    for row in finished_sweep[1]["rows"][:8]:
        assert row["failure"].endswith("its file has no [tendon] section; did you mean 'klute-3-4-pair'?")
        assert row["toe_off [%]"] is None
        assert row["trips"] is None


@pytest.mark.slow
def test_csv_reads_back_and_the_plan_contains_the_inputs(finished_sweep: tuple[Path, dict[str, Any]]) -> None:
    folder, output = finished_sweep
    with (folder / "s" / "sweep.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(r["toe_off [%]"]) for r in rows[8:]] == [r["toe_off [%]"] for r in output["rows"][8:]]
    assert rows[0]["moment_distance [sd]"] == ""
    plan = json.loads((folder / "s" / "sweep.json").read_text())
    assert plan["devices"]["klute-1-1-4-pair"]["file"] == load_device("klute-1-1-4-pair").content.decode()
    assert plan["controllers"]["constant:2"] == {"kind": "constant", "pressure_bar": 2.0}
    files = {file.name for file in (folder / "s").iterdir()}
    assert files == {"index.html", "figure.png", "sweep.parquet", "sweep.csv", "sweep.json", RESULTS_FOLDER}


@pytest.mark.slow
def test_same_command_shows_the_table_without_simulating(
    finished_sweep: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    from klute_sim.parameter_sweep import local

    monkeypatch.setattr(local.LocalRunner, "run", lambda *_, **__: pytest.fail("a case was simulated"))
    done = run("sweep", *ARGUMENTS, cwd=finished_sweep[0], COLUMNS="220")
    assert done.returncode == 0, done.stderr
    assert done.stderr == "16 cases were already finished and were not simulated again.\n"
    assert "16 cases" in done.stdout
    assert "its file has no [tendon] section" in done.stdout
    assert "8 of 16 cases failed" in done.stdout
    assert "reference" in done.stdout
    assert "Sweep folder: s  (index.html, figure.png, sweep.csv, sweep.json, sweep.parquet)" in done.stdout


@pytest.mark.slow
@pytest.mark.usefixtures("in_process_runner")
def test_changed_reference_file_is_another_sweep(tmp_path: Path) -> None:
    text = (resources.files("klute_sim.gait") / "normative_gait.csv").read_text("utf-8")
    (tmp_path / "me.csv").write_text(text)
    inputs = ("sweep", "--reference", "me.csv", "--reference", "able-bodied", "--stature", "1.8", "--spring-foot", "6")
    small = ("--strides", "1", "--step", "1", "--jobs", "1", "--out", "s")
    done = run(*inputs, *small, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["rows"]
    assert [(r["device"], r["reference"], r["stature [m]"], r["failure"]) for r in rows] == [
        ("spring foot 6", "me.csv", 1.8, None),
        ("spring foot 6", "able-bodied", 1.8, None),
    ]
    column = "ankle_moment_peak [N*m/kg]"
    assert rows[0][column] == rows[1][column]  # the same gait under two names
    assert rows[0]["reference_sha256"] == rows[1]["reference_sha256"]
    assert rows[0]["air_per_stride [g]"] == 0.0
    (tmp_path / "me.csv").write_text(text + "\n")
    done = run(*inputs, *small, cwd=tmp_path)
    assert done.returncode == 2
    assert "output folder s holds another sweep (other references)" in done.stderr


@pytest.mark.slow
@pytest.mark.usefixtures("in_process_runner")
def test_several_subjects_have_a_row_each_with_their_own_numbers(tmp_path: Path) -> None:
    (tmp_path / "subjects").mkdir()
    bodies = {"anna": (58.0, 1.62), "ben": (81.0, 1.84)}
    for number, (name, (mass, stature)) in enumerate(bodies.items()):
        folder, stride_time = tmp_path / "subjects" / name, 1.05 + 0.05 * number
        write_reference_folder(folder, mass=mass, stature=stature, stride_time=stride_time)
    inputs = ("sweep", "--reference", "subjects/*", "--controller", "profile", "--controller", "constant:6")
    done = run(*inputs, "--strides", "1", "--step", "1", "--jobs", "1", "--out", "s", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["rows"]
    columns = ("reference", "mass [kg]", "stature [m]", "reference_stride_time [s]")
    expected = [
        (f"subjects{os.sep}{name}", *bodies[name], pytest.approx(1.05 + 0.05 * number))
        for number, name in enumerate(bodies)
    ]
    assert [tuple(row[column] for column in columns) for row in rows] == 2 * expected
    for row in rows:
        assert row["failure"] is None
        assert row["trips"] in (True, False)
        assert row["load_not_tracked"] == (row["grf_vertical_tracking_rms [1]"] > MAX_GRF_TRACKING_RMS_BW)
    # At a constant 6 bar the ankle hardly yields, and the rig does not learn every load.
    n_untracked = sum(row["load_not_tracked"] for row in rows[2:])
    assert n_untracked > 0
    assert not any(row["load_not_tracked"] for row in rows[:2])
    shown = run(*inputs, "--strides", "1", "--step", "1", "--jobs", "1", "--out", "s", cwd=tmp_path, COLUMNS="220")
    assert "not tracked" in shown.stdout
    assert f"In {n_untracked} of 4 cases the ankle does not carry the load of the reference" in shown.stdout
    other = run(*inputs, "--stride-time", "1.2", "--strides", "1", "--step", "1", "--out", "s", cwd=tmp_path)
    assert "output folder s holds another sweep (other stride)" in other.stderr


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_ctrl_c_keeps_finished_cases_and_names_the_folder(tmp_path: Path) -> None:
    code = (
        "import os, signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a background job ignores the signal
        "from klute_sim.parameter_sweep.store import ResultStore\n"
        "put = ResultStore.put\n"
        "def put_and_interrupt(*arguments):\n"
        "    put(*arguments)\n"
        "    os.killpg(0, signal.SIGINT)\n"  # as from a terminal: every process receives it
        "ResultStore.put = put_and_interrupt\n"
        "from klute_sim.cli import main\n"
        "main(['sweep', '--mass', '60,75,90', '--strides', '1', '--step', '1', '--jobs', '1', '--out', 's'])\n"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False, start_new_session=True, timeout=120
    )
    assert done.returncode == 130
    assert "the same command with --out s resumes there" in done.stderr
    assert done.stderr.strip().splitlines()[-1] == "klute-sim: interrupted; no file was left half-written"
    assert "Traceback" not in done.stderr
    assert len(list((tmp_path / "s" / RESULTS_FOLDER).iterdir())) == 1
    assert not (tmp_path / "s" / "sweep.parquet").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--device", "nobody"], "no device 'nobody'"),
        (["--controller", "pid"], "no controller 'pid'; allowed: profile, off, constant:BAR"),
        (["--controller", "constant:x"], "needs a pressure in bar"),
        (["--mass", "60,-75"], "mass is -75; allowed: 20 to 250 kg"),
        (["--stature", "3"], "stature is 3; allowed: 1"),
        (["--reference", "subjects/*"], "reference subjects/* matches no file or folder"),
        (["--stride-time", "1"], "a stride time requires a reference file"),
        (["--reference", "nobody"], "reference nobody cannot be read: No such file or directory"),
        (["--spring-foot", "x"], "'x' is not a number"),
        (["--mass", "60,,75"], "'' is not a number"),
        (["--mass", "reference"], "'reference' is not a number"),
        (["--speed", "fast"], "'fast' is not a number or 'reference'"),
        (["--speed", "nan"], "speed is nan"),
        (["--slope", "30"], "slope is 30; allowed: -10 to 10 degrees"),
        (["--strides", "0"], "strides is 0; allowed: 1 to 200"),
        (["--step", "7"], "step is 7; allowed: 0.01 to 1 ms"),
        (["--jobs", "-1"], "--jobs"),
        (["--jobs", "2", "--ray", "local"], "--jobs and --ray exclude each other"),
        (["--out", ""], "the path is empty"),
        (["--out", "full"], "output folder full is not empty and holds no sweep"),
        (["--out", "file"], "output folder file is a file"),
        (["--out", "file/s"], "output folder file/s cannot be written"),
        (["--out", "odd"], "sweep.json is not the plan of a sweep"),
        (["--out", "other"], "output folder other holds another sweep (other devices, controllers, references"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_no_file(arguments: list[str], message: str, tmp_path: Path) -> None:
    for name, text in (("full/x", ""), ("odd/sweep.json", "[]"), ("other/sweep.json", "{}"), ("file", "")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    before = sorted(tmp_path.rglob("*"))
    done = run("sweep", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""
    assert sorted(tmp_path.rglob("*")) == before
