"""The margin of names over a free term: true names keep it, imitations lose it."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.free_term import find_free_model
from klute_sim.diagnosis.selection.sparse_regression import _eliminate_functions
from tests.diagnosis.test_sparse_regression import create_search

FRICTION = EffectTerm("braid_hysteresis", "coulomb")


def add_terms(search: ForwardSelection, base: Fit, *terms: EffectTerm) -> Fit:
    """Return ``base`` refitted with ``terms``."""
    hypothesis = base.hypothesis
    for term in terms:
        hypothesis = hypothesis.with_term(term)
    start = hypothesis.initial_point()
    start[: len(base.x)] = base.x
    start[len(base.x) :] = np.where(start[len(base.x) :] == 0.0, 0.1, start[len(base.x) :])
    return fit_hypothesis(search.data, hypothesis, start)


def test_elimination_keeps_the_true_functions() -> None:
    functions = np.random.default_rng(1).standard_normal((200, 6))
    functions /= np.linalg.norm(functions, axis=0)
    target = 5.0 * functions[:, 1] - 3.0 * functions[:, 4]
    subsets = _eliminate_functions(functions, target)
    assert [len(subset) for subset in subsets] == [6, 5, 4, 3, 2, 1]
    assert subsets[-2:] == [[1, 4], [1]]


@pytest.mark.slow
def test_true_name_is_not_beaten_and_an_imitation_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for search, base in create_search(tmp_path / "d", {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}}):
        named = add_terms(search, base, FRICTION)
        assert not search.has_misfit(named)
        assert find_free_model(search, base, named) is None
        assert find_free_model(search, base, base) is None  # nothing was named
        imitation = add_terms(search, base, EffectTerm("muscle_damping", "viscous"))
        free_model = find_free_model(search, base, imitation)
        assert free_model is not None
        assert free_model.bic_difference < -search.bic_threshold
        assert not search.has_misfit(free_model.fit)
        assert find_free_model(search, base, imitation, ("unknown_force",)) is None
        # A term must not lose in any validation group, even where it gains in the mean.
        monkeypatch.setattr(search, "compute_validation_gains", lambda before, after: {"a": 0.5, "b": -0.1})
        assert find_free_model(search, base, imitation) is None
