"""``klute-sim import`` and ``klute-sim export`` end to end."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from klute_sim.gait import reference, reference_folder
from klute_sim.mocap.formats import storage
from klute_sim.recording import parquet
from klute_sim.report.gait.table import collect_remarks
from tests import synthetic_gait
from tests.command_line import run


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with files of a synthetic gait, and with the reference ``me`` imported from them."""
    folder = tmp_path_factory.mktemp("lab")
    synthetic_gait.opensim(folder, synthetic_gait.Walker())
    process = run(
        "import", "ik.mot", "grf.mot", "id.sto", "--mass", "70", "--stature", "1.8", "--out", "me", cwd=folder
    )
    assert process.returncode == 0, process.stderr
    (folder / "terminal.txt").write_text(process.stdout)
    return folder


def test_folder_contains_metadata_and_log(lab: Path) -> None:
    assert {file.name for file in (lab / "me").iterdir()} == {
        "import.json",
        "reference.csv",
        "reference.toml",
        "strides_left.parquet",
        "strides_right.parquet",
    }
    metadata = tomllib.loads((lab / "me" / "reference.toml").read_text())
    assert (metadata["format"], metadata["side"], metadata["strides"]) == (reference_folder.FORMAT, "right", 3)
    assert (metadata["mass_kg"], metadata["stature_m"]) == (70.0, 1.8)
    assert metadata["stride_time_s"] == pytest.approx(1.1, abs=1e-3)
    assert metadata["speed_m_per_s"] == pytest.approx(1.2, abs=1e-3)
    assert metadata["filters"]["angles"] == "Butterworth, zero lag, order 4, 6 Hz"
    assert [source["file"] for source in metadata["source"]] == ["ik.mot", "grf.mot", "id.sto"]
    report = json.loads((lab / "me" / "import.json").read_text())
    assert report["files"][0]["sha256"] == metadata["source"][0]["sha256"]
    knee = next(e for e in report["channels"] if e["channel"] == "knee_angle" and e["side"] == "right")
    assert (knee["column"], knee["unit"], knee["sign"]) == ("knee_angle_r", "deg", 1)
    strides = parquet.load_recording(lab / "me" / "strides_right.parquet")
    assert len(strides) == 3 * 101
    assert np.all(np.diff(strides["time"]) > 0.0)
    assert strides["knee_angle"].max() == pytest.approx(64.4, abs=1.0)


def test_terminal_shows_log(lab: Path) -> None:
    output = (lab / "terminal.txt").read_text()
    for part in (
        "Files",
        "Channels",
        "knee_angle_r",
        "brakes first",
        "Derived: ",
        "3 strides of the right leg",
        "--reference me",
    ):
        assert part in output


def test_gait_uses_stride_time_mass_and_stature_of_folder(lab: Path) -> None:
    process = run("gait", "--reference", "me", "--strides", "1", "--step", "1", "--out", "walked", "--json", cwd=lab)
    assert process.returncode == 0, process.stderr
    options = parquet.load_recording(lab / "walked" / "recording.parquet").provenance["options"]
    assert (options["mass_kg"], options["stature_m"]) == (70.0, 1.8)
    assert options["stride_time_s"] == pytest.approx(1.1, abs=1e-3)
    summary = json.loads(process.stdout)
    assert summary["grf_vertical_tracking_rms_bw"] < 0.1
    assert (summary["reference"], summary["reference_speed_m_per_s"]) == ("me", pytest.approx(1.2, abs=1e-3))
    (walker,) = [sentence for sentence in collect_remarks(summary) if sentence.startswith("Subject")]
    assert walker.startswith("Subject: 70 kg, 1.8 m. Speed: ")
    assert "Reference gait: me, measured at 1.20 m/s" in walker


@pytest.mark.slow
def test_gait_options_override_folder(lab: Path) -> None:
    words = (
        "--mass",
        "80",
        "--stature",
        "1.7",
        "--stride-time",
        "1.2",
        "--strides",
        "1",
        "--step",
        "1",
        "--out",
        "other",
    )
    assert run("gait", "--reference", "me", *words, cwd=lab).returncode == 0
    options = parquet.load_recording(lab / "other" / "recording.parquet").provenance["options"]
    assert (options["mass_kg"], options["stature_m"], options["stride_time_s"]) == (80.0, 1.7, 1.2)


def test_recordings_are_refused_as_reference(lab: Path) -> None:
    (lab / "trial.c3d").write_bytes(b"\x02\x50\xff")
    for file, message in (
        ("trial.c3d", "import it first: klute-sim import trial.c3d --mass KG --out me, and give the folder"),
        ("me/strides_right.parquet", "give its folder instead: me"),
    ):
        process = run("gait", "--reference", file, cwd=lab)
        assert (process.returncode, len(process.stderr.splitlines())) == (2, 1)
        assert message in process.stderr


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "reference.toml cannot be read: No such file or directory; create such a folder with klute-sim import"),
        ("format = 1", "'format' is 1; allowed: 'klute-sim-reference/1'"),
        ("[", "is not valid TOML"),
        ('format = "klute-sim-reference/1"\nmass_kg = 70', "key 'stride_time_s' is missing"),
        ('format = "klute-sim-reference/1"\nmass_kg = 7\nstride_time_s = 1', "'mass_kg' = 7 is refused"),
        ('format = "klute-sim-reference/1"\nmass_kg = 70\nstride_time_s = true', "'stride_time_s' = True is refused"),
        ('format = "klute-sim-reference/1"\nmass_kg = 70\nstride_time_s = 1', "reference.csv cannot be read"),
    ],
)
def test_invalid_reference_folders_are_refused(text: str | None, message: str, tmp_path: Path) -> None:
    (tmp_path / "me").mkdir()
    if text is not None:
        (tmp_path / "me" / "reference.toml").write_text(text)
    process = run("gait", "--reference", "me", cwd=tmp_path)
    assert process.returncode == 2
    assert message in process.stderr
    assert len(process.stderr.splitlines()) == 1


@pytest.mark.slow
def test_exported_files_match_recording(lab: Path) -> None:
    assert run("gait", "--strides", "3", "--step", "1", "--out", "run", cwd=lab).returncode == 0
    formats = [word for kind in ("mot", "sto", "trc", "log", "csv", "parquet") for word in ("--format", kind)]
    process = run("export", "run", *formats, "--out", "out", cwd=lab)
    assert process.returncode == 0, process.stderr
    recording = parquet.load_recording(lab / "run" / "recording.parquet")

    def column(file: str, label: str) -> np.ndarray:
        lines = (lab / "out" / file).read_text().splitlines()
        end = lines.index("endheader")
        index = lines[end + 1].split("\t").index(label)
        return np.array([float(line.split("\t")[index]) for line in lines[end + 2 :]])

    assert "inDegrees=yes" in (lab / "out" / "angles.mot").read_text().splitlines()[:6]
    assert np.array_equal(column("angles.mot", "time"), recording["time"])
    assert np.array_equal(column("angles.mot", "ankle_angle_r"), recording["ankle_angle"])
    assert np.array_equal(column("angles.mot", "knee_angle_r"), recording["knee_angle"])
    assert np.array_equal(column("angles.mot", "hip_flexion_r"), -recording["thigh_angle"])
    assert np.array_equal(column("moments.sto", "ankle_angle_r_moment"), -recording["ankle_moment"])
    assert np.array_equal(column("moments.sto", "hip_flexion_r_moment"), -recording["hip_moment"])
    assert np.array_equal(column("moments.sto", "knee_angle_r_moment"), recording["knee_moment"])
    for label, channel in (("vx", "grf_forward"), ("vy", "grf_vertical")):
        assert np.array_equal(column("ground_reaction.mot", f"ground_force_{label}"), recording[channel])
    loaded = recording["grf_vertical"] > 20.0
    assert np.array_equal(column("ground_reaction.mot", "ground_force_px")[loaded], recording["cop_x"][loaded])
    table = pq.read_table(lab / "out" / "recording.parquet")
    assert np.array_equal(table.column("ankle_moment [N*m]").to_numpy(), recording["ankle_moment"])
    text = np.genfromtxt(lab / "out" / "recording.csv", delimiter=",", names=None, skip_header=1)
    assert np.array_equal(text[:, 0], recording["time"])
    heading = (lab / "out" / "log.csv").read_text().splitlines()[0].split(",")
    logged = np.genfromtxt(lab / "out" / "log.csv", delimiter=",", skip_header=1)
    assert len(heading) == 6
    for index, name in enumerate(heading):
        assert np.array_equal(logged[:, index], recording[name.split(" [")[0]]), name
    labels = (lab / "out" / "markers.trc").read_text().splitlines()[3].rstrip().split("\t")
    table_values = np.genfromtxt(lab / "out" / "markers.trc", delimiter="\t", skip_header=5)
    ankle, knee = (table_values[:, labels.index(name) :][:, :3] for name in ("R ANKLE", "R KNEE"))
    assert np.array_equal(table_values[:, 1], recording["time"])
    assert np.array_equal(ankle[:, 0], recording["ankle_x"])  # forward is x, and up is y
    assert np.array_equal(ankle[:, 1], recording["ankle_z"])
    inclination = np.degrees(np.arctan2(*(knee - ankle)[:, :2].T))
    assert np.abs(inclination - recording["shank_angle"]).max() < 1e-9


@pytest.mark.slow
def test_export_and_import_round_trip(lab: Path) -> None:
    if not (lab / "out").exists():
        test_exported_files_match_recording(lab)
    recording = parquet.load_recording(lab / "run" / "recording.parquet")
    second = recording.select(recording["stride"] == 2)
    for number, files in enumerate(
        (
            ("out/angles.mot", "out/ground_reaction.mot", "out/moments.sto"),
            ("out/markers.trc", "out/ground_reaction.mot"),
            ("run/recording.parquet",),
        )
    ):
        words = (
            "--mass",
            "75",
            "--ankle-zero",
            "file",
            "--out",
            f"back-{number}",
            "--cutoff",
            "0",
            "--load-cutoff",
            "0",
        )
        process = run("import", *files, *words, cwd=lab)
        assert process.returncode == 0, process.stderr
        back = reference.load_reference(lab / f"back-{number}")
        # its heel strike is the first contact of the prosthesis, shortly after that of the reference
        delay = second["gait_phase"][np.argmax(second["grf_vertical"] > 20.0)] / 100.0
        phase = second["gait_phase"] / 100.0 - delay
        middle = (phase > 0.1) & (phase < 0.9)
        for column, channel, tolerance in (
            ("ankle_dorsiflexion_deg", "ankle_angle", 0.6),
            ("knee_flexion_deg", "knee_angle", 0.6),
            ("shank_forward_deg", "shank_angle", 0.6),
        ):
            difference = back(column, phase[middle]) - second[channel][middle]
            assert np.sqrt(np.mean(difference**2)) < tolerance, (files, column)
        moment = 75.0 * back("ankle_plantarflexor_moment_nm_per_kg", phase[middle]) - second["ankle_moment"][middle]
        assert np.sqrt(np.mean(moment**2)) < 6.0, files


def test_mean_stride_of_import_is_exported(lab: Path) -> None:
    assert run("export", "me", "--side", "left", "--out", "stride", cwd=lab).returncode == 0
    angles = storage.read(lab / "stride" / "angles.mot")
    assert angles.time[-1] == pytest.approx(1.1, abs=1e-3)
    mean_stride = reference.load_reference(lab / "me")
    assert angles.columns["knee_angle_l"] == pytest.approx(mean_stride("knee_flexion_deg", np.linspace(0, 1, 101)))
    forces = storage.read(lab / "stride" / "ground_reaction.mot")
    assert forces.columns["ground_force_vy"].max() == pytest.approx(70 * 11.1, rel=0.03)
    process = run("export", "me", "--format", "trc", "--out", "points", cwd=lab)
    assert (process.returncode, len(process.stderr.splitlines())) == (2, 1)
    assert "which only runs of klute-sim gait have" in process.stderr
    assert not (lab / "points").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("none.c3d",), "none.c3d cannot be read: No such file or directory"),
        (("ik.xlsx",), "the suffix '.xlsx' is not supported"),
        (("ik.mot",), "no ground reaction of the right foot"),
        (("ik.mot", "grf.mot", "id.sto", "--mass", "7"), "mass is 7; allowed: 20 to 250 kg"),
        (("ik.mot", "grf.mot", "id.sto", "--cutoff", "60"), "cutoff is 60 Hz; allowed at a sampling rate of 100 Hz"),
        (("ik.mot", "grf.mot", "id.sto", "--map", "none.toml"), "none.toml cannot be read"),
        ((), "Missing argument 'FILES...'"),
    ],
)
def test_invalid_input_raises_one_sentence_and_leaves_no_folder(
    lab: Path, arguments: tuple[str, ...], message: str
) -> None:
    process = run("import", *arguments, "--out", "nothing", cwd=lab)
    assert process.returncode == 2
    assert message in process.stderr
    assert len(process.stderr.splitlines()) == 1
    assert not (lab / "nothing").exists()


def test_full_and_empty_folders_are_refused(lab: Path, tmp_path: Path) -> None:
    before = sorted((lab / "me").iterdir())
    process = run("import", "ik.mot", "grf.mot", "id.sto", "--out", "me", cwd=lab)
    assert process.returncode == 2
    assert "is not empty" in process.stderr
    assert sorted((lab / "me").iterdir()) == before
    process = run("export", str(tmp_path), cwd=tmp_path)
    assert process.returncode == 2
    assert "pass a folder of klute-sim gait or import" in process.stderr


def test_json_output_is_one_object(lab: Path) -> None:
    process = run("import", "ik.mot", "grf.mot", "id.sto", "--json", "--out", "again", cwd=lab)
    summary = json.loads(process.stdout)
    assert summary["run"] == "again"
    assert summary["mass_kg"] == pytest.approx(69.5, abs=0.3)
    assert any("--mass was not given" in sentence for sentence in summary["derived"])
    assert summary["peaks"]["ankle_moment_nm_per_kg"] == pytest.approx(1.43, abs=0.05)
