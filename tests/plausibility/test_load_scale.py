"""Sign and unit of measured forces and moments, judged by the static loads of the devices."""

import numpy as np
import pytest

from klute_sim.plausibility.load_scale import LoadSeries, check_load_scale
from klute_sim.plausibility.samples import Samples
from klute_sim.types import Array

EXPECTED = 300.0 + 100.0 * np.sin(np.linspace(0.0, 6.0, 60))
MOMENT = EXPECTED / 25.0


def make_load(measured: Array, expected: Array = EXPECTED, channel: str = "force_calf", unit: str = "N") -> LoadSeries:
    samples = Samples(channel, measured, unit, 1.0)
    gross = np.abs(expected)
    return LoadSeries(samples, measured, expected, gross, 1.5 * float(gross.max()), "trial 'a'")


@pytest.mark.parametrize(
    ("measured", "kind", "part"),
    [
        (EXPECTED / 4.448, "unit", "is its unit lbf?"),
        (1.3 * EXPECTED / 4.448, "unit", "is its unit lbf?"),
        (0.75 * EXPECTED / 9.80665, "unit", "is its unit kgf?"),
        (EXPECTED / 1000.0, "unit", "is its unit kN?"),
        (-0.7 * EXPECTED, "sign", "tension is positive"),
    ],
)
def test_mistake_in_a_force_is_found(measured: Array, kind: str, part: str) -> None:
    (finding,) = check_load_scale([make_load(measured)])
    assert finding.name == f"force_calf-{kind}"
    assert part in finding.statement


@pytest.mark.parametrize(
    ("measured", "kind", "part"),
    [(100.0 * MOMENT, "unit", "is its unit N*cm?"), (-2.0 * MOMENT, "sign", "turns the joint to larger angles")],
)
def test_mistake_in_a_moment_is_found(measured: Array, kind: str, part: str) -> None:
    (finding,) = check_load_scale([make_load(measured, MOMENT, "moment_ankle", "N*m")])
    assert finding.name == f"moment_ankle-{kind}"
    assert part in finding.statement


@pytest.mark.parametrize(
    "measured",
    [
        EXPECTED,
        1.3 * EXPECTED,
        0.4 * EXPECTED,  # a weak muscle
        2.0 * EXPECTED,  # two muscles, or a moment arm that is twice as long
        1.3558 * EXPECTED,  # foot-pounds are too close to newton metres
        EXPECTED - 150.0,  # a load cell that was zeroed under load
        500.0 - EXPECTED,  # another waveform
        np.full(60, 60.0),  # a constant load
        np.full(60, np.nan),
    ],
)
def test_other_load_is_accepted(measured: Array) -> None:
    assert check_load_scale([make_load(measured)]) == []


def test_all_trials_have_to_agree() -> None:
    assert check_load_scale([make_load(EXPECTED / 4.448), make_load(0.5 * EXPECTED)]) == []
    assert check_load_scale([make_load(-EXPECTED), make_load(EXPECTED)]) == []
    assert check_load_scale([]) == []


def test_small_difference_of_antagonists_shows_no_sign() -> None:
    load = make_load(-MOMENT, MOMENT, "moment_elbow", "N*m")
    assert check_load_scale([load._replace(gross=3.0 * MOMENT)]) == []
