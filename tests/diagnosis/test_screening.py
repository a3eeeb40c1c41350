"""Effects that the device's numbers imitate: what they promise where everything is taken to be linear."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.hidden_effects.generate import make_dataset

from klute_sim.datasets import dataset as datasets
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.noise.heteroscedastic import add_noise_scales
from klute_sim.diagnosis.selection.candidates import list_candidate_terms
from klute_sim.diagnosis.selection.screening import (
    MAX_PRIOR_CANDIDATES,
    PRIOR_DEVIATION_SIGMAS,
    screen_candidates,
)
from klute_sim.diagnosis.workflow import fit_base_device

pytestmark = pytest.mark.slow

RISING = {"name": "threshold_pressure", "form": "rising", "parameters": {"pressure_bar": 0.1136, "rise_bar": 1.604}}
THICK = {"name": "thick_wall_bladder", "form": "mooney_rivlin", "parameters": {"share": 0.5}}


@pytest.mark.parametrize(("effect", "seed"), [(RISING, 2252072962), pytest.param(THICK, 8, marks=pytest.mark.long)])
def test_effect_that_numbers_imitate_far_from_their_priors_is_screened(tmp_path: Path, effect: dict, seed: int) -> None:
    make_dataset(tmp_path / "d", seed, effects=[effect], muscle_length=False)
    data, bench = datasets.load_dataset(tmp_path / "d"), Simulator(2)
    every = [e for e in prepare_experiments(data, datasets.split_dataset(data)) if e.use == "fit"]
    base, evidence = fit_base_device(data, add_noise_scales(every, every, bench)[0], bench)
    assert np.abs(base.x).max() > PRIOR_DEVIATION_SIGMAS  # the device's numbers had to go far
    found = screen_candidates(evidence, base, list_candidate_terms(evidence, data))
    leaders = [one.term.effect for one in found[:MAX_PRIOR_CANDIDATES]]
    assert effect["name"] in leaders
    first = next(one for one in found if one.term.effect == effect["name"])
    assert first.predicted_gain > 0.3 * base.chi2
    assert len(first.x0) == len(first.nuisance_shift) == len(base.x)
    bench.close()
