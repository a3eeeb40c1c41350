"""Threshold pressure: the braid carries the tension of the pressure beyond the threshold, and none below it."""

import pytest

from klute_sim.device import dynamics
from klute_sim.effects import catalogue
from klute_sim.laws import mckibben
from tests.effects.devices import PAIR, activate

REST = PAIR.parameters.muscle.resting_length
DIAMETER_MM = 12.8
"""Outer diameter of the bladders of the preset."""


@pytest.mark.parametrize(
    ("form", "values", "contraction", "threshold"),
    [
        ("constant", {"pressure_bar": 0.5}, 0.1, 0.5e5),
        ("rising", {"pressure_bar": 0.5, "rise_bar": 10.0}, 0.1, 1.5e5),
        ("rising", {"pressure_bar": 0.5, "rise_bar": 10.0}, 0.0, 0.5e5),
    ],
)
@pytest.mark.parametrize("pressure", [0.2e5, 3e5])
def test_gas_pulls_with_the_pressure_beyond_the_threshold(
    form: str, values: dict[str, float], contraction: float, threshold: float, pressure: float
) -> None:
    bare = PAIR.parameters._replace(
        muscle=PAIR.parameters.muscle._replace(friction_slope=0.0, friction_offset=0.0, c10=0.0, c01=0.0)
    )
    device = activate(catalogue.find_slot("threshold_pressure", form), values, bare)
    length = (1.0 - contraction) * REST
    force = dynamics.compute_muscle_force(device, dynamics.ZERO_INTERNAL_STATE, pressure, length, 0.0)
    expected = mckibben.gas_force(bare.muscle, max(0.0, pressure - threshold * 10.0 / DIAMETER_MM), length)
    assert force == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("form", ["constant", "rising"])
def test_threshold_is_inversely_proportional_to_the_diameter(form: str) -> None:
    """The parameters are those of a bladder of 10 mm."""
    effect_form = catalogue.find_form("threshold_pressure", form)[1]
    p = effect_form.pack({"pressure_bar": 0.6, "rise_bar": 4.0})
    thresholds = []
    for diameter_mm in (10.0, 20.0, 40.0):
        muscle = PAIR.parameters.muscle._replace(bladder_radius=0.5e-3 * diameter_mm)
        thresholds.append(5e5 - effect_form.laws["acting_pressure"](p, (), 5e5, muscle, 0.95 * muscle.resting_length))
    at_10_mm = 0.6e5 if form == "constant" else 0.8e5
    assert thresholds == pytest.approx([at_10_mm, at_10_mm / 2.0, at_10_mm / 4.0])
