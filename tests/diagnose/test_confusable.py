"""Which effects look alike, and which rig tells them apart."""

import numpy as np
import pytest

from klute_sim.device.files import load
from klute_sim.diagnose.confusable import ALIKE, Confusion, confusions, twins
from klute_sim.diagnose.experiment import Bench
from klute_sim.diagnose.hypothesis import Term
from klute_sim.diagnose.signature import signature


@pytest.fixture(scope="module")
def found() -> list[Confusion]:
    bench = Bench(2)
    result = confusions(load("klute-3-4-pair"), bench)
    bench.close()
    return result


def of(found: Confusion, *names: str) -> list[int]:
    return [k for name in names for k, s in enumerate(found.signatures) if str(s.term).startswith(name)]


def test_cosines_are_those_of_unit_vectors(found: list[Confusion]) -> None:
    for one in found:
        cosines = one.cosines()
        assert np.diag(cosines) == pytest.approx(1.0)
        assert np.array_equal(cosines, cosines.T)
        assert cosines.max() <= 1.0 + 1e-12
        assert all(0.0 < s.kept <= 1.0 + 1e-12 for s in one.signatures)


def test_what_the_device_s_numbers_imitate_is_projected_off(found: list[Confusion]) -> None:
    kept = {str(s.term): s.kept for s in found[0].signatures}
    for name in ("end_taper (cone)", "tendon_slack", "sensor_gain of force"):
        assert kept[name] < 0.2, name
    for name in ("pressure_lag", "pressure_delay", "sensor_gain of pressure"):
        assert kept[name] > 0.9, name


def test_a_wrong_gauge_looks_like_a_wrong_regulator_until_there_is_a_second_one(found: list[Confusion]) -> None:
    alike = twins(found)
    (twin,) = alike[Term("regulator_error", "gain")]
    assert twin.terms == (Term("regulator_error", "gain"), Term("sensor_gain", "linear", "pressure"))
    assert twin.cosine > 0.98
    assert twin.split_by is not None
    assert "gauge" in twin.split_by.words
    assert twin.after < 0.8
    (late,) = alike[Term("sensor_lag", "linear", "force")]
    assert late.terms[1] == Term("clock_skew", "linear", "force")
    assert late.split_by is None
    assert late.after > ALIKE
    assert all(
        t.terms[1].effect != term.effect or t.terms[1].channel != term.channel for term in alike for t in alike[term]
    )


def test_what_a_device_does_not_have_has_no_signature() -> None:
    bench = Bench(2)
    bare = confusions(load("klute-3-4"), bench)
    bench.close()
    assert of(bare[0], "end_taper", "braid_hysteresis")
    assert not of(bare[0], "tendon_", "laminar_orifice", "discharge_loss")


def test_a_signature_is_the_difference_that_the_effect_makes() -> None:
    bench = Bench(2)
    found = signature(load("klute-3-4-pair"), Term("regulator_error", "offset"), bench)
    bench.close()
    pressure = next(s for s in found.shown if s.channel == "pressure")
    apart = (pressure.having - pressure.without)[pressure.without < 4.5e5]
    assert np.median(apart) == pytest.approx(0.1e5, rel=1e-6)
