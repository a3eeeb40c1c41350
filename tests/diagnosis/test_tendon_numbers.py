"""A number that is wrong for the device on one of several tendons."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.number_error import list_tendon_error_candidates
from klute_sim.report.diagnosis.text import format_term
from tests.diagnosis import synthetic_joint_dataset as joint
from tests.diagnosis.test_mechanism_diagnosis import PAIR, SHORT


def test_wrong_number_of_one_device_changes_that_device_only(tmp_path: Path) -> None:
    dataset = load_dataset(joint.write_dataset(tmp_path, **SHORT))
    assert dataset.mechanism is not None
    key = "extensor/tendon.slack_length_mm"
    numbers = tuple(list_tendon_error_candidates(dataset.mechanism.devices, ()).items())
    hypothesis = Hypothesis(dataset.device, (), (), rig_numbers=numbers)
    assert hypothesis.list_fitted_keys("extensor") == set()
    hypothesis = hypothesis.with_term(EffectTerm("number_error", "value", number=key))
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    (setup, *_) = hypothesis.build_setups(np.array([1.0]), experiments)
    flexor, extensor = setup.devices
    assert flexor == PAIR.parameters
    assert extensor.tendon.slack_length == pytest.approx(PAIR.parameters.tendon.slack_length + 2e-3)
    assert hypothesis.list_fitted_keys("extensor") == {"tendon.slack_length_mm"}
    assert hypothesis.list_fitted_keys("flexor") == set()
    assert format_term(hypothesis.terms[0]) == "slack length of the tendon on 'extensor'"
    assert hypothesis.terms[0].qualified_name == f"number_error@{key}"
