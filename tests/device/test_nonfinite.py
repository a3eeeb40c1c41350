"""Random devices end alike under both backends, and what cannot be computed ends in one sentence."""

import math
import re

import numpy as np
import pytest
from benchmarks.robustness import numerics
from benchmarks.robustness.random_devices import draw_run
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.recorded_rollout import record_rollout
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.errors import SimulationError
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE

PAIR = load_device("klute-3-4-pair").parameters
LENGTHS = np.full(8, 0.34)
COMMANDS = np.linspace(0.0, 5e5, 8)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**48))
def test_random_devices_end_alike_with_positive_pressure(seed: int) -> None:
    outcome = numerics.compare_backends(seed)
    assert outcome.kind == "equal", outcome
    assert outcome.min_pressure > 0.0


def test_small_leaking_muscle_behind_a_choked_valve_keeps_its_air() -> None:
    """Without limits the mass of the air becomes negative within 0.1 s."""
    device = load_device("klute-1-1-4-pair").with_changes(
        {
            "muscle.resting_length_mm": 20.0,
            "muscle.braid_length_ratio": 1.1,
            "muscle.turns_per_m": 1e3 * (1.1**2 - 1.0) ** 0.5 / np.pi,
            "muscle.bladder_radius_mm": 0.5,
            "muscle.bladder_thickness_mm": 0.1,
        }
    )
    device = device.with_effect("choked_valve", resistance_s_bar_per_dm3=4.0, critical_ratio=0.5)
    device = device.with_effect("leak", conductance_dm3_per_s_bar=1.0)
    for backend in ("compiled", "python"):
        trace = simulate_rollouts(
            device.parameters, np.full(100, 0.1195), np.full(100, 5e5), 1e-2, n_jobs=1, backend=backend
        )
        assert 0.0 < trace.pressure[-1] < 5e5


def test_regulator_with_volume_coupling_keeps_absolute_pressure_positive() -> None:
    """Without limits the pressure falls below -2 bar gauge."""
    device = load_device("klute-1-1-4-pair").with_effect("volume_coupling", recovery_s=5.0, exponent=1.4)
    device = device.with_effect("unknown_pressure", offset_bar=-1.0, falling_lag_s=-1.0)
    muscle = device.parameters.muscle
    time = np.arange(400) * 1e-3
    length = 0.1 + muscle.resting_length * np.where(time < 0.2, 1.0 - time, 0.8)
    command = np.where(time < 0.25, 5e5, 0.0)
    for backend in ("compiled", "python"):
        trace = simulate_rollouts(device.parameters, length, command, 1e-3, backend=backend)
        assert -ATMOSPHERIC_PRESSURE < trace.pressure.min() < -1e4


def test_campaign_covers_every_effect_and_section() -> None:
    specs = [draw_run(seed).device.spec for seed in range(400)]
    effects = {(name, content["form"]) for spec in specs for name, content in spec.effects.items()}
    assert len(effects) >= 35
    for title in ("damper", "tendon", "valve", "line", "chamber", "tank", "leak"):
        assert {getattr(spec, title) is None for spec in specs} == {True, False}, title
    steps = [draw_run(seed).time_step for seed in range(40)]
    assert (min(steps), max(steps)) == (5e-5, 1e-2)


def replace_muscle(**fields: float) -> DeviceParameters:
    return PAIR._replace(muscle=PAIR.muscle._replace(**fields))


VALVE = PAIR.supply._replace(fill_conductance=1e-8, exhaust_conductance=1e-8, valve_gain=1.0)
BROKEN = {
    "no turns": (replace_muscle(braid_turns=0.0), "initial state|pressure|muscle length"),
    "stiffness that is no number": (
        PAIR._replace(tendon=PAIR.tendon._replace(stiffness_1=math.nan, slack_length=0.09)),  # never slack
        "muscle length",
    ),
    "rubber that is no number": (replace_muscle(c10=math.nan), "muscle length"),
    "no temperature": (PAIR._replace(supply=VALVE._replace(temperature=0.0)), "initial state|pressure"),
    "negative temperature": (PAIR._replace(supply=VALVE._replace(temperature=-10.0)), "pressure"),
}


@pytest.mark.parametrize("case", BROKEN)
@pytest.mark.parametrize("simulate", [simulate_rollouts, record_rollout])
def test_both_backends_name_what_has_no_finite_value(case: str, simulate: object) -> None:
    parameters, quantity = BROKEN[case]
    messages = []
    for backend in ("compiled", "python"):
        with pytest.raises(SimulationError) as caught:
            simulate(parameters, LENGTHS, COMMANDS, 1e-3, backend=backend)  # type: ignore[operator]
        messages.append(str(caught.value))
    assert messages[0] == messages[1]
    assert re.search(rf"has no finite state at t = 0\.00\d0 s: no finite ({quantity}) results there", messages[0])
