"""Which effects look alike, and which rig tells them apart."""

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.planning.identifiability import (
    INDISTINGUISHABLE_COSINE,
    RigIdentifiability,
    compute_identifiability,
    find_indistinguishable_pairs,
)
from klute_sim.diagnosis.planning.signatures import simulate_effect_response


@pytest.fixture(scope="module")
def found() -> list[RigIdentifiability]:
    bench = Simulator(2)
    result = compute_identifiability(load_device("klute-3-4-pair"), bench)
    bench.close()
    return result


def of(found: RigIdentifiability, *names: str) -> list[int]:
    return [k for name in names for k, s in enumerate(found.signatures) if str(s.term).startswith(name)]


def test_signatures_are_unit_vectors(found: list[RigIdentifiability]) -> None:
    for one in found:
        cosines = one.cosine_matrix()
        assert np.diag(cosines) == pytest.approx(1.0)
        assert np.array_equal(cosines, cosines.T)
        assert cosines.max() <= 1.0 + 1e-12
        assert all(0.0 < s.orthogonal_fraction <= 1.0 + 1e-12 for s in one.signatures)


def test_device_numbers_are_projected_out(found: list[RigIdentifiability]) -> None:
    kept = {str(s.term): s.orthogonal_fraction for s in found[0].signatures}
    for name in ("end_taper (cone)", "tendon_slack", "sensor_gain of force"):
        assert kept[name] < 0.2, name
    for name in ("pressure_lag", "pressure_delay", "sensor_gain of pressure"):
        assert kept[name] > 0.9, name


def test_second_gauge_separates_sensor_from_regulator(
    found: list[RigIdentifiability],
) -> None:
    alike = find_indistinguishable_pairs(found)
    (twin,) = alike[EffectTerm("regulator_error", "gain")]
    assert twin.terms == (EffectTerm("regulator_error", "gain"), EffectTerm("sensor_gain", "linear", "pressure"))
    assert twin.cosine > 0.98
    assert twin.separated_by is not None
    assert "gauge" in twin.separated_by.description
    assert twin.remaining_cosine < 0.8
    (late,) = alike[EffectTerm("sensor_lag", "linear", "force")]
    assert late.terms[1] == EffectTerm("clock_skew", "linear", "force")
    assert late.separated_by is None
    assert late.remaining_cosine > INDISTINGUISHABLE_COSINE
    assert all(
        t.terms[1].effect != term.effect or t.terms[1].channel != term.channel for term in alike for t in alike[term]
    )


def test_incompatible_effects_have_no_signature() -> None:
    bench = Simulator(2)
    bare = compute_identifiability(load_device("klute-3-4"), bench)
    bench.close()
    assert of(bare[0], "end_taper", "braid_hysteresis")
    assert not of(bare[0], "tendon_", "laminar_orifice", "discharge_loss")


def test_effect_response_is_the_difference_of_simulations() -> None:
    bench = Simulator(2)
    found = simulate_effect_response(load_device("klute-3-4-pair"), EffectTerm("regulator_error", "offset"), bench)
    bench.close()
    pressure = next(s for s in found.channels if s.channel == "pressure")
    apart = (pressure.with_effect - pressure.without_effect)[pressure.without_effect < 4.5e5]
    assert np.median(apart) == pytest.approx(0.1e5, rel=1e-6)
