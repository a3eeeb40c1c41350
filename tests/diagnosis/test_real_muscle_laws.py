"""The law of the device against published muscles of six lengths, not part of the project (``KLUTE_SIM_DATA``).

No diagnosis is run: the effects are given, and their numbers are fitted by plain least squares.
"""

import csv
from collections import defaultdict
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import least_squares

from klute_sim.device.device import parse_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.types import Array
from tests.diagnosis.test_real_data import DATA, DEVICE

pytestmark = [
    pytest.mark.extras,
    pytest.mark.skipif(not DATA.exists(), reason="KLUTE_SIM_DATA does not hold these measurements"),
]

Forms = tuple[tuple[str, str], ...]
STEP = 10
"""Every tenth logged sample is used: a filling lasts 14 s, and samples are then 0.1 s apart."""
DEVICE_LIMITS = {
    "braid_length_ratio": (1.078, 1.122),
    "turns_per_m": (12.6, 13.92),
    "c10": (160e3, 640e3),
    "c01": (160e3, 640e3),
}
"""Limits of the uncertain numbers of the device: 2, 5, 60 and 60 %, in SI units."""


class ClampedMuscle(NamedTuple):
    """Trials at one length of one muscle."""

    resting_length: float
    length: float
    pressure: Array
    force: Array


def read_muscles() -> list[ClampedMuscle]:
    rows = defaultdict(list)
    with DATA.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            rows[row["L0_cm"], row["L_cm"]].append((1e3 * float(row["P_kPa"]), float(row["F_N"])))
    return [
        ClampedMuscle(1e-2 * float(resting), 1e-2 * float(length), *np.array(samples[::STEP]).T)
        for (resting, length), samples in rows.items()
    ]


def build_device(
    device: DeviceParameters, resting_length: float, values: dict[str, float], forms: Forms
) -> DeviceParameters:
    active = {
        (name, form): {p.key: values[p.key] for p in catalogue.find_form(name, form)[1].parameters}
        for name, form in forms
    }
    muscle = device.muscle._replace(
        resting_length=resting_length,
        braid_length=values["braid_length_ratio"] * resting_length,
        braid_turns=values["turns_per_m"] * resting_length,
        c10=values["c10"],
        c01=values["c01"],
    )
    return device._replace(muscle=muscle, effects=catalogue.pack_effects(active))


def compute_misfit(
    device: DeviceParameters, muscles: list[ClampedMuscle], values: dict[str, float], forms: Forms
) -> Array:
    """Return simulated minus measured force [N]."""
    return np.concatenate(
        [
            simulate_rollouts(
                build_device(device, m.resting_length, values, forms),
                np.full(len(m.pressure), m.length),
                m.pressure,
                0.01,
            ).tension
            - m.force
            for m in muscles
        ]
    )


def fit(device: DeviceParameters, muscles: list[ClampedMuscle], forms: Forms) -> dict[str, float]:
    """Return device numbers and effect parameters that fit ``muscles``, within their limits."""
    limits, start = dict(DEVICE_LIMITS), {key: sum(pair) / 2.0 for key, pair in DEVICE_LIMITS.items()}
    for name, form in forms:
        for parameter in catalogue.find_form(name, form)[1].parameters:
            limits[parameter.key] = (parameter.lower, min(parameter.upper, 10.0 * parameter.typical))
            start[parameter.key] = parameter.typical
    low, high = np.array(list(limits.values())).T
    result = least_squares(
        lambda x: compute_misfit(device, muscles, dict(zip(limits, low + x * (high - low), strict=True)), forms),
        (np.array(list(start.values())) - low) / (high - low),
        bounds=(0.0, 1.0),
        x_scale=0.1,
        diff_step=1e-5,
        max_nfev=60,
    )
    return dict(zip(limits, low + result.x * (high - low), strict=True))


@pytest.mark.parametrize(
    ("forms", "expected_pct"),
    [
        ((), 14.0),
        ((("passive_tension", "exponential"),), 5.5),
        ((("passive_tension", "exponential"), ("end_taper", "length")), 4.2),
        ((("passive_tension", "power"), ("end_taper", "length")), 4.3),
    ],
    ids=["none", "passive tension", "passive tension and length", "power and length"],
)
def test_law_predicts_the_force_of_a_muscle_of_another_length(forms: Forms, expected_pct: float) -> None:
    """Each length is predicted by the numbers that fit the other five; per cent of the largest force."""
    device = parse_device(DEVICE.encode(), "10 mm muscle").parameters
    muscles = read_muscles()
    misfit = []
    for length in {m.resting_length for m in muscles}:
        values = fit(device, [m for m in muscles if m.resting_length != length], forms)
        misfit.append(compute_misfit(device, [m for m in muscles if m.resting_length == length], values, forms))
    largest = max(m.force.max() for m in muscles)
    assert 100.0 * np.sqrt(np.mean(np.concatenate(misfit) ** 2)) / largest == pytest.approx(expected_pct, abs=0.4)
