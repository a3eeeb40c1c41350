"""How a comparison is shown: what is drawn and said is what was found, and long ones are cut to what matters."""

from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.legend import Legend

from klute_sim.comparison.comparison import Comparison, ComparisonOptions, compare
from klute_sim.comparison.runs import ComparedRun
from klute_sim.recording.recording import Recording
from klute_sim.report.comparison import figures as comparison_figures
from klute_sim.report.comparison import page as comparison_page
from klute_sim.report.comparison import table as comparison_table
from klute_sim.report.comparison import text as words
from klute_sim.report.style import STYLE
from klute_sim.viewer.layouts import comparison as recording
from klute_sim.viewer.picture import picture, rrd_reader

PHASE = np.tile(np.arange(50) * 2.0, 4)


def walk(bump: float, seed: int = 0, *, rig: str | None = None, channels: int = 1) -> Recording:
    """Four strides of a wave, a bump at 40 to 50 % on it; of several channels the later ones have larger bumps."""
    scatter = np.repeat(np.random.default_rng(seed).normal(size=4) * 0.1, 50)
    columns = [("time [s]", np.arange(200) / 50.0), ("gait_phase [%]", PHASE)]
    for k in range(channels):
        bumped = bump * (k + 1) * ((PHASE >= 40.0) & (PHASE <= 50.0))
        columns.append((f"x{k} [N*m]", np.sin(0.02 * np.pi * PHASE) + scatter + bumped))
    reference = [("reference_x0 [N*m]", np.sin(0.02 * np.pi * PHASE)), ("reference_x0_sd [N*m]", np.full(200, 0.3))]
    return Recording.from_columns([*columns, *reference], {"rig": rig} if rig else None)


def found(
    *bumps: float, options: ComparisonOptions | None = None, rig: str | None = None, channels: int = 1
) -> Comparison:
    runs = [
        ComparedRun("abc"[k], Path("abc"[k]), {"": walk(bump, k, rig=rig, channels=channels)})
        for k, bump in enumerate(bumps)
    ]
    return compare(runs, options)


def trials(count: int) -> Comparison:
    """``count`` trials over time, the later ones with larger differences."""
    time = np.arange(50) / 10.0
    parts = [
        {
            f"t{k}": Recording.from_columns([("time [s]", time), ("force [N]", np.sin(time) + size * k * (time > 4.0))])
            for k in range(count)
        }
        for size in (0.0, 1.0)
    ]
    return compare([ComparedRun(label, Path(label), own) for label, own in zip("ab", parts, strict=True)])


def test_lines_and_bands_are_those_of_the_comparison() -> None:
    made = found(0.0, 2.0, options=ComparisonOptions(include_reference=True))
    (part,) = made.parts
    with matplotlib.rc_context(STYLE):
        figure = comparison_figures.build_part_figure(part, "phase")
    above, below = figure.axes[:2]
    assert above.get_title() == "x0 [N·m]"
    drawn = {line.get_color(): line.get_ydata() for line in above.lines}
    looks = comparison_figures._build_line_styles(part)
    for series in part.series:
        assert np.array_equal(drawn[looks[series.label]["color"]], series.curves["x0"].mean)
    assert sum(isinstance(own, PolyCollection) for own in above.collections) == 3
    d = part.differences["x0"]["b"]
    (line,) = [line for line in below.lines if np.array_equal(line.get_ydata(), d.values)]
    assert line.get_color() == looks["b"]["color"]
    bars = [line.get_xdata() for line in below.lines if line.get_linewidth() == 3.0]
    assert any(np.array_equal(bar, d.half_interval) for bar in bars)
    low, high = below.get_ylim()
    assert (
        -low
        == high
        == pytest.approx(1.2 * max(abs(own.max_difference or 0.0) for own in part.differences["x0"].values()))
    )
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend[:3] == ["a (4 strides)", "b (4 strides)", "human (reference)"]
    assert {"mean ±1 sd", "95 % interval of no difference", "beyond it"} <= set(legend)


def test_what_is_beyond_the_band_is_filled_and_nothing_else() -> None:
    made = found(0.0, 2.0)
    d = made.parts[0].differences["x0"]["b"]
    inside = comparison_figures._mask_regions(d, made.parts[0].axis)
    (region,) = d.regions
    assert np.flatnonzero(inside).tolist() == list(range(int(region.begin), int(region.end) + 1))


def test_rules_are_those_of_the_bands_there_are() -> None:
    two = " ".join(words.explain_numbers(found(0.0, 2.0)))
    assert "Welch's t" in two
    assert "people" not in two
    assert "standard deviation of 'a' between its repeats" in two
    assert "simulated" not in two
    assert "repeat almost exactly" in " ".join(words.explain_numbers(found(0.0, 2.0, rig="gait")))
    human = " ".join(words.explain_numbers(found(0.0, 2.0, options=ComparisonOptions(include_reference=True))))
    assert "Beyond the band (b): where the difference is more than its 95 % interval" in human
    assert "Beyond the band (human): where the difference is more than the 95 % interval of the reference's" in human
    assert "standard deviation of 'human' between people" in human
    single = " ".join(words.explain_numbers(found(0.0, 2.0, options=ComparisonOptions(skip_strides=3))))
    assert "No band: where nothing is repeated" in single
    assert "Beyond" not in single


@pytest.mark.parametrize(
    ("first", "other", "skip", "exact"),
    [("gait", "gait", 1, True), ("gait", None, 1, False), (None, None, 1, False), ("gait", "one", 1, True)],
)
def test_that_bands_of_simulated_strides_alone_say_little(
    first: str | None, other: str | None, skip: int, exact: bool
) -> None:
    own = walk(2.0, 1, rig="gait" if other == "gait" else None)
    if other == "one":
        own = own.select(np.arange(len(own)) >= 100)
    runs = [ComparedRun("a", Path("a"), {"": walk(0.0, rig=first)}), ComparedRun("b", Path("b"), {"": own})]
    assert (
        "repeat almost exactly" in " ".join(words.explain_numbers(compare(runs, ComparisonOptions(skip_strides=skip))))
    ) == exact


def test_places_are_told_where_they_are() -> None:
    made = found(0.0, 2.0)
    (row,) = words.iter_rows(made)
    assert words.format_half_error_interval(row, "phase").endswith(" %")
    assert words.format_significant_regions(row.difference, "phase") == "39-51 %"
    (same,) = words.iter_rows(found(0.0, 0.0, options=ComparisonOptions(skip_strides=3)))
    assert (
        words.format_half_error_interval(same, "phase"),
        words.format_significant_regions(same.difference, "phase"),
    ) == ("spread out", "no band")
    (shifted,) = words.iter_rows(found(0.0, 0.0))
    assert words.format_significant_regions(shifted.difference, "phase") == "nowhere"
    assert words.format_number(-0.0, "+.3g") == "+0"
    assert words.format_number(None) == "-"
    assert words.format_unit("N*m") == "N·m"


def test_of_many_differences_the_largest_are_shown_and_the_rest_is_counted() -> None:
    many = trials(45)
    (table,) = comparison_table.build_tables(many)
    shown = list(table.columns[0].cells)
    assert shown == [f"t{k}" for k in range(5, 45)]
    assert (
        comparison_table.collect_remarks(many)[0]
        == "Shown are the 40 largest of 45 differences; comparison.csv has all."
    )
    (short,) = comparison_table.build_tables(trials(3))
    assert list(short.columns[0].cells) == ["t0", "t1", "t2"]
    assert "Shown" not in comparison_table.collect_remarks(trials(3))[0]


def test_of_many_trials_and_channels_the_most_different_are_drawn() -> None:
    drawn = [part.name for part, _ in comparison_figures.build_figures(trials(8))]
    assert drawn == [f"t{k}" for k in range(2, 8)]
    page = comparison_page.build_page_context(trials(8), dict.fromkeys(drawn, b""))
    assert page["undrawn"] == ["Drawn are the 6 trials with the largest differences of 8."]
    many = found(0.0, 1.0, channels=18)
    assert comparison_figures._select_channels(many.parts[0]) == [f"x{k}" for k in range(2, 18)]
    assert comparison_page.build_page_context(many, {"": b""})["undrawn"] == [
        "Drawn are the 16 channels with the largest differences of 18."
    ]
    assert comparison_page.build_page_context(many, {})["undrawn"] == []


def test_a_page_links_to_a_recording_that_is_there() -> None:
    assert 'href="comparison.rrd"' in comparison_page.render_page(found(0.0, 1.0), {}, "comparison.rrd")
    assert "rrd" not in comparison_page.render_page(found(0.0, 1.0), {})


def test_one_series_alone_is_shown_with_its_band_and_no_difference() -> None:
    made = found(2.0, channels=3, rig="gait", options=ComparisonOptions(skip_strides=0))
    (table,) = comparison_table.build_tables(made)
    assert str(table.title) == "a (4 strides)"
    assert [column.header for column in table.columns] == ["channel", *words.EXTENT_HEADINGS]
    assert list(table.columns[0].cells) == ["x0 [N·m]", "x1 [N·m]", "x2 [N·m]"]
    assert "repeat almost exactly" in " ".join(comparison_table.collect_remarks(made))
    ((part, figure),) = comparison_figures.build_figures(made)
    visible = [axis for axis in figure.axes if axis.get_visible()]
    assert [axis.get_title() for axis in visible] == ["x0 [N·m]", "x1 [N·m]", "x2 [N·m]"]
    for axis, channel in zip(visible, part.differences, strict=True):
        (line,), (band,) = axis.lines, axis.collections
        assert np.array_equal(line.get_ydata(), part.series[0].curves[channel].mean)
        assert isinstance(band, PolyCollection)
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == ["a (4 strides)", "mean ±1 sd"]
    page = comparison_page.render_page(made, {"": b""})
    assert "<title>a</title>" in page
    assert "Means and bands" in page
    assert "bias" not in page
    assert page.count("<td>x1</td>") == 1


def test_one_legend_is_on_a_page_with_each_series_once(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    recording.write_recording(found(0.0, 2.0, channels=2), tmp_path / "comparison.rrd")
    panels = picture.build_window_figure(rrd_reader.read_rrd(tmp_path / "comparison.rrd"), 50.0).findobj(Legend)
    assert [[text.get_text() for text in panel.get_texts()] for panel in panels] == [["a (4 strides)", "b (4 strides)"]]


def test_one_series_alone_in_rerun(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    made = found(2.0)
    kinds = [line.entity for line in recording.build_lines(made.parts[0], 1, "phase")]
    assert kinds == [f"part_1/x0/curves/series_0/{end}" for end in ("mean", "low", "high")]
    title, _, heads = recording.format_page(made).splitlines()[:3]
    assert title == "# a (4 strides)"
    assert "largest sd" in heads
    recording.write_recording(made, tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").stat().st_size > 1000
