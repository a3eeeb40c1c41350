"""Which effects look alike, and which rig distinguishes them."""

from pathlib import Path

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
from klute_sim.diagnosis.planning.proposals import list_rig_changes
from klute_sim.diagnosis.planning.signatures import simulate_effect_response

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def identifiability() -> list[RigIdentifiability]:
    bench = Simulator(2)
    result = compute_identifiability(load_device("klute-3-4-pair"), bench)
    bench.close()
    return result


def find_signatures(rig: RigIdentifiability, *names: str) -> list[int]:
    return [k for name in names for k, s in enumerate(rig.signatures) if str(s.term).startswith(name)]


def test_signatures_are_unit_vectors(identifiability: list[RigIdentifiability]) -> None:
    for rig in identifiability:
        cosines = rig.cosine_matrix()
        assert np.diag(cosines) == pytest.approx(1.0)
        assert np.array_equal(cosines, cosines.T)
        assert cosines.max() <= 1.0 + 1e-12
        assert all(0.0 < s.orthogonal_fraction <= 1.0 + 1e-12 for s in rig.signatures)


def test_device_numbers_are_projected_out(identifiability: list[RigIdentifiability]) -> None:
    fractions = {str(s.term): s.orthogonal_fraction for s in identifiability[0].signatures}
    for name in ("end_taper (cone)", "tendon_slack", "sensor_gain of force"):
        assert fractions[name] < 0.3, name
    for name in ("pressure_lag (first_order)", "pressure_delay", "sensor_gain of pressure"):
        assert fractions[name] > 0.9, name


def test_second_gauge_separates_sensor_from_regulator(
    identifiability: list[RigIdentifiability],
) -> None:
    pairs = find_indistinguishable_pairs(identifiability)
    (twin,) = pairs[EffectTerm("regulator_error", "gain")]
    assert twin.terms == (EffectTerm("regulator_error", "gain"), EffectTerm("sensor_gain", "linear", "pressure"))
    assert twin.cosine > 0.98
    assert twin.separated_by is not None
    assert "gauge" in twin.separated_by.description
    assert twin.remaining_cosine < 0.8
    (late,) = pairs[EffectTerm("sensor_lag", "first_order", "force")]
    assert late.terms[1] == EffectTerm("clock_skew", "linear", "force")
    assert late.separated_by is None
    assert late.remaining_cosine > INDISTINGUISHABLE_COSINE
    assert all(
        t.terms[1].effect != term.effect or t.terms[1].channel != term.channel for term in pairs for t in pairs[term]
    )


@pytest.mark.slow
def test_incompatible_effects_have_no_signature() -> None:
    bench = Simulator(2)
    bare = compute_identifiability(load_device("klute-3-4"), bench)
    bench.close()
    assert find_signatures(bare[0], "end_taper", "braid_hysteresis")
    assert not find_signatures(bare[0], "tendon_", "laminar_orifice", "discharge_loss")


def test_part_of_a_device_is_examined_with_the_changes_of_its_rig(tmp_path: Path) -> None:
    """A tendon alone has no muscle whose length a sensor could show, and none of the usual uncertain numbers."""
    numbers = "slack_length_mm = 100\nstiffness_1_n_per_mm = 60\nstiffness_2_n_per_mm = 0\nengagement_mm = 40\n"
    path = tmp_path / "cable.toml"
    path.write_text(f'name = "cable"\n[tendon]\n{numbers}', "utf-8")
    bench = Simulator(2)
    rigs = compute_identifiability(load_device(path), bench)
    bench.close()
    assert [rig.rig_change for rig in rigs] == list_rig_changes(load_device(path))
    assert not any("muscle" in rig.rig_change.description for rig in rigs)
    assert find_signatures(rigs[0], "tendon_hysteresis")


def test_effect_response_is_the_difference_of_simulations() -> None:
    bench = Simulator(2)
    response = simulate_effect_response(load_device("klute-3-4-pair"), EffectTerm("regulator_error", "offset"), bench)
    bench.close()
    pressure = next(s for s in response.channels if s.channel == "pressure")
    shift = (pressure.with_effect - pressure.without_effect)[pressure.without_effect < 4.5e5]
    assert np.median(shift) == pytest.approx(0.1e5, rel=1e-6)
