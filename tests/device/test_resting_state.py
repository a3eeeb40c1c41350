"""States at rest with the dry friction that an earlier motion left."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.device import dynamics
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters, DeviceState
from klute_sim.device.equilibrium import compute_equilibrium_state, compute_resting_state, holds_friction
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.effects import catalogue

ANKLE = load_device("klute-1-1-4-pair").parameters
SLOPE = 10.0
FORMS = {
    "maxwell_slip": {"slope_n_per_bar": SLOPE, "stiffness_n_per_mm": 60.0},
    "dahl": {"slope_n_per_bar": SLOPE, "stiffness_n_per_mm": 60.0},
    "bouc_wen": {"slope_n_per_bar": SLOPE, "stiffness_n_per_mm": 60.0, "gamma_over_beta": 0.5},
}
UNIT_LENGTH = ANKLE.muscle.resting_length + ANKLE.tendon.slack_length
PRESSURE = 2e5


def add_friction(form: str, *, rigid: bool) -> DeviceParameters:
    muscle = ANKLE.muscle._replace(friction_slope=0.0, friction_offset=0.0)
    tendon = ANKLE.tendon._replace(is_rigid=rigid)
    effects = catalogue.pack_effects({("braid_hysteresis", form): FORMS[form]})
    return ANKLE._replace(muscle=muscle, tendon=tendon, effects=effects)


def compute_pull(parameters: DeviceParameters, state: DeviceState) -> float:
    """Return the force [N] of the muscle at rest."""
    return dynamics.compute_muscle_force(parameters, state.internal_state, state.pressure, state.length, 0.0)


@pytest.mark.parametrize("form", FORMS)
def test_clamped_muscle_holds_all_its_friction(form: str) -> None:
    """After a lengthening the muscle pulls n slope P more than a relaxed one, after a shortening as much less."""
    device = add_friction(form, rigid=True)
    unit_length = UNIT_LENGTH - 0.1 * ANKLE.muscle.resting_length
    relaxed, lengthened, shortened = (
        compute_pull(device, compute_resting_state(device, unit_length, PRESSURE, f)) for f in (0.0, 1.0, -1.0)
    )
    friction = ANKLE.muscle.n_actuators * SLOPE * 1e-5 * PRESSURE
    assert lengthened - relaxed == pytest.approx(friction, rel=1e-6)
    assert shortened - relaxed == pytest.approx(-friction, rel=1e-6)


@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=25, deadline=None)
@given(
    fraction=st.floats(-1.0, 1.0) | st.sampled_from([-1.0, 0.0, 1.0]),
    contraction=st.floats(0.02, 0.15),
    pressure=st.floats(0.5e5, 4e5),
)
def test_elastic_tendon_balances_the_muscle(form: str, fraction: float, contraction: float, pressure: float) -> None:
    device = add_friction(form, rigid=False)
    unit_length = UNIT_LENGTH + 0.01 - contraction * ANKLE.muscle.resting_length
    state = compute_resting_state(device, unit_length, pressure, fraction)
    tension = dynamics.compute_tendon_force(device, state.internal_state, state.length, unit_length)
    if state.length < ANKLE.muscle.resting_length - 1e-9 and tension > 0.0:
        assert abs(compute_pull(device, state) - tension) < 1e-6


@pytest.mark.parametrize("form", FORMS)
def test_pull_at_rest_grows_with_the_fraction(form: str) -> None:
    device = add_friction(form, rigid=False)
    states = [compute_resting_state(device, UNIT_LENGTH - 5e-3, PRESSURE, 0.25 * k) for k in range(-4, 5)]
    tensions = [dynamics.compute_tendon_force(device, s.internal_state, s.length, UNIT_LENGTH - 5e-3) for s in states]
    assert all(after > before for before, after in itertools.pairwise(tensions))


def test_fraction_changes_nothing_without_friction_that_is_held() -> None:
    coulomb = {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": SLOPE}}
    for device in (ANKLE, ANKLE._replace(effects=catalogue.pack_effects(coulomb))):
        assert not holds_friction(device)
        assert compute_resting_state(device, UNIT_LENGTH, PRESSURE, 0.7) == compute_equilibrium_state(
            device, UNIT_LENGTH, PRESSURE
        )
    device = add_friction("dahl", rigid=False)
    assert holds_friction(device)
    assert compute_resting_state(device, UNIT_LENGTH, PRESSURE, 0.0) == compute_equilibrium_state(
        device, UNIT_LENGTH, PRESSURE
    )


@pytest.mark.parametrize("form", FORMS)
def test_device_at_rest_stays_there(form: str) -> None:
    """A simulation from the state keeps its tension until the inputs change."""
    device = add_friction(form, rigid=False)
    for fraction in (-1.0, -0.4, 0.5, 1.0):
        state = compute_resting_state(device, UNIT_LENGTH - 5e-3, PRESSURE, fraction)
        tension = dynamics.compute_tendon_force(device, state.internal_state, state.length, UNIT_LENGTH - 5e-3)
        trace = simulate_rollouts(
            device, [UNIT_LENGTH - 5e-3] * 200, [PRESSURE] * 200, 1e-3, initial_state=state, n_jobs=1
        )
        assert trace.tension[-1] == pytest.approx(tension, abs=1e-6)
