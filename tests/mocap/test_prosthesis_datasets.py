"""Import of prosthesis trials as datasets: round trip of an export, and messages on missing or suspicious data."""

import json
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.controllers.pressure import load_default_profile
from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import TimeSeries
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
from tests import synthetic_gait
from tests.command_line import run

DEVICE = "klute-1-1-4-pair"
RAW = ImportOptions(motion_cutoff=0.0, load_cutoff=0.0, ankle_zero="file")
FILES = ("markers.trc", "ground_reaction.mot", "log.csv")
KINDS = ("mot", "sto", "trc", "log", "parquet")
SI = {"deg": np.pi / 180.0, "bar": 1e5, "m": 1.0, "N": 1.0, "N*m": 1.0}


def export_lab_files(
    folder: Path, recording: Recording, *, marker_decimation: int = 1, noise: float = 0.0
) -> list[Path]:
    """Export ``recording``; with ``marker_decimation``, markers and the log are decimated and get ``noise``."""
    random = np.random.default_rng(len(recording))
    folder.mkdir(parents=True, exist_ok=True)
    export.write_files(recording, "right", KINDS, folder)
    if marker_decimation > 1:
        markers = trc.read(folder / "markers.trc")
        positions = {
            n: p[::marker_decimation] + 3e-4 * noise * random.normal(size=p[::marker_decimation].shape)
            for n, p in markers.positions.items()
        }
        trc.write(trc.Markers(markers.time[::marker_decimation], positions), folder / "markers.trc")
        log = export.to_prosthesis_log(recording).select(slice(None, None, 2))
        scale = {"pressure": 0.01, "force": 5.0, "muscle_length": 5e-5, "ankle_angle": 0.1}
        noisy = {n: s + noise * scale.get(n, 0.0) * random.normal(size=len(s)) for n, s in log.channels.items()}
        csv.write(Recording(noisy, log.units), folder / "log.csv")
    return [folder / name for name in FILES]


def import_trials(files: list[Path], options: ImportOptions = RAW, **more: object) -> ImportedDataset:
    return dataset_import.import_dataset(files, options, DatasetOptions(device=DEVICE, uncertainties={}, **more))  # type: ignore[arg-type]


def write_and_load(imported: ImportedDataset, folder: Path) -> datasets.Dataset:
    folder.mkdir()
    dataset_import.write_dataset(imported, folder)
    return datasets.load_dataset(folder)


def edit_log(folder: Path, change: Callable[[str], str]) -> list[Path]:
    """Apply ``change`` to the text of the log; return the exported files."""
    text = (folder / "log.csv").read_text()
    (folder / "log.csv").write_text(change(text))
    return [folder / name for name in FILES]


@pytest.fixture(scope="module")
def gait_recording() -> Recording:
    return rig.simulate_gait(load_device(DEVICE), load_default_profile(), GaitOptions(strides=3, dt=1e-3))


@pytest.mark.slow
@pytest.mark.parametrize("files", [FILES, ("recording.parquet",)])
def test_export_and_import_round_trip(files: tuple[str, ...], gait_recording: Recording, tmp_path: Path) -> None:
    export_lab_files(tmp_path / "lab", gait_recording)
    imported = write_and_load(import_trials([tmp_path / "lab" / name for name in files]), tmp_path / "data")
    (trial,) = imported.trials
    channels: dict[str, TimeSeries] = {**trial.prescribed, **trial.measured}
    moments = {"ankle_moment"} if "recording.parquet" in files else set()
    assert set(trial.measured) == {"ankle_angle", "force", "pressure", "muscle_length"} | moments
    for name, series in channels.items():
        expected = SI[gait_recording.units[name]] * np.interp(series.time, gait_recording["time"], gait_recording[name])
        inside = np.isfinite(series.value)
        assert inside.any()
        # A load that begins in the last samples is below the threshold of the plate, and is read as none.
        compared = inside & (series.time < gait_recording["time"][-1] - 5e-3)
        assert series.value[compared] == pytest.approx(expected[compared], rel=1e-9, abs=1e-9), name
        if name == "cop_x":
            # The toe grazes the ground with 30 N for 6 ms after toe-off, which no plate tells from its noise.
            load = np.interp(series.time, gait_recording["time"], gait_recording["grf_vertical"])
            assert not inside[load <= 20.0].any()
            assert inside[load > 50.0].all()
    assert len(prepare_gait_trial(trial, "fit").foot_strikes) == 2


def test_files_keep_their_sampling_rates(gait_recording: Recording, tmp_path: Path) -> None:
    imported = import_trials(export_lab_files(tmp_path / "lab", gait_recording, marker_decimation=5))
    (trial,) = write_and_load(imported, tmp_path / "data").trials
    channels = {**trial.prescribed, **trial.measured}
    rates = {name: round(1.0 / series.sampling_interval) for name, series in channels.items()}
    assert rates["shank_angle"] == rates["ankle_z"] == 200
    assert rates["grf_vertical"] == rates["cop_x"] == 1000
    assert rates["pressure_command"] == rates["force"] == rates["ankle_angle"] == 500
    assert {file.name for file in trial.files} == {"walk_01_motion.csv", "walk_01_load.csv", "walk_01_log.csv"}
    assert any("with an offset below 10 ms" in sentence for sentence in imported.log.derived)


def remove_markers(path: Path, *names: str) -> None:
    markers = trc.read(path)
    positions = {name: position for name, position in markers.positions.items() if name[2:].lower() not in names}
    trc.write(trc.Markers(markers.time, positions), path)


@pytest.mark.slow
@pytest.mark.parametrize("removed", [("hip",), ("hip", "heel"), ("hip", "heel", "toe")])
def test_markers_of_the_shank_are_enough(removed: tuple[str, ...], gait_recording: Recording, tmp_path: Path) -> None:
    """A person with a prosthesis may wear markers on the prosthesis only."""
    files = export_lab_files(tmp_path / "lab", gait_recording)
    expected = import_trials(files).trials[0].channels
    remove_markers(files[0], *removed)
    if "heel" in removed:
        with pytest.raises(InputError, match=r"no foot was recognised .* or state forward and up under \[axes\]"):
            import_trials(files)
    axes = mapping.ImportMapping(axes={"forward": "x", "up": "y"})
    channels = import_trials(files, replace(RAW, mapping=axes)).trials[0].channels
    assert channels.keys() == expected.keys()
    for name, series in channels.items():
        assert series.value == pytest.approx(expected[name].value, nan_ok=True), name
    remove_markers(files[0], "knee")
    with pytest.raises(InputError, match=r"the right leg has no markers for knee; name them"):
        import_trials(files, replace(RAW, mapping=axes))


@pytest.mark.slow
def test_files_of_equal_names_are_distinguished_by_folder(gait_recording: Recording, tmp_path: Path) -> None:
    delayed = Recording(
        {n: s + (n == "time") for n, s in gait_recording.channels.items()},
        gait_recording.units,
        gait_recording.provenance,
    )  # another file with the same trial
    imported = import_trials(
        [*export_lab_files(tmp_path / "one", gait_recording), *export_lab_files(tmp_path / "two", delayed)]
    )
    assert [trial.files[0] for trial in imported.trials] == ["one/markers.trc", "two/markers.trc"]
    assert imported.groups == ("condition_1", "condition_1")
    assert not any("Repeats" in sentence for sentence in imported.log.missing)
    apart = import_trials(
        [*export_lab_files(tmp_path / "one", gait_recording), *export_lab_files(tmp_path / "two", delayed)],
        trials_per_group=1,
    )
    assert apart.groups == ("condition_1", "condition_2")
    assert any(
        sentence.startswith("Repeats: no two trials have the same pressures and speed")
        for sentence in apart.log.missing
    )


def test_clock_offset_is_reported_and_corrected_by_mapping(gait_recording: Recording, tmp_path: Path) -> None:
    files = export_lab_files(tmp_path / "lab", gait_recording)
    log = export.to_prosthesis_log(gait_recording)
    delayed = {n: s - 0.05 if n == "time" else s for n, s in log.channels.items()}
    csv.write(Recording(delayed, log.units), tmp_path / "lab" / "log.csv")
    (warning,) = [s for s in import_trials(files).log.warnings if "clock" in s]
    assert "correlate best with an offset of 50 ms" in warning
    assert "'\"log.csv\" = 0.05'" in warning
    (tmp_path / "map.toml").write_text('[clock]\n"log.csv" = 0.05\n')
    corrected = import_trials(files, replace(RAW, mapping=mapping.read(tmp_path / "map.toml")))
    assert any("with an offset below 10 ms" in sentence for sentence in corrected.log.derived)
    assert corrected.trials[0].channels["force"].time == pytest.approx(gait_recording["time"], abs=1e-9)
    (tmp_path / "map.toml").write_text('[clock]\n"other.csv" = 0.05\n')
    with pytest.raises(InputError, match=r"\[clock\] names 'other.csv', which is not an input file"):
        import_trials(files, replace(RAW, mapping=mapping.read(tmp_path / "map.toml")))


def test_lag_of_two_clocks_is_estimated() -> None:
    time = np.arange(0.0, 4.0, 0.01)
    wave = TimeSeries(time, np.sin(5.0 * time) + 0.3 * np.sin(11.0 * time))
    imported = time_sync.estimate_lag(TimeSeries(time - 0.12, wave.value), wave)
    assert imported is not None
    assert imported[0] == pytest.approx(0.12, abs=time_sync.LAG_STEP)
    assert imported[1] > 0.999
    assert time_sync.estimate_lag(TimeSeries(time[:150], wave.value[:150]), wave) is None
    unknown = TimeSeries(time, np.full(len(time), np.nan))  # of a marker that is listed but never visible
    assert time_sync.estimate_lag(unknown, wave) is time_sync.estimate_lag(wave, unknown) is None


def test_mapping_sets_columns_units_and_signs(gait_recording: Recording, tmp_path: Path) -> None:
    export_lab_files(tmp_path / "lab", gait_recording)
    lines = (tmp_path / "lab" / "log.csv").read_text().splitlines()
    lines[0] = "time [s],u,P1,F,muscle_length [m],ankle_angle [deg]"
    rows = [line.split(",") for line in lines[1:]]
    body = [",".join([r[0], r[1], repr(100.0 * float(r[2])), repr(-float(r[3])), *r[4:]]) for r in rows]
    files = edit_log(tmp_path / "lab", lambda _: "\n".join([lines[0], *body]) + "\n")
    (tmp_path / "map.toml").write_text(
        '[prosthesis]\npressure_command = { column = "u", unit = "bar" }\n'
        'pressure = { column = "P1", unit = "kPa" }\nforce = { column = "F", unit = "N", sign = -1 }\n'
    )
    channels = import_trials(files, replace(RAW, mapping=mapping.read(tmp_path / "map.toml"))).trials[0].channels
    assert channels["pressure"].value == pytest.approx(gait_recording["pressure"], abs=1e-9)
    assert channels["force"].value == pytest.approx(gait_recording["force"], abs=1e-9)
    assert channels["muscle_length"].value == pytest.approx(1e3 * gait_recording["muscle_length"], abs=1e-9)


def test_mapping_sets_positions(gait_recording: Recording, tmp_path: Path) -> None:
    names = {"cop_x": "Druckpunkt", "ankle_x": "Px", "ankle_z": "Pz"}
    renamed = (
        {names.get(n, n): s for n, s in each.items()} for each in (gait_recording.channels, gait_recording.units)
    )
    file = tmp_path / "recording.parquet"
    parquet.write_recording(Recording(*renamed, gait_recording.provenance), file)
    lines = [f'{channel} = "{column} [m]"' for channel, column in names.items()]
    for line, channel in zip(lines, names, strict=True):
        (tmp_path / "map.toml").write_text("\n".join(["[right]", *(each for each in lines if each != line)]))
        with pytest.raises(InputError, match=rf"name a column of {channel} in a file for --map, under \[right\]"):
            import_trials([file], replace(RAW, mapping=mapping.read(tmp_path / "map.toml")))
    (tmp_path / "map.toml").write_text("\n".join(["[right]", *lines]))
    channels = import_trials([file], replace(RAW, mapping=mapping.read(tmp_path / "map.toml"))).trials[0].channels
    for name in ("ankle_x", "ankle_z"):
        assert channels[name].value == pytest.approx(gait_recording[name], abs=1e-9)


def test_suspicious_measurements_are_reported(gait_recording: Recording, tmp_path: Path) -> None:
    export_lab_files(tmp_path / "lab", gait_recording)
    log = export.to_prosthesis_log(gait_recording)
    odd = {**log.channels, "pressure": log["pressure"] + 1.013, "force": -log["force"]}
    csv.write(Recording(odd, log.units), tmp_path / "lab" / "log.csv")
    warnings = import_trials([tmp_path / "lab" / name for name in FILES]).log.warnings
    assert any(
        "exceeds the commanded one by 1.01 bar; it may be an absolute pressure" in sentence for sentence in warnings
    )
    assert any("the force is mostly negative" in sentence for sentence in warnings)


@pytest.mark.slow
def test_steps_without_plate_are_trimmed(gait_recording: Recording, tmp_path: Path) -> None:
    longer = rig.simulate_gait(load_device(DEVICE), load_default_profile(), GaitOptions(strides=5, dt=1e-3))
    files = export_lab_files(tmp_path / "lab", longer)
    force = storage.read(files[1])
    on_plate = ~((force.time > 0.9) & (force.time < 2.0))  # the second step misses the plates
    columns = {n: s if n == "time" else s * on_plate for n, s in force.columns.items()}
    storage.write(storage.Storage(columns, False), files[1])
    imported = import_trials(files)
    (trial,) = imported.trials
    assert len(trial.foot_strikes) == 3
    begin = trial.channels["shank_angle"].time[0]
    assert begin == pytest.approx(trial.foot_strikes[0] - 0.3, abs=2e-3)
    assert begin == trial.channels["force"].time[0]
    assert any("because of steps on no plate" in sentence for sentence in imported.log.warnings)


def test_command_writes_self_contained_folder(gait_recording: Recording, tmp_path: Path) -> None:
    words = [str(path) for path in export_lab_files(tmp_path / "lab", gait_recording, marker_decimation=5)]
    (tmp_path / "mine.toml").write_bytes(load_device(DEVICE).content.replace(b"klute-1-1-4-pair", b"mine"))
    uncertainties = ("--uncertain", "muscle.c10_kpa=10 %", "--uncertain", "tendon.stiffness_1_n_per_mm=0.5")
    process = run("import", *words, "--dataset", "--device", "mine.toml", *uncertainties, "--out", "data", cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    for part in (
        "Files",
        "Channels",
        "Derived: ",
        "Trials",
        "condition_1",
        "Use: 1 for fit",
        "klute-sim diagnose data",
    ):
        assert part in process.stdout
    (tmp_path / "mine.toml").unlink()
    imported = datasets.load_dataset(tmp_path / "data")
    assert imported.device.name == "mine"
    assert imported.uncertainties["tendon.stiffness_1_n_per_mm"] == 0.5
    assert imported.uncertainties["muscle.c10_kpa"] == pytest.approx(
        0.1 * load_device(DEVICE).spec.collect_values()["muscle.c10_kpa"]
    )
    assert imported.remarks == ()
    summary = json.loads((tmp_path / "data" / "import.json").read_text())
    (trial,) = summary["trials"]
    assert trial["sources"] == [*FILES]
    assert trial["strides"] == 1
    assert trial["peak_command_bar"] == pytest.approx(gait_recording["pressure_command"].max(), abs=0.01)
    assert summary["split"]["fit"] == ["walk_01_motion+walk_01_load+walk_01_log"]
    assert summary["files"][0]["sha256"]


def test_gaps_of_centre_of_pressure_are_filled_or_reported(gait_recording: Recording, tmp_path: Path) -> None:
    for gap, message in ((0.1, None), (0.3, "the centre of pressure is unknown for")):
        is_missing = (gait_recording["time"] > 0.3) & (gait_recording["time"] < 0.3 + gap)
        channels = {
            n: np.where(is_missing, np.nan, s) if n == "cop_x" else s for n, s in gait_recording.channels.items()
        }
        parquet.write_recording(
            Recording(channels, gait_recording.units, gait_recording.provenance), tmp_path / "recording.parquet"
        )
        if message is None:
            cop = import_trials([tmp_path / "recording.parquet"]).trials[0].channels["cop_x"]
            assert cop.value[is_missing] == pytest.approx(gait_recording["cop_x"][is_missing], abs=5e-3)
        else:
            with pytest.raises(InputError, match=message):
                import_trials([tmp_path / "recording.parquet"])


def _without(*names: str) -> Callable[[Path], list[Path]]:
    return lambda folder: [folder / name for name in FILES if name not in names]


def _remove_cop(folder: Path) -> list[Path]:
    force = storage.read(folder / "ground_reaction.mot")
    columns = {n: s for n, s in force.columns.items() if "_p" not in n}
    storage.write(storage.Storage(columns, False), folder / "ground_reaction.mot")
    return [folder / name for name in FILES]


def _reverse_forward_axis(folder: Path) -> list[Path]:
    force = storage.read(folder / "ground_reaction.mot")
    columns = {n: -s if n.endswith("vx") else s for n, s in force.columns.items()}
    storage.write(storage.Storage(columns, False), folder / "ground_reaction.mot")
    return [folder / name for name in FILES]


def _shift_log_times(folder: Path) -> list[Path]:
    return edit_log(
        folder,
        lambda text: text.splitlines()[0] + "".join(f"\n{9 + 0.01 * k},1,1,1,1,{k % 7}" for k in range(50)) + "\n",
    )


def _truncate_log(folder: Path) -> list[Path]:
    return edit_log(folder, lambda text: "\n".join(text.splitlines()[:1000]) + "\n")


@pytest.mark.parametrize(
    ("select_files", "message"),
    [
        (_without("log.csv"), "no commanded pressure: add the prosthesis log"),
        (
            _without("markers.trc"),
            "the inclination of the right shank or the position of its ankle is unknown: add the markers",
        ),
        (_without("ground_reaction.mot"), "no ground reaction of the right foot"),
        (_remove_cop, "no centre of pressure of the right foot, so the moment of the load about the ankle is unknown"),
        (_reverse_forward_axis, "'forward' points backward"),
        (_shift_log_times, "so they do not overlap; set the time offset of a file under [clock]"),
        (_truncate_log, "0 foot strikes after a swing in consecutive strides"),
        (
            lambda folder: edit_log(folder, lambda text: text.replace("pressure [bar]", "pressure", 1)),
            "column 'pressure' has no unit; write the heading 'pressure [bar]'",
        ),
        (
            lambda folder: edit_log(folder, lambda text: text.replace("pressure_command [bar]", "wish [bar]", 1)),
            "no commanded pressure",
        ),
    ],
)
def test_missing_data_raise_one_sentence_and_leave_no_folder(
    select_files: Callable[[Path], list[Path]], message: str, gait_recording: Recording, tmp_path: Path
) -> None:
    export_lab_files(tmp_path / "lab", gait_recording)
    words = [str(path) for path in select_files(tmp_path / "lab")]
    process = run("import", *words, "--dataset", "--device", DEVICE, "--out", "data", cwd=tmp_path)
    assert process.returncode == 2
    assert message in process.stderr
    assert len(process.stderr.splitlines()) == 1
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--dataset",), "a dataset needs --device"),
        (("--dataset", "--device", "nobody"), "no device 'nobody'"),
        (("--dataset", "--device", DEVICE, "--cutoff", "6"), "--cutoff cannot be combined with --dataset"),
        (("--dataset", "--device", DEVICE, "--repeats", "0"), "--repeats is 0; allowed: 1 or more"),
        (("--dataset", "--device", DEVICE, "--uncertain", "x"), "--uncertain 'x' does not have the form KEY=SD"),
        (
            ("--dataset", "--device", DEVICE, "--uncertain", "x=1"),
            "names 'x', which is not a numeric key of the device",
        ),
        (("--dataset", "--device", DEVICE, "--uncertain", "muscle.c10_kpa=-1"), "allowed: a standard deviation"),
        (("--device", DEVICE), "--device requires --dataset"),
        (("--repeats", "2"), "--repeats requires --dataset"),
    ],
)
def test_incompatible_options_are_refused(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    process = run("import", "none.c3d", *arguments, cwd=tmp_path)
    assert process.returncode == 2
    assert message in process.stderr
    assert len(process.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_two_legs_require_side(tmp_path: Path) -> None:
    trc.write(synthetic_gait.markers(synthetic_gait.Walker()), tmp_path / "both.trc")
    with pytest.raises(InputError, match=r"pass the side of the prosthesis \(--side right or left\)"):
        import_trials([tmp_path / "both.trc"])


def test_c3d_with_plates_and_log_is_imported(tmp_path: Path) -> None:
    pytest.importorskip("ezc3d")
    walker = synthetic_gait.Walker()
    path = synthetic_gait.c3d(tmp_path, walker)
    angle = walker.of("ankle_dorsiflexion_deg", "left")
    rows = [f"{1e3 * t:.1f},1.5,{a:.6f}" for t, a in zip(walker.time, angle, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["time [ms],PressureSetpoint [bar],AnkleAngle [deg]", *rows]) + "\n")
    channels = import_trials([path, tmp_path / "log.csv"], replace(RAW, side="left")).trials[0].channels
    ankle = walker.points("left")["ANKLE"]
    for index, name in enumerate(("ankle_x", "ankle_z")):
        expected = np.interp(channels[name].time, walker.time, ankle[:, index])
        assert channels[name].value == pytest.approx(expected, abs=2e-3), name
    time, load = channels["grf_vertical"]
    assert load == pytest.approx(np.interp(time, walker.time, walker.of("grf_vertical_n_per_kg", "left")), abs=15.0)
    is_loaded = load > 100.0
    expected = np.interp(time, walker.time, walker.pressure_centre("left"))[is_loaded]
    assert np.abs(channels["cop_x"].value[is_loaded] - expected).max() < 5e-3
    assert channels["ankle_angle"].value == pytest.approx(angle, abs=1e-5)
    assert np.all(channels["pressure_command"].value == 1.5)


def make_trial(stride: float, bar: float) -> ProsthesisTrial:
    time = np.arange(0.0, 5.0 * stride, 0.01)
    command = TimeSeries(time, bar * (1.0 + np.sin(2.0 * np.pi * time / stride)))
    return ProsthesisTrial("x", ("x",), {"pressure_command": command}, stride * np.arange(5.0))


def test_file_names_stay_inside_comments(tmp_path: Path) -> None:
    expected = DatasetOptions(device="any", uncertainties={})
    text = dataset_import._format_toml(expected, "any", [("one", ["a.csv"], ["odd\nrig = 'bench'.c3d"])])
    assert tomllib.loads(text)["rig"] == "gait"


def test_repeats_have_equal_speed_and_profile() -> None:
    trials = [
        make_trial(1.1, 2.0),
        make_trial(1.13, 2.0),
        make_trial(1.2, 2.0),
        make_trial(1.1, 1.5),
        make_trial(1.1, 2.05),
    ]
    assert repeats.group_repeats(trials) == [1, 1, 2, 3, 1]
    assert repeats.group_repeats(trials, 2) == [1, 1, 2, 2, 3]
    assert repeats.group_repeats([make_trial(1.1, 0.0), make_trial(1.1, 0.0)]) == [1, 1]


@pytest.mark.long
def test_hidden_effect_is_identified_after_export_and_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The gait is simulated, exported, measured with noise, imported and diagnosed."""
    monkeypatch.setenv("KLUTE_SIM_CACHE", str(tmp_path / "cache"))
    text = load_device(DEVICE).content.decode() + '\n[effects.seal_friction]\nform = "coulomb"\nforce_n = 40.0\n'
    hidden, words = parse_device(text.encode(), "hidden"), list[str]()
    for name, speed in (("a1", 1.2), ("a2", 1.21), ("b1", 1.0), ("b2", 1.01)):
        recording = rig.simulate_gait(hidden, load_default_profile(), GaitOptions(speed=speed, strides=4))
        words += [str(path) for path in export_lab_files(tmp_path / name, recording, marker_decimation=10, noise=1.0)]
    process = run("import", *words, "--dataset", "--device", DEVICE, "--out", "data", cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    groups = [trial.group for trial in datasets.load_dataset(tmp_path / "data").trials]
    assert groups == ["condition_1", "condition_1", "condition_2", "condition_2"]
    selection = ("--only", "seal_friction", "--only", "pressure_lag", "--only", "sensor_gain")
    process = run("diagnose", "data", *selection, "--no-report", "--json", "--out", "found", cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    verdict = json.loads(process.stdout)
    assert [one["name"] for one in verdict["effects"]] == ["seal_friction"]
    assert verdict["effects"][0]["parameters"]["force_n"]["value"] == pytest.approx(40.0, rel=0.05)
