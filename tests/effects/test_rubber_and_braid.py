"""Effects of rubber, braid and oil against what they are derived from."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from klute_sim.device.device import load_device
from klute_sim.effects.families import damper, instrument
from klute_sim.effects.families.muscle import bladder_wall, braid_extensibility, braid_hysteresis
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import Muscle

MUSCLES = [load_device(name).parameters.muscle for name in ("klute-1-1-4", "klute-3-4", "klute-1-2")]
RATIOS = (0.75, 0.85, 0.93, 0.99)


def wall_energy(muscle: Muscle, length: float) -> float:
    """Of all bladders [J]: rubber that keeps its volume, its outside on the braid, layer by layer."""
    ratio, outer = length / muscle.resting_length, muscle.bladder_radius
    radius_now = math.sqrt(muscle.braid_length**2 - length**2) / (2.0 * math.pi * muscle.braid_turns)
    radius_at_rest = math.sqrt(muscle.braid_length**2 - muscle.resting_length**2) / (2.0 * math.pi * muscle.braid_turns)
    grip = muscle.resting_length / (2.0 * math.pi * muscle.braid_turns * outer)
    hoop_outer = math.sqrt(1.0 + grip**2 * (1.0 - ratio**2))  # (3.3)'s, which the braid's own nearly is
    assert hoop_outer == pytest.approx(radius_now / radius_at_rest, rel=0.05)

    def layer(radius: float) -> float:
        now = math.sqrt((outer * hoop_outer) ** 2 - (outer**2 - radius**2) / ratio)
        hoop = now / radius
        across = 1.0 / (ratio * hoop)
        i1 = ratio**2 + hoop**2 + across**2
        i2 = (ratio * hoop) ** 2 + (hoop * across) ** 2 + (across * ratio) ** 2
        return 2.0 * math.pi * radius * (muscle.c10 * (i1 - 3.0) + muscle.c01 * (i2 - 3.0))

    inner = outer - muscle.bladder_thickness
    return muscle.n_actuators * muscle.resting_length * quad(layer, inner, outer, epsabs=0.0, epsrel=1e-12)[0]


@pytest.mark.parametrize("muscle", MUSCLES)
@pytest.mark.parametrize("ratio", RATIOS)
def test_a_thick_wall_pulls_with_the_slope_of_its_energy(muscle: Muscle, ratio: float) -> None:
    length, step = ratio * muscle.resting_length, 1e-6
    slope = (wall_energy(muscle, length + step) - wall_energy(muscle, length - step)) / (2.0 * step)
    thin = mckibben.bladder_force(muscle, length)
    found = bladder_wall.thick_wall_correction((1.0,), (), thin, muscle, 3e5, length, 0.0)
    assert found == pytest.approx(slope, rel=2e-4)
    assert 1.1 < found / thin < 2.2  # the source's sizes: 16 to 73 % more over most of the contraction
    assert bladder_wall.thick_wall_correction((0.0,), (), thin, muscle, 3e5, length, 0.0) == thin


def test_a_thin_wall_is_the_source_s() -> None:
    muscle = MUSCLES[1]._replace(bladder_thickness=1e-6)
    for ratio in RATIOS:
        length = ratio * muscle.resting_length
        thin = mckibben.bladder_force(muscle, length)
        assert bladder_wall.thick_wall_correction((1.0,), (), thin, muscle, 0.0, length, 0.0) == pytest.approx(
            thin, rel=1e-3
        )


@pytest.mark.parametrize("strain_per_bar", [0.001, 0.01])
def test_threads_that_stretch_hold_the_least_energy(strain_per_bar: float) -> None:
    """Tension is the slope of the energy of gas and threads, the threads as long as makes it least."""
    muscle, pressure, strain = MUSCLES[1], 4e5, strain_per_bar / 1e5
    stiffness = muscle.resting_length / (2.0 * math.pi * muscle.braid_turns**2 * strain)  # of all threads [N/m]

    def energy(length: float) -> float:
        def at(braid: float) -> float:
            volume = length * (braid**2 - length**2) / (4.0 * math.pi * muscle.braid_turns**2)
            return 0.5 * stiffness * (braid - muscle.braid_length) ** 2 - pressure * volume

        near = muscle.braid_length
        return float(minimize_scalar(at, bracket=(near, 1.01 * near), tol=1e-14).fun)

    for ratio in RATIOS:
        length, step = ratio * muscle.resting_length, 1e-4
        slope = (energy(length + step) - energy(length - step)) / (2.0 * step)
        gas = mckibben.gas_force(muscle, pressure, length)
        found = braid_extensibility.stretch_braid((strain,), (), gas, muscle, pressure, length, 0.0)
        assert found == pytest.approx(slope, rel=1e-4)
        assert found < gas


def test_rubber_is_softer_where_it_has_been() -> None:
    muscle, own, memory = MUSCLES[1], (0.3, 1e4), (0.0,)
    rest = muscle.resting_length
    deeper, first, back = np.linspace(1.0, 0.8, 50), [], []
    for ratio in deeper:
        memory = bladder_wall.step_max_energy_density(own, memory, muscle, 0.0, ratio * rest, 0.0, 1e-3)
        first.append(bladder_wall.soften_bladder(own, memory, 0.0, muscle, 0.0, ratio * rest, 0.0))
    assert first == [0.0] * 50
    for ratio in deeper:
        memory = bladder_wall.step_max_energy_density(own, memory, muscle, 0.0, ratio * rest, 0.0, 1e-3)
        plain = mckibben.bladder_force(muscle, ratio * rest)
        back.append(bladder_wall.soften_bladder(own, memory, plain, muscle, 0.0, ratio * rest, 0.0) / (plain or 1.0))
    assert back[-1] == 1.0
    assert min(back[1:]) == pytest.approx(0.7, abs=0.03)
    assert all(0.7 <= share <= 1.0 for share in back[1:])


def test_bouc_and_wen_s_stretch_goes_to_its_limit() -> None:
    muscle, pressure, own = MUSCLES[1], 3e5, (8.0 / 1e5, 40e3)
    reach, memory, rest = own[0] * pressure / own[1], (0.0, 0.0), muscle.resting_length
    for k in range(1, 1001):
        memory = braid_hysteresis.step_bouc_wen(own, memory, muscle, pressure, rest + 1e-5 * k, 0.0, 1e-3)
    assert memory[0] == pytest.approx(reach)
    force = braid_hysteresis.bouc_wen_force(own, memory, 0.0, muscle, pressure, rest, 0.0)
    assert force == pytest.approx(muscle.n_actuators * 8.0 * 3.0)
    # As many or as few steps as one likes.
    once = braid_hysteresis.step_bouc_wen(own, memory, muscle, pressure, rest + 0.0095, 0.0, 1e-3)
    twice = braid_hysteresis.step_bouc_wen(own, memory, muscle, pressure, rest + 0.0098, 0.0, 1e-3)
    twice = braid_hysteresis.step_bouc_wen(own, twice, muscle, pressure, rest + 0.0095, 0.0, 1e-3)
    assert once[0] == pytest.approx(twice[0])
    assert braid_hysteresis.step_bouc_wen(own, memory, muscle, 0.0, rest, 0.0, 1e-3)[0] == 0.0


def test_a_seal_sticks_more_than_it_slides() -> None:
    muscle, own = MUSCLES[1], (15.0, 0.6, 0.015)
    forces = {}
    for speed in (0.003, 0.1):
        memory = (0.0, 0.0, 0.0)
        for k in range(1, 400):
            memory = damper.step_stribeck(own, memory, muscle, 0.0, muscle.resting_length + speed * 1e-3 * k, 0.0, 1e-3)
        forces[speed] = damper.stribeck_friction(own, memory, 0.0, speed)
        assert damper.stribeck_friction(own, memory, 0.0, -speed) == -forces[speed]
    assert forces[0.1] == pytest.approx(15.0, rel=1e-3)
    assert forces[0.003] == pytest.approx(15.0 * (1.0 + 0.6 * math.exp(-0.04)) * 3.0 / math.sqrt(10.0), rel=1e-3)


def test_trapped_air_gives_way_after_a_reversal() -> None:
    muscle, own, memory, rest = MUSCLES[1], (3e-3,), (0.0, 0.0), MUSCLES[1].resting_length
    shares = []
    path = [*np.linspace(0.0, 8e-3, 81), *np.linspace(8e-3, 2e-3, 61)]
    for before, x in pairwise(path):
        rate = 0.1 if x > before else -0.1
        memory = damper.step_dead_stroke(own, memory, muscle, 0.0, rest + x, 0.0, 1e-3)
        shares.append(damper.trapped_air_force(own, memory, 100.0, rate) / 100.0)
    assert shares[40] == pytest.approx(1.0)
    assert shares[80] < 0.05  # just turned round
    assert shares[80 + 31] == pytest.approx(1.0, abs=0.05)  # 3 mm later
    assert all(-1e-12 <= share <= 1.0 + 1e-12 for share in shares)


def test_whole_steps_only() -> None:
    value = np.random.default_rng(0).normal(size=500)
    shown = instrument.quantize((0.25,), value, value)
    assert np.abs(shown - value).max() <= 0.125
    assert np.array_equal(np.round(shown / 0.25) * 0.25, shown)
    assert instrument.quantize((0.0,), value, value) is value
