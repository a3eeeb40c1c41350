"""Exchanged columns of two forces, and laws that only make them look exchanged."""

import numpy as np

from klute_sim.plausibility.exchanged_forces import Balance, ForcePair, check_exchanged_forces
from klute_sim.plausibility.load_scale import LoadSeries
from klute_sim.plausibility.samples import Samples
from klute_sim.types import Array

WAVEFORM = np.sin(np.linspace(0.0, 6.0, 60))
FLEXOR, EXTENSOR = 300.0 + 60.0 * WAVEFORM, 140.0 - 20.0 * WAVEFORM
ARM = 0.025
"""Arm of both forces [m]."""
BALANCE = Balance(np.full(60, ARM), np.full(60, -ARM), -ARM * (FLEXOR - EXTENSOR))


def make_load(channel: str, measured: Array, expected: Array) -> LoadSeries:
    return LoadSeries(Samples(channel, measured, "N", 1.0), measured, expected, expected, 600.0, "trial 'a'")


def make_pair(flexor: Array, extensor: Array, balance: Balance | None = None) -> ForcePair:
    first, second = make_load("force_flexor", flexor, FLEXOR), make_load("force_extensor", extensor, EXTENSOR)
    return ForcePair(first, second, balance)


def test_exchanged_forces_are_found() -> None:
    for balance in (None, BALANCE):
        (finding,) = check_exchanged_forces([make_pair(1.2 * EXTENSOR, 0.8 * FLEXOR, balance)])
        assert finding.name == "force_extensor-force_flexor-exchanged"
        assert "correct the headings" in finding.statement


def test_right_forces_are_accepted() -> None:
    assert check_exchanged_forces([]) == []
    for first, second in [(1.0, 1.0), (0.7, 1.3), (1.3, 0.7)]:
        assert check_exchanged_forces([make_pair(first * FLEXOR, second * EXTENSOR, BALANCE)]) == []


def test_forces_that_balance_the_load_are_accepted_whatever_the_laws() -> None:
    balance = Balance(BALANCE.first_arm, BALANCE.second_arm, -BALANCE.load)
    assert check_exchanged_forces([make_pair(EXTENSOR, FLEXOR, balance)]) == []


def test_one_trial_with_the_right_difference_decides() -> None:
    pairs = [make_pair(EXTENSOR, FLEXOR, BALANCE), make_pair(FLEXOR, EXTENSOR, BALANCE)]
    assert check_exchanged_forces(pairs) == []


def test_like_forces_are_not_judged() -> None:
    pair = make_pair(EXTENSOR, FLEXOR)
    assert check_exchanged_forces([pair._replace(second=pair.second._replace(expected=1.05 * FLEXOR))]) == []
