"""Which equation of a walk has the misfit, and the data-driven term of the ankle."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.discrepancy.sparse_regression import add_data_driven_term, format_formula
from klute_sim.diagnosis.experiments.base import BodyEdit
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import fit_hypothesis
from klute_sim.diagnosis.localization.equation_residuals import compute_equation_residuals, select_significant_equations
from klute_sim.diagnosis.localization.gait_equations import compute_walk_residual_series
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.errors import InputError
from klute_sim.gait.rig.build import build_gait_model
from tests.diagnosis import synthetic_walk as walk

pytestmark = pytest.mark.slow


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    simulator = Simulator(2)
    yield simulator
    simulator.close()


SPRING = BodyEdit("return_spring_error", "stiffness", (("gain", 1.2),))
SECTIONS = {
    "muscle and damper": '\n[effects.seal_friction]\nform = "coulomb"\nforce_n = 60.0\n',
    "tendon": "\n[effects.tendon_stiffening]\nstiffening_n_per_mm2 = 4.0\n",
    "supply": '\n[effects.regulator_error]\nform = "offset"\noffset_bar = 0.2\n',
}


def list_significant(simulator: Simulator, **options: object) -> dict[str, float]:
    """Return name and rms of each significant equation, most significant first."""
    data, nominal = walk.weight_walks(walk.make_walks(**options), simulator)  # type: ignore[arg-type]
    residuals = compute_equation_residuals(data, fit_hypothesis(data, nominal))
    assert {residual.name for residual in residuals} == {"supply", "muscle and damper", "tendon", "ankle"}
    return {residual.name: residual.rms for residual in select_significant_equations(residuals)}


def test_no_equation_of_a_clean_walk_lacks_anything(simulator: Simulator) -> None:
    assert list_significant(simulator) == {}


@pytest.mark.parametrize("equation", SECTIONS)
def test_effect_of_the_device_is_missing_in_its_equation_only(simulator: Simulator, equation: str) -> None:
    """The ankle moves otherwise under each of them, but its own equation holds."""
    assert list(list_significant(simulator, effects=SECTIONS[equation])) == [equation]


@pytest.mark.parametrize("channel", ["force", "pressure"])
def test_dropout_of_a_log_is_no_misfit_of_an_equation(channel: str) -> None:
    """A quarter of a second without samples, as of a wireless log, is not interpolated."""
    recorded = walk.make_walks(amplitudes=(1.0,))[0]
    series = recorded.measured[channel]
    is_kept = (series.time < 1.25) | (series.time > 1.5)
    kept = TimeSeries(series.time[is_kept], series.value[is_kept])
    broken = replace(recorded, measured={**recorded.measured, channel: kept})
    (setup,) = Hypothesis(walk.DEVICE, (), ()).build_setups(np.zeros(0), [recorded])
    whole, rest = (compute_walk_residual_series(each, setup) for each in (recorded, broken))
    for name, residual in rest.items():
        assert 0.85 * len(whole[name].time) < len(residual.time) < len(whole[name].time)
        assert not ((residual.time > 1.26) & (residual.time < 1.49)).any()
        assert np.abs(residual.value).max() < 1.5 * np.abs(whole[name].value).max()


def test_stiffer_return_spring_is_missing_in_the_equation_of_the_ankle(simulator: Simulator) -> None:
    """The moment that is missing is a fifth of that of the declared spring."""
    found = list_significant(simulator, body_edits=[SPRING])
    assert list(found) == ["ankle"]
    angle = np.concatenate([e.measured["ankle_angle"].value for e in walk.make_walks(body_edits=[SPRING])])
    moment = 0.2 * walk.FOOT.spring_stiffness * (-angle - walk.FOOT.spring_rest_angle)
    assert found["ankle"] == pytest.approx(np.sqrt(np.mean(moment**2)), rel=0.05)


def test_walk_without_ankle_angle_has_no_equations(simulator: Simulator) -> None:
    walks = walk.make_walks()
    for each in walks:
        del each.measured["ankle_angle"]  # type: ignore[attr-defined]
    data, nominal = walk.weight_walks(walks, simulator)
    assert compute_equation_residuals(data, fit_hypothesis(data, nominal)) == []


def test_unknown_moment_becomes_a_formula(simulator: Simulator) -> None:
    """A moment of 6 N.m per 100 N.m of dorsiflexing load, which is no effect of the catalogue."""
    walks = []
    for k, amplitude in enumerate((1.0, 0.7)):
        moment = -0.06 * walk.compute_inputs(amplitude).ground_moment
        walks += [e for e in walk.make_walks(moment=moment, amplitudes=(1.0, 0.7), seed=k) if e.group == str(k)]
    data, nominal = walk.weight_walks(walks, simulator)
    base_fit = fit_hypothesis(data, nominal)
    search = ForwardSelection(data, [], [], has_repeats=True)
    result = add_data_driven_term(search, base_fit, base_fit, compute_equation_residuals(data, base_fit))
    assert result.equation == "ankle"
    assert result.fit is not None
    assert not search.has_misfit(result.fit)
    formula = format_formula(result.fit)
    assert formula.startswith("M += ")
    assert "l = dorsiflexing moment of the ground reaction/(100 N·m)" in formula
    found = dict(zip(result.fit.hypothesis.terms[-1].parameter_keys, result.fit.values, strict=True))
    assert found["load_n_m"] == pytest.approx(6.0, rel=0.06)
    assert all(abs(value) < 1.0 for key, value in found.items() if key != "load_n_m")
    assert result.fit.chi2 < 0.2 * base_fit.chi2


def test_gait_run_refuses_an_unknown_moment() -> None:
    device = walk.parse_device(
        f"{walk.DEVICE.content.decode()}\n[effects.unknown_ankle_moment]\nload_n_m = 5.0\n".encode(), "unknown"
    )
    with pytest.raises(InputError, match="cannot be simulated in a gait run"):
        build_gait_model(device, mass=75.0, stature=1.75, dt=1e-3)
