"""One trial file: units, headings, cells, and error messages."""

import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.datasets import channels, unit_conversion
from klute_sim.datasets.trial_files import table
from klute_sim.datasets.trial_files.expressions import parse_expression
from klute_sim.errors import InputError

BENCH = channels.get_column_units("bench")


def read(folder: Path, content: bytes | str, name: str = "a.csv") -> table.Table:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return table.read_trial_file(path, BENCH)


def read_error(folder: Path, content: bytes | str, name: str = "a.csv") -> str:
    with pytest.raises(InputError) as caught:
        read(folder, content, name)
    sentence = str(caught.value)
    assert str(folder / name) in sentence
    assert "\n" not in sentence
    return sentence


@pytest.mark.parametrize(
    ("unit", "si", "value"),
    [
        ("bar", "Pa", 1e5),
        ("kPa", "Pa", 1e3),
        ("MPa", "Pa", 1e6),
        ("psi", "Pa", 4.4482216152605 / 0.0254**2),
        ("N/mm^2", "Pa", 1e6),
        ("kgf/cm^2", "Pa", 98066.5),
        ("mm", "m", 1e-3),
        ("in", "m", 0.0254),
        ("N", "N", 1.0),
        ("kgf", "N", 9.80665),
        ("lbf", "N", 4.4482216152605),
        ("s", "s", 1.0),
        ("ms", "s", 1e-3),
        ("µs", "s", 1e-6),
        ("deg", "rad", np.pi / 180),
        ("°", "rad", np.pi / 180),
        ("rad", "rad", 1.0),
        ("N*m", "N*m", 1.0),
        ("N·m", "N*m", 1.0),
        ("N⋅m", "N*m", 1.0),
        ("lbf*ft", "N*m", 1.3558179483314),
    ],
)
def test_units_convert_to_si(unit: str, si: str, value: float) -> None:
    assert unit_conversion.get_si_factor(unit, si) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "si"),
    [
        ("mm", "N"),
        ("N", "m"),
        ("kg", "N"),
        ("%", "rad"),
        ("1", "rad"),
        ("", "rad"),
        ("Hz", "s"),
        ("degC", "Pa"),
        ("Nm", "N*m"),
        ("N", "N*m"),
        ("bananas", "N"),
        ("N;", "N"),
        ("N'", "N"),
        ("m^9^9^9", "m"),
        ("m**9**9**9", "m"),
        ("m^99999999999", "m"),
        ("__import__('os')", "m"),
    ],
)
def test_units_of_another_kind_have_no_factor(unit: str, si: str) -> None:
    assert unit_conversion.get_si_factor(unit, si) is None


@given(st.text(max_size=12), st.sampled_from(sorted(unit_conversion.EXAMPLE_UNITS)))
def test_any_text_has_a_positive_factor_or_none(unit: str, si: str) -> None:
    factor = unit_conversion.get_si_factor(unit, si)
    assert factor is None or (isinstance(factor, float) and factor > 0)


@pytest.mark.parametrize("unit", ["grad", "Grad", "grad/s"])
def test_grad_is_refused(unit: str) -> None:
    si_unit = "rad/s" if "/" in unit else "rad"
    assert unit_conversion.get_si_factor(unit, si_unit) is None
    sentence = unit_conversion.describe_wrong_unit(unit, si_unit)
    assert sentence.startswith(f"the ambiguous unit '{unit}'; did you mean 'deg")
    assert unit_conversion.get_si_factor("gon", "rad") == pytest.approx(np.pi / 200)


def test_example_units_are_valid_and_cover_all_channels() -> None:
    for rig in channels.RIGS:
        assert set(channels.get_column_units(rig).values()) <= set(unit_conversion.EXAMPLE_UNITS)
    for si, units in unit_conversion.EXAMPLE_UNITS.items():
        assert all(unit_conversion.get_si_factor(unit, si) for unit in units.split(", "))


def test_requested_columns_are_in_si_and_others_are_listed(tmp_path: Path) -> None:
    result = read(tmp_path, 'time [ms],note,force [kgf],pressure [psi]\n1,"a, b",2,3\n2,é,,5\n')
    assert result.columns["time"] == pytest.approx([1e-3, 2e-3])
    assert result.columns["force"] == pytest.approx([2 * 9.80665, np.nan], nan_ok=True)
    assert result.columns["pressure"] == pytest.approx([3 * 6894.757293, 5 * 6894.757293])
    assert result.ignored == ("note",)
    assert result.headings["force"] == "force [kgf]"
    assert set(result.columns) == {"time", "force", "pressure"}


@pytest.mark.parametrize(
    "content",
    [
        "time [s];force [N]\n1;2\n3;4\n",
        "time [s]\tforce [N]\n1\t2\n3\t4\n",
        "\ufefftime [s],force [N]\n1,2\n3,4\n",
        "time [s],force [N]\r\n1,2\r\n3,4\r\n",
        "time [s],force [N]\r1,2\r3,4",
        '"time [s]","force [N]"\n"1",2\n3,"4"\n',
        "\n  \ntime [s],force [N]\n\n1,2\n\n3,4\n\n",
        "Time[s], Force [ N ] \n 1 , 2\n 3,4 \n",
        "time [s],force [N],,\n1,2,,\n3,4,,\n",
        "time [s],force [N]\n1e0,+2.\n.3e1,4\n",
        "time [s];force [N]\n1,0;2,00\n3;4\n",
        "time [s]\tforce [N]\tnote\n0,1e1\t2\t1.5 m\n3,000\t4,0\t\n",
        "time [s];force [N];date\n1;2;1,5\n3;4;2.5\n",
        "time [s];force [N]\n1,000;2,000\n3,000;004,000\n",
        "# time [s], force [N]\n1,2\n3,4\n",
        "% time [s];force [N]\n1;2\n3;4\n",
        "time,force\n(s),(N)\n1,2\n3,4\n",
        "Machine,7\nTest,3\nTime,Force\n(s),(N)\n1,2\n3,4\n",
        "Time;Force;note\n[ms];[kN];\n1000;0,002;\n3000;0,004;\n",
        "Logger 7, serial 3\nrate [Hz];10\n\ntime [s];force [N]\n1;2\n3;4\n",
        "LabVIEW Measurement\nDate\t2026/11/23\n***End_of_Header***\n\ntime [s]\tforce [N]\n1\t2\n3\t4\n",
    ],
)
def test_csv_dialects_are_read_alike(tmp_path: Path, content: str) -> None:
    result = read(tmp_path, content)
    assert result.columns["time"].tolist() == [1, 3]
    assert result.columns["force"].tolist() == [2, 4]


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig", "cp1252"])
def test_encodings_of_spreadsheets_and_instruments_are_read(tmp_path: Path, encoding: str) -> None:
    units = {"time": "s", "ankle_angle": "rad"}
    (tmp_path / "a.csv").write_bytes("time [µs];ankle_angle [°];Gerät\n1,5;180;ü\n2,5;90;ü\n".encode(encoding))
    result = table.read_trial_file(tmp_path / "a.csv", units)
    assert result.columns["time"] == pytest.approx([1.5e-6, 2.5e-6])
    assert result.columns["ankle_angle"] == pytest.approx([np.pi, np.pi / 2])
    assert result.ignored == ("Gerät",)


PREAMBLE = "Operator;Smith\nForce;100 N\ntime [s];force [N]\n1;2\n3;4\n"


def test_heading_below_other_text_is_found_and_reported(tmp_path: Path) -> None:
    result = read(tmp_path, PREAMBLE)
    assert result.remarks == (
        f"trial file {tmp_path / 'a.csv'}: line 3 is read as the heading (heading_row changes this)",
    )
    assert result.locate_row(1) == "line 5"


def test_heading_row_selects_the_heading(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time [s];force [N]\nnames below\nTIME [s];force [kN]\n1;2\n3;4\n")
    assert table.read_trial_file(path, BENCH, heading_row=3).columns["force"].tolist() == [2000, 4000]
    assert table.read_trial_file(path, BENCH, heading_row=3).remarks == ()
    for row, message in (
        (1, "line 2 has 1 cell, but the heading (line 1) has 2 cells"),
        (4, "has no heading: line 4 must name the columns, such as"),
        (9, "heading_row = 9 is beyond its last line, 5; give the line of the heading"),
    ):
        with pytest.raises(InputError) as caught:
            table.read_trial_file(path, BENCH, heading_row=row)
        assert message in str(caught.value)


def test_heading_is_found_by_the_columns_of_expressions(tmp_path: Path) -> None:
    expressions = {
        "time": [parse_expression("X [s]", "s", "", "")],
        "force": [parse_expression("2 * `Y, raw` [N]", "N", "", "")],
    }
    (tmp_path / "a.csv").write_text('a;b\nX;100\nX;"Y, raw"\n1;2\n3;4\n')
    assert table.read_trial_file(tmp_path / "a.csv", BENCH, expressions).columns["force"].tolist() == [4, 8]


@pytest.mark.parametrize("cell", ["1" * 200_000 + "x", "a" + " " * 200_000 + "b", "1,234" * 40_000, "[" * 200_000])
def test_long_cells_are_refused_quickly(tmp_path: Path, cell: str) -> None:
    start = time.perf_counter()
    read_error(tmp_path, f"time [s];force [N]\n1;2\n3;{cell}\n")
    read_error(tmp_path, f"{cell};{cell}\n1;2\n")
    assert time.perf_counter() - start < 2.0


@pytest.mark.parametrize("cell", ["", "   ", '""', "nan", "NaN"])
def test_empty_cell_is_a_missing_sample(tmp_path: Path, cell: str) -> None:
    result = read(tmp_path, f"time [s],force [N]\n1,{cell}\n2,3\n")
    assert np.isnan(result.columns["force"]).tolist() == [True, False]


@pytest.mark.parametrize("end", ["\n\n", "  \n\t\n", ",\n,\n", " , ", "\r\n,\r\n", ",\r,\r"])
def test_empty_rows_at_the_end_are_no_samples(tmp_path: Path, end: str) -> None:
    result = read(tmp_path, f"time [s],force [N]\n1,2\n2,\n{end}")
    assert result.columns["time"].tolist() == [1.0, 2.0]
    assert np.isnan(result.columns["force"]).tolist() == [False, True]


def test_row_location_is_the_line_number_in_an_editor(tmp_path: Path) -> None:
    result = read(tmp_path, "\n\ntime [s],force [N]\r\n1,2\n\n3,4\n")
    assert [result.locate_row(0), result.locate_row(1)] == ["line 4", "line 6"]


HEAD = "time [s],force [N]\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty"),
        (" \n\n", "is empty"),
        (b"\xef\xbb\xbf", "is empty"),
        (b"\x7fELF\x00\x01\x02\n1,2\n", "is neither text nor Parquet nor a MAT-file; allowed"),
        (b"PK\x03\x04\x14\x00\x06\x00", "is a spreadsheet or an archive; save the sheet as CSV"),
        (HEAD + "1,2\n" + HEAD + "3,4\n", "line 3 repeats the heading; delete it, or write each recording into its"),
        ("time [s],force [N]\n1,2\n".encode("utf-16")[:-1], "is damaged UTF-16 text; save it as UTF-8"),
        (b"time [s],force [\xb0]\n1,2\n", "column 'force [°]' has a unit of the wrong kind"),
        ("1,2\n3,4\n", "has no heading: the first line must name the columns, such as 'time [s]'"),
        ("1,5;2,5\n3,5;4,5\n", "has no heading"),
        ("time[s] force[N]\n0 1.5\n", "its columns are separated by spaces; separate them by commas, semicolons or"),
        ("time [s]   force [N]\n\n  0,0   1,5\n", "its columns are separated by spaces"),
        ("Bench 3\nFilling, slow\n\ntime force\n 0.0 -1.5e-3\n", "its columns are separated by spaces"),
        ("Bench 3, slow\ntime force\n 0.0 nan\n", "its columns are separated by spaces"),
        ('time [s],"force [N]\n1,2\n', "the heading line cannot be read"),
        ("time [s],force\n1,2\n", "column 'force' has no unit in square brackets; write for example 'force [N]'"),
        (
            "time [s],Force (V)\n1,2\n",
            "'Force (V)' is a raw reading in V; state its calibration under [columns], for example force = "
            '"(`Force (V)` - 0.5) * 2.5 [N]" if it reads 0.5 V at 0 N',
        ),
        ("time [s],force [counts]\n1,2\n", "column 'force [counts]' is a raw reading in counts; state its calibration"),
        ("time (s),force [N]\n1,2\n", "column 'time (s)' has no unit in square brackets; write for example 'time [s]'"),
        ("time [s],length\n1,2\n", "write for example 'length [mm]'"),
        ("time [s],pressure\n1,2\n", "write for example 'pressure [bar]'"),
        ("time [s],force [mm]\n1,2\n", "column 'force [mm]' has a unit of the wrong kind; allowed: N, kN, kgf, lbf"),
        ("time [s],force []\n1,2\n", "column 'force []' has a unit of the wrong kind"),
        ("time [s],force [N],Force [kN]\n1,2,3\n", "columns 'force [N]' and 'Force [kN]' are the same channel"),
        (HEAD + "1,2\n\n3,abc\n", "column 'force [N]', line 4: 'abc' is not a number; leave the cell of a missing"),
        (
            HEAD + "10:15:00.000,2\n",
            "line 2: '10:15:00.000' is a date or a time of day, which cannot be read; write sec",
        ),
        (HEAD + "2024-03-11T10:15:00.000,2\n", "'2024-03-11T10:15:00.000' is a date or a time of day, which cannot be"),
        (HEAD + "11.03.2024 10:15,2\n", "'11.03.2024 10:15' is a date or a time of day, which cannot be read"),
        (HEAD + "now,2\n", "line 2: 'now' is not a number; every row needs a time as a number, such as seconds"),
        (HEAD + "1,2\n3,1_0\n", "line 3: '1_0' is not a number"),
        (HEAD + "1,2\n3,inf\n", "line 3: the value is infinite"),
        (HEAD + "1,2\n3,-Infinity\n4,2\n", "line 3: the value is infinite"),
        (HEAD + "1,2\n3,1e999\n", "line 3: the value is infinite"),
        (HEAD + "1,2\n3,1e999\n4,x\n", "line 3: '1e999' is too large"),
        (HEAD + "1,2\n3\n", "line 3 has 1 cell, but the heading (line 1) has 2 cells"),
        (
            HEAD + "1,2\n3,4,5\n",
            "line 3 has 3 cells, but the heading (line 1) has 2 cells; write decimal points, not commas",
        ),
        ("time [s];force [N]\n0.5;2\n2;1,5\n", "points are mixed: '0.5' (line 2) and '1,5' (line 3); use one of them"),
        (
            "time [s];force [N]\n0;1,5\n2;1.5\n",
            "mixed: '1,5' (line 2) and '1.5' (line 3); use one of them in the whole",
        ),
        (
            HEAD + '"0,000","1,5"\n',
            "line 2: '0,000' has a decimal comma; write decimal points, or separate the cells by",
        ),
        (HEAD + '1,"1,5"\n', "line 2: '1,5' has a decimal comma; write decimal points, or separate the cells by"),
        (HEAD + '1,"1,234"\n', "line 2: '1,234' may have a decimal comma or separate thousands; write decimal points"),
        (HEAD + '1,"1,234,567"\n', "line 2: '1,234,567' separates thousands; write digits without separators"),
        ("time [s];force [N]\n0;1.234,5\n", "'1.234,5' separates thousands; write digits without separators"),
        ("time [s]\tforce [N]\n0\t1,234.5\n", "'1,234.5' separates thousands; write digits without"),
        ("time [s];force [N]\n0;1,234,567\n", "'1,234,567' separates thousands; write digits without"),
        ("time [s];force [N]\n0;1 234\n", "'1 234' separates thousands; write digits without"),
        ("time [s];force [N]\n1e-2;1,234\n", "line 2: '1,234' may have a decimal comma or separate thousands; write"),
        ("time [s];force [N]\n0;999\n1;1,234\n", "line 3: '1,234' may have a decimal comma or separate thousands; wr"),
        ("time [s];force [N]\n1;2\n2;1;5\n", "line 3 has 3 cells, but the heading (line 1) has 2 cells"),
        ('time [s],force [N],x\n1,2,\n2,3,"oops\n3,4,\n', "line 3 opens a quote and does not close it"),
        (HEAD.encode() + b"1,2\n3,\xff\n", "line 3: '\ufffd' is not a number"),
    ],
)
def test_invalid_text_is_refused_with_location_and_fix(tmp_path: Path, content: bytes | str, message: str) -> None:
    assert message in read_error(tmp_path, content)


def test_surplus_cell_is_not_attributed_to_decimal_commas(tmp_path: Path) -> None:
    sentence = read_error(tmp_path, "time [s];force [N]\n1;2\n2;1;5\n")
    assert "decimal" not in sentence


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.csv does not exist; give paths relative to the folder"):
        table.read_trial_file(tmp_path / "a.csv", BENCH)
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        table.read_trial_file(tmp_path, BENCH)


def parquet(folder: Path, columns: dict[str, object]) -> bytes:
    pq.write_table(pa.table(columns), folder / "x.parquet")
    return (folder / "x.parquet").read_bytes()


@pytest.mark.parametrize("name", ["a.parquet", "a.pq", "a.csv"])
def test_parquet_is_recognized_by_its_content(tmp_path: Path, name: str) -> None:
    content = parquet(tmp_path, {"time [s]": [1, 2], "force [kN]": [1.5, None], "note": ["x", "y"]})
    result = read(tmp_path, content, name)
    assert result.columns["time"].tolist() == [1, 2]
    assert result.columns["force"] == pytest.approx([1500, np.nan], nan_ok=True)
    assert result.ignored == ("note",)
    assert result.locate_row(1) == "row 2"


def test_parquet_may_have_other_columns_of_lists_and_structs(tmp_path: Path) -> None:
    nested = {"pose": [{"x": 1.0, "y": 2.0}] * 2, "samples": [[1.0, 2.0], []]}
    result = read(tmp_path, parquet(tmp_path, {**nested, "time [s]": [1, 2], "force [N]": [3, 4]}), "a.parquet")
    assert result.columns["force"].tolist() == [3.0, 4.0]
    assert result.ignored == ("pose", "samples")


def test_invalid_parquet_is_refused(tmp_path: Path) -> None:
    used = {"time [s]": [1, 2], "force [N]": [[1.0], [2.0]]}
    assert "column 'force [N]' holds list<" in read_error(tmp_path, parquet(tmp_path, used), "a.parquet")
    assert "is not a Parquet file" in read_error(tmp_path, "time [s],force [N]\n1,2\n", "a.parquet")
    assert "is empty" in read_error(tmp_path, "", "a.parquet")
    text = parquet(tmp_path, {"time [s]": [1.0], "force [N]": ["2"]})
    assert "column 'force [N]' holds string; allowed: numbers" in read_error(tmp_path, text, "a.parquet")
    timestamps = parquet(tmp_path, {"time [s]": pa.array([1], pa.timestamp("us"))})
    assert "column 'time [s]' holds timestamp[us]" in read_error(tmp_path, timestamps, "a.parquet")
    infinite = parquet(tmp_path, {"time [s]": [1.0, 2.0], "force [N]": [2.0, -np.inf]})
    assert "column 'force [N]', row 2: the value is infinite" in read_error(tmp_path, infinite, "a.parquet")
    truncated = parquet(tmp_path, {"time [s]": [1.0, 2.0]})
    assert "is not a Parquet file" in read_error(tmp_path, truncated[:-9], "a.parquet")


def test_digest_depends_on_the_content_only(tmp_path: Path) -> None:
    first = read(tmp_path, HEAD + "1,2\n").digest
    assert read(tmp_path, HEAD + "1,2\n", "b.csv").digest == first
    assert read(tmp_path, HEAD + "1,3\n").digest != first


def test_comma_after_the_last_cell_of_every_row_is_no_cell(tmp_path: Path) -> None:
    read_table = read(tmp_path, "time [s],force [N]\n0,1,\n1,2,\n")
    assert read_table.columns["force"].tolist() == [1.0, 2.0]
    assert "line 2 has 3 cells" in read_error(tmp_path, "time [s],force [N]\n0,1,5\n1,2,5\n", "b.csv")


def test_heading_of_a_labview_file_is_below_the_words_of_its_head(tmp_path: Path) -> None:
    head = "LabVIEW Measurement\nChannels\t3\nX_Dimension\tTime\tTime\tTime\n***End_of_Header***\n"
    found = read(tmp_path, head + "time [s]\tforce [N]\tpressure [bar]\n0\t1\t2\n1\t3\t2\n")
    assert found.columns["force"].tolist() == [1.0, 3.0]
