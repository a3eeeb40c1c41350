"""Pressures of the trials that are proposed on a joint: those of the data, which the supply and the joint can take."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from klute_sim.diagnosis.experiments.mechanism import MechanismExperiment
from klute_sim.diagnosis.planning import joint_proposals
from klute_sim.types import Array
from klute_sim.units import BAR


def read_settings(*commands: Array) -> tuple[float, float]:
    """Return mean and difference [bar] that are proposed after trials with ``commands`` [bar]."""
    experiment = object.__new__(MechanismExperiment)
    for name, value in {"inputs": {str(k): BAR * c for k, c in enumerate(commands)}, "command": commands[0]}.items():
        object.__setattr__(experiment, name, value)
    settings = joint_proposals._read_settings(cast(Any, SimpleNamespace(experiments=[experiment])))
    return settings.mean_pressure / BAR, settings.difference / BAR


@pytest.mark.parametrize(("low", "high"), [(0.0, 5.0), (1.0, 4.0), (3.0, 5.0)])
@pytest.mark.parametrize("is_pair", [False, True])
@pytest.mark.parametrize("usual", ["low", "high", "middle"])
def test_proposed_pressures_are_those_of_the_data(low: float, high: float, usual: str, *, is_pair: bool) -> None:
    """Short pulses to both ends, from wherever the pressure usually is."""
    command = np.full(1000, {"low": low, "high": high, "middle": 0.5 * (low + high)}[usual])
    command[:50], command[50:100] = low, high
    others = [low + high - command] if is_pair else []
    if is_pair and usual == "high":
        others = [np.where(np.arange(1000) < 50, high, command)]  # both are pressurized
    mean, difference = read_settings(command, *others)
    assert difference == pytest.approx(0.5 * (high - low))
    assert low - 1e-9 <= mean - difference < mean + difference <= high + 1e-9
