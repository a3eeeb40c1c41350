"""``klute-sim gait`` end to end, as a user types it, and the same through the Python API."""

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.device.device import load_device
from klute_sim.recording import parquet
from tests.command_line import run, run_in_subprocess
from tests.report.figure_checks import check_figure

REQUIRED_KEYS = {
    "device", "mass_kg", "strides", "ankle_range_deg", "ankle_moment_peak_nm_per_kg", "ankle_power_peak_w_per_kg",
    "ankle_work_net_j_per_kg", "toe_off_pct", "grf_vertical_peaks_bw", "air_per_stride_g", "run",
}  # fmt: skip


@pytest.fixture(scope="module")
def default_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    folder = tmp_path_factory.mktemp("default")
    done = run("gait", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def test_json_has_the_required_keys_and_the_run_folder_all_files(default_run: tuple[Path, dict[str, object]]) -> None:
    folder, summary = default_run
    assert set(summary) >= REQUIRED_KEYS
    assert summary["device"] == "klute-1-1-4-pair"
    assert summary["strides"] == 5
    run_folder = folder / str(summary["run"])
    assert run_folder == folder / "runs" / "gait-001"
    expected = {"recording.parquet", "summary.json", "figure.png", "index.html", "device.toml"}
    if find_spec("rerun"):
        expected.add("recording.rrd")
    assert {file.name for file in run_folder.iterdir()} == expected == set(summary["files"])  # type: ignore[call-overload]
    assert json.loads((run_folder / "summary.json").read_text()) == summary
    # The file also states the alignment of the run, so that a further run of this prosthesis keeps it.
    saved, preset = load_device(run_folder / "device.toml"), load_device("klute-1-1-4-pair")
    alignment = {"mounting.alignment_deg": pytest.approx(summary["alignment_deg"], abs=1e-3)}
    assert saved.spec.collect_values() == preset.spec.collect_values() | alignment
    assert saved.parameters == preset.parameters
    assert (run_folder / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_recording_reproduces_the_metrics_of_the_summary(default_run: tuple[Path, dict[str, object]]) -> None:
    folder, summary = default_run
    recording = parquet.load_recording(folder / str(summary["run"]) / "recording.parquet")
    assert len(recording) == 5 * 2200
    last = recording.select(recording["stride"] > 1)
    peaks = [last.select(last["stride"] == k)["ankle_moment"].max() / 75 for k in (2, 3, 4, 5)]
    assert np.mean(peaks) == pytest.approx(summary["ankle_moment_peak_nm_per_kg"], rel=1e-12)
    assert recording.units["ankle_moment"] == "N*m"
    assert recording.provenance["device"]["sha256"] == load_device("klute-1-1-4-pair").digest


@pytest.mark.slow
def test_strides_are_printed_on_demand(tmp_path: Path) -> None:
    done = run("gait", "--strides", "2", "--step", "1", "--per-stride", "--out", "r", cwd=tmp_path, COLUMNS="80")
    summary, strides = done.stdout.split("stride by stride")
    heading, *rows = [line.split() for line in strides.splitlines() if line.strip()]
    assert heading == ["unit", "1", "2", "±", "sd"]
    assert max(map(len, strides.split("Run folder")[0].splitlines())) <= 80
    (toe_off,) = [row for row in rows if row[:1] == ["toe-off"]]
    stored = json.loads((tmp_path / "r" / "summary.json").read_text("utf-8"))["per_stride"]
    assert toe_off[3:5] == [f"{stride['toe_off_pct']:.1f}" for stride in stored]
    assert "stride by stride" not in summary


@pytest.mark.long
def test_same_command_writes_the_same_parquet_bits(tmp_path: Path) -> None:
    files = []
    for name in ("a", "b"):
        assert run("gait", "--strides", "1", "--out", name, "--json", cwd=tmp_path).returncode == 0
        files.append((tmp_path / name / "recording.parquet").read_bytes())
    assert files[0] == files[1]


@pytest.mark.slow
def test_table_states_what_is_tracked_and_the_csv_reads_back(tmp_path: Path) -> None:
    done = run("gait", "--strides", "1", "--out", "r", "--csv", cwd=tmp_path, COLUMNS="80")
    assert done.returncode == 0
    assert done.stdout.startswith("klute-1-1-4-pair: ankle power peaks at ")
    assert re.search(
        r"In stance, angle, moment and power are \d\.\d, \d\.\d and \d\.\d standard deviations from people", done.stdout
    )
    table = done.stdout.split("Subject:")[0].splitlines()[1:]
    assert max(map(len, table)) <= 80
    assert "Reference gait: able-bodied adults (Winter" in done.stdout
    assert "tracked, not predicted" in done.stdout
    assert "peak net moment" in done.stdout
    assert table[2].split() == ["unit", "human", "prosthesis", "difference"]
    recording = parquet.load_recording(tmp_path / "r" / "recording.parquet")
    lines = (tmp_path / "r" / "recording.csv").read_text().splitlines()
    assert lines[0].split(",")[0] == "time [s]"
    assert len(lines) == len(recording) + 1
    force = lines[0].split(",").index("force [N]")
    assert [float(line.split(",")[force]) for line in lines[1:]] == recording["force"].tolist()


@pytest.mark.long
def test_user_reference_without_deviations_and_user_profile(tmp_path: Path) -> None:
    from klute_sim.gait import reference

    text = (Path(reference.__file__).parent / "normative_gait.csv").read_text()
    rows = [line.split(",") for line in text.splitlines()]
    keep = [i for i, name in enumerate(rows[0]) if "_sd_" not in name]
    (tmp_path / "ref.csv").write_text("\n".join(",".join(row[i] for i in keep) for row in rows))
    (tmp_path / "p.csv").write_text("gait_pct,pressure_bar\n0,0.9\n30,2\n50,4\n65,1\n")
    arguments = ("--strides", "1", "--reference", "ref.csv", "--controller", "p.csv", "--out", "r", "--json")
    done = run("gait", *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["distance_to_reference"]["moment_distance_sd"]["stance_rms"] is None
    assert summary["reference"] == "ref.csv"
    assert summary["controller"]["name"] == "p.csv"


@pytest.mark.slow
def test_toe_catch_is_reported(tmp_path: Path) -> None:
    """At 3 bar the foot points down in swing, and without an alignment nothing lifts its toe."""
    arguments = ("--strides", "2", "--step", "1", "--controller", "constant:3", "--align", "0", "--out", "r")
    done = run("gait", *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "catches" in done.stdout or "trips" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--mass", "-75"], "mass is -75; allowed: 20 to 250 kg"),
        (["--mass", "nan"], "mass is nan"),
        (["--speed", "0"], "speed is 0; allowed: 0.4 to 2.5 m/s"),
        (["--strides", "0"], "strides is 0; allowed: 1 to 200"),
        (["--step", "7"], "step is 7; allowed: 0.01 to 1 ms"),
        (["--device", "nobody"], "no device 'nobody'"),
        (["--device", "klute-3-4"], "no [tendon] section"),
        (["--device", "bad.toml"], "unknown key 'muscle.weight'"),
        (["--reference", "none.csv"], "reference none.csv cannot be read"),
        (["--reference", "bad.toml"], "reference bad.toml"),
        (["--controller", "none.csv"], "pressure profile none.csv cannot be read"),
        (["--controller", "none.toml"], "state machine none.toml cannot be read"),
        (["--controller", "constant"], "needs a pressure in bar, as in constant:3.5"),
        (["--controller", "constant:-1"], "0 bar or more"),
        (["--controller", "off:1"], "off has no argument"),
        (["--controller", "pid"], "no controller 'pid'; allowed: profile, off"),
        (["--spring-foot", "100"], "stiffness of the spring foot is 100; allowed: 0.5 to 40 N.m/deg"),
        (["--spring-foot", "6", "--controller", "machine"], "a spring foot takes no pressure command"),
        (["--spring-foot", "6", "--device", "klute-1-1-4-pair"], "a spring foot replaces the device; leave out"),
        (["--slope", "45"], "slope is 45; allowed: -10 to 10 degrees"),
        (["--out", "full"], "output folder full is not empty"),
        (["--out", "bad.toml"], "is a file"),
        (["--out", "bad.toml/run"], "cannot be written"),
        (["--frobnicate"], "No such option"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_no_file(arguments: list[str], message: str, tmp_path: Path) -> None:
    text = load_device("klute-1-1-4-pair").content.decode().replace("count = 2", "count = 2\nweight = 3")
    (tmp_path / "bad.toml").write_text(text)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").touch()
    before = sorted(tmp_path.rglob("*"))
    done = run("gait", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.slow
def test_missing_rerun_is_named_and_all_other_files_are_written(tmp_path: Path) -> None:
    (tmp_path / "rerun").mkdir()
    (tmp_path / "rerun" / "__init__.py").write_text("raise ImportError('not here')")
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    arguments = ("--strides", "1", "--step", "1", "--learning-strides", "0", "--out", "r")
    done = run_in_subprocess("gait", *arguments, cwd=tmp_path, PYTHONPATH=paths)
    assert done.returncode == 0, done.stderr
    assert "pip install '.[rerun]'" in done.stderr
    names = {file.name for file in (tmp_path / "r").iterdir()}
    assert names == {"recording.parquet", "summary.json", "figure.png", "index.html", "device.toml"}
    done = run_in_subprocess("view", "r", cwd=tmp_path, PYTHONPATH=paths)
    assert done.returncode == 2
    assert "pip install '.[rerun]'" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_spring_foot_has_neither_device_nor_its_assumptions(tmp_path: Path) -> None:
    foot = ks.simulate_gait(spring_foot=6.0, strides=1, time_step=1e-3)
    assert foot.device is None
    assert foot.summary["device"] == "spring foot, 6 N·m/deg"
    assert set(foot.summary["assumptions"]) == {"spring foot", "prosthesis"}
    assert foot.summary["without_source"] == []
    assert "spring foot, 6 N·m/deg, stride 1" in str(foot)
    assert "actuator" not in str(foot)
    assert "klute" not in str(foot)
    saved = foot.save(tmp_path / "foot")
    assert not (saved / "device.toml").exists()
    assert len(foot.plot().axes) == 6
    with pytest.raises(ks.InputError, match="a spring foot replaces the device"):
        ks.simulate_gait("klute-1-1-4-pair", spring_foot=6.0)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_ctrl_c_leaves_no_half_written_run(tmp_path: Path) -> None:
    code = (
        "import os, signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a background job ignores the signal
        "from klute_sim.gait.rig.measurements import GaitMeasurements\n"
        "measure, calls = GaitMeasurements.measure, []\n"
        "def measure_and_interrupt(*arguments):\n"
        "    calls.append(1)\n"
        "    if len(calls) == 500: os.kill(os.getpid(), signal.SIGINT)\n"
        "    return measure(*arguments)\n"
        "GaitMeasurements.measure = measure_and_interrupt\n"
        "from klute_sim.cli import main\n"
        "main(['gait', '--strides', '1', '--step', '1', '--learning-strides', '0', '--out', 'r'])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 130
    assert done.stderr.strip() == "klute-sim: interrupted; no file was left half-written"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_full_disk_is_one_sentence_and_leaves_no_file(tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    code = (
        "import errno, sys\n"
        "from klute_sim.recording import parquet\n"
        "def write_half(recording, path):\n"
        "    path.write_bytes(b'half'); raise OSError(errno.ENOSPC, 'No space left on device')\n"
        "parquet.write_recording = write_half\n"
        "from klute_sim.cli import main\n"
        "main(['gait', '--strides', '1', '--step', '1', '--learning-strides', '0', '--out', 'r'])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "the disk is full" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_api_writes_the_same_files_and_metrics_as_the_command(
    default_run: tuple[Path, dict[str, object]], tmp_path: Path
) -> None:
    gait_run = ks.simulate_gait()
    folder, summary = default_run
    command_folder = folder / str(summary["run"])
    saved = gait_run.save(tmp_path / "r")
    assert {file.name for file in saved.iterdir()} == {file.name for file in command_folder.iterdir()}
    assert (saved / "recording.parquet").read_bytes() == (command_folder / "recording.parquet").read_bytes()
    assert {name: summary[name] for name in gait_run.metrics} == gait_run.metrics
    assert "ankle_work_net_j_per_kg" in gait_run.metrics
    assert repr(gait_run) == "GaitRun('klute-1-1-4-pair', 5 strides, 1.19 m/s)"
    assert "peak net moment" in str(gait_run)
    assert "<table>" in gait_run._repr_html_()
    figure = gait_run.plot()
    assert len(figure.axes) == 8
    check_figure(figure)


@pytest.mark.slow
def test_api_accepts_objects_names_and_paths(tmp_path: Path) -> None:
    (tmp_path / "device.toml").write_bytes(ks.load_device("klute-1-1-4-pair").content)
    devices = ("klute-1-1-4-pair", tmp_path / "device.toml", ks.load_device("klute-1-1-4-pair"))
    runs = [ks.simulate_gait(device, controller="off", strides=1, time_step=1e-3) for device in devices]
    assert len({gait_run.metrics["ankle_work_net_j_per_kg"] for gait_run in runs}) == 1
    with pytest.raises(ks.InputError, match="a spring foot takes no pressure command"):
        ks.simulate_gait(spring_foot=6.0, controller="machine")


def test_api_reports_progress() -> None:
    reports: list[tuple[float, str]] = []
    ks.simulate_gait(strides=1, time_step=1e-3, progress=lambda fraction, stage: reports.append((fraction, stage)))
    assert reports[-1][0] == 1.0
    assert all(0.0 <= fraction <= 1.0 for fraction, _ in reports)


@pytest.mark.slow
def test_foot_is_in_the_files_of_the_run(tmp_path: Path) -> None:
    done = run("gait", "--foot", "sach+shoe", "--strides", "1", "--step", "1", "--out", "mine", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["foot"] == "sach+shoe"
    saved = load_device(tmp_path / "mine" / "device.toml")
    assert saved.spec.describe_foot()["name"] == "sach+shoe"
    assert run("gait", "--foot", "sash", cwd=tmp_path).stderr.count("did you mean 'sach'?") == 1


@pytest.mark.slow
def test_spring_foot_has_the_heel_and_keel_of_a_foot(tmp_path: Path) -> None:
    options = {"spring_foot": 6.0, "strides": 1, "time_step": 1e-3, "learning_strides": 3}
    elastic, rigid = (ks.simulate_gait(foot=foot, **options) for foot in ("sach", None))  # type: ignore[arg-type]
    assert elastic.summary["foot"] == "sach"
    assert "foot.keel_loss_pct" in elastic.summary["assumptions"]
    assert elastic.metrics["ankle_range_deg"] != rigid.metrics["ankle_range_deg"]
    elastic.save(tmp_path / "run")
