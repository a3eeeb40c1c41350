"""Effects of rubber, braid and oil against the energies and equations of their derivation."""

import math
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from klute_sim.device.device import load_device, parse_device
from klute_sim.effects import catalogue
from klute_sim.effects.effect import EffectForm
from klute_sim.effects.families import instrument, seal
from klute_sim.effects.families.muscle import bladder_wall, braid_extensibility, braid_hysteresis
from klute_sim.effects.smoothing import step_bouc_wen
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import MuscleParameters

MUSCLES = [load_device(name).parameters.muscle for name in ("klute-1-1-4", "klute-3-4", "klute-1-2")]
RUBBER_EFFECTS = [
    ("thick_wall_bladder", "[effects.thick_wall_bladder]\nshare = 1.0\n"),
    ("bladder_softening", "[effects.bladder_softening]\nshare = 0.3\nenergy_density_kpa = 10.0\n"),
]
RATIOS = (0.75, 0.85, 0.93, 0.99)


def wall_energy(muscle: MuscleParameters, length: float) -> float:
    """Return the energy of all bladders [J]: incompressible layers, the outer one on the braid."""
    ratio, outer = length / muscle.resting_length, muscle.bladder_radius
    radius_now = math.sqrt(muscle.braid_length**2 - length**2) / (2.0 * math.pi * muscle.braid_turns)
    radius_at_rest = math.sqrt(muscle.braid_length**2 - muscle.resting_length**2) / (2.0 * math.pi * muscle.braid_turns)
    grip = muscle.resting_length / (2.0 * math.pi * muscle.braid_turns * outer)
    hoop_outer = math.sqrt(1.0 + grip**2 * (1.0 - ratio**2))  # that of (3.3), close to that of the braid
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


def find_form(effect: str, form: str | None = None) -> EffectForm:
    return catalogue.find_form(effect, form)[1]


@pytest.mark.parametrize("muscle", MUSCLES)
@pytest.mark.parametrize("ratio", RATIOS)
def test_thick_wall_tension_is_the_slope_of_its_energy(muscle: MuscleParameters, ratio: float) -> None:
    length, step = ratio * muscle.resting_length, 1e-6
    slope = (wall_energy(muscle, length + step) - wall_energy(muscle, length - step)) / (2.0 * step)
    thin = mckibben.bladder_force(muscle, length)
    p = find_form("thick_wall_bladder").parameter_type
    tension = bladder_wall.thick_wall_correction(p(1.0), (), thin, muscle, 3e5, length, 0.0)
    assert tension == pytest.approx(slope, rel=2e-4)
    assert 1.1 < tension / thin < 2.2  # 16 to 73 % more over most of the contraction
    assert bladder_wall.thick_wall_correction(p(0.0), (), thin, muscle, 3e5, length, 0.0) == thin


def test_thick_wall_formula_converges_to_thin_wall() -> None:
    muscle = MUSCLES[1]._replace(bladder_thickness=1e-6)
    p = find_form("thick_wall_bladder").parameter_type(1.0)
    for ratio in RATIOS:
        length = ratio * muscle.resting_length
        thin = mckibben.bladder_force(muscle, length)
        assert bladder_wall.thick_wall_correction(p, (), thin, muscle, 0.0, length, 0.0) == pytest.approx(
            thin, rel=1e-3
        )


@pytest.mark.parametrize("strain_per_bar", [0.001, 0.01])
def test_extensible_braid_tension_is_the_slope_of_the_minimum_energy(strain_per_bar: float) -> None:
    """Tension is the slope of the energy of gas and threads at the thread length of minimum energy."""
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
        p = find_form("braid_extensibility").parameter_type(strain)
        tension = braid_extensibility.stretch_braid(p, (), gas, muscle, pressure, length, 0.0)
        assert tension == pytest.approx(slope, rel=1e-4)
        assert tension < gas


def test_rubber_is_softer_after_a_larger_stretch() -> None:
    muscle, form = MUSCLES[1], find_form("bladder_softening")
    p, state = form.parameter_type(0.3, 1e4), form.make_zero_state()
    rest = muscle.resting_length
    ratios, loading, reloading = np.linspace(1.0, 0.8, 50), [], []
    for ratio in ratios:
        state = form.state_type(
            *bladder_wall.step_max_energy_density(p, state, muscle, 0.0, 0.0, ratio * rest, 0.0, 1e-3)
        )
        loading.append(bladder_wall.soften_bladder(p, state, 0.0, muscle, 0.0, ratio * rest, 0.0))
    assert loading == [0.0] * 50
    for ratio in ratios:
        state = form.state_type(
            *bladder_wall.step_max_energy_density(p, state, muscle, 0.0, 0.0, ratio * rest, 0.0, 1e-3)
        )
        plain = mckibben.bladder_force(muscle, ratio * rest)
        reloading.append(bladder_wall.soften_bladder(p, state, plain, muscle, 0.0, ratio * rest, 0.0) / (plain or 1.0))
    assert reloading[-1] == 1.0
    assert min(reloading[1:]) == pytest.approx(0.7, abs=0.03)
    assert all(0.7 <= fraction <= 1.0 for fraction in reloading[1:])


@pytest.mark.parametrize(("name", "ratio"), [("dahl", 0.0), ("bouc_wen", 0.4), ("bouc_wen", 1.0)])
def test_hysteretic_stretch_approaches_its_limit_for_any_step(name: str, ratio: float) -> None:
    muscle, pressure, form = MUSCLES[1], 3e5, find_form("braid_hysteresis", name)
    p = form.parameter_type(*(8.0 / 1e5, 40e3, ratio)[: len(form.parameters)])
    state, rest = form.make_zero_state(), muscle.resting_length

    def step(state: Any, pressure: float, length: float) -> Any:
        return form.state_type(*form.laws["next_state"](p, state, muscle, pressure, 0.0, length, 0.0, 1e-3))

    for k in range(1, 1001):
        state = step(state, pressure, rest + 1e-5 * k)
    assert state.hysteretic_stretch == pytest.approx(p.slope * pressure / p.stiffness)
    force = braid_hysteresis.hysteretic_force(p, state, 0.0, muscle, pressure, rest, 0.0)
    assert force == pytest.approx(muscle.n_actuators * 8.0 * 3.0)
    one_step = step(state, pressure, rest + 0.0095)
    two_steps = step(step(state, pressure, rest + 0.0098), pressure, rest + 0.0095)
    assert one_step.hysteretic_stretch == pytest.approx(two_steps.hysteretic_stretch)
    assert step(state, 0.0, rest).hysteretic_stretch == 0.0


@settings(deadline=None)
@given(
    ratio=st.sampled_from([0.0, 0.3, 0.9, 1.0]),
    start=st.floats(-2e-3, 2e-3),
    displacement=st.floats(-5e-3, 5e-3),
    max_stretch=st.floats(1e-4, 1e-3),
)
def test_bouc_wen_step_integrates_its_equation(
    ratio: float, start: float, displacement: float, max_stretch: float
) -> None:
    """Against many explicit midpoint steps of ``du/dx = 1 - |u| (beta sign(u dx) + gamma)``."""
    beta, n = 1.0 / (max_stretch * (1.0 + ratio)), 4000
    start = min(max(start, -max_stretch), max_stretch)
    u, dx = start, displacement / n

    def slope(u: float) -> float:
        return 1.0 - abs(u) * beta * (math.copysign(1.0, u * dx) + ratio)

    for _ in range(n):
        u += dx * slope(u + 0.5 * dx * slope(u))
    assert step_bouc_wen(start, displacement, max_stretch, ratio, 1e-3) == pytest.approx(u, abs=2e-7)


@settings(deadline=None)
@given(
    ratio=st.sampled_from([0.0, 0.8, 1.0]),
    start=st.floats(-1e-3, 1e-3),
    displacement=st.floats(-1e-2, 1e-2),
    exponent=st.floats(-323.0, -3.0),
)
def test_vanishing_friction_leaves_a_finite_stretch(
    ratio: float, start: float, displacement: float, exponent: float
) -> None:
    """The pressure of a vented muscle decays to the smallest number that a computer represents."""
    stretch = step_bouc_wen(start, displacement, 10.0**exponent, ratio, 1e-3)
    assert abs(stretch) <= max(abs(start), 10.0**exponent)


@settings(deadline=None)
@given(
    ratio=st.sampled_from([0.0, 0.8, 1.0]),
    start=st.floats(-2e-3, 2e-3),
    displacement=st.floats(-5e-3, 5e-3) | st.just(0.0),
    max_stretch=st.floats(1e-5, 1e-3),
)
def test_friction_slips_where_less_pressure_holds_it(
    ratio: float, start: float, displacement: float, max_stretch: float
) -> None:
    stretch = step_bouc_wen(start, displacement, max_stretch, ratio, 1e-3)
    assert abs(stretch) <= max_stretch * (1.0 + 1e-12)
    if displacement == 0.0 and abs(start) <= max_stretch:
        assert stretch == start


def test_dahl_unloads_on_a_curve_and_equal_constants_on_a_line() -> None:
    start, max_stretch, path = 0.5e-3, 0.6e-3, 0.2e-3
    unloaded = {ratio: step_bouc_wen(start, -path, max_stretch, ratio, 1e-3) for ratio in (0.0, 1.0)}
    assert unloaded[1.0] == pytest.approx(start - path, abs=1e-15)
    assert unloaded[0.0] == pytest.approx((start + max_stretch) * math.exp(-path / max_stretch) - max_stretch)


def step_states(form: Any, p: Any, muscle: Any, displacements: Any, dt: float = 1e-3) -> list[Any]:
    """Return the internal states of ``form`` after each of ``displacements`` beyond the resting length [m]."""
    states = [form.make_zero_state()]
    for x in displacements:
        length = muscle.resting_length + x
        states.append(form.state_type(*form.laws["next_state"](p, states[-1], muscle, 0.0, 0.0, length, 0.0, dt)))
    return states[1:]


def test_stribeck_friction_falls_with_speed() -> None:
    muscle, form = MUSCLES[1], find_form("seal_friction", "stribeck")
    p = form.parameter_type(15.0, 0.6, 0.015)
    forces = {}
    for speed in (0.003, 0.1):
        state = step_states(form, p, muscle, speed * 1e-3 * np.arange(1, 400))[-1]
        forces[speed] = seal.stribeck_friction(p, state, 0.0, speed)
        assert seal.stribeck_friction(p, state, 0.0, -speed) == -forces[speed]
    assert forces[0.1] == pytest.approx(15.0, rel=1e-3)
    assert forces[0.003] == pytest.approx(15.0 * (1.0 + 0.6 * math.exp(-0.04)), rel=1e-3)


def test_stribeck_friction_follows_the_speed_with_the_time_constant_of_the_film() -> None:
    muscle, form = MUSCLES[1], find_form("seal_friction", "stribeck")
    p, dt = form.parameter_type(15.0, 0.6, 0.015), 1e-5
    n = round(seal.FILM_TIME_CONSTANT / dt)
    states = step_states(form, p, muscle, 0.1 * dt * np.arange(1, n + 1), dt)  # at once at 0.1 m/s
    assert states[-1].film == pytest.approx(1.0 - math.exp(-1.0), rel=2e-3)


def test_seal_deforms_before_it_slides() -> None:
    muscle, form = MUSCLES[1], find_form("seal_friction", "presliding")
    p = form.parameter_type(15.0, 3e-4)
    path = np.concatenate((np.linspace(0.0, 3e-3, 301)[1:], np.linspace(3e-3, 0.0, 301)[1:]))
    states = step_states(form, p, muscle, path)
    forces = np.array([seal.presliding_friction(p, state, 0.0, 0.0) for state in states])
    assert forces[0] == pytest.approx(15.0 * 1e-5 / 3e-4, rel=0.02)
    assert forces[299] == pytest.approx(15.0, rel=1e-3)
    assert forces[-1] == pytest.approx(-15.0, rel=1e-3)
    assert np.trapezoid(np.append(0.0, forces), np.append(0.0, path)) > 0.0  # it dissipates


def test_quantized_reading_is_a_multiple_of_the_step() -> None:
    value = np.random.default_rng(0).normal(size=500)
    p = find_form("quantisation").parameter_type
    reading = instrument.quantize(p(0.25), value, value)
    assert np.abs(reading - value).max() <= 0.125
    assert np.array_equal(np.round(reading / 0.25) * 0.25, reading)
    assert instrument.quantize(p(0.0), value, value) is value


@pytest.mark.parametrize("change", [("bladder_radius_mm", "bladder = false\nbladder_radius_mm"), None])
@pytest.mark.parametrize(("name", "content"), RUBBER_EFFECTS)
def test_effect_on_rubber_that_is_absent_is_refused(name: str, content: str, change: tuple[str, str] | None) -> None:
    """It would do nothing, also beside the effect ``bladder``, whose rubber it does not know."""
    text = load_device("klute-1-1-4").content.decode()
    parse_device(f"{text}\n{content}".encode(), "x")
    text = text.replace(*change, 1) if change else re.sub(r"(c10_kpa|c01_kpa) = .*", r"\1 = 0.0", text)
    with pytest.raises(InputError, match=rf"\[effects.{name}\] changes the rubber of \[muscle\], which has none"):
        parse_device(f"{text}\n{content}".encode(), "x")
    assert not parse_device(text.encode(), "x").spec.can_add_effect(catalogue.get_effects()[name])
