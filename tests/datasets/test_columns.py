"""``[columns]``: channels that follow from the columns of any file, with calibration and unit."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.errors import InputError
from tests.command_line import run

HEAD = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
TRIALS = '[[trial]]\nfiles = ["a.csv"]\n[[trial]]\nfiles = ["b.csv"]\n'
N = 20
COUNTS = np.arange(float(N))
CHANNELS = 'time = "t [ms]"\nlength = "stroke"\npressure_command = "(AIN3 - 0.5) * 2.5 [bar]"\n'
MAPPING = "[columns]\n" + CHANNELS + 'force = "(0.5 * `raw force` + 150) * 4.4482216152605 [N]"\n'
COLUMNS = {"t": 10 * COUNTS, "stroke [mm]": 340 + 0 * COUNTS, "AIN3": 1.7 + 0 * COUNTS, "raw force": COUNTS}


def write(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    rows = [",".join(columns), *(",".join(map(repr, map(float, row))) for row in zip(*columns.values(), strict=True))]
    path.write_text("\n".join(rows), "utf-8")


def load(folder: Path, text: str = MAPPING + TRIALS, **changes: np.ndarray | None) -> Dataset:
    for name in "ab":
        write(folder / f"{name}.csv", COLUMNS)
    renamed = {name.replace("_", " "): value for name, value in changes.items()}
    if changes:
        columns = {name: value for name, value in {**COLUMNS, **renamed}.items() if value is not None}
        write(folder / "b.csv", columns)
    (folder / "dataset.toml").write_text(HEAD + text, "utf-8")
    return load_dataset(folder)


def load_error(folder: Path, text: str = MAPPING + TRIALS, **changes: np.ndarray | None) -> str:
    with pytest.raises(InputError) as caught:
        load(folder, text, **changes)
    sentence = str(caught.value)
    assert str(folder) in sentence
    assert "\n" not in sentence
    return sentence


def test_channels_are_computed_in_si(tmp_path: Path) -> None:
    dataset = load(tmp_path)
    trial = dataset.trials[0]
    assert trial.prescribed["length"].time == pytest.approx(0.01 * COUNTS)
    assert trial.prescribed["length"].value == pytest.approx(0.34)
    assert trial.prescribed["pressure_command"].value == pytest.approx(3e5)
    assert trial.measured["force"].value == pytest.approx((0.5 * COUNTS + 150) * 4.4482216152605)
    assert dataset.remarks == ()


def test_unit_of_a_raw_reading_is_refused_with_an_expression_that_can_be_used(tmp_path: Path) -> None:
    mapping = MAPPING.replace("(AIN3 - 0.5) * 2.5 [bar]", "`Pressure (V)`")
    mapping += '[[trial]]\nfiles = ["b.csv"]\n'
    sentence = load_error(tmp_path, mapping, AIN3=None, **{"Pressure (V)": 1.7 + 0 * COUNTS})
    expression = "(`Pressure (V)` - 0.5) * 2.5 [bar]"
    assert f'state its calibration under [columns], for example pressure_command = "{expression}"' in sentence
    mapping = mapping.replace('"`Pressure (V)`"', f'"{expression}"')
    trial = load(tmp_path, mapping, AIN3=None, **{"Pressure (V)": 1.7 + 0 * COUNTS}).trials[0]
    assert trial.prescribed["pressure_command"].value == pytest.approx(3e5)


def test_missing_samples_stay_missing(tmp_path: Path) -> None:
    raw = COUNTS.copy()
    raw[3] = np.nan
    assert np.flatnonzero(np.isnan(load(tmp_path, raw_force=raw).trials[1].measured["force"].value)).tolist() == [3]


def test_columns_of_a_trial_replace_those_of_the_dataset(tmp_path: Path) -> None:
    text = MAPPING + TRIALS + '[trial.columns]\nlength = "0.9 * stroke + 34.2 [mm]"\n'
    lengths = [trial.prescribed["length"].value[0] for trial in load(tmp_path, text).trials]
    assert lengths == pytest.approx([0.34, 0.3402])


def test_time_may_follow_from_the_row_and_a_clamped_length_from_a_number(tmp_path: Path) -> None:
    text = MAPPING.replace("t [ms]", "row / 200 [s]").replace('"stroke"', '"341 [mm]"')
    trial = load(tmp_path, text + TRIALS).trials[0]
    assert trial.measured["force"].time == pytest.approx(COUNTS / 200)
    assert trial.prescribed["length"].value == pytest.approx(np.full(N, 0.341))


def test_number_of_the_row_is_no_column_of_another_case(tmp_path: Path) -> None:
    text = MAPPING.replace("t [ms]", "row / 200 [s]")
    second = load(tmp_path, text + TRIALS, Row=COUNTS + 1.0).trials[1]
    assert second.measured["force"].time == pytest.approx(COUNTS / 200)


def test_each_file_gives_the_channels_whose_columns_it_has(tmp_path: Path) -> None:
    text = "[columns]\n" + CHANNELS + 'pressure = "100 * p [kPa]"\n' + '[[trial]]\nfiles = ["a.csv", "c.csv"]\n'
    write(tmp_path / "c.csv", {"t": 20 * COUNTS, "p": 3 + 0 * COUNTS})
    trial = load(tmp_path, text).trials[0]
    assert trial.measured["pressure"].time == pytest.approx(0.02 * COUNTS)
    assert trial.measured["pressure"].value == pytest.approx(3e5)


def test_channel_by_the_row_belongs_to_the_first_file(tmp_path: Path) -> None:
    text = MAPPING.replace('"stroke"', '"340 + 0.5 * row [mm]"').replace("t [ms]", "row / 200 [s]")
    write(tmp_path / "c.csv", {"pressure [bar]": 3 + np.zeros(2 * N)})
    trial = load(tmp_path, text + '[[trial]]\nfiles = ["a.csv", "c.csv"]\n').trials[0]
    assert trial.prescribed["length"].value == pytest.approx(0.34 + 0.0005 * COUNTS)
    assert trial.measured["pressure"].time == pytest.approx(np.arange(2 * N) / 200)


def test_headings_with_units_need_no_expression(tmp_path: Path) -> None:
    text = '[columns]\ntime = "T"\n[[trial]]\nfiles = ["c.csv"]\n'
    columns = {"t (ms)": 10 * COUNTS, "length [mm]": 340 + 0 * COUNTS, "pressure_command [bar]": 3 + 0 * COUNTS}
    write(tmp_path / "c.csv", columns | {"force [N]": 690 + 0 * COUNTS})
    assert load(tmp_path, text).trials[0].measured["force"].time == pytest.approx(0.01 * COUNTS)


def test_channel_that_corrects_another_one_remains_a_channel(tmp_path: Path) -> None:
    """The force stretches the frame, and its column has its own heading; a column that is another channel has none."""
    columns = {"time [s]": 0.01 * COUNTS, "pressure_command [bar]": 3 + 0 * COUNTS}
    columns |= {"length [mm]": 340 + 0 * COUNTS, "force [N]": COUNTS, "pressure": 3 + 0 * COUNTS}
    write(tmp_path / "a.csv", columns)
    text = '[columns]\nlength = "length - 0.01 * force + 0 * pressure [mm]"\n[[trial]]\nfiles = ["a.csv"]\n'
    (tmp_path / "dataset.toml").write_text(HEAD + text, "utf-8")
    (trial,) = load_dataset(tmp_path).trials
    assert trial.prescribed["length"].value == pytest.approx(0.34 - 1e-5 * COUNTS)
    assert list(trial.measured) == ["force"]
    assert trial.measured["force"].value == pytest.approx(COUNTS)


def test_measured_channel_may_lack_in_some_trials(tmp_path: Path) -> None:
    text = MAPPING + 'pressure = "2 * AIN4 [bar]"\n' + TRIALS
    dataset = load(tmp_path, text, AIN4=1.5 + 0 * COUNTS)
    assert [list(trial.measured) for trial in dataset.trials] == [["force"], ["force", "pressure"]]
    (remark,) = dataset.remarks
    assert "[columns] pressure = '2 * AIN4 [bar]' cannot be computed: there is no column 'AIN4'; did you mean" in remark
    assert remark.endswith("the trial is used without it")


@pytest.mark.parametrize(
    ("channel", "expression", "column"),
    [("force", "forze * 2 [N]", "forze"), ("force", "force(:,2) [N]", "force(:,2)"), ("length", "lenth [mm]", "lenth")],
)
def test_misspelt_column_is_refused_beside_one_called_as_the_channel(
    tmp_path: Path, channel: str, expression: str, column: str
) -> None:
    text = f'[columns]\n{channel} = "{expression}"\n[[trial]]\nfiles = ["c.csv"]\n'
    columns = {"time [s]": 0.01 * COUNTS, "length [mm]": 340 + 0 * COUNTS, "pressure_command [bar]": 3 + 0 * COUNTS}
    write(tmp_path / "c.csv", columns | {"force [N]": 690 + 0 * COUNTS})
    sentence = load_error(tmp_path, text)
    assert f"[columns] {channel} = '{expression}' cannot be computed: there is no column '{column}'" in sentence
    assert "he columns are 'time [s]', 'length [mm]', 'pressure_command [bar]', 'force [N]'" in sentence


def test_channel_may_be_calibrated_in_some_trials_only(tmp_path: Path) -> None:
    dataset = load(tmp_path, raw_force=None, **{"force [N]": 690 + 0 * COUNTS})
    assert dataset.trials[1].measured["force"].value == pytest.approx(690.0)
    remark = next(remark for remark in dataset.remarks if "cannot be computed" in remark)
    assert "b.csv: [columns] force = '(0.5 * `raw force` + 150) * 4.4482216152605 [N]' cannot be computed" in remark
    assert remark.endswith("; its column 'force' is used as it is")


def test_other_unit_than_in_the_heading_is_reported(tmp_path: Path) -> None:
    text = MAPPING.replace('"stroke"', '"depth [cm]"') + '[[trial]]\nfiles = ["b.csv"]\n'
    dataset = load(tmp_path, text, **{"depth [mm]": 34 + 0 * COUNTS})
    assert dataset.trials[0].prescribed["length"].value == pytest.approx(0.34)
    assert "column 'depth [mm]' is read in cm, as " in dataset.remarks[1]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("time =", "tiem =", "[columns] names the unknown channel 'tiem'; did you mean 'time'? Allowed: time, length"),
        ('"t [ms]"', "3", "columns.time = 3 is refused; allowed: a table of channel = 'expression [unit]', as text"),
        ("[ms]", "[mm]", "[columns] time = 't [mm]' has a unit of the wrong kind; allowed: s, ms, min"),
        ("[N]", "[lbs]", "has a unit of mass, 'lbs'; did you mean 'lbf'? Allowed: N, kN, kgf, lbf"),
        ("[N]", "[kg]", "has a unit of mass, 'kg'; did you mean 'kgf'? Allowed: N, kN, kgf, lbf"),
        ("t [ms]", "t", "[columns] time = 't' names a column without a unit; write for example 't [s]'"),
        ("t [ms]", "x [ms]", "has no time: there is no column 'x'; the columns are 't', 'stroke [mm]', 'AIN3', 'raw"),
        ('"stroke"', '"strok"', "'strok' cannot be computed: there is no column 'strok'; did you mean 'stroke [mm]'?"),
        ("`raw force`", "`raw farce`", "there is no column 'raw farce'; did you mean 'raw force'?"),
        ("2.5 [bar]", "2.5 bar", "[columns] pressure_command = '(AIN3 - 0.5) * 2.5 bar', position 20: 'bar' is not"),
        ("(AIN3 - 0.5)", "(AIN3 - 0.5) / 0", "the value is infinite"),
        ("(AIN3 - 0.5)", "(AIN3 - AIN3) / (AIN3 - AIN3)", "is not a number in row 1; look for a division by 0"),
        ("length =", "unit_length = '340 [mm]'\nlength =", "are the same channel; remove one of them"),
    ],
)
def test_invalid_columns_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in MAPPING
    assert message in load_error(tmp_path, MAPPING.replace(old, new, 1) + TRIALS)


def test_column_that_only_one_trial_names_must_exist(tmp_path: Path) -> None:
    sentence = load_error(tmp_path, MAPPING + TRIALS + '[trial.columns]\npressure = "AIN4 [bar]"\n')
    assert "b.csv: [trial.columns] pressure = 'AIN4 [bar]' cannot be computed: there is no column 'AIN4'" in sentence


def test_name_that_two_headings_match_is_refused(tmp_path: Path) -> None:
    text = '[columns]\nforce = "Raw [N]"\n[[trial]]\nfiles = ["c.csv"]\n'
    write(tmp_path / "c.csv", {"raw [V]": COUNTS, "RAW [A]": COUNTS})
    assert "names 'Raw', but columns 'raw [V]' and 'RAW [A]' match it; write the complete heading in" in load_error(
        tmp_path, text
    )
    (tmp_path / "c.csv").write_text("Raw [N],Raw [N]\n1,2\n", "utf-8")
    assert "names 'Raw', but 2 columns have the heading 'Raw [N]'; rename all but one in the file" in load_error(
        tmp_path, text
    )


MAT = """[columns]
time = "row / fs [s]"
length = "340 [mm]"
pressure_command = "run.inlet [kPa]"
pressure = "data(:,2) [kPa]"
[[trial]]
files = ["a.mat"]
[trial.columns]
force = "4 * run.counts + 690 [N]"
"""


def write_mat(folder: Path, **changes: object) -> None:
    inlet = 300 + 0 * COUNTS
    run = {"inlet": inlet, "counts": np.zeros(N, np.int16)}
    content = {"fs": 100.0, "run": run, "data": np.column_stack((COUNTS, inlet)), "note": "text", "other": np.zeros(7)}
    savemat(folder / "a.mat", content | changes, do_compression=True)


def test_matlab_files_are_trial_files(tmp_path: Path) -> None:
    write_mat(tmp_path)
    dataset = load(tmp_path, MAT)
    (trial,) = dataset.trials
    assert trial.name == "a"
    assert dataset.remarks == ()
    assert trial.prescribed["pressure_command"].time == pytest.approx(COUNTS / 100)
    assert trial.prescribed["pressure_command"].value == pytest.approx(3e5)
    assert trial.measured["force"].value == pytest.approx(690.0)
    assert trial.measured["pressure"].value == pytest.approx(3e5)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("data(:,2)", "data", "'data' is a matrix of size 20x2; name one part of it, data(:,1) to data(:,2)"),
        ("data(:,2)", "data(:,3)", "there is no column 'data(:,3)'; did you mean 'data("),
        ("run.counts", "note", "'note' is text"),
        ("run.counts", "other", "has 20 values and 'other' 7"),
        ("row / fs [s]", "row / 0 / fs [s]", "is not a number in row 1; look for a division by 0"),
        (
            'time = "row / fs [s]"',
            "",
            "has no column 'time [s]'; its columns are 'fs', 'run.inlet', 'run.co",
        ),
        ("run.inlet [kPa]", "run.inlet", "names a column without a unit; write for example 'run.inlet [bar]'"),
    ],
)
def test_invalid_columns_of_matlab_files_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in MAT
    write_mat(tmp_path)
    assert message in load_error(tmp_path, MAT.replace(old, new, 1))


REAL = """[columns]
time = "data(:,1) [s]"
pressure = "data(:,2) [kPa]"
pressure_command = "620 [kPa]"
length = "340 [mm]"
"""


@pytest.mark.extras
def test_real_filling_tests_are_a_dataset(tmp_path: Path) -> None:
    files = sorted(Path(os.environ.get("KLUTE_SIM_DATA", "/nonexistent")).glob("pam_fill_tests/*.mat"))
    if not files:
        pytest.skip("set KLUTE_SIM_DATA to the folder of the measured data")
    dataset = load(tmp_path, REAL + "".join(f'[[trial]]\nfiles = ["{path}"]\n' for path in files))
    for trial in dataset.trials:
        pressure = trial.measured["pressure"]
        assert 6.1e5 < pressure.value.max() < 6.4e5
        assert 0.009 < pressure.sampling_interval < 0.02


def test_command_names_the_expression_that_is_wrong(tmp_path: Path) -> None:
    load(tmp_path)
    (tmp_path / "dataset.toml").write_text(HEAD + MAPPING.replace("* 2.5 [bar]", "* 2.5 bar") + TRIALS)
    result = run("diagnose", str(tmp_path))
    assert result.returncode == 2
    assert "[columns] pressure_command = '(AIN3 - 0.5) * 2.5 bar', position 20" in " ".join(result.stderr.split())


def test_each_file_has_the_time_whose_column_it_has(tmp_path: Path) -> None:
    times = 'time = ["t [ms]", "`Time (s)`"]\n'
    text = "[columns]\n" + CHANNELS.replace('time = "t [ms]"\n', times) + 'pressure = "100 * p [kPa]"\n'
    trial = '[[trial]]\nfiles = ["a.csv", "c.csv"]\n'
    write(tmp_path / "c.csv", {"Time (s)": 0.02 * COUNTS, "p": 3 + 0 * COUNTS})
    loaded = load(tmp_path, text + trial).trials[0]
    assert loaded.prescribed["length"].time == pytest.approx(0.01 * COUNTS)
    assert loaded.measured["pressure"].time == pytest.approx(0.02 * COUNTS)
    write(tmp_path / "c.csv", {"zeit [s]": 0.02 * COUNTS, "p": 3 + 0 * COUNTS})
    assert (
        "c.csv has no time: it does not have the columns of 't [ms]' or '`Time (s)`'; its columns are 'zeit [s]', 'p'; "
        'state the time of each kind of file in a list: time = ["t [ms]", "`Time (s)`", "`zeit [s]`"]'
    ) in load_error(tmp_path, text + trial)
    assert "there is no column 't'; the columns are 'zeit [s]', 'p'; state the time of each" in load_error(
        tmp_path, text.replace(times, 'time = "t [ms]"\n') + trial
    )
    write(tmp_path / "c.csv", {"Time (s)": 0.02 * COUNTS, "p": 3 + 0 * COUNTS})
    assert 'time = ["t [ms]", "`Time (s)`"]' in load_error(tmp_path, text.replace(times, 'time = "t [ms]"\n') + trial)
    assert "[columns] length is a list; only 'time' may be one" in load_error(
        tmp_path, text.replace('"stroke"', '["stroke", "pos [mm]"]') + trial
    )
