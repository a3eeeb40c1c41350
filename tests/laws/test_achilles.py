"""The Achilles power law: inverse, slope, limits; and the published numbers as cited."""

import inspect
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.device.backend.compiled import compile_module
from klute_sim.laws import achilles
from klute_sim.laws.achilles import Measurement, PowerLaw
from tests.compiled_function import make_callable

laws = st.builds(PowerLaw, st.floats(1e8, 1e11), st.floats(1.0, 3.0))
strains = st.floats(1e-4, 0.1)

PUBLISHED = {  # value and standard error in the units of the papers: N/mm, mm, %, kN
    "STIFFNESS_FAST": (193, 18, 1e3, "Peltonen"),
    "STIFFNESS_SLOW": (207, 22, 1e3, "Peltonen"),
    "ELONGATION_FAST": (13.0, 1.2, 1e-3, "Peltonen"),
    "ELONGATION_SLOW": (14.3, 0.9, 1e-3, "Peltonen"),
    "HYSTERESIS_LOSS_FRACTION": (5, 2, 1e-2, "Peltonen"),
    "MAX_WALKING_FORCE": (1.99, None, 1e3, "Kharazi"),
    "MAX_WALKING_STRAIN": (4.0, None, 1e-2, "Kharazi"),
}


def test_measurements_match_their_publications() -> None:
    measurements = {name: value for name, value in vars(achilles).items() if isinstance(value, Measurement)}
    assert measurements.keys() == PUBLISHED.keys()
    for name, (value, error, unit, author) in PUBLISHED.items():
        assert measurements[name].value == pytest.approx(value * unit, rel=1e-12), name
        assert measurements[name].standard_error == (
            None if error is None else pytest.approx(error * unit, rel=1e-12)
        ), name
        assert author in measurements[name].source
        assert "doi 10." in measurements[name].source


def test_module_defines_no_tendon_constants() -> None:
    assert not [name for name, value in vars(achilles).items() if isinstance(value, PowerLaw)]


def test_linear_law_is_hookes_law() -> None:
    law = PowerLaw(1.2e9, 1.0)
    assert achilles.stress(law, 0.04) == pytest.approx(48e6, rel=1e-15)
    assert achilles.tangent_modulus(law, 0.04) == 1.2e9


def test_square_law_matches_hand_calculation() -> None:
    law = PowerLaw(1e10, 2.0)
    assert achilles.stress(law, 0.05) == pytest.approx(25e6, rel=1e-15)
    assert achilles.tangent_modulus(law, 0.05) == pytest.approx(1e9, rel=1e-15)
    assert achilles.strain_at_stress(law, 25e6) == pytest.approx(0.05, rel=1e-15)


@given(laws, strains)
def test_strain_at_stress_inverts_stress(law: PowerLaw, strain: float) -> None:
    assert achilles.strain_at_stress(law, achilles.stress(law, strain)) == pytest.approx(strain, rel=1e-12)


@given(laws, strains)
def test_tangent_modulus_is_the_slope_of_stress(law: PowerLaw, strain: float) -> None:
    d = 1e-5 * strain
    slope = (achilles.stress(law, strain + d) - achilles.stress(law, strain - d)) / (2.0 * d)
    assert achilles.tangent_modulus(law, strain) == pytest.approx(slope, rel=1e-6)


@given(laws, strains, strains)
def test_stress_and_modulus_increase_with_strain(law: PowerLaw, strain_a: float, strain_b: float) -> None:
    low, high = sorted((strain_a, strain_b))
    assert 0.0 < achilles.stress(law, low) <= achilles.stress(law, high)
    assert achilles.tangent_modulus(law, low) <= achilles.tangent_modulus(law, high) * (1.0 + 1e-15)


@given(laws, st.floats(-1.0, 0.0))
def test_stress_is_zero_under_compression(law: PowerLaw, strain: float) -> None:
    assert achilles.stress(law, strain) == 0.0
    assert achilles.tangent_modulus(law, strain) == 0.0
    assert achilles.strain_at_stress(law, strain) == 0.0


@pytest.mark.parametrize("name", ["stress", "strain_at_stress", "tangent_modulus"])
def test_compiled_laws_are_bit_identical(name: str) -> None:
    python, compiled = getattr(achilles, name), make_callable(getattr(compile_module(achilles), name))
    pick = random.Random(3)
    for _ in range(400):
        law = PowerLaw(pick.uniform(1e8, 1e10), pick.choice([1.0, 2.0, pick.uniform(1.0, 3.0)]))
        argument = pick.choice([0.0, -0.1, pick.uniform(0.0, 0.1)]) * (1e9 if name == "strain_at_stress" else 1.0)
        assert float(compiled(law, argument)).hex() == float(python(law, argument)).hex(), (law, argument)


def test_all_laws_are_in_the_compilation_test() -> None:
    functions = {f for f in vars(achilles).values() if inspect.isfunction(f) and f.__module__ == achilles.__name__}
    assert {f.__name__ for f in functions} == {"stress", "strain_at_stress", "tangent_modulus"}
