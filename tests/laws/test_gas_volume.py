"""The room for air in a muscle, compared with the water that would fill the bore of its drawing.

The comparison shares nothing with the law: it winds a thread, presses layers of rubber against it, each with the volume
that it has at rest, and adds up discs of water between the innermost layer and the axis.
"""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from klute_sim.device.device import load_device
from klute_sim.device.dynamics import advance_state
from klute_sim.device.energy.outputs import compute_outputs
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE
from klute_sim.units import BAR

PRESETS = ("klute-1-1-4-pair", "klute-1-1-4", "klute-3-4-pair", "klute-3-4", "klute-1-2")
PAIR = load_device("klute-1-1-4-pair").parameters.muscle
N_LAYERS, N_DISCS, N_CHORDS = 40, 25, 720


def measure_thread(radius: float, length: float, turns: float) -> float:
    """Return the length [m] of a helix as a polygon of chords."""
    step, angle = length / N_CHORDS, 2.0 * math.pi * turns / N_CHORDS
    return N_CHORDS * math.hypot(step, 2.0 * radius * math.sin(0.5 * angle))


def fill_with_water(muscle: MuscleParameters, length: float) -> float:
    """Return the water [m3] that the bores of all bladders take at muscle ``length`` [m]."""
    outside = brentq(
        lambda r: measure_thread(r, length, muscle.braid_turns) - muscle.braid_length, 0.0, 0.2, xtol=1e-13
    )
    at_rest = [muscle.bladder_radius - k * muscle.bladder_thickness / N_LAYERS for k in range(N_LAYERS + 1)]
    radius = outside
    for outer, inner in itertools.pairwise(at_rest):
        rubber = math.pi * (outer + inner) * (outer - inner) * muscle.resting_length
        # Below this layer there is what its outside encloses, less its rubber.
        radius = math.sqrt(radius * radius - rubber / (math.pi * length))
    disc = length / N_DISCS
    return muscle.n_actuators * sum(math.pi * radius * radius * disc for _ in range(N_DISCS))


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("ratio", [1.0, 0.975, 0.93, 0.85, 0.7, 0.61])
def test_gas_has_the_room_that_water_would_fill(preset: str, ratio: float) -> None:
    muscle = load_device(preset).parameters.muscle
    length = ratio * muscle.resting_length
    assert mckibben.gas_volume(muscle, length) == pytest.approx(fill_with_water(muscle, length), rel=2e-4)


def test_rubber_displaces_what_a_referee_found() -> None:
    """Volume of the rubber, and by how much the braid's volume exceeds that of the air, 1-1/4 in pair."""
    rubber = PAIR.n_actuators * mckibben.bladder_volume(PAIR)
    assert rubber == pytest.approx(59.7e-6, abs=0.05e-6)
    for ratio, excess in ((1.0, 0.82), (0.975, 0.45), (0.93, 0.26), (0.85, 0.17)):
        length = ratio * PAIR.resting_length
        found = mckibben.braid_volume(PAIR, length) / mckibben.gas_volume(PAIR, length) - 1.0
        assert found == pytest.approx(excess, abs=0.005)
    small = load_device("klute-1-2").parameters.muscle
    at_rest = small.resting_length
    assert mckibben.braid_volume(small, at_rest) / mckibben.gas_volume(small, at_rest) - 1.0 == pytest.approx(
        1.61, abs=0.005
    )


def test_air_that_is_enclosed_is_stiffer_than_the_braid_volume_lets_it_be() -> None:
    """``n p V'^2/V`` at 3 bar and L/L0 0.975 with n = 1.2: 187 N/mm with the rubber taken for air, 271 without it."""
    length, exponent, pressure = 0.975 * PAIR.resting_length, 1.2, 3.0 * BAR
    slope = -mckibben.gas_force(PAIR, 1.0, length)
    stiffness = [
        exponent * (pressure + ATMOSPHERIC_PRESSURE) * slope * slope / volume
        for volume in (mckibben.braid_volume(PAIR, length), mckibben.gas_volume(PAIR, length))
    ]
    assert stiffness == pytest.approx([187e3, 272e3], abs=0.5e3)


def compute_sealed_stiffness(dead_volume: float) -> float:
    """Return the stiffness [N/m] of the device's own sealed muscle at 3 bar, L/L0 0.975 and n = 1.2, by two lengths."""
    device = load_device("klute-1-1-4-pair").with_changes({"supply.dead_volume_cm3": 1e6 * dead_volume})
    parameters = device.with_effect("volume_coupling", recovery_s=5.0, exponent=1.2).parameters
    clamp = parameters._replace(
        tendon=load_device("klute-1-1-4").parameters.tendon, damper=load_device("klute-1-1-4").parameters.damper
    )
    bare = clamp._replace(muscle=PAIR._replace(c10=0.0, c01=0.0, friction_slope=0.0, friction_offset=0.0))
    length, step = 0.975 * PAIR.resting_length, 2e-5
    start = compute_equilibrium_state(bare, length, 3.0 * BAR)
    forces = []
    for end in (length - step, length + step):
        state = advance_state(bare, start, end, 3.0 * BAR, 1e-6)  # the regulator has no time to compensate
        forces.append(mckibben.gas_force(PAIR, state.pressure, state.length))
    return (forces[1] - forces[0]) / (2.0 * step)


def test_device_has_the_sealed_stiffness_of_its_air() -> None:
    length, pressure = 0.975 * PAIR.resting_length, 3.0 * BAR
    slope = -mckibben.gas_force(PAIR, 1.0, length)
    curvature = -6.0 * PAIR.n_actuators * length / (4.0 * math.pi * PAIR.braid_turns**2)
    for dead_volume in (0.0, 20e-6):
        room = fill_with_water(PAIR, length) + dead_volume
        expected = 1.2 * (pressure + ATMOSPHERIC_PRESSURE) * slope * slope / room - pressure * curvature
        assert compute_sealed_stiffness(dead_volume) == pytest.approx(expected, rel=2e-3)


def test_dead_volume_holds_air_that_no_motion_moves() -> None:
    """The mass of the air differs by that of the dead volume at every pressure and length."""
    fitted = load_device("klute-3-4-pair").with_changes({"supply.dead_volume_cm3": 12.0})
    bare = fitted.with_changes({"supply.dead_volume_cm3": 0.0})
    for command, unit_length in ((0.0, 0.34), (2.0 * BAR, 0.345), (5.0 * BAR, 0.33)):
        masses = []
        for device in (fitted, bare):
            p = device.parameters
            state = compute_equilibrium_state(p, unit_length, command)
            masses.append(compute_outputs(p, state, unit_length, 0.0).air_mass)
        expected = 12e-6 * (state.pressure + ATMOSPHERIC_PRESSURE) / (287.05 * 293.15)
        assert masses[0] - masses[1] == pytest.approx(expected, rel=1e-9)


@given(st.sampled_from(PRESETS), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_gas_volume_is_positive_and_grows_as_the_muscle_shortens(preset: str, first: float, second: float) -> None:
    muscle = load_device(preset).parameters.muscle
    lock = mckibben.lock_length(muscle)
    shorter, longer = (
        lock + share * (muscle.resting_length - lock) for share in (min(first, second), max(first, second))
    )
    assert 0.0 < mckibben.gas_volume(muscle, longer) <= mckibben.gas_volume(muscle, shorter)
    assert mckibben.gas_volume(muscle, shorter) < mckibben.braid_volume(muscle, shorter)
