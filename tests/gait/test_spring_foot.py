"""The passive spring foot."""

import math
from functools import cache

import numpy as np
import pytest

from klute_sim.controllers.pressure import create_off_controller, load_default_profile
from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.gait.metrics import compute_gait_metrics, compute_reference_metrics
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.recording.recording import Recording


@cache
def simulate_run(per_degree: float, *, powered: bool = False) -> Recording:
    foot = SpringFoot(stiffness=math.degrees(per_degree))
    options = GaitOptions(strides=2, dt=1e-3, spring_foot=foot, alignment=0.0)
    return simulate_gait(
        load_device("klute-1-1-4-pair"), load_default_profile() if powered else create_off_controller(), options
    )


def test_moment_is_that_of_spring_and_damping() -> None:
    run = simulate_run(6.0)
    spring = 6.0 * run["ankle_angle"] + 1.0 * np.radians(run["ankle_velocity"])
    assert run["passive_moment"] == pytest.approx(spring, abs=1e-6 * np.abs(spring).max() + 1e-9)
    assert np.abs(run["force"]).max() == pytest.approx(0.0, abs=1e-12)
    assert run.provenance["options"]["spring_foot_nm_per_deg"] == pytest.approx(6.0)


def test_pressure_has_no_effect() -> None:
    plain, powered = simulate_run(6.0), simulate_run(6.0, powered=True)
    assert np.array_equal(plain["ankle_moment"], powered["ankle_moment"])
    assert np.array_equal(plain["grf_vertical"], powered["grf_vertical"])


@pytest.mark.slow
def test_quasi_stiffness_is_the_stiffness_and_energy_return_is_below_one() -> None:
    previous = 0.0
    for per_degree in (3.0, 6.0, 12.0):
        stride = compute_gait_metrics(simulate_run(per_degree)).strides[-1]
        assert stride.quasi_stiffness_nm_per_kg_deg == pytest.approx(per_degree / 75.0, rel=0.05)
        assert stride.energy_return is not None
        assert previous < stride.energy_return < 1.0  # a stiffer foot turns more slowly, so damping dissipates less
        assert stride.ankle_work_net_j_per_kg < 0.0
        previous = stride.energy_return


def test_energy_return_of_a_human_ankle_is_above_one() -> None:
    human = compute_reference_metrics(simulate_run(6.0))
    assert human.energy_return is not None
    assert human.energy_return > 2.0
    assert human.quasi_stiffness_nm_per_kg_deg == pytest.approx(0.080, abs=0.01)


@pytest.mark.parametrize(
    ("foot", "message"),
    [
        ({"stiffness": 0.0}, "stiffness of the spring foot is 0; allowed: 0.5 to 40 N.m/deg"),
        ({"stiffness": math.nan}, "is nan"),
        ({"stiffness": 400.0, "rest_angle": 1.0}, "rest angle of the spring foot is 57.2958"),
    ],
)
def test_foot_out_of_range_is_refused(foot: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SpringFoot(**foot)
