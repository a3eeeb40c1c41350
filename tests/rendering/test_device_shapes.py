"""Shapes of devices: where muscle and tendon are, how wide, and in which colour."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.bench.build import build_tester
from klute_sim.device.device import load_device
from klute_sim.laws import mckibben
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.rendering import device_shapes
from klute_sim.units import BAR

DEVICE = load_device("klute-1-1-4-pair")
MUSCLE = DEVICE.parameters.muscle


def draw(pressure: float, muscle_length: float, unit_length: float) -> list[mujoco.MjvGeom]:
    """Return the shapes of a device on the tester at ``pressure`` [Pa] and lengths [m]: tendon, then muscles."""
    model = build_tester(DEVICE, 1e-3)
    data = mujoco.MjData(model)
    data.joint("crosshead").qpos[0] = unit_length
    mujoco.mj_forward(model, data)
    address = DeviceActuator(model, "muscle_tendon").act_address
    data.act[address : address + 2] = pressure / BAR, muscle_length - MUSCLE.resting_length
    scene = mujoco.MjvScene(model, 50)
    scene.ngeom = 0
    device_shapes.add_devices(scene, model, data)
    return [scene.geoms[index] for index in range(scene.ngeom)]


def get_capsules(shapes: list[mujoco.MjvGeom]) -> list[mujoco.MjvGeom]:
    return [shape for shape in shapes if shape.type == mujoco.mjtGeom.mjGEOM_CAPSULE]


def test_both_muscles_and_the_tendon_fill_the_unit() -> None:
    tendon, *muscles = get_capsules(draw(3e5, 0.25, 0.36))
    assert len(muscles) == round(MUSCLE.n_actuators) == 2
    assert tendon.pos == pytest.approx([0.5 * (0.25 + 0.36), 0.0, 0.0], abs=1e-6)
    assert 2.0 * tendon.size[2] == pytest.approx(0.11, abs=1e-6)
    sides = sorted(muscle.pos[1] for muscle in muscles)
    assert sides[0] == pytest.approx(-sides[1])
    assert sides[1] - sides[0] >= 2.0 * muscles[0].size[0]  # side by side, not in each other
    assert all(muscle.pos[0] == pytest.approx(0.125) for muscle in muscles)


@given(st.floats(0.18, 0.26), st.floats(0.001, 0.02))
def test_a_shorter_muscle_is_wider(length: float, contraction: float) -> None:
    parameters = DEVICE.parameters
    longer = device_shapes.compute_muscle_radius(parameters, length)
    shorter = device_shapes.compute_muscle_radius(parameters, length - contraction)
    assert shorter >= longer >= MUSCLE.bladder_radius
    braid = mckibben.compute_braid_radius(MUSCLE.braid_length, length, MUSCLE.braid_turns)
    assert longer == max(braid, MUSCLE.bladder_radius)


def test_drawn_muscle_has_the_radius_of_its_braid() -> None:
    empty, full = get_capsules(draw(0.0, 0.26, 0.36))[1], get_capsules(draw(5e5, 0.2, 0.36))[1]
    expected = math.sqrt(MUSCLE.braid_length**2 - 0.2**2) / (2.0 * math.pi * MUSCLE.braid_turns)
    assert full.size[0] == pytest.approx(expected, rel=1e-6)
    assert full.size[0] > 1.5 * empty.size[0]


def test_colours_follow_pressure_and_tension() -> None:
    greens = [get_capsules(draw(pressure, 0.25, 0.36))[1].rgba[1] for pressure in (0.0, 1e5, 3e5, 5e5, 9e5)]
    assert greens[:4] == sorted(greens[:4])
    assert greens[0] == pytest.approx(device_shapes.EMPTY_COLOUR[1])
    assert greens[3] == greens[4] == pytest.approx(device_shapes.FULL_COLOUR[1])
    slack, taut = (get_capsules(draw(0.0, 0.25, length))[0].rgba for length in (0.34, 0.358))
    assert slack[:3] == pytest.approx(device_shapes.SLACK_COLOUR, abs=1e-6)
    assert taut[0] > slack[0]
    assert taut[1] < slack[1]


def test_a_device_without_a_finite_state_is_left_out() -> None:
    assert draw(math.nan, 0.25, 0.36) == []


def test_a_full_scene_takes_no_more_shapes() -> None:
    model = build_tester(DEVICE, 1e-3)
    data = mujoco.MjData(model)
    data.joint("crosshead").qpos[0] = 0.36
    mujoco.mj_forward(model, data)
    scene = mujoco.MjvScene(model, 3)
    scene.ngeom = 0
    device_shapes.add_devices(scene, model, data)
    assert scene.ngeom == 3


@given(st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=2, max_size=5), st.floats(0.0, 1.0))
def test_a_path_is_split_at_a_length(points: list[tuple[float, float, float]], fraction: float) -> None:
    path = np.array(points)
    total = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    first, rest = device_shapes.split_path(path, fraction * total)
    lengths = [float(np.linalg.norm(np.diff(part, axis=0), axis=1).sum()) for part in (first, rest)]
    assert sum(lengths) == pytest.approx(total, abs=1e-9)
    assert lengths[0] == pytest.approx(fraction * total, abs=1e-9)
    assert first[0] == pytest.approx(path[0])
    assert rest[-1] == pytest.approx(path[-1])
