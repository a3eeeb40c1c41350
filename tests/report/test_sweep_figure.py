"""Figure of many runs: it shows the inputs that vary, in an order where they have one."""

from typing import Any

import pytest
from matplotlib.colors import to_rgb

from klute_sim.report.sweep.figure import GAIT_METRICS, build_figure, choose_layout
from klute_sim.report.tuning.search_figure import build_figure as build_tuning_figure
from tests.report.figure_checks import check_figure

INPUTS = ("device", "controller", "slope [deg]", "mass [kg]")
METRIC = "ankle_work_net [J/kg]"


def make_rows(masses: list[float], slopes: list[float], controllers: list[str]) -> list[dict[str, Any]]:
    """Return one row for each combination; the metric grows with mass and slope."""
    return [
        {
            **{"device": "d", "controller": controller, "slope [deg]": slope, "mass [kg]": mass, "trips": slope > 4.0},
            **dict.fromkeys(GAIT_METRICS, 0.01 * mass + slope),
        }
        for mass in masses
        for slope in slopes
        for controller in controllers
    ]


def test_the_input_with_most_values_is_the_axis_and_numbers_have_ordered_colours() -> None:
    rows = make_rows([60.0, 75.0, 90.0], [-5.0, 0.0], ["profile", "off"])
    assert choose_layout(rows, INPUTS) == ("mass [kg]", True, "slope [deg]", "controller")
    figure = build_figure(rows, INPUTS, GAIT_METRICS)
    check_figure(figure)
    assert [axis.get_title() for axis in figure.axes] == list(GAIT_METRICS.values())
    assert {axis.get_xlabel() for axis in figure.axes} == {"mass [kg]"}
    entries = {text.get_text(): handle for text, handle in zip(*_get_legend(figure), strict=True)}
    assert set(entries) == {"slope -5 deg", "slope 0 deg", "profile", "off"}
    brightness = [sum(to_rgb(entries[f"slope {slope} deg"].get_color())) for slope in (-5, 0)]
    assert brightness[0] < brightness[1]


def test_an_input_that_follows_from_others_is_left_out() -> None:
    rows = [
        row | {"controller": f"machine at {row['slope [deg]']}"} for row in make_rows([75.0], [1.0, 2.0, 3.0], [""])
    ]
    assert choose_layout(rows, INPUTS) == ("slope [deg]", True, None, None)


def test_repeats_give_mean_and_deviation_and_unusable_rows_open_markers() -> None:
    rows = make_rows([60.0, 80.0], [5.0], ["off"]) + make_rows([60.0, 80.0], [0.0], ["profile"])
    figure = build_figure(rows, ("controller",), {METRIC: "work"}, unusable=("trips",))
    (axis,) = figure.axes
    assert [label.get_text() for label in axis.get_yticklabels()] == ["off", "profile"]
    points = [line for line in axis.lines if line.get_marker() == "o"]
    assert [line.get_xdata()[0] for line in points] == pytest.approx([5.7, 0.7])
    assert [line.get_markerfacecolor() == "none" for line in points] == [True, False]
    assert "open: trips" in [text.get_text() for text in _get_legend(figure)[0]]
    (segments, *_) = (collection.get_segments() for collection in axis.collections)
    assert segments[0][1][0] - segments[0][0][0] == pytest.approx(2.0 * 0.1414, abs=1e-3)


def test_a_single_case_and_a_missing_metric_make_a_figure() -> None:
    (row,) = make_rows([75.0], [0.0], ["off"])
    figure = build_figure([row | {METRIC: None}], INPUTS, GAIT_METRICS)
    check_figure(figure)
    assert figure.get_suptitle() == "1 cases"


def test_figure_of_a_search_shows_changes_in_per_cent() -> None:
    outcomes = {"cost": (4.0, 3.0), "asymmetry": (0.0, 0.1), "work": (None, None)}
    figure = build_tuning_figure([5.0, 90.0, 4.0], [False, True, False], outcomes, {"push_off_bar": (4.0, 4.4)})
    check_figure(figure)
    objective, changes, variables = figure.axes
    assert list(objective.lines[2].get_ydata()) == [5.0, 5.0, 4.0]
    assert [bar.get_width() for bar in changes.patches] == pytest.approx([-25.0])
    assert [bar.get_width() for bar in variables.patches] == pytest.approx([10.0])


def _get_legend(figure: Any) -> tuple[list[Any], list[Any]]:
    (legend,) = figure.legends
    return legend.get_texts(), legend.legend_handles
