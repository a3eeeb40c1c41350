"""The gait run of the Python API says what differs from the request."""

from dataclasses import replace

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.api.gait import report_rounded_stride_time
from klute_sim.gait.reference import load_default_reference
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.recording.recording import Recording


def make_recording(stride_time: float) -> Recording:
    return Recording({"time": np.zeros(1)}, {"time": "s"}, {"options": {"stride_time_s": stride_time}})


def test_stride_time_is_reported_if_it_differs_by_more_than_a_thousandth() -> None:
    reference = replace(load_default_reference(), stride_time=1.1005)
    options = GaitOptions(reference=reference, strides=1, dt=1e-3)
    (sentence,) = report_rounded_stride_time(make_recording(1.102), options)
    assert sentence == (
        "A stride takes 1.102 s instead of the 1.1005 s of the reference, because it has a whole number of time steps "
        "of 1 ms; a step that divides it keeps it."
    )
    assert report_rounded_stride_time(make_recording(1.101), options) == ()


@pytest.mark.parametrize("options", [{"time_step": 1e-3}, {"time_step": 7e-4, "speed": 1.2}])
def test_step_that_divides_the_stride_or_a_given_speed_needs_no_remark(options: dict[str, float]) -> None:
    assert ks.simulate_gait(strides=1, **options).warnings == ()  # type: ignore[arg-type]
