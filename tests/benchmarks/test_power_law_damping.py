"""A damping that grows with less than the speed, from the laws of the benchmark, is named as one of the muscle."""

from pathlib import Path

import pytest
from benchmarks.hidden_effects import generate

from klute_sim.datasets.dataset import load_dataset
from klute_sim.diagnosis.workflow import diagnose


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [0.4, 0.7])
def test_power_law_damping_is_named(exponent: float, tmp_path: Path) -> None:
    """One with 0.6 was called a cold oil in the damper, where the catalogue did not have it."""
    parameters = {"coefficient_n_s_per_m": 400.0, "exponent": exponent}
    hidden = [{"name": "muscle_damping", "form": "power_law", "parameters": parameters}]
    generate.make_dataset(tmp_path / "data", 3, effects=hidden)
    result = diagnose(load_dataset(tmp_path / "data"))
    assert [(t.effect, t.form) for t in result.added_terms] == [("muscle_damping", "power_law")], result.reasons
    assert result.verdict in ("identified", "indistinguishable")
    assert result.fitted_device is not None
    found = result.fitted_device.spec.effects["muscle_damping"]
    for key, value in parameters.items():
        assert found[key] == pytest.approx(value, rel=0.1)
