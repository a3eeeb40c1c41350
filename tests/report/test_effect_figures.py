"""Axes of the figures of effects."""

import pytest
from matplotlib.figure import Figure

from klute_sim.report.effects.figures import _align_zeros


@pytest.mark.parametrize("difference", [(-5.0, 1.0), (2.0, 3.0), (-3.0, -2.0), (-1.0, 1.0)])
def test_zeros_of_two_axes_are_at_one_height(difference: tuple[float, float]) -> None:
    axis = Figure().subplots()
    other = axis.twinx()
    axis.set_ylim(100.0, 900.0)
    other.set_ylim(*difference)
    _align_zeros(axis, other)
    heights = [-low / (high - low) for low, high in (axis.get_ylim(), other.get_ylim())]
    assert heights[0] == pytest.approx(heights[1])
    assert axis.get_ylim()[0] <= 100.0
    assert axis.get_ylim()[1] >= 900.0
    assert other.get_ylim()[0] <= difference[0]
    assert other.get_ylim()[1] >= difference[1]
