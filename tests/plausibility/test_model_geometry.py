"""Mistakes in the geometry of a model: wrapping geoms, stops of hinges, and positions beyond the stops of slides."""

import numpy as np
import pytest

from klute_sim.plausibility.samples import Samples
from klute_sim.plausibility.slide_position import check_slide_position
from klute_sim.plausibility.stop_unit import check_stop_unit
from klute_sim.plausibility.wrapping import Wrap, check_wrap

WRAP = Wrap("calf", "drum", 0.04, "end", 0.0405)
STOPS = (-0.15, 0.25)
"""Stops of a slide [m]."""
WAVEFORM = np.sin(np.linspace(0.0, 6.0, 100))


@pytest.mark.parametrize(
    ("wrap", "part"),
    [
        (WRAP._replace(distance=0.04), "where MuJoCo never wraps the tendon around it; move the site out of the geom"),
        (WRAP._replace(distance=0.01), "on the rim or inside of the geom"),
        (WRAP._replace(radius=40.0), "is the radius in mm? Write 0.04 m"),
        (WRAP._replace(radius=4e-5), "whose radius is 0.04 mm; allowed: 0.2 mm and more"),
    ],
)
def test_geom_that_cannot_be_wrapped_is_found(wrap: Wrap, part: str) -> None:
    (finding,) = check_wrap(wrap, "trial 'a'")
    assert finding.name == "length-geometry"
    assert part in finding.statement


def test_site_outside_of_the_geom_is_accepted() -> None:
    assert check_wrap(WRAP, "trial 'a'") == []


def test_stops_in_degrees_are_found() -> None:
    angle = Samples("angle_ankle", np.radians(20.0 * WAVEFORM), "deg", np.pi / 180.0)
    (finding,) = check_stop_unit([angle], (-40.0, 40.0), "trial 'a'")
    assert finding.name == "angle_ankle-geometry"
    assert 'Write angle="degree" under compiler' in finding.statement


def test_stops_of_a_winch_and_small_stops_are_accepted() -> None:
    angle, turns = (Samples("angle_winch", each, "rad", 1.0) for each in (0.5 * WAVEFORM, 20.0 * WAVEFORM))
    assert check_stop_unit([angle, turns], (-40.0, 40.0), "trial 'a'") == []
    assert check_stop_unit([angle], (-0.7, 0.7), "trial 'a'") == []
    assert check_stop_unit([], (-40.0, 40.0), "trial 'a'") == []


@pytest.mark.parametrize(
    ("position", "name", "part"),
    [
        (20.0 + 20.0 * WAVEFORM, "position_guide-unit", "is its unit mm? Correct it in the heading or under [columns]"),
        (0.6 + 0.02 * WAVEFORM, "position_guide-zero", "the stops of its joint are at -0.15 m and 0.25 m"),
    ],
)
def test_position_far_beyond_the_stops_is_found(position: np.ndarray, name: str, part: str) -> None:
    (finding,) = check_slide_position(Samples("position_guide", position, "m", 1.0), STOPS, "trial 'a'")
    assert finding.name == name
    assert part in finding.statement


def test_position_near_the_stops_is_accepted() -> None:
    for position in (
        0.05 + 0.2 * WAVEFORM,
        0.3 + 0.02 * WAVEFORM,
        np.where(WAVEFORM > 0.9, 5.0, 0.1),
        np.full(9, np.nan),
    ):
        assert check_slide_position(Samples("position_guide", position, "m", 1.0), STOPS, "trial 'a'") == []
