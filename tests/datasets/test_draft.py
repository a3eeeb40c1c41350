"""Draft of dataset.toml: meaning of headings, units, repeats, and what is left to the user."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import klute_sim as ks
from klute_sim.datasets.draft.headings import find_gait_words, interpret_heading
from klute_sim.errors import InputError
from tests.command_line import run

DEVICE = "klute-3-4-pair"
TIME = np.linspace(0.0, 4.0, 400)
LENGTH = 340.0 - 10.0 * np.sin(2.0 * TIME) ** 2
COMMAND = np.where(TIME < 1.0, 0.0, 3.0)
FORCE = 100.0 * COMMAND


def write(path: Path, headings: Sequence[str], columns: Sequence[np.ndarray]) -> None:
    rows = [",".join(headings), *(",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True))]
    path.write_text("\n".join(rows), "utf-8")


@pytest.mark.parametrize(
    ("heading", "channel", "unit"),
    [
        ("time [s]", "time", "s"),
        ("t_ms", "time", "ms"),
        ("Zeit in s", "time", "s"),
        ("F/N", "force", "N"),
        ("Load cell (kN)", "force", "kN"),
        ("Load (kg)", "force", "kgf"),
        ("load_kg", "force", "kgf"),
        ("pressure_in", "pressure", ""),
        ("p_m", "pressure", ""),
        ("F_m", "force", ""),
        ("x_m", "length", "m"),
        ("p_bar", "pressure", "bar"),
        ("p_set (kPa)", "pressure_command", "kPa"),
        ("PressureCommand", "pressure_command", ""),
        ("gauge (psig)", "pressure", "psi"),
        ("unit_length [mm]", "length", "mm"),
        ("Crosshead (in)", "length", "in"),
        ("muscle length [mm]", "muscle_length", "mm"),
        ("channel 3 [N]", "force", "N"),
        ("Länge (mm)", "length", "mm"),
        ("LVDT (in)", "length", "in"),
        ("X_Value", "time", ""),
        ("Verkürzung [mm]", "length", "mm"),
        ("Solldruck [bar]", "pressure_command", "bar"),
        ("run.pset", "pressure_command", ""),
        ("Contraction/%", "length", "%"),
        ("TIME [S]", "time", "s"),
        ("Length (MM)", "length", "mm"),
        ("millis", "time", "ms"),
        ("Force (N, filtered, 10 Hz)", "force", "N"),
        ("Strain in %", "length", "%"),
        ("elongation_%", "length", "%"),
    ],
)
def test_words_and_units_name_a_channel(heading: str, channel: str, unit: str) -> None:
    meaning = interpret_heading(heading)
    assert meaning is not None
    assert (meaning.channel, meaning.unit) == (channel, unit)


@pytest.mark.parametrize(
    ("heading", "channel"),
    [
        ("Load cell (counts)", "force"),
        ("load_cell_raw", "force"),
        ("F [mV/V]", "force"),
        ("pressure (V)", "pressure"),
        ("p_set_V", "pressure_command"),
        ("stroke ADC", "length"),
    ],
)
def test_reading_without_calibration_is_that_of_a_channel(heading: str, channel: str) -> None:
    meaning = interpret_heading(heading)
    assert meaning is not None
    assert (meaning.channel, meaning.unit, meaning.is_raw) == (channel, "", True)


@pytest.mark.parametrize(
    "heading",
    [
        "AIN3 [V]",
        "angle [deg]",
        "note",
        "force setpoint [N]",
        "position cmd [mm]",
        "Tensile stress (MPa)",
        "Ambient pressure (kPa)",
        "d/%",
        "",
    ],
)
def test_other_columns_are_no_channel(heading: str) -> None:
    assert interpret_heading(heading) is None


@pytest.mark.parametrize(
    ("heading", "unit", "is_absolute"),
    [
        ("p [kPa abs]", "kPa", True),
        ("pressure (bar(a))", "bar", True),
        ("pressure (bar, abs)", "bar", True),
        ("pressure (bar, gauge)", "bar", False),
        ("p_psia", "psi", True),
        ("p [mbar g]", "mbar", False),
        ("Druck [barü]", "bar", False),
        ("p [MPa]", "MPa", False),
    ],
)
def test_unit_tells_absolute_from_gauge_pressure(heading: str, unit: str, is_absolute: bool) -> None:
    meaning = interpret_heading(heading)
    assert meaning is not None
    assert (meaning.unit, meaning.is_absolute) == (unit, is_absolute)


@given(st.text(max_size=30))
def test_any_heading_can_be_read(heading: str) -> None:
    meaning = interpret_heading(heading)
    assert meaning is None or meaning.channel


def test_unit_in_other_words_becomes_an_expression(tmp_path: Path) -> None:
    headings = ["time [s]", "length [mm]", "pressure_command [KPA]", "pressure [psig]", "force [kg]"]
    write(tmp_path / "a.csv", headings, [TIME, LENGTH, 100.0 * COMMAND, 14.5 * COMMAND, FORCE])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert draft.is_complete
    lines = ("pressure_command [KPA]` [kPa]", "pressure [psig]` [psi]", "force [kg]` [kgf]")
    assert all(line in draft.text for line in lines)
    (trial,) = ks.load_dataset(tmp_path).trials
    assert trial.measured["force"].value.max() == pytest.approx(300.0 * 9.80665)


def test_filtered_column_comes_after_the_measured_one() -> None:
    filtered, measured = interpret_heading("Force filtered [N]"), interpret_heading("Force [N]")
    assert filtered is not None
    assert measured is not None
    assert measured.rank < filtered.rank
    short, long = interpret_heading("L_cm"), interpret_heading("L0_cm")
    assert short is not None
    assert long is not None
    assert short.rank < long.rank


def test_pressure_before_the_valve_comes_after_that_of_the_muscle(tmp_path: Path) -> None:
    headings = ["Time (s)", "Length (mm)", "Supply Pressure (psi)", "Muscle Pressure (psi)", "Load (N)"]
    write(tmp_path / "a.csv", headings, [TIME, LENGTH, np.full_like(TIME, 90.0), 14.5 * COMMAND, FORCE])
    assert 'pressure_command = "`Muscle Pressure (psi)` [psi]"' in ks.draft_dataset(tmp_path, DEVICE).text


def test_draft_of_foreign_files_is_a_dataset(tmp_path: Path) -> None:
    for name, scale in (("iso_a", 1.0), ("iso_b", 1.0), ("half", 0.5)):
        columns = [1e3 * TIME, LENGTH / 10.0, scale * COMMAND, scale * FORCE / 1e3]
        write(tmp_path / f"{name}.csv", ["t (ms)", "Crosshead (cm)", "P set (bar)", "Load cell (kN)"], columns)
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert (draft.n_trials, draft.n_groups) == (3, 2)
    assert draft.remarks == (
        "check the groups: no other file has the inputs of 'half.csv'; if some are repeats, give them one group",
    )
    dataset = ks.load_dataset(tmp_path)
    assert [trial.group for trial in dataset.trials] == ["half", "iso", "iso"]
    trial = dataset.trials[1]
    assert trial.prescribed["length"].value == pytest.approx(LENGTH / 1e3)
    assert trial.prescribed["pressure_command"].value == pytest.approx(COMMAND * 1e5)
    assert trial.measured["force"].value == pytest.approx(FORCE)


def test_absolute_pressure_becomes_a_gauge_pressure(tmp_path: Path) -> None:
    columns = [TIME, LENGTH, COMMAND, COMMAND + 1.01325]
    write(tmp_path / "a.csv", ["time [s]", "length [mm]", "pressure_command [bar]", "pressure [bara]"], columns)
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert "a standard atmosphere" in "".join(draft.remarks)
    assert ks.load_dataset(tmp_path).trials[0].measured["pressure"].value == pytest.approx(COMMAND * 1e5, abs=1.0)


def test_size_of_samples_tells_units_that_no_heading_states(tmp_path: Path) -> None:
    for name, scale in (("a", 1.0), ("low", 0.05)):  # 15 kPa would be 15 bar if this file stood alone
        columns = [1e3 * TIME, LENGTH, 100.0 * scale * COMMAND, scale * FORCE]
        write(tmp_path / f"{name}.csv", ["Time", "Length", "Setpoint", "Force"], columns)
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert 'check time = "Time [ms]": the file states no unit; ms is assumed' in draft.remarks
    trial = ks.load_dataset(tmp_path).trials[1]
    assert trial.prescribed["pressure_command"].value == pytest.approx(5e3 * COMMAND)
    assert trial.measured["force"].time == pytest.approx(TIME)


def test_slow_recording_stays_in_seconds(tmp_path: Path) -> None:
    seconds = np.arange(float(len(TIME)))
    write(tmp_path / "a.csv", ["Time", "Length [mm]", "cmd [bar]", "F [N]"], [seconds, LENGTH, COMMAND, FORCE])
    assert 'time = "Time [s]"' in ks.draft_dataset(tmp_path, DEVICE).text


def test_column_with_a_unit_comes_before_one_without(tmp_path: Path) -> None:
    columns = [TIME, TIME, LENGTH, COMMAND, FORCE]
    write(tmp_path / "a.csv", ["X_Value", "x", "Weg (mm)", "cmd [bar]", "F [N]"], columns)
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert "not used: the columns 'x'" in draft.remarks
    assert ks.load_dataset(tmp_path).trials[0].prescribed["length"].value == pytest.approx(1e-3 * LENGTH)


def test_displacement_gets_the_resting_length_and_a_remark(tmp_path: Path) -> None:
    columns = [TIME, LENGTH - 350.0, COMMAND, FORCE]
    write(tmp_path / "a.csv", ["time [s]", "Displacement [mm]", "pressure_command [bar]", "force [N]"], columns)
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert any("350 + `Displacement [mm]`" in remark and "lengthening is assumed" in remark for remark in draft.remarks)
    assert ks.load_dataset(tmp_path).trials[0].prescribed["length"].value == pytest.approx(LENGTH / 1e3)


@pytest.mark.parametrize("load", ["Force [N]", "Load cell (counts)"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_force_at_equal_pressure_shows_the_direction_of_a_displacement(tmp_path: Path, sign: float, load: str) -> None:
    for shortening in (0.0, 10.0, 25.0):
        force = FORCE * (1.0 - shortening / 40.0) + 1.0 * np.sin(50.0 * TIME)
        columns = [TIME, sign * shortening + 0.0 * TIME, COMMAND, force if "N" in load else 8400.0 - 40.0 * force]
        write(tmp_path / f"{shortening:.0f}.csv", ["time [s]", "stroke [mm]", "cmd [bar]", load], columns)
    text = ks.draft_dataset(tmp_path, DEVICE).text
    assert f'length = "350 {"-" if sign > 0 else "+"} `stroke [mm]` [mm]"' in text
    assert "because at equal pressure the force" in text


@pytest.mark.parametrize(("word", "sign"), [("Contraction", -1.0), ("Dehnung", 1.0)])
def test_displacement_in_per_cent_is_one_of_the_resting_length(tmp_path: Path, word: str, sign: float) -> None:
    columns = [TIME, sign * 100.0 * (LENGTH - 350.0) / 350.0, COMMAND, FORCE]
    write(tmp_path / "a.csv", ["time [s]", f"{word} (%)", "cmd [bar]", "F [N]"], columns)
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert f'"350 * (1 {"-" if sign < 0 else "+"} `{word} (%)` / 100) [mm]"' in draft.text
    assert ks.load_dataset(tmp_path).trials[0].prescribed["length"].value == pytest.approx(LENGTH / 1e3)


@pytest.mark.parametrize(("word", "operator"), [("contraction", "-"), ("elongation", "+")])
def test_heading_tells_the_direction_of_a_displacement(tmp_path: Path, word: str, operator: str) -> None:
    write(tmp_path / "a.csv", ["time [s]", f"{word} [mm]", "cmd [bar]", "F [N]"], [TIME, 0 * TIME, COMMAND, FORCE])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert f'"350 {operator} `{word} [mm]` [mm]"' in draft.text
    assert "by its heading" in draft.text


def test_short_specimen_is_no_displacement(tmp_path: Path) -> None:
    for length in (120.0, 108.0, 300.0):
        columns = [TIME, length + 0.0 * TIME, COMMAND, FORCE]
        write(tmp_path / f"{length:.0f}.csv", ["Zeit [s]", "Laenge [mm]", "Soll [bar]", "Kraft [N]"], columns)
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert "displacement" not in draft.text
    assert draft.text.count("length = ") == 1


def test_raw_reading_waits_for_its_calibration(tmp_path: Path) -> None:
    columns = [TIME, LENGTH, COMMAND, 40.0 * FORCE + 8400.0]
    write(tmp_path / "a.csv", ["time [s]", "length [mm]", "P [bar]", "Load cell (counts)"], columns)
    draft = ks.draft_dataset(tmp_path, DEVICE)
    line = '# force = "(`Load cell (counts)` - ZERO) * SCALE [N]"   # to do'
    assert line in draft.text
    assert any("SCALE the N per step" in remark for remark in draft.remarks)
    with pytest.raises(InputError, match="no channel is measured"):
        ks.load_dataset(tmp_path)
    draft.path.write_text(draft.text.replace(line, 'force = "(`Load cell (counts)` - 8400) * 0.025 [N]"'), "utf-8")
    assert ks.load_dataset(tmp_path).trials[0].measured["force"].value == pytest.approx(FORCE)


def test_calibrated_column_comes_before_a_raw_reading(tmp_path: Path) -> None:
    headings = ["time [s]", "length [mm]", "cmd [bar]", "force (V)", "Load [N]"]
    write(tmp_path / "a.csv", headings, [TIME, LENGTH, COMMAND, FORCE / 100.0, FORCE])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert "SCALE" not in draft.text
    assert "not used: the columns 'force (V)'" in draft.remarks
    assert ks.load_dataset(tmp_path).trials[0].measured["force"].value == pytest.approx(FORCE)


def test_raw_reading_of_some_files_stands_in_their_trials(tmp_path: Path) -> None:
    for name, load in (("a", "F [N]"), ("b", "F [N]"), ("c", "F (counts)")):
        write(tmp_path / f"{name}.csv", ["time [s]", "length [mm]", "cmd [bar]", load], [TIME, LENGTH, COMMAND, FORCE])
    head, *trials = ks.draft_dataset(tmp_path, DEVICE).text.split("[[trial]]")
    assert "SCALE" not in head
    assert ["SCALE" in trial for trial in trials] == [False, False, True]


def test_missing_command_is_replaced_by_the_measured_pressure(tmp_path: Path) -> None:
    write(
        tmp_path / "a.csv", ["time [s]", "length [mm]", "pressure [bar]", "force [N]"], [TIME, LENGTH, COMMAND, FORCE]
    )
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert any("stands for it" in remark for remark in draft.remarks)
    trial = ks.load_dataset(tmp_path).trials[0]
    assert "pressure" not in trial.measured
    assert trial.input_noise["pressure_command"] == pytest.approx(2e3)


def test_missing_length_is_left_to_the_user(tmp_path: Path) -> None:
    write(tmp_path / "a.csv", ["time [s]", "AIN3 [V]", "p_set [bar]", "force [N]"], [TIME, TIME, COMMAND, FORCE])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert any("length" in remark and "AIN3" in remark for remark in draft.remarks)
    completed = draft.text.replace('# length = "340 [mm]"   # to do: no column was recognized', 'length = "340 [mm]"')
    draft.path.write_text(completed, "utf-8")
    assert ks.load_dataset(tmp_path).trials[0].prescribed["length"].value == pytest.approx(0.34)


def test_a_file_with_other_headings_gets_its_own_columns(tmp_path: Path) -> None:
    columns = [TIME, LENGTH, COMMAND, FORCE]
    for name in "ab":
        write(tmp_path / f"{name}.csv", ["time [s]", "length [mm]", "pressure_command [bar]", "force [N]"], columns)
    write(tmp_path / "c.csv", ["t (s)", "pos (mm)", "cmd (bar)", "Force (N)"], columns)
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert draft.text.count("[trial.columns]") == 1
    assert len(ks.load_dataset(tmp_path).trials) == 3


def test_other_files_are_left_out_by_name(tmp_path: Path) -> None:
    write(
        tmp_path / "a.csv",
        ["time [s]", "length [mm]", "pressure_command [bar]", "force [N]"],
        [TIME, LENGTH, COMMAND, FORCE],
    )
    write(tmp_path / "room.csv", ["time [s]", "humidity [%]"], [TIME, TIME])
    (tmp_path / "notes.txt").write_text("0 1 2\n3 4 5\n")
    (tmp_path / "readme.txt").write_text("Recorded on the tester, gauge pressure, force in N\n")
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert draft.n_trials == 1
    left_out = [remark for remark in draft.remarks if remark.startswith("left out")]
    assert len(left_out) == 3
    assert "humidity" in "".join(left_out)


def test_heading_below_a_preamble_and_above_its_units_is_found(tmp_path: Path) -> None:
    for name, units in (("a", "(s);(mm);(bar);(N)"), ("b", "s;mm;bar;N")):
        samples = zip(TIME, LENGTH, COMMAND, FORCE, strict=True)
        rows = [";".join(f"{value:.3f}".replace(".", ",") for value in row) for row in samples]
        text = ["Messung McKibben;Pruefstand 2", "Zeit;Laenge;Druck Soll;Kraft", units, *rows]
        (tmp_path / f"{name}.csv").write_text("\n".join(text))
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert (draft.n_trials, draft.remarks) == (2, ())
    trial = ks.load_dataset(tmp_path).trials[1]
    assert trial.measured["force"].value == pytest.approx(FORCE, abs=1e-2)


def test_files_with_the_same_error_share_a_sentence(tmp_path: Path) -> None:
    for k in range(5):
        (tmp_path / f"{k}.csv").write_text("time [s],force [N]\n1,2,3\n")
    with pytest.raises(InputError, match=r"left out: trial file .*0\.csv and 4 more: line 2 has 3 cells") as refusal:
        ks.draft_dataset(tmp_path, DEVICE)
    assert str(refusal.value).count("line 2 has") == 1


def test_table_without_time_beside_recordings_is_left_out(tmp_path: Path) -> None:
    for name in "ab":
        write(
            tmp_path / f"{name}.csv",
            ["time [s]", "L0_cm", "L_cm", "p_bar", "F_N"],
            [TIME, 0 * TIME, LENGTH / 10, COMMAND, FORCE],
        )
    write(tmp_path / "summary.csv", ["L0_cm", "Fmax_N"], [TIME, FORCE])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert draft.n_trials == 2
    assert f"left out: trial file {tmp_path / 'summary.csv'}: it has no time" in draft.remarks
    assert ks.load_dataset(tmp_path).trials[0].prescribed["length"].value == pytest.approx(LENGTH / 1e3)


def test_refusals_name_the_way_out(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"contains no device file; name the device with --device"):
        ks.draft_dataset(tmp_path)
    with pytest.raises(InputError, match=r"contains no recording; allowed are files that end in \.csv"):
        ks.draft_dataset(tmp_path, DEVICE)
    (tmp_path / "dataset.toml").write_text("")
    with pytest.raises(InputError, match="exists already; remove it"):
        ks.draft_dataset(tmp_path, DEVICE)


def test_gait_is_referred_to_the_import(tmp_path: Path) -> None:
    write(tmp_path / "a_motion.csv", ["time [s]", "shank_angle [deg]", "ankle_x [m]"], [TIME, COMMAND, LENGTH])
    write(tmp_path / "a_plate.csv", ["time [s]", "grf_vertical [N]", "cop_x [m]"], [TIME, FORCE, LENGTH])
    with pytest.raises(InputError, match=r"recordings of gait .*'klute-sim import FILES --dataset --device DEVICE"):
        ks.draft_dataset(tmp_path, DEVICE)
    assert not (tmp_path / "dataset.toml").exists()


@pytest.mark.parametrize(
    ("heading", "words"),
    [
        *(
            (heading, {"grf"})
            for heading in ("GRFz (N)", "vGRF", "leftGRFy", "GRFVertical", "grfz", "GRFzLeft", "R_GRF1")
        ),
        *((heading, {"cop"}) for heading in ("COPx", "CoPx [mm]", "COPy", "FP1_COPap", "cop_x")),
        *((heading, {"ankle"}) for heading in ("ankle_angle", "RAnkleX", "AnkleAngle")),
        *((heading, set()) for heading in ("scope", "SCOPE", "copper temperature", "COPPER", "Copley drive", "copy")),
    ],
)
def test_words_of_gait_are_found_in_headings(heading: str, words: set[str]) -> None:
    assert find_gait_words(heading) == words


def test_one_word_of_gait_may_be_that_of_a_bench(tmp_path: Path) -> None:
    headings = ["time [s]", "length [mm]", "pressure_command [bar]", "force [N]", "ankle (deg)"]
    write(tmp_path / "a.csv", headings, [TIME, LENGTH, COMMAND, FORCE, COMMAND])
    assert ks.draft_dataset(tmp_path, DEVICE).n_trials == 1


def test_device_file_in_the_folder_is_used(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_bytes(ks.load_device(DEVICE).content)
    write(
        tmp_path / "a.csv",
        ["time [s]", "length [mm]", "pressure_command [bar]", "force [N]"],
        [TIME, LENGTH, COMMAND, FORCE],
    )
    assert 'device = "mine.toml"' in ks.draft_dataset(tmp_path).text


def test_command_writes_the_draft_and_says_what_is_next(tmp_path: Path) -> None:
    write(tmp_path / "a.csv", ["t (s)", "pos (mm)", "cmd", "Force (N)"], [TIME, LENGTH, COMMAND, FORCE])
    result = run("diagnose", str(tmp_path), "--draft", "--device", DEVICE)
    assert result.returncode == 0, result.stderr
    assert "the file states no unit; bar is assumed" in result.stdout
    assert f"klute-sim diagnose {tmp_path}" in result.stdout
    assert (tmp_path / "dataset.toml").exists()
    with_tolerance = run("diagnose", str(tmp_path), "--draft", "--device", DEVICE, "--tolerance", "force=5 N")
    assert with_tolerance.returncode == 2
    assert "pass no other option than --device" in with_tolerance.stderr
    again = run("diagnose", str(tmp_path), "--draft", "--device", DEVICE)
    assert again.returncode == 2
    assert "exists already" in again.stderr


def test_lengths_in_metres_without_a_unit_are_told_from_mm(tmp_path: Path) -> None:
    write(tmp_path / "a.csv", ["time", "Length", "cmd [bar]", "F [N]"], [TIME, LENGTH / 1e3, COMMAND, FORCE])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert 'check length = "Length [m]": the file states no unit; m is assumed' in draft.remarks
    assert ks.load_dataset(tmp_path).trials[0].prescribed["length"].value == pytest.approx(LENGTH / 1e3)


def test_contraction_without_a_unit_is_a_fraction_where_it_cannot_be_mm(tmp_path: Path) -> None:
    fraction = 0.1 + 0.05 * np.sin(2.0 * TIME) + np.where(TIME < 0.1, 0.1, 0.0)
    write(tmp_path / "a.csv", ["time", "contraction", "cmd [bar]", "F [N]"], [TIME, fraction, COMMAND, FORCE])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert 'length = "350 * (1 - contraction) [mm]"' in draft.text
    assert any("a fraction of the resting length is assumed" in remark for remark in draft.remarks)
    trial = ks.load_dataset(tmp_path).trials[0]
    assert trial.prescribed["length"].value == pytest.approx(0.35 * (1.0 - fraction))


@pytest.mark.parametrize("heading", ["x", "contraction", "stroke"])
def test_displacement_of_an_unknown_unit_is_left_to_the_user(tmp_path: Path, heading: str) -> None:
    write(tmp_path / "a.csv", ["time", heading, "cmd [bar]", "F [N]"], [TIME, 0.02 + 0.01 * TIME, COMMAND, FORCE])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert not draft.is_complete
    assert f'# length = "{heading} [UNIT]"   # to do' in draft.text
    assert any("its numbers are no mm; write [m] if they are metres" in remark for remark in draft.remarks)


def test_noise_of_a_displacement_sensor_stays_in_mm(tmp_path: Path) -> None:
    noise = 1e-3 * np.sin(40.0 * TIME)
    write(tmp_path / "a.csv", ["time", "stroke", "cmd [bar]", "F [N]"], [TIME, noise, COMMAND, FORCE])
    assert "350 + stroke [mm]" in ks.draft_dataset(tmp_path, DEVICE).text


@pytest.mark.parametrize("headings", ["Date,Time,Elapsed (s)", "Date,Timestamp,t", "Date,Time of day,Zeit"])
def test_time_that_counts_comes_before_dates_and_times_of_day(tmp_path: Path, headings: str) -> None:
    rows = [
        f"2024-05-01,10:00:{time:06.3f},{time:.4f},{length:.4f},{command:g},{force:g}"
        for time, length, command, force in zip(TIME, LENGTH, COMMAND, FORCE, strict=True)
    ]
    text = "\n".join([f"{headings},Length (mm),p_set (bar),Force (N)", *rows])
    (tmp_path / "a.csv").write_text(text, "utf-8")
    ks.draft_dataset(tmp_path, DEVICE)
    assert ks.load_dataset(tmp_path).trials[0].measured["force"].time == pytest.approx(TIME, abs=1e-4)
