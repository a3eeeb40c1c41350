"""Figures of joint tests and of predicted walks."""

import numpy as np

import klute_sim as ks
from klute_sim.report.style import get_ordered_colours
from tests.report.figure_checks import check_figure


def test_trials_are_ordered_by_the_condition_that_varies() -> None:
    figure = ks.simulate_joint("klute-3-4-pair", "steps", time_step=2e-3).plot()
    differences = (-1.0, -0.5, 0.5, 1.0)
    lines = figure.axes[0].get_lines()
    assert [line.get_label() for line in lines] == [f"difference {value:+g} bar" for value in differences]
    assert [line.get_color() for line in lines] == list(get_ordered_colours(differences).values())
    final = [np.interp(2.4, *line.get_data()) for line in lines]
    assert final == sorted(final)
    check_figure(figure)


def test_walk_shows_delivered_pressure_below_the_command() -> None:
    run = ks.simulate_walk(seconds=6.0)
    figure = run.plot()
    panel = next(axis for axis in figure.axes if axis.get_title() == "gauge pressure [bar]")
    delivered, commanded = panel.get_lines()
    assert commanded.get_zorder() > delivered.get_zorder()
    last = run.recording["time"] > run.recording["time"][-1] - 4.0
    assert np.array_equal(delivered.get_ydata(), run.recording["pressure"][last])
    assert np.array_equal(commanded.get_ydata(), run.recording["pressure_command"][last])
    moment = next(axis for axis in figure.axes if axis.get_title().startswith("moment of the device [N·m]"))
    assert np.array_equal(moment.get_lines()[0].get_ydata(), run.recording["device_moment"][last])
    check_figure(figure)
