"""Effects that the device's numbers imitate: what they promise where everything is taken to be linear."""

import sys
from pathlib import Path

import numpy as np
import pytest

from klute_sim.dataset import dataset as datasets
from klute_sim.diagnose.diagnosis import base_fit
from klute_sim.diagnose.experiment import Bench
from klute_sim.diagnose.loudness import heard
from klute_sim.diagnose.prepare import prepare
from klute_sim.diagnose.screen import FAR, FROM_AFAR, screen, terms

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks" / "hidden_effects"))
from generate import make

RISING = {"name": "threshold_pressure", "form": "rising", "parameters": {"pressure_bar": 0.1136, "rise_bar": 1.604}}
THICK = {"name": "thick_wall_bladder", "form": "mooney_rivlin", "parameters": {"share": 0.5}}


@pytest.mark.parametrize(("effect", "seed"), [(RISING, 2252072962), pytest.param(THICK, 8, marks=pytest.mark.long)])
def test_what_the_numbers_imitate_far_from_what_was_believed_is_promised(
    tmp_path: Path, effect: dict, seed: int
) -> None:
    make(tmp_path / "d", seed, effects=[effect], muscle_length=False)
    data, bench = datasets.read(tmp_path / "d"), Bench(2)
    every = [e for e in prepare(data, datasets.split(data)) if e.use == "fit"]
    base, evidence = base_fit(data, heard(every, every, bench), bench)
    assert np.abs(base.steps).max() > FAR  # the device's numbers had to go far
    found = screen(evidence, base, terms(evidence, data.device))
    leaders = [one.term.effect for one in found[:FROM_AFAR]]
    assert effect["name"] in leaders
    first = next(one for one in found if one.term.effect == effect["name"])
    assert first.gain > 0.3 * base.cost
    assert len(first.origin) == len(first.follow) == len(base.steps)
    bench.close()
