"""Import of one published stride in % of the gait cycle, and of units in round brackets."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.constants import GRAVITY
from klute_sim.errors import InputError
from klute_sim.gait import reference
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import sources
from klute_sim.mocap.parsing.channel_names import split_unit
from klute_sim.mocap.parsing.single_stride import (
    N_FINE_ROWS,
    find_percent_label,
    interpolate_cycle,
    unroll_single_strides,
)
from klute_sim.mocap.reference_import import import_reference
from tests.command_line import run
from tests.synthetic_gait import HUMAN, MASS

COLUMNS = {
    "Hip flexion (deg)": "hip_flexion_deg",
    "Knee flexion (deg)": "knee_flexion_deg",
    "Ankle dorsiflexion (deg)": "ankle_dorsiflexion_deg",
    "Ankle moment (Nm/kg)": "ankle_plantarflexor_moment_nm_per_kg",
    "GRF vertical (N/kg)": "grf_vertical_n_per_kg",
    "GRF forward (N/kg)": "grf_forward_n_per_kg",
}
"""Heading of a published table -> column of the reference."""
AXES, ANKLE_HEIGHT = ("vertical", "forward"), 0.08
"""Words for the axes of the ground reaction in :data:`COLUMNS`, and height of the ankle above the ground [m]."""
OPTIONS = ImportOptions(mass=MASS, stride_time=1.2, ankle_zero="file")


def write_stride(path: Path, n_rows: int = 51, heading: str = "Gait cycle (%)", end: float = 100.0) -> Path:
    percent = np.linspace(0.0, end, n_rows)
    columns = [percent, *(HUMAN(name, percent / 100.0) for name in COLUMNS.values())]
    rows = [",".join((heading, *COLUMNS)), *(",".join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True))]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("n_rows", [51, 101])
def test_published_stride_becomes_the_reference(n_rows: int, tmp_path: Path) -> None:
    result = import_reference([write_stride(tmp_path / "stride.csv", n_rows)], OPTIONS)
    assert len(result.strides["right"]) == 1
    assert result.stride_time == pytest.approx(1.2)
    for column in ("knee_flexion_deg", "ankle_dorsiflexion_deg", "ankle_plantarflexor_moment_nm_per_kg"):
        expected = HUMAN(column, result.table["gait_pct"] / 100.0)
        assert result.table[column] == pytest.approx(expected, abs=0.015 * np.ptp(expected))
    load = HUMAN("grf_vertical_n_per_kg", result.table["gait_pct"] / 100.0)
    inside = (result.table["gait_pct"] > 3.0) & (result.table["gait_pct"] < 60.0)
    assert result.table["grf_vertical_n_per_kg"][inside] == pytest.approx(load[inside], abs=0.2)
    assert not any(name.endswith("_sd_deg") for name in result.table)
    assert any("one stride over 'Gait cycle (%)', 1.2 s long" in sentence for sentence in result.log.derived)
    reference.parse_reference(result.to_csv(), "stride", result.stride_time)


def write_positions(path: Path, ankle_x: float = 0.3, offset: float = 0.0, gap: range = range(0)) -> Path:
    """Write a stride whose moment is replaced by positions that determine it; the foot has no mass."""
    percent = np.linspace(0.0, 100.0, 101)
    columns = {label: HUMAN(name, percent / 100.0) for label, name in COLUMNS.items()}
    moment, up, ahead = (columns.pop("Ankle moment (Nm/kg)"), *(columns[f"GRF {a} (N/kg)"] for a in AXES))
    is_loaded = up > 0.5
    cop = np.where(is_loaded, ankle_x + offset + (moment - ANKLE_HEIGHT * ahead) / np.where(is_loaded, up, 1.0), np.nan)
    cop[list(gap)] = np.nan
    columns |= {"cop_x [m]": cop, "ankle_x [m]": np.full(101, ankle_x), "ankle_z [m]": np.full(101, ANKLE_HEIGHT)}
    rows = zip(percent, *columns.values(), strict=True)
    lines = [",".join("" if np.isnan(v) else f"{v:.6f}" for v in row) for row in rows]
    path.write_text("\n".join([",".join(("Gait cycle (%)", *columns)), *lines]) + "\n")
    return path


def test_moment_follows_from_centre_of_pressure_and_ankle(tmp_path: Path) -> None:
    result = import_reference([write_positions(tmp_path / "stride.csv")], OPTIONS)
    phase = result.table["gait_pct"] / 100.0
    expected = HUMAN("ankle_plantarflexor_moment_nm_per_kg", phase)
    moment = result.table["ankle_plantarflexor_moment_nm_per_kg"]
    assert moment == pytest.approx(expected, abs=0.03)
    assert moment.max() == pytest.approx(expected.max(), abs=0.01)
    assert any("weight and inertia of the foot are neglected" in sentence for sentence in result.log.derived)
    assert {"cop_x", "ankle_x", "ankle_z"} <= {entry["channel"] for entry in result.log.channels}


def test_positions_from_different_origins_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"`cop_x` is 1\.\d+ m from the ankle under load, .* it has another origin"):
        import_reference([write_positions(tmp_path / "stride.csv", ankle_x=1.3, offset=1.5)], OPTIONS)


@pytest.mark.parametrize(
    ("dropped", "needed"),
    [
        ((), "'cop_x [m]', 'ankle_x [m]', 'ankle_z [m]'"),
        (("ankle_z",), "the column 'ankle_z [m]' ("),
        (("cop_x", "ankle_z"), "the columns 'cop_x [m]', 'ankle_z [m]' ("),
    ],
)
def test_refusal_without_moment_says_what_to_add(dropped: Sequence[str], needed: str, tmp_path: Path) -> None:
    lines = write_positions(tmp_path / "stride.csv").read_text().splitlines()
    names = lines[0].split(",")
    dropped = dropped or ("cop_x", "ankle_x", "ankle_z")
    kept = [k for k, name in enumerate(names) if name.removesuffix(" [m]") not in dropped]
    (tmp_path / "stride.csv").write_text("\n".join(",".join(line.split(",")[k] for k in kept) for line in lines) + "\n")
    with pytest.raises(InputError) as caught:
        import_reference([tmp_path / "stride.csv"], OPTIONS)
    assert "add a column 'Ankle moment [N*m/kg]', the inverse dynamics (.sto), the markers" in str(caught.value)
    assert needed in str(caught.value)


def test_long_gaps_of_the_centre_of_pressure_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"'cop_x \[m\]' is empty for \d+ % of the loaded time"):
        import_reference([write_positions(tmp_path / "stride.csv", gap=range(15, 45))], OPTIONS)


def test_table_without_fore_aft_load_and_moment_names_both(tmp_path: Path) -> None:
    lines = write_stride(tmp_path / "stride.csv").read_text().splitlines()
    kept = [
        k for k, name in enumerate(lines[0].split(",")) if name not in ("Ankle moment (Nm/kg)", "GRF forward (N/kg)")
    ]
    (tmp_path / "stride.csv").write_text("\n".join(",".join(line.split(",")[k] for k in kept) for line in lines) + "\n")
    message = "add a column 'GRF forward [N/kg]'; also missing: ankle moment"
    with pytest.raises(InputError, match=message.replace("[", r"\[").replace("]", r"\]")):
        import_reference([tmp_path / "stride.csv"], OPTIONS)


def test_units_in_square_brackets_are_those_of_round_ones(tmp_path: Path) -> None:
    path = write_stride(tmp_path / "stride.csv")
    expected = import_reference([path], OPTIONS).table
    path.write_text(path.read_text().replace("(Nm/kg)", "[Nm/kg]").replace("(N/kg)", "[N/kg]"))
    table = import_reference([path], OPTIONS).table
    assert table.keys() == expected.keys()
    for column in expected:
        np.testing.assert_array_equal(table[column], expected[column])


@pytest.mark.parametrize(("unit", "scale"), [("N/kg", 1.0), ("BW", 1.0 / GRAVITY), ("%BW", 100.0 / GRAVITY)])
def test_ground_reactions_may_be_fractions_of_the_body_weight(unit: str, scale: float, tmp_path: Path) -> None:
    path = write_stride(tmp_path / "stride.csv")
    expected = import_reference([path], OPTIONS).table["grf_vertical_n_per_kg"]
    heading, *rows = path.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    scaled = [",".join([*row[:-2], *(f"{scale * float(cell):.8f}" for cell in row[-2:])]) for row in cells]
    path.write_text("\n".join([heading.replace("(N/kg)", f"[{unit}]"), *scaled]) + "\n")
    assert import_reference([path], OPTIONS).table["grf_vertical_n_per_kg"] == pytest.approx(expected, abs=1e-4)


def test_unknown_unit_is_refused_with_the_usual_ones(tmp_path: Path) -> None:
    path = write_stride(tmp_path / "stride.csv")
    path.write_text(path.read_text().replace("(Nm/kg)", "[Nm/lb]"))
    with pytest.raises(InputError, match=r"is in 'Nm/lb', which is not .* use for example 'N\*m' or 'N\*m/kg'"):
        import_reference([path], OPTIONS)


def unroll(path: Path, stride_time: float | None = 1.2) -> Sequence[sources.SourceFile]:
    return unroll_single_strides(sources.read(path), stride_time, ImportLog())


@pytest.mark.parametrize("heading", ["gait_pct", "% gait cycle", "Percent", "gait_phase [%]", "time (%)", "Stride (%)"])
def test_percent_columns_are_recognised(heading: str, tmp_path: Path) -> None:
    (source,) = sources.read(write_stride(tmp_path / "stride.csv", heading=heading))
    assert find_percent_label(source) == heading
    assert unroll(tmp_path / "stride.csv")[0].get_column("time")[N_FINE_ROWS] == pytest.approx(1.2)


def test_fraction_of_the_cycle_counts_as_percent(tmp_path: Path) -> None:
    (source,) = unroll(write_stride(tmp_path / "stride.csv", heading="gait cycle", end=1.0))
    assert source.get_column("time")[N_FINE_ROWS // 2] == pytest.approx(0.6)


def test_a_file_with_times_is_no_single_stride(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("time [s],gait_phase [%]\n" + "".join(f"{0.01 * k},{k}\n" for k in range(101)))
    assert find_percent_label(sources.read(path)[0]) is None
    with pytest.raises(InputError, match="these files have times"):
        unroll(path)


def test_unusable_strides_are_refused_in_one_sentence(tmp_path: Path) -> None:
    path = write_stride(tmp_path / "stride.csv")
    with pytest.raises(InputError, match=r"pass the duration of the stride \(--stride-duration S, or --cadence"):
        import_reference([path], ImportOptions(mass=MASS))
    half = write_stride(tmp_path / "half.csv", end=60.0)
    with pytest.raises(
        InputError, match="must increase from 0 to 100 % in 20 rows or more; it has 51 rows from 0 to 60"
    ):
        unroll(half)
    with pytest.raises(InputError, match="it has 11 rows"):
        unroll(write_stride(tmp_path / "short.csv", 11))
    lines = path.read_text().splitlines()
    (tmp_path / "open.csv").write_text("\n".join([*lines[:-1], "100,90,9,9,9,9,9"]) + "\n")
    (source,) = unroll(tmp_path / "open.csv")
    with pytest.raises(
        InputError, match="a whole stride, from heel strike to heel strike of the same foot, ends as it"
    ):
        source.get_column("Hip flexion (deg)")
    with pytest.raises(InputError, match=r"stride duration is 5; allowed: 0\.6 to 2\.5 s"):
        ImportOptions(stride_time=5.0)


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("Time (s)", ("Time", "s")),
        ("Time(s)", ("Time", "s")),
        ("time_s", ("time", "s")),
        ("Time_ms", ("Time", "ms")),
        ("Angle (deg)", ("Angle", "deg")),
        ("Moment (N m / kg)", ("Moment", "N*m/kg")),
        ("angle [rad]", ("angle", "rad")),
        ("Ankle (left)", ("Ankle (left)", "")),
        ("knee_angle", ("knee_angle", "")),
    ],
)
def test_units_in_round_brackets_and_after_time(label: str, expected: tuple[str, str]) -> None:
    assert split_unit(label) == expected


def test_table_with_round_brackets_reads_its_time(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("Time(s),Knee angle (rad)\n" + "".join(f"{0.01 * k},{0.001 * k}\n" for k in range(100)))
    (source,) = sources.read(path)
    assert source.time_label == "Time(s)"
    assert source.units == {"Time(s)": "s", "Knee angle (rad)": "rad"}
    assert source.detect_roles() == {"angles"}


def test_command_takes_a_cadence(tmp_path: Path) -> None:
    write_stride(tmp_path / "stride.csv")
    done = run("import", "stride.csv", "--mass", "70", "--cadence", "100", "--json", "--out", "me", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["stride_time_s"] == pytest.approx(1.2)
    for arguments, message in (
        (("--cadence", "100", "--stride-duration", "1.2"), "--cadence and --stride-duration state the same"),
        (("--cadence", "1000"), "cadence is 1000; allowed: 48 to 200 steps/min"),
        (("--cadence", "100", "--dataset", "--device", "klute-1-1-4-pair"), "--cadence cannot be combined"),
    ):
        done = run("import", "stride.csv", "--mass", "70", *arguments, cwd=tmp_path)
        assert done.returncode == 2
        assert message in done.stderr


@pytest.mark.parametrize("n_rows", [34, 51, 100])
def test_coarse_stride_is_interpolated_smoothly(n_rows: int) -> None:
    percent = np.linspace(0.0, 100.0, n_rows, endpoint=False)
    fine = np.linspace(0.0, 100.0, 200, endpoint=False)

    def curve(x: np.ndarray) -> np.ndarray:
        angle = 2.0 * np.pi * x / 100.0
        return 10.0 * np.sin(angle) + 3.0 * np.cos(3.0 * angle)

    values = interpolate_cycle(percent, curve(percent), fine)
    linear = np.interp(fine, np.append(percent, 100.0), np.append(curve(percent), curve(percent[:1])))
    error, linear_error = np.abs(values - curve(fine)).max(), np.abs(linear - curve(fine)).max()
    assert error < 0.1 * linear_error
    kinks, true_kinks = (np.diff(np.concatenate([row, row[:2]]), 2) for row in (values, curve(fine)))
    assert np.abs(kinks - true_kinks).max() < 0.1 * np.abs(true_kinks).max()


@given(st.lists(st.floats(-50.0, 50.0), min_size=20, max_size=60), st.integers(0, 10))
def test_interpolation_keeps_the_rows_and_what_is_constant(values: list[float], zeros: int) -> None:
    rows = np.array(values)
    rows[: zeros + 1] = 0.0  # no load in swing
    percent = 100.0 * np.arange(len(rows)) / len(rows)
    assert np.array_equal(interpolate_cycle(percent, rows, percent), rows)
    fine = np.sort(np.concatenate([percent, percent[:-1] + 30.0 / len(rows)]))
    refined = interpolate_cycle(percent, rows, fine)
    assert refined[np.isin(fine, percent)] == pytest.approx(rows, abs=1e-9)
    assert not refined[fine <= percent[zeros]].any()


def test_gaps_of_a_column_stay_gaps() -> None:
    percent = np.arange(0.0, 100.0, 2.0)
    values = np.where((percent > 60.0) & (percent < 98.0), np.nan, percent)
    refined = interpolate_cycle(percent, values, np.arange(0.0, 100.0, 0.5))
    assert np.isnan(refined[125:190]).all()
    assert refined[:120] == pytest.approx(np.arange(0.0, 60.0, 0.5))
