"""Effects that the device's numbers imitate: what they promise where everything is taken to be linear."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from benchmarks.hidden_effects.generate import make_dataset

from klute_sim.datasets import dataset as datasets
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.noise.heteroscedastic import add_noise_scales
from klute_sim.diagnosis.selection.candidates import list_candidate_terms
from klute_sim.diagnosis.selection.screening import (
    MAX_PRIOR_CANDIDATES,
    PRIOR_DEVIATION_SIGMAS,
    Candidate,
    screen_candidates,
)
from klute_sim.diagnosis.workflow import fit_base_device

pytestmark = pytest.mark.slow

RISING = {"name": "threshold_pressure", "form": "rising", "parameters": {"pressure_bar": 0.1136, "rise_bar": 1.604}}
SMALL = {"name": "threshold_pressure", "form": "rising", "parameters": {"pressure_bar": 0.08, "rise_bar": 2.5}}
THICK = {"name": "thick_wall_bladder", "form": "mooney_rivlin", "parameters": {"share": 0.5}}


def _screen(folder: Path, seed: int, effect: dict) -> tuple[Fit, list[Candidate]]:
    """Return the fit of the device without ``effect``, which the data contain, and the candidates."""
    make_dataset(folder, seed, effects=[effect], muscle_length=False)
    data = datasets.load_dataset(folder)
    with closing(Simulator(2)) as simulator:
        fitted = [e for e in prepare_experiments(data, datasets.split_dataset(data)) if e.use == "fit"]
        base_fit, evidence = fit_base_device(data, add_noise_scales(fitted, fitted, simulator)[0], simulator)
        return base_fit, screen_candidates(evidence, base_fit, list_candidate_terms(evidence, data))


@pytest.mark.parametrize(("effect", "seed"), [(RISING, 2252072962), pytest.param(THICK, 8, marks=pytest.mark.long)])
def test_effect_that_numbers_imitate_far_from_their_priors_is_screened(tmp_path: Path, effect: dict, seed: int) -> None:
    base, found = _screen(tmp_path / "d", seed, effect)
    assert np.abs(base.x).max() > PRIOR_DEVIATION_SIGMAS  # the device's numbers had to go far
    leaders = [one.term.effect for one in found[:MAX_PRIOR_CANDIDATES]]
    assert effect["name"] in leaders
    first = next(one for one in found if one.term.effect == effect["name"])
    assert first.predicted_gain > 0.3 * base.chi2
    assert len(first.x0) == len(first.nuisance_shift) == len(base.x)


def test_small_effect_is_screened_at_its_size(tmp_path: Path) -> None:
    base, found = _screen(tmp_path / "d", 1120693001, SMALL)
    gain = next(c.predicted_gain for c in found if (c.term.effect, c.term.form) == ("threshold_pressure", "rising"))
    assert gain > 0.05 * base.chi2  # at typical size, the muscle would not pull at all
