"""Walks with a prosthesis as datasets: what was exported comes back, and what is missing or odd is said."""

import json
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.controllers.pressure import load_default_profile
from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import Series
from klute_sim.device.device import load_device, parse_device
from klute_sim.diagnosis.experiments.gait import prepare_gait_trial
from klute_sim.errors import InputError
from klute_sim.gait.rig import rig
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.mocap import dataset_import, export
from klute_sim.mocap.dataset_import import DatasetOptions, ImportedDataset
from klute_sim.mocap.formats import storage, trc
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import mapping, time_sync
from klute_sim.mocap.prosthesis_trials import ProsthesisTrial
from klute_sim.mocap.strides import repeats
from klute_sim.recording import csv, parquet
from klute_sim.recording.recording import Recording
from tests import synthetic_gait as made
from tests.command_line import run

DEVICE = "klute-1-1-4-pair"
RAW = ImportOptions(motion_cutoff=0.0, load_cutoff=0.0, ankle_zero="file")
FILES = ("markers.trc", "ground_reaction.mot", "log.csv")
KINDS = ("mot", "sto", "trc", "log", "parquet")
SI = {"deg": np.pi / 180.0, "bar": 1e5, "m": 1.0, "N": 1.0, "N*m": 1.0}


def lab(folder: Path, recording: Recording, *, slow: int = 1, noise: float = 0.0) -> list[Path]:
    """What is exported of ``recording``; markers at every ``slow`` th sample, the log at every other, ``noise``."""
    random = np.random.default_rng(len(recording))
    folder.mkdir(parents=True, exist_ok=True)
    export.write_files(recording, "right", KINDS, folder)
    if slow > 1:
        markers = trc.read(folder / "markers.trc")
        positions = {
            n: p[::slow] + 3e-4 * noise * random.normal(size=p[::slow].shape) for n, p in markers.positions.items()
        }
        trc.write(trc.Markers(markers.time[::slow], positions), folder / "markers.trc")
        own = export.to_prosthesis_log(recording).select(slice(None, None, 2))
        scale = {"pressure": 0.01, "force": 5.0, "muscle_length": 5e-5, "ankle_angle": 0.1}
        seen = {n: s + noise * scale.get(n, 0.0) * random.normal(size=len(s)) for n, s in own.channels.items()}
        csv.write(Recording(seen, own.units), folder / "log.csv")
    return [folder / name for name in FILES]


def gathered(files: list[Path], options: ImportOptions = RAW, **more: object) -> ImportedDataset:
    return dataset_import.import_dataset(files, options, DatasetOptions(device=DEVICE, uncertainties={}, **more))  # type: ignore[arg-type]


def written(found: ImportedDataset, folder: Path) -> datasets.Dataset:
    folder.mkdir()
    dataset_import.write_dataset(found, folder)
    return datasets.load_dataset(folder)


def with_log(folder: Path, change: Callable[[str], str]) -> list[Path]:
    """The laboratory's files with the log's text changed."""
    text = (folder / "log.csv").read_text()
    (folder / "log.csv").write_text(change(text))
    return [folder / name for name in FILES]


@pytest.fixture(scope="module")
def walked() -> Recording:
    return rig.simulate_gait(load_device(DEVICE), load_default_profile(), GaitOptions(strides=3, dt=1e-3))


@pytest.mark.parametrize("files", [FILES, ("recording.parquet",)])
def test_what_was_exported_comes_back(files: tuple[str, ...], walked: Recording, tmp_path: Path) -> None:
    lab(tmp_path / "lab", walked)
    found = written(gathered([tmp_path / "lab" / name for name in files]), tmp_path / "data")
    (trial,) = found.trials
    own: dict[str, Series] = {**trial.prescribed, **trial.measured}
    moments = {"ankle_moment"} if "recording.parquet" in files else set()
    assert set(trial.measured) == {"ankle_angle", "force", "pressure", "muscle_length"} | moments
    for name, series in own.items():
        wanted = SI[walked.units[name]] * np.interp(series.time, walked["time"], walked[name])
        inside = np.isfinite(series.value)
        assert inside.any()
        assert series.value[inside] == pytest.approx(wanted[inside], rel=1e-9, abs=1e-9), name
        if name == "cop_x":
            assert np.array_equal(inside, np.interp(series.time, walked["time"], walked["grf_vertical"]) > 20.0)
    assert len(prepare_gait_trial(trial, "fit").foot_strikes) == 2


def test_every_file_keeps_its_own_clock(walked: Recording, tmp_path: Path) -> None:
    found = gathered(lab(tmp_path / "lab", walked, slow=5))
    (trial,) = written(found, tmp_path / "data").trials
    own = {**trial.prescribed, **trial.measured}
    rates = {name: round(1.0 / series.sampling_interval) for name, series in own.items()}
    assert rates["shank_angle"] == rates["ankle_z"] == 200
    assert rates["grf_vertical"] == rates["cop_x"] == 1000
    assert rates["pressure_command"] == rates["force"] == rates["ankle_angle"] == 500
    assert {file.name for file in trial.files} == {"walk_01_motion.csv", "walk_01_load.csv", "walk_01_log.csv"}
    assert any("less than 10 ms apart" in sentence for sentence in found.log.derived)


def test_files_of_one_name_are_told_apart_by_their_folder(walked: Recording, tmp_path: Path) -> None:
    later = Recording(
        {n: s + (n == "time") for n, s in walked.channels.items()}, walked.units, walked.provenance
    )  # which is another file, and the same walk
    found = gathered([*lab(tmp_path / "one", walked), *lab(tmp_path / "two", later)])
    assert [walk.files[0] for walk in found.trials] == ["one/markers.trc", "two/markers.trc"]
    assert found.groups == ("condition_1", "condition_1")
    assert not any("Repeats" in sentence for sentence in found.log.missing)
    apart = gathered([*lab(tmp_path / "one", walked), *lab(tmp_path / "two", later)], repeats=1)
    assert apart.groups == ("condition_1", "condition_2")
    assert any(sentence.startswith("Repeats: no walk is a second one") for sentence in apart.log.missing)


def test_clocks_that_differ_are_told_and_mended(walked: Recording, tmp_path: Path) -> None:
    files = lab(tmp_path / "lab", walked)
    own = export.to_prosthesis_log(walked)
    late = {n: s - 0.05 if n == "time" else s for n, s in own.channels.items()}
    csv.write(Recording(late, own.units), tmp_path / "lab" / "log.csv")
    (doubt,) = [s for s in gathered(files).log.warnings if "clock" in s]
    assert "are most alike 50 ms apart" in doubt
    assert "'\"log.csv\" = 0.05'" in doubt
    (tmp_path / "map.toml").write_text('[clock]\n"log.csv" = 0.05\n')
    mended = gathered(files, replace(RAW, mapping=mapping.read(tmp_path / "map.toml")))
    assert any("less than 10 ms apart" in sentence for sentence in mended.log.derived)
    assert mended.trials[0].channels["force"].time == pytest.approx(walked["time"], abs=1e-9)
    (tmp_path / "map.toml").write_text('[clock]\n"other.csv" = 0.05\n')
    with pytest.raises(InputError, match=r"\[clock\] names 'other.csv', which is none of the files"):
        gathered(files, replace(RAW, mapping=mapping.read(tmp_path / "map.toml")))


def test_two_clocks_are_held_against_each_other() -> None:
    time = np.arange(0.0, 4.0, 0.01)
    wave = time_sync.Signal(time, np.sin(5.0 * time) + 0.3 * np.sin(11.0 * time))
    found = time_sync.estimate_lag(time_sync.Signal(time - 0.12, wave.value), wave)
    assert found is not None
    assert found[0] == pytest.approx(0.12, abs=time_sync.LAG_STEP)
    assert found[1] > 0.999
    assert time_sync.estimate_lag(time_sync.Signal(time[:150], wave.value[:150]), wave) is None


def test_columns_are_named_and_turned_by_the_user(walked: Recording, tmp_path: Path) -> None:
    lab(tmp_path / "lab", walked)
    lines = (tmp_path / "lab" / "log.csv").read_text().splitlines()
    lines[0] = "time [s],u,P1,F,muscle_length [m],ankle_angle [deg]"
    rows = [line.split(",") for line in lines[1:]]
    body = [",".join([r[0], r[1], repr(100.0 * float(r[2])), repr(-float(r[3])), *r[4:]]) for r in rows]
    files = with_log(tmp_path / "lab", lambda _: "\n".join([lines[0], *body]) + "\n")
    (tmp_path / "map.toml").write_text(
        '[prosthesis]\npressure_command = { column = "u", unit = "bar" }\n'
        'pressure = { column = "P1", unit = "kPa" }\nforce = { column = "F", unit = "N", sign = -1 }\n'
    )
    own = gathered(files, replace(RAW, mapping=mapping.read(tmp_path / "map.toml"))).trials[0].channels
    assert own["pressure"].value == pytest.approx(walked["pressure"], abs=1e-9)
    assert own["force"].value == pytest.approx(walked["force"], abs=1e-9)
    assert own["muscle_length"].value == pytest.approx(1e3 * walked["muscle_length"], abs=1e-9)


def test_what_looks_wrong_is_told(walked: Recording, tmp_path: Path) -> None:
    lab(tmp_path / "lab", walked)
    own = export.to_prosthesis_log(walked)
    odd = {**own.channels, "pressure": own["pressure"] + 1.013, "force": -own["force"]}
    csv.write(Recording(odd, own.units), tmp_path / "lab" / "log.csv")
    told = gathered([tmp_path / "lab" / name for name in FILES]).log.warnings
    assert any("1.01 bar above what was commanded: is it absolute?" in sentence for sentence in told)
    assert any("the force is mostly negative" in sentence for sentence in told)


def test_what_no_plate_carried_is_cut_off(walked: Recording, tmp_path: Path) -> None:
    longer = rig.simulate_gait(load_device(DEVICE), load_default_profile(), GaitOptions(strides=5, dt=1e-3))
    files = lab(tmp_path / "lab", longer)
    force = storage.read(files[1])
    seen = ~((force.time > 0.9) & (force.time < 2.0))  # the second step was beside the plates
    columns = {n: s if n == "time" else s * seen for n, s in force.columns.items()}
    storage.write(storage.Storage(columns, False), files[1])
    found = gathered(files)
    (walk,) = found.trials
    assert len(walk.foot_strikes) == 3
    begin = walk.channels["shank_angle"].time[0]
    assert begin == pytest.approx(walk.foot_strikes[0] - 0.3, abs=2e-3)
    assert begin == walk.channels["force"].time[0]
    assert any("a step was on no plate" in sentence for sentence in found.log.warnings)


def test_the_command_makes_a_folder_that_stands_alone(walked: Recording, tmp_path: Path) -> None:
    words = [str(path) for path in lab(tmp_path / "lab", walked, slow=5)]
    (tmp_path / "mine.toml").write_bytes(load_device(DEVICE).content.replace(b"klute-1-1-4-pair", b"mine"))
    spread = ("--uncertain", "muscle.c10_kpa=10 %", "--uncertain", "tendon.stiffness_1_n_per_mm=0.5")
    done = run("import", *words, "--dataset", "--device", "mine.toml", *spread, "--out", "data", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for part in ("Found", "Mapped", "Derived: ", "Trials", "condition_1", "Use: 1 to fit", "klute-sim diagnose data"):
        assert part in done.stdout
    (tmp_path / "mine.toml").unlink()
    found = datasets.load_dataset(tmp_path / "data")
    assert found.device.name == "mine"
    assert found.uncertainties["tendon.stiffness_1_n_per_mm"] == 0.5
    assert found.uncertainties["muscle.c10_kpa"] == pytest.approx(
        0.1 * load_device(DEVICE).spec.collect_values()["muscle.c10_kpa"]
    )
    assert found.remarks == ()
    told = json.loads((tmp_path / "data" / "import.json").read_text())
    (trial,) = told["trials"]
    assert trial["of"] == [*FILES]
    assert trial["strides"] == 1
    assert trial["command_peak_bar"] == pytest.approx(walked["pressure_command"].max(), abs=0.01)
    assert told["split"]["fit"] == ["walk_01_motion+walk_01_load+walk_01_log"]
    assert told["found"][0]["sha256"]


def test_gaps_of_the_pressure_centre_are_bridged_or_told(walked: Recording, tmp_path: Path) -> None:
    for gap, told in ((0.1, None), (0.3, "the centre of pressure is not known for")):
        hole = (walked["time"] > 0.3) & (walked["time"] < 0.3 + gap)
        holed = {n: np.where(hole, np.nan, s) if n == "cop_x" else s for n, s in walked.channels.items()}
        parquet.write(Recording(holed, walked.units, walked.provenance), tmp_path / "recording.parquet")
        if told is None:
            own = gathered([tmp_path / "recording.parquet"]).trials[0].channels["cop_x"]
            assert own.value[hole] == pytest.approx(walked["cop_x"][hole], abs=5e-3)
        else:
            with pytest.raises(InputError, match=told):
                gathered([tmp_path / "recording.parquet"])


def _without(*names: str) -> Callable[[Path], list[Path]]:
    return lambda folder: [folder / name for name in FILES if name not in names]


def _no_point(folder: Path) -> list[Path]:
    force = storage.read(folder / "ground_reaction.mot")
    columns = {n: s for n, s in force.columns.items() if "_p" not in n}
    storage.write(storage.Storage(columns, False), folder / "ground_reaction.mot")
    return [folder / name for name in FILES]


def _backward(folder: Path) -> list[Path]:
    force = storage.read(folder / "ground_reaction.mot")
    columns = {n: -s if n.endswith("vx") else s for n, s in force.columns.items()}
    storage.write(storage.Storage(columns, False), folder / "ground_reaction.mot")
    return [folder / name for name in FILES]


def _of_another_day(folder: Path) -> list[Path]:
    return with_log(
        folder,
        lambda text: text.splitlines()[0] + "".join(f"\n{9 + 0.01 * k},1,1,1,1,{k % 7}" for k in range(50)) + "\n",
    )


def _one_stride(folder: Path) -> list[Path]:
    return with_log(folder, lambda text: "\n".join(text.splitlines()[:1000]) + "\n")


@pytest.mark.parametrize(
    ("files", "says"),
    [
        (_without("log.csv"), "no pressure was commanded: add the prosthesis' own log"),
        (_without("markers.trc"), "nothing says how the right shank leans and where its ankle is: add the markers"),
        (_without("ground_reaction.mot"), "no ground reaction of the right foot"),
        (_no_point, "no centre of pressure of the right foot"),
        (_backward, "'forward' points backward"),
        (_of_another_day, "they share no time; say how far a file's clock is off under [clock]"),
        (_one_stride, "0 foot strikes after a swing, one stride after the other"),
        (
            lambda folder: with_log(folder, lambda text: text.replace("pressure [bar]", "pressure", 1)),
            "column 'pressure' has no unit; head it 'pressure [bar]'",
        ),
        (
            lambda folder: with_log(folder, lambda text: text.replace("pressure_command [bar]", "wish [bar]", 1)),
            "no pressure was commanded",
        ),
    ],
)
def test_what_is_missing_is_one_sentence_and_leaves_no_folder(
    files: Callable[[Path], list[Path]], says: str, walked: Recording, tmp_path: Path
) -> None:
    lab(tmp_path / "lab", walked)
    words = [str(path) for path in files(tmp_path / "lab")]
    done = run("import", *words, "--dataset", "--device", DEVICE, "--out", "data", cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--dataset",), "a dataset needs --device"),
        (("--dataset", "--device", "nobody"), "no device 'nobody'"),
        (("--dataset", "--device", DEVICE, "--cutoff", "6"), "--cutoff makes no sense with --dataset"),
        (("--dataset", "--device", DEVICE, "--repeats", "0"), "--repeats is 0; allowed: 1 or more"),
        (("--dataset", "--device", DEVICE, "--uncertain", "x"), "--uncertain 'x' is not of the form KEY=SPREAD"),
        (("--dataset", "--device", DEVICE, "--uncertain", "x=1"), "names 'x', which is no number of the device"),
        (("--dataset", "--device", DEVICE, "--uncertain", "muscle.c10_kpa=-1"), "allowed is a standard deviation"),
        (("--device", DEVICE), "--device goes with --dataset"),
        (("--repeats", "2"), "--repeats goes with --dataset"),
    ],
)
def test_options_that_do_not_fit(words: tuple[str, ...], says: str, tmp_path: Path) -> None:
    done = run("import", "none.c3d", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_both_legs_take_a_word_on_which(tmp_path: Path) -> None:
    trc.write(made.markers(made.Walker()), tmp_path / "both.trc")
    with pytest.raises(InputError, match=r"say which one wears the prosthesis \(--side right or left\)"):
        gathered([tmp_path / "both.trc"])


def test_a_capture_with_plates_and_a_log(tmp_path: Path) -> None:
    pytest.importorskip("ezc3d")
    walker = made.Walker()
    path = made.c3d(tmp_path, walker)
    angle = walker.of("ankle_dorsiflexion_deg", "left")
    rows = [f"{1e3 * t:.1f},1.5,{a:.6f}" for t, a in zip(walker.time, angle, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["time [ms],PressureSetpoint [bar],AnkleAngle [deg]", *rows]) + "\n")
    own = gathered([path, tmp_path / "log.csv"], replace(RAW, side="left")).trials[0].channels
    ankle = walker.points("left")["ANKLE"]
    for place, name in enumerate(("ankle_x", "ankle_z")):
        there = np.interp(own[name].time, walker.time, ankle[:, place])
        assert own[name].value == pytest.approx(there, abs=2e-3), name
    time, load = own["grf_vertical"]
    assert load == pytest.approx(np.interp(time, walker.time, walker.of("grf_vertical_n_per_kg", "left")), abs=15.0)
    pressing = load > 100.0
    there = np.interp(time, walker.time, walker.pressure_centre("left"))[pressing]
    assert np.abs(own["cop_x"].value[pressing] - there).max() < 5e-3
    assert own["ankle_angle"].value == pytest.approx(angle, abs=1e-5)
    assert np.all(own["pressure_command"].value == 1.5)


def walk_of(stride: float, bar: float) -> ProsthesisTrial:
    time = np.arange(0.0, 5.0 * stride, 0.01)
    asked = time_sync.Signal(time, bar * (1.0 + np.sin(2.0 * np.pi * time / stride)))
    return ProsthesisTrial("x", ("x",), {"pressure_command": asked}, stride * np.arange(5.0))


def test_no_name_of_a_file_gets_out_of_its_comment(tmp_path: Path) -> None:
    wanted = DatasetOptions(device="any", uncertainties={})
    text = dataset_import._format_toml(wanted, "any", [("one", ["a.csv"], ["odd\nrig = 'bench'.c3d"])])
    assert tomllib.loads(text)["rig"] == "gait"


def test_repeats_have_one_speed_and_one_profile() -> None:
    walks = [walk_of(1.1, 2.0), walk_of(1.13, 2.0), walk_of(1.2, 2.0), walk_of(1.1, 1.5), walk_of(1.1, 2.05)]
    assert repeats.group_repeats(walks) == [1, 1, 2, 3, 1]
    assert repeats.group_repeats(walks, 2) == [1, 1, 2, 2, 3]
    assert repeats.group_repeats([walk_of(1.1, 0.0), walk_of(1.1, 0.0)]) == [1, 1]


@pytest.mark.long
def test_a_hidden_effect_goes_through_a_laboratory_and_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Simulated, exported, seen by noisy instruments, imported, diagnosed."""
    monkeypatch.setenv("KLUTE_SIM_CACHE", str(tmp_path / "cache"))
    text = load_device(DEVICE).content.decode() + '\n[effects.seal_friction]\nform = "coulomb"\nforce_n = 40.0\n'
    hidden, words = parse_device(text.encode(), "hidden"), list[str]()
    for name, speed in (("a1", 1.2), ("a2", 1.21), ("b1", 1.0), ("b2", 1.01)):
        recording = rig.simulate_gait(hidden, load_default_profile(), GaitOptions(speed=speed, strides=4))
        words += [str(path) for path in lab(tmp_path / name, recording, slow=10, noise=1.0)]
    done = run("import", *words, "--dataset", "--device", DEVICE, "--out", "data", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    groups = [trial.group for trial in datasets.load_dataset(tmp_path / "data").trials]
    assert groups == ["condition_1", "condition_1", "condition_2", "condition_2"]
    looked = ("--only", "seal_friction", "--only", "pressure_lag", "--only", "sensor_gain")
    done = run("diagnose", "data", *looked, "--no-report", "--json", "--out", "found", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    verdict = json.loads(done.stdout)
    assert [one["name"] for one in verdict["effects"]] == ["seal_friction"]
    assert verdict["effects"][0]["parameters"]["force_n"]["value"] == pytest.approx(40.0, rel=0.05)
