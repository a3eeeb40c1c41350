"""Figures of bench runs and of a design: legible, with a scale from dark to bright with the pressure."""

import pytest
from matplotlib.colors import to_rgb

import klute_sim as ks
from tests.report.figure_checks import check_figure


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["isometric", "workloop"])
def test_colours_grow_brighter_with_pressure(protocol: str) -> None:
    figure = ks.simulate_bench("klute-3-4-pair", protocol, time_step=1e-3, pressures_bar=[2.0, 5.0, 3.0]).plot()
    check_figure(figure)
    labelled = {line.get_label(): line.get_color() for line in figure.axes[0].lines if "bar" in str(line.get_label())}
    brightness = {float(str(label).split(" bar")[0]): sum(to_rgb(colour)) for label, colour in labelled.items()}
    assert sorted(brightness) == [2.0, 3.0, 5.0]
    assert brightness[2.0] < brightness[3.0] < brightness[5.0]


@pytest.mark.slow
def test_figure_of_a_design_is_legible() -> None:
    check_figure(ks.design(mass=75).plot())
