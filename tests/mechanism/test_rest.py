"""Where a mechanism begins: a joint with dry friction rests where it was, as far as its friction can hold it."""

from collections.abc import Mapping

import numpy as np
import pytest

from klute_sim.datasets.mechanism_channels import parse_channel
from klute_sim.device.device import load_device
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.mechanism.simulate import simulate_mechanism
from klute_sim.plant.mjcf.model_effects import ModelEffect
from klute_sim.plant.mjcf.model_file import load_model_file
from klute_sim.types import Array

PAIR = load_device("klute-3-4-pair")
DT = 5e-4
NUMBERS = {"model.site.flexor_origin.pos_z": 0.29, "model.site.extensor_origin.pos_z": 0.29}
COMMANDS = {"pressure_command_flexor": np.full(600, 2.5e5), "pressure_command_extensor": np.full(600, 2e5)}
FORMS: Mapping[str, Mapping[str, float]] = {
    "coulomb": {},
    "presliding": {"presliding_deg": 0.05},
    "stribeck": {"static_excess": 0.0001, "stribeck_velocity_deg_per_s": 10.0},
}


def simulate(initial_angle: float | None, friction: float = 0.0, form: str = "coulomb") -> Array:
    """Return the angle of a joint [rad] with this ``friction`` [N m] under constant commands."""
    mechanism = Mechanism(load_model_file("antagonist_joint"), ("flexor", "extensor"), tuple(COMMANDS))
    effect = ModelEffect("joint_friction", form, tuple({"moment_n_m": friction, **FORMS[form]}.items()), "joint")
    rollout = simulate_mechanism(
        mechanism,
        dict.fromkeys(("flexor", "extensor"), PAIR.parameters),
        COMMANDS,
        DT,
        numbers=NUMBERS,
        effects=[effect] if friction else [],
        initial_positions={} if initial_angle is None else {"joint": initial_angle},
    )
    return rollout.read_channel(mechanism.bind(parse_channel("angle_joint")))


OFFSET = np.radians(2.0)


@pytest.fixture(scope="module")
def equilibrium() -> float:
    return float(simulate(None)[0])


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("offset", [OFFSET, -OFFSET])
def test_friction_holds_the_joint_where_it_was(form: str, offset: float, equilibrium: float) -> None:
    angle = simulate(equilibrium + offset, 5.0, form)
    assert angle[0] == pytest.approx(equilibrium + offset, abs=1e-9)
    assert np.ptp(angle) < 0.02 * OFFSET


def test_weak_friction_lets_it_slide_to_where_it_holds(equilibrium: float) -> None:
    """The distance from the equilibrium that a friction holds is in proportion to it, in both directions."""
    strong, weak = (float(simulate(equilibrium + 10 * OFFSET, friction)[0]) - equilibrium for friction in (0.2, 0.1))
    assert 0.0 < weak < strong < 10 * OFFSET
    assert strong / weak == pytest.approx(2.0, rel=0.02)
    other = float(simulate(equilibrium - 10 * OFFSET, 0.1)[0]) - equilibrium
    assert other == pytest.approx(-weak, rel=0.02)
    assert simulate(equilibrium + weak, 0.1)[0] == pytest.approx(equilibrium + weak, abs=1e-9)


@pytest.mark.parametrize("form", FORMS)
def test_held_joint_rests_at_the_edge(form: str, equilibrium: float) -> None:
    angle = simulate(equilibrium + 10 * OFFSET, 0.2, form)
    assert np.ptp(angle) < 0.2 * (angle[0] - equilibrium)


def test_vanishing_friction_begins_in_the_equilibrium(equilibrium: float) -> None:
    assert simulate(equilibrium + OFFSET, 1e-9)[0] == pytest.approx(equilibrium, abs=1e-8)
    assert simulate(equilibrium + OFFSET)[0] == pytest.approx(equilibrium, abs=1e-8)
    assert simulate(None, 5.0)[0] == pytest.approx(equilibrium, abs=1e-8)  # where it was is unknown
