"""Magnitude of the gravity of a model."""

import pytest

from klute_sim.plausibility.gravity import check_gravity


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.0, 0.0, -9.81), (6.9, 0.0, -6.9), (0.0, 1.62, 0.0)])
def test_possible_gravity_is_accepted(gravity: tuple[float, float, float]) -> None:
    assert check_gravity(gravity, "trial 'a'") == []


@pytest.mark.parametrize(
    ("gravity", "cause"),
    [((0.0, 0.0, -9810.0), "looks like mm/s2"), ((0.0, -981.0, 0.0), "looks like cm/s2"), ((0.0, 0.0, -1e6), "")],
)
def test_impossible_gravity_is_found(gravity: tuple[float, float, float], cause: str) -> None:
    (finding,) = check_gravity(gravity, "trial 'a'")
    assert finding.name == "gravity"
    assert cause in finding.statement
    assert ("looks like" in finding.statement) == bool(cause)
    assert "allowed: 0, or 0.5 to 30 m/s2" in finding.statement


def test_gravity_opposite_to_that_of_the_file_is_found() -> None:
    (finding,) = check_gravity((0.0, 0.0, 9.81), "trial 'a'", (0.0, 0.0, -9.81))
    assert "is (0, 0, 9.81) m/s2, opposite to (0, 0, -9.81) m/s2" in finding.statement
    assert check_gravity((6.9, 0.0, -6.9), "trial 'a'", (0.0, 0.0, -9.81)) == []
    assert check_gravity((0.0, 0.0, 0.0), "trial 'a'", (0.0, 0.0, -9.81)) == []
