"""Tables, figures and pages of a comparison agree with its numbers and keep the largest differences."""

import io
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.legend import Legend
from rich.console import Console

from klute_sim.comparison.comparison import Comparison, ComparisonOptions, compare
from klute_sim.comparison.runs import ComparedRun
from klute_sim.recording.recording import Recording
from klute_sim.report.comparison import figures as comparison_figures
from klute_sim.report.comparison import page as comparison_page
from klute_sim.report.comparison import table as comparison_table
from klute_sim.report.comparison import text as words
from klute_sim.report.comparison.headline import format_headline
from klute_sim.report.run_page import list_files
from klute_sim.viewer.layouts import comparison as recording
from klute_sim.viewer.picture import picture, rrd_reader
from tests.report.figure_checks import check_figure

PHASE = np.tile(np.arange(50) * 2.0, 4)


def make_gait_recording(bump: float, seed: int = 0, *, rig: str | None = None, channels: int = 1) -> Recording:
    """Return four strides of a sine with a bump at 40 to 50 %; later channels have larger bumps."""
    scatter = np.repeat(np.random.default_rng(seed).normal(size=4) * 0.1, 50)
    columns = [("time [s]", np.arange(200) / 50.0), ("gait_phase [%]", PHASE)]
    for k in range(channels):
        bump_values = bump * (k + 1) * ((PHASE >= 40.0) & (PHASE <= 50.0))
        columns.append((f"x{k} [N*m]", np.sin(0.02 * np.pi * PHASE) + scatter + bump_values))
    reference = [("reference_x0 [N*m]", np.sin(0.02 * np.pi * PHASE)), ("reference_x0_sd [N*m]", np.full(200, 0.3))]
    return Recording.from_columns([*columns, *reference], {"rig": rig} if rig else None)


def compare_gait_runs(
    *bumps: float, options: ComparisonOptions | None = None, rig: str | None = None, channels: int = 1
) -> Comparison:
    runs = [
        ComparedRun("abc"[k], Path("abc"[k]), {"": make_gait_recording(bump, k, rig=rig, channels=channels)})
        for k, bump in enumerate(bumps)
    ]
    return compare(runs, options)


def compare_trials(count: int) -> Comparison:
    """Compare ``count`` trials over time; later ones have larger differences."""
    time = np.arange(50) / 10.0
    parts = [
        {
            f"t{k}": Recording.from_columns([("time [s]", time), ("force [N]", np.sin(time) + size * k * (time > 4.0))])
            for k in range(count)
        }
        for size in (0.0, 1.0)
    ]
    return compare([ComparedRun(label, Path(label), part) for label, part in zip("ab", parts, strict=True)])


def test_figure_shows_the_curves_and_bands_of_the_comparison() -> None:
    comparison = compare_gait_runs(0.0, 2.0, options=ComparisonOptions(include_reference=True))
    (part,) = comparison.parts
    figure = comparison_figures.build_part_figure(part, "phase")
    check_figure(figure)
    top, bottom = figure.axes[:2]
    assert top.get_title() == "x0 [N·m]"
    curves = {line.get_color(): line.get_ydata() for line in top.lines}
    styles = comparison_figures._build_line_styles(part)
    for series in part.series:
        assert np.array_equal(curves[styles[series.label]["color"]], series.curves["x0"].mean)
    assert sum(isinstance(collection, PolyCollection) for collection in top.collections) == 3
    d = part.differences["x0"]["b"]
    (line,) = [line for line in bottom.lines if np.array_equal(line.get_ydata(), d.values)]
    assert line.get_color() == styles["b"]["color"]
    bars = [line.get_xdata() for line in bottom.lines if line.get_linewidth() == 3.0]
    assert any(np.array_equal(bar, d.half_interval) for bar in bars)
    low, high = bottom.get_ylim()
    assert (
        -low
        == high
        == pytest.approx(1.2 * max(abs(other.max_difference or 0.0) for other in part.differences["x0"].values()))
    )
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend[:3] == ["a (4 strides)", "b (4 strides)", "human (reference)"]
    assert {"mean ±1 sd", "95 % interval of no difference", "beyond it"} <= set(legend)


def test_only_regions_beyond_the_band_are_filled() -> None:
    comparison = compare_gait_runs(0.0, 2.0)
    d = comparison.parts[0].differences["x0"]["b"]
    mask = comparison_figures._mask_regions(d, comparison.parts[0].axis)
    (region,) = d.regions
    assert np.flatnonzero(mask).tolist() == list(range(int(region.begin), int(region.end) + 1))


def test_explanations_match_the_kinds_of_bands() -> None:
    two = " ".join(words.explain_numbers(compare_gait_runs(0.0, 2.0)))
    assert "Welch's t" in two
    assert "subjects" not in two
    assert "standard deviation of 'a' between its repeats" in two
    assert "Simulated" not in two
    assert "repeat almost exactly" in " ".join(words.explain_numbers(compare_gait_runs(0.0, 2.0, rig="gait")))
    options = ComparisonOptions(include_reference=True)
    human = " ".join(words.explain_numbers(compare_gait_runs(0.0, 2.0, options=options)))
    assert "Beyond the band (b): intervals where the difference exceeds its 95 % interval" in human
    assert (
        "Beyond the band (human): intervals where the difference exceeds the 95 % interval of the reference's" in human
    )
    assert "standard deviation of 'human' between subjects" in human
    single = " ".join(words.explain_numbers(compare_gait_runs(0.0, 2.0, options=ComparisonOptions(skip_strides=3))))
    assert "No band: there are neither repeats" in single
    assert "Beyond" not in single


@pytest.mark.parametrize(
    ("first", "other", "skip", "expected"),
    [("gait", "gait", 1, True), ("gait", None, 1, False), (None, None, 1, False), ("gait", "one", 1, True)],
)
def test_bands_from_simulated_strides_alone_carry_a_warning(
    first: str | None, other: str | None, skip: int, expected: bool
) -> None:
    recording = make_gait_recording(2.0, 1, rig="gait" if other == "gait" else None)
    if other == "one":
        recording = recording.select(np.arange(len(recording)) >= 100)
    runs = [
        ComparedRun("a", Path("a"), {"": make_gait_recording(0.0, rig=first)}),
        ComparedRun("b", Path("b"), {"": recording}),
    ]
    comparison = compare(runs, ComparisonOptions(skip_strides=skip))
    assert ("Not tested" in " ".join(words.explain_numbers(comparison))) == expected


def test_positions_and_intervals_are_formatted_with_units() -> None:
    (row,) = words.iter_rows(compare_gait_runs(0.0, 2.0))
    assert words.format_half_error_interval(row, "phase").endswith(" %")
    assert words.format_significant_regions(row, "phase") == "39-51 %"
    (same,) = words.iter_rows(compare_gait_runs(0.0, 0.0, options=ComparisonOptions(skip_strides=3)))
    assert (
        words.format_half_error_interval(same, "phase"),
        words.format_significant_regions(same, "phase"),
    ) == ("spread out", "no band")
    (shifted,) = words.iter_rows(compare_gait_runs(0.0, 0.0))
    assert words.format_significant_regions(shifted, "phase") == "nowhere"
    (simulated,) = words.iter_rows(compare_gait_runs(0.0, 2.0, rig="gait"))
    assert words.format_significant_regions(simulated, "phase") == "not tested"
    assert words.format_number(None) == "-"
    assert words.format_unit("N*m") == "N·m"


def test_table_shows_the_largest_of_many_differences_and_counts_the_rest() -> None:
    many = compare_trials(45)
    for table in comparison_table.build_tables(many):
        names = list(table.columns[0].cells)
        assert names[::2] == [f"t{k}" for k in range(5, 45)]
        assert names[1::2] == ["  force [N]"] * 40
    assert (
        comparison_table.collect_remarks(many)[0]
        == "The table shows the 40 largest of 45 differences; comparison.csv has all of them."
    )
    short = next(comparison_table.build_tables(compare_trials(3)))
    assert list(short.columns[0].cells)[::2] == ["t0", "t1", "t2"]
    assert "The table shows" not in comparison_table.collect_remarks(compare_trials(3))[0]


@pytest.mark.parametrize(
    ("value", "signed", "text"),
    [
        (-1810.4, True, "-1810"),
        (5.9, False, "5.90"),
        (0.00123456, False, "0.00123"),
        (999.6, False, "1000"),
        (-0.0, True, "0"),
        (12345.6, True, "+12300"),
        (3.2e-9, False, "3.20e-09"),
        (None, False, "-"),
    ],
)
def test_numbers_have_three_significant_digits(value: float | None, signed: bool, text: str) -> None:
    assert words.format_number(value, signed=signed) == text


@pytest.mark.parametrize("width", [60, 80])
@pytest.mark.parametrize("is_single", [True, False])
def test_tables_fit_the_terminal_and_keep_names_whole(width: int, is_single: bool) -> None:
    names = ("ground reaction vertical", "muscle force", "muscle length")
    columns = [("time [s]", np.arange(200) / 50.0), ("gait_phase [%]", PHASE)]
    scatter = np.repeat(np.random.default_rng(1).normal(size=4) * 0.1, 50)
    heads = ("grf_vertical [N]", "muscle_force [kN]", "muscle_length [m]")
    factors = (-1234.5, -0.012345, 0.0012345)
    runs = []
    for label in "a" if is_single else "ab":
        curve = (label == "b") + np.sin(0.02 * np.pi * PHASE) + scatter
        data = [(head, factor * curve) for head, factor in zip(heads, factors, strict=True)]
        runs.append(ComparedRun(label, Path(label), {"": Recording.from_columns([*columns, *data])}))
    for table in comparison_table.build_tables(compare(runs, ComparisonOptions(skip_strides=0))):
        printed = Console(width=width, file=io.StringIO())
        printed.print(table)
        lines = printed.file.getvalue().splitlines()  # type: ignore[attr-defined]
        assert max(map(len, lines)) <= width
        assert "…" not in "".join(lines)
        words_of_names = {word for line in lines for word in line[:25].split()}
        assert words_of_names >= {word for name in names for word in name.split()}


def test_rms_over_the_deviation_of_simulated_strides_is_not_given() -> None:
    simulated = compare_gait_runs(0.0, 2.0, rig="gait")
    (row,) = words.iter_rows(simulated)
    assert row.difference.rms_sd is None
    assert "rms/sd is not given: the strides of the simulation 'a'" in " ".join(words.explain_numbers(simulated))
    assert all("rms/sd" not in [c.header for c in t.columns] for t in comparison_table.build_tables(simulated))
    human = compare_gait_runs(0.0, 2.0, rig="gait", options=ComparisonOptions(include_reference=True))
    assert all(row.difference.rms_sd is not None for row in words.iter_rows(human))
    assert "rms/sd is not given" not in " ".join(words.explain_numbers(human))


def test_headline_names_the_channel_with_the_largest_relative_difference() -> None:
    (headline,) = format_headline(compare_gait_runs(0.0, 2.0, channels=3))
    assert headline.startswith("'b' differs most from 'a' in x2: rms ")
    assert "at most +5.99 N·m at 43 %" in headline
    assert headline.endswith("3 of 3 tested curves leave their 95 % band somewhere.")
    same = Path("a")
    runs = [ComparedRun(label, same, {"": make_gait_recording(1.0)}) for label in "ab"]
    assert format_headline(compare(runs)) == ["'b' equals 'a' in the only compared curve."]
    (trial,) = format_headline(compare_trials(3))
    assert "in force of trial t2" in trial
    (single,) = format_headline(compare_gait_runs(2.0, options=ComparisonOptions(skip_strides=0)))
    assert single.startswith("'a' is the mean of 4 strides; relative to its range, x0 varies most")
    (simulated,) = format_headline(compare_gait_runs(2.0, rig="gait", options=ComparisonOptions(skip_strides=0)))
    assert "4 simulated strides" in simulated


def test_figures_show_the_most_different_trials_and_channels() -> None:
    names = [part.name for part, _ in comparison_figures.build_figures(compare_trials(8))]
    assert names == [f"t{k}" for k in range(2, 8)]
    page = comparison_page.build_page_context(compare_trials(8), dict.fromkeys(names, ""))
    assert page["omitted_figures"] == ["The figures show the 6 trials with the largest differences of 8."]
    many = compare_gait_runs(0.0, 1.0, channels=18)
    assert comparison_figures._select_channels(many.parts[0]) == [f"x{k}" for k in range(2, 18)]
    assert comparison_page.build_page_context(many, {"": ""})["omitted_figures"] == [
        "The figures show the 16 channels with the largest differences of 18."
    ]
    assert comparison_page.build_page_context(many, {})["omitted_figures"] == []


def test_page_links_to_the_files_of_its_folder(tmp_path: Path) -> None:
    (tmp_path / "comparison.rrd").touch()
    (tmp_path / ".lock").touch()
    files = list_files(tmp_path)
    assert files == [{"name": "comparison.rrd", "description": "recording for klute-sim view"}]
    assert 'href="comparison.rrd"' in comparison_page.render_page(compare_gait_runs(0.0, 1.0), {}, files)
    assert "rrd" not in comparison_page.render_page(compare_gait_runs(0.0, 1.0), {})


def test_single_series_has_a_band_and_no_difference() -> None:
    single = compare_gait_runs(2.0, channels=3, rig="gait", options=ComparisonOptions(skip_strides=0))
    (table,) = comparison_table.build_tables(single)
    assert str(table.title) == "a (4 strides)"
    assert [column.header for column in table.columns] == ["channel", *words.EXTENT_HEADINGS[:5]]
    assert list(table.columns[0].cells) == ["x0 [N·m]", "x1 [N·m]", "x2 [N·m]"]
    assert "repeat almost exactly" in " ".join(comparison_table.collect_remarks(single))
    ((part, figure),) = comparison_figures.build_figures(single)
    visible = [axis for axis in figure.axes if axis.get_visible()]
    assert [axis.get_title() for axis in visible] == ["x0 [N·m]", "x1 [N·m]", "x2 [N·m]"]
    for axis, channel in zip(visible, part.differences, strict=True):
        (line,), (band,) = axis.lines, axis.collections
        assert np.array_equal(line.get_ydata(), part.series[0].curves[channel].mean)
        assert isinstance(band, PolyCollection)
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == ["a (4 strides)", "mean ±1 sd"]
    page = comparison_page.render_page(single, {"": ""})
    assert "<title>a</title>" in page
    assert "Means and bands" in page
    assert "bias" not in page
    assert page.count("<td>x1</td>") == 1


def test_recording_has_one_legend_with_each_series_once(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    recording.write_recording(compare_gait_runs(0.0, 2.0, channels=2), tmp_path / "comparison.rrd")
    panels = picture.build_window_figure(rrd_reader.read_rrd(tmp_path / "comparison.rrd"), 50.0).findobj(Legend)
    assert [[text.get_text() for text in panel.get_texts()] for panel in panels] == [["a (4 strides)", "b (4 strides)"]]


def test_recording_of_a_single_series_has_curves_only(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    single = compare_gait_runs(2.0)
    entities = [line.entity for line in recording.build_lines(single.parts[0], 1, "phase")]
    assert entities == [f"part_1/x0/curves/series_0/{end}" for end in ("mean", "low", "high")]
    title, _, headings = recording.format_page(single).splitlines()[:3]
    assert title == "# a (4 strides)"
    assert "largest sd" in headings
    recording.write_recording(single, tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").stat().st_size > 1000
