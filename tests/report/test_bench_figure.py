"""Colours of bench figures: a scale from dark to bright with the pressure."""

import pytest
from matplotlib.colors import to_rgb

import klute_sim as ks


@pytest.mark.parametrize("protocol", ["isometric", "workloop"])
def test_colours_grow_brighter_with_pressure(protocol: str) -> None:
    figure = ks.simulate_bench("klute-3-4-pair", protocol, time_step=1e-3, pressures_bar=[2.0, 5.0, 3.0]).plot()
    labelled = {line.get_label(): line.get_color() for line in figure.axes[0].lines if "bar" in str(line.get_label())}
    brightness = {float(str(label).split(" bar")[0]): sum(to_rgb(colour)) for label, colour in labelled.items()}
    assert sorted(brightness) == [2.0, 3.0, 5.0]
    assert brightness[2.0] < brightness[3.0] < brightness[5.0]


def test_legends_of_a_design_lie_below_the_curves() -> None:
    figure = ks.design(mass=75).plot()
    figure.canvas.draw()
    for axis in figure.axes:
        legend = axis.get_legend()
        if legend is not None:
            assert legend.get_window_extent().y1 <= axis.get_window_extent().y0
