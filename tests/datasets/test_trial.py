"""Trials: roles of channels, time axes, aliases, and simulated recordings as measurements."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from klute_sim import bench
from klute_sim.datasets import channels, trial
from klute_sim.datasets.channels import Rig
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.gait.rig import measurements
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording

N = 20
TIME = np.arange(N) * 0.01
GAIT = {
    **{"shank_angle [deg]": TIME, "ankle_x [mm]": TIME, "ankle_z [mm]": 100 + 0 * TIME, "cop_x [mm]": TIME},
    **{"grf_vertical [N]": 800 + 0 * TIME, "grf_forward [N]": TIME},
    **{"pressure_command [bar]": TIME, "ankle_moment [N*m]": TIME},
}


def columns(**changes: np.ndarray | None) -> dict[str, np.ndarray]:
    result: dict[str, np.ndarray | None] = {
        "time [s]": TIME,
        "length [mm]": 340 + TIME,
        "pressure_command [bar]": 3 + 0 * TIME,
        "force [N]": 500 + TIME,
    }
    names = {heading.split(" ")[0]: heading for heading in result}
    result |= {names[name]: value for name, value in changes.items()}
    return {heading: value for heading, value in result.items() if value is not None}


def replace_row(row: int, value: float, base: np.ndarray = TIME) -> np.ndarray:
    changed = base.copy()
    changed[row] = value
    return changed


def read(folder: Path, *files: Mapping[str, np.ndarray], rig: Rig = "bench") -> trial.TrialChannels:
    paths = [folder / f"{name}.csv" for name in "abc"[: len(files)]]
    for path, content in zip(paths, files, strict=True):
        write_trial(path, content)
    return trial.read_trial(paths, rig)


def read_error(folder: Path, *files: Mapping[str, np.ndarray], rig: Rig = "bench") -> str:
    with pytest.raises(InputError) as caught:
        read(folder, *files, rig=rig)
    sentence = str(caught.value)
    assert str(folder / "a.csv") in sentence
    assert "\n" not in sentence
    return sentence


def test_channels_are_in_si_and_have_roles(tmp_path: Path) -> None:
    result = read(tmp_path, columns(force=replace_row(3, np.nan)))
    assert list(result.prescribed) == ["length", "pressure_command"]
    assert list(result.measured) == ["force"]
    assert result.prescribed["length"].value == pytest.approx(0.34 + 1e-3 * TIME)
    assert result.prescribed["pressure_command"].value == pytest.approx(3e5)
    assert result.measured["force"].time == pytest.approx(TIME)
    assert np.flatnonzero(np.isnan(result.measured["force"].value)).tolist() == [3]
    assert result.remarks == ()


def test_each_file_has_its_own_time_axis(tmp_path: Path) -> None:
    late = {"time [ms]": 1e3 * TIME[::2] + 5, "pressure [kPa]": 300 + TIME[::2]}
    result = read(tmp_path, columns(), late)
    assert result.measured["force"].time == pytest.approx(TIME)
    assert result.measured["pressure"].time == pytest.approx(TIME[::2] + 0.005)
    assert result.measured["pressure"].value == pytest.approx(3e5 + 1e3 * TIME[::2])
    assert len(set(result.digests)) == 2


def test_any_subset_of_measured_channels_is_allowed(tmp_path: Path) -> None:
    base = columns(force=None)
    for heading in ("force [N]", "pressure [bar]", "muscle_length [mm]"):
        assert list(read(tmp_path, base | {heading: TIME}).measured) == [heading.split(" ")[0]]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            columns(time=None),
            "has no column 'time [s]'; its columns are 'length [mm]', 'pressure_command [bar]', '",
        ),
        (
            columns(time=replace_row(4, np.nan)),
            "column 'time [s]', line 6: the cell is empty or NaN; every sample needs",
        ),
        (columns(time=replace_row(4, 0.03)), "the time repeats at line 6 (0.03 s after 0.03 s); time must increase"),
        (columns(time=replace_row(4, 0.02)), "row to row; if several tests follow each other, write each into a"),
        (columns(time=replace_row(4, 0.02)), "the time decreases at line 6 (0.02 s after 0.03 s)"),
        (
            columns(length=replace_row(0, np.nan)),
            "column 'length [mm]', line 2: the cell is empty or NaN; 'length' is pre",
        ),
        (columns(length=None), "the prescribed channel 'length' is missing; a bench trial needs length, pressure_com"),
        (columns(pressure_command=None), "the prescribed channel 'pressure_command' is missing"),
        (
            columns(pressure_command=None) | {"pressure [bar]": 3 + 0 * TIME},
            'pressure_command = "`pressure [bar]`" under [columns], and the standard deviation',
        ),
        (
            columns(force=None),
            "no channel is measured; a bench trial needs at least one of force, pressure, muscle_",
        ),
        (columns(force=np.where(TIME < 0.085, 1.0, np.nan)), "column 'force [N]' has 9 samples; at least 10"),
        ({k: v[:9] for k, v in columns().items()}, "has 9 rows; at least 10 are needed"),
        ({k: v[:0] for k, v in columns().items()}, "has 0 rows; at least 10 are needed"),
        (columns() | {"unit_length [m]": TIME}, "'length [mm]' and 'unit_length [m]' are the same channel"),
    ],
)
def test_invalid_trials_are_refused(tmp_path: Path, content: dict[str, np.ndarray], message: str) -> None:
    assert message in read_error(tmp_path, content)


def test_ten_samples_suffice(tmp_path: Path) -> None:
    assert len(read(tmp_path, {k: v[:10] for k, v in columns().items()}).measured["force"].value) == 10


def test_a_channel_in_two_files_is_refused(tmp_path: Path) -> None:
    other = {"time [s]": TIME, "force [kN]": TIME}
    assert f"a.csv and {tmp_path / 'b.csv'} both have 'force'" in read_error(tmp_path, columns(), other)


def test_files_without_overlap_in_time_are_refused(tmp_path: Path) -> None:
    other = {"time [s]": TIME + 100, "pressure [bar]": TIME}
    message = f"{tmp_path / 'b.csv'} do not overlap in time: 'length' ends at 0.19 s, 'pressure' starts at 100 s"
    assert message in read_error(tmp_path, columns(), other)


@pytest.mark.parametrize("start", [0.1898, 0.171])
def test_files_that_hardly_overlap_are_refused(tmp_path: Path, start: float) -> None:
    command = {"time [s]": TIME + start, "pressure_command [bar]": 3 + 0 * TIME}
    sentence = read_error(tmp_path, columns(pressure_command=None), command)
    assert f"{tmp_path / 'b.csv'} overlap by {0.19 - start:.3g} s only: 'length' ends at 0.19 s" in sentence
    assert sentence.endswith("at least 0.02 s in common are needed; correct the times, or leave the trial out")


def test_files_that_overlap_by_two_samples_are_read(tmp_path: Path) -> None:
    command = {"time [s]": TIME + 0.169, "pressure_command [bar]": 3 + 0 * TIME}
    assert read(tmp_path, columns(pressure_command=None), command).prescribed["pressure_command"].time[0] == 0.169


def test_trial_of_a_millisecond_is_refused(tmp_path: Path) -> None:
    fast = {"time [us]" if name == "time [s]" else name: value for name, value in columns().items()}
    fast["time [us]"] = 50.0 * np.arange(N)
    assert "the time spans 0.00095 s with a sample every 5e-05 s" in read_error(tmp_path, fast)


@pytest.mark.parametrize(("seconds", "unit"), [(3600.0, "h"), (86400.0, "day")])
def test_time_in_hours_or_days_is_named(tmp_path: Path, seconds: float, unit: str) -> None:
    n = 300
    values = {"length [mm]": 340.0, "pressure_command [bar]": 3.0, "force [N]": 500.0}
    held = {heading: np.full(n, value) for heading, value in values.items()}
    time = 0.01 * np.arange(n) / seconds
    message = f"a trial takes seconds to minutes: is the unit of 'time [s]' {unit}? Correct the heading"
    assert message in read_error(tmp_path, {"time [s]": time, **held})
    result = read(tmp_path, {f"time [{unit}]": time, **held})
    assert result.measured["force"].time == pytest.approx(0.01 * np.arange(n))


def test_dates_of_a_spreadsheet_with_few_digits_are_named(tmp_path: Path) -> None:
    days = np.round(45413.0 + TIME / 86400.0, 6)
    assert "days since 1900 with which spreadsheets write dates" in read_error(tmp_path, columns(time=days))


def test_delay_that_leaves_no_overlap_is_named(tmp_path: Path) -> None:
    write_trial(tmp_path / "a.csv", columns())
    with pytest.raises(InputError) as error:
        trial.read_trial((tmp_path / "a.csv",), "bench", delays={"force": 20.0})
    assert str(error.value).startswith(f"the channels of trial file {tmp_path / 'a.csv'} do not overlap in time:")
    assert "'force' ends at -19.81 s after its [delay] of 20 s, 'length' starts at 0 s" in str(error.value)
    assert str(error.value).endswith("; is the unit of the delay right?")


def test_unknown_columns_cause_a_remark(tmp_path: Path) -> None:
    (remark,) = read(tmp_path, columns() | {"oil_temperature [degC]": TIME, "gas_power [W]": TIME}).remarks
    assert remark.endswith("a.csv: ignored columns 'oil_temperature [degC]', 'gas_power [W]'")


def test_gait_trial_prescribes_motion_and_load(tmp_path: Path) -> None:
    result = read(tmp_path, {"time [s]": TIME, **GAIT}, rig="gait")
    assert set(result.prescribed) == set(channels.PRESCRIBED_CHANNELS["gait"])
    assert set(result.measured) == {"ankle_moment"}
    assert result.prescribed["shank_angle"].value == pytest.approx(np.radians(TIME))
    assert result.prescribed["ankle_z"].value == pytest.approx(0.1)
    assert result.remarks == ()


@pytest.mark.parametrize("missing", ["ankle_x [mm]", "grf_vertical [N]", "cop_x [mm]"])
def test_gait_trial_without_motion_or_load_is_refused(tmp_path: Path, missing: str) -> None:
    content = {"time [s]": TIME, **GAIT}
    del content[missing]
    message = "is missing; a gait trial needs shank_angle, ankle_x, ankle_z, grf_vertical, grf_forward, cop_x, pressure"
    assert f"'{missing.split()[0]}' {message}" in read_error(tmp_path, content, rig="gait")


def test_gait_trial_without_measurement_is_refused(tmp_path: Path) -> None:
    content = {"time [s]": TIME, **GAIT}
    del content["ankle_moment [N*m]"]
    message = "no channel is measured; a gait trial needs at least one of ankle_angle, force, pressure, muscle_length"
    assert message in read_error(tmp_path, content, rig="gait")


def test_centre_of_pressure_may_be_missing_only_without_load(tmp_path: Path) -> None:
    gap = {"time [s]": TIME, **GAIT, "cop_x [mm]": replace_row(2, np.nan)}
    assert np.isnan(
        read(tmp_path, gap | {"grf_vertical [N]": replace_row(2, 20.0)}, rig="gait").prescribed["cop_x"].value[2]
    )
    message = (
        "column 'cop_x [mm]', line 4: the cell is empty or NaN under a load of 800 N; "
        "empty cells are allowed up to 20 N"
    )
    assert message in read_error(tmp_path, gap, rig="gait")
    gap = {"time [s]": TIME, **GAIT, "grf_vertical [N]": replace_row(2, np.nan)}
    assert "line 4: the cell is empty or NaN; 'grf_vertical' is prescribed" in read_error(tmp_path, gap, rig="gait")


def test_offset_of_the_force_plate_is_subtracted(tmp_path: Path) -> None:
    """What the plate reads in swing it also adds in stance; a small offset is subtracted without a remark."""
    load = np.where(np.arange(N) < 12, 800.0, 0.0)
    cop = np.where(np.arange(N) < 12, TIME, np.nan)
    for vertical, forward, text in ((-25.0, 8.0, "-25 N up and 8 N forward"), (2.0, 1.0, "")):
        forces = {"grf_vertical [N]": load + vertical, "grf_forward [N]": 0.1 * load + forward}
        content = read(tmp_path, {**GAIT, **forces, "cop_x [mm]": cop, "time [s]": TIME}, rig="gait")
        assert content.prescribed["grf_vertical"].value == pytest.approx(load)
        assert content.prescribed["grf_forward"].value == pytest.approx(0.1 * load)
        assert [text in remark for remark in content.remarks if "plate" in remark] == [True] * bool(text)


def test_noise_of_an_unloaded_plate_needs_no_centre_of_pressure(tmp_path: Path) -> None:
    load = np.where(np.arange(N) < 15, 800.0, 0.0)
    load[17] = 25.0
    cop = np.where(np.arange(N) < 15, TIME, np.nan)
    content = read(tmp_path, {**GAIT, "grf_vertical [N]": load, "cop_x [mm]": cop, "time [s]": TIME}, rig="gait")
    assert np.isfinite(content.prescribed["cop_x"].value).sum() == 15


@pytest.mark.parametrize("cop", [np.full(N, np.nan), np.zeros(N)])
def test_trial_without_foot_strike_is_refused(tmp_path: Path, cop: np.ndarray) -> None:
    unloaded = {"time [s]": TIME, **GAIT, "cop_x [mm]": cop, "grf_vertical [N]": replace_row(3, 1.26)}
    message = read_error(tmp_path, unloaded, rig="gait")
    assert "column 'grf_vertical [N]' is 1.26 N at most and there is no centre of pressure" in message
    assert "leave the trial out, or check the force plate" in message


def test_small_load_with_a_centre_of_pressure_may_have_another_unit(tmp_path: Path) -> None:
    read(tmp_path, {"time [s]": TIME, **GAIT, "grf_vertical [N]": 0.8 + 0 * TIME}, rig="gait")


def test_simulated_rigs_record_all_channels_of_a_trial() -> None:
    for rig, headings in (("bench", bench.CHANNELS), ("gait", measurements.MEASURED_COLUMNS)):
        recorded = {heading.split(" ")[0] for heading in headings}
        assert set(channels.MEASURED_CHANNELS[rig]) <= recorded
        # The rigs record these two themselves, in addition to the sensor readings.
        assert set(channels.PRESCRIBED_CHANNELS[rig]) - recorded <= {"length", "pressure_command"}
    assert "unit_length [m]" in measurements.MEASURED_COLUMNS


def simulate_pull() -> Recording:
    time = np.arange(200) * 5e-4
    return bench.simulate_tester(
        load_device("klute-3-4-pair"), 0.335 + 0.005 * np.sin(20 * time), np.full(200, 4e5), 5e-4
    )


def test_bench_recording_is_a_valid_trial(tmp_path: Path) -> None:
    recording = simulate_pull()
    parquet.write_recording(recording, tmp_path / "recording.parquet")
    result = trial.read_trial([tmp_path / "recording.parquet"], "bench")
    assert result.prescribed["length"].value == pytest.approx(1e-3 * recording["length"])
    assert result.prescribed["pressure_command"].value == pytest.approx(4e5)
    assert set(result.measured) == {"force", "pressure", "muscle_length"}
    assert result.measured["pressure"].value == pytest.approx(1e5 * recording["pressure"])
    assert result.measured["muscle_length"].value == pytest.approx(1e-3 * recording["muscle_length"])
    assert "'gas_power [W]'" in result.remarks[0]


def test_unit_length_is_an_alias_of_length(tmp_path: Path) -> None:
    recording = simulate_pull()
    renamed = [("unit_length [m]" if n == "length" else recording.format_heading(n), s * (1e-3 if n == "length" else 1))
               for n, s in recording.channels.items()]  # fmt: skip
    parquet.write_recording(Recording.from_columns(renamed), tmp_path / "recording.parquet")
    result = trial.read_trial([tmp_path / "recording.parquet"], "bench")
    assert result.prescribed["length"].value == pytest.approx(1e-3 * recording["length"])
