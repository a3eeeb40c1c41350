"""The equation of motion of a foot on a prescribed shank, compared with MuJoCo."""

import mujoco
import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.laws import foot as law
from klute_sim.laws.foot import Foot, FootInputs
from klute_sim.plant import models

FOOT = build_device_foot(load_device("klute-1-1-4-pair"))
NO_MOTION = FootInputs(0.0, 0.0, 0.0, 0.0, 0.0)


def make_model_on_moving_base() -> mujoco.MjModel:
    """Return ankle.xml with a pylon free in the plane, a rigid heel and no device force."""
    spec = models.load_spec("ankle")
    for name, kind, axis in (
        ("x", mujoco.mjtJoint.mjJNT_SLIDE, (1, 0, 0)),
        ("z", mujoco.mjtJoint.mjJNT_SLIDE, (0, 0, 1)),
        ("lean", mujoco.mjtJoint.mjJNT_HINGE, (0, 1, 0)),
    ):
        spec.body("pylon").add_joint(name=name, type=kind, axis=axis)
    spec.delete(spec.joint("heel"))
    spec.delete(spec.geom("floor"))
    return spec.compile()


def test_foot_parameters_match_the_model() -> None:
    """The gait rig's foot equals that of ankle.xml, except for the device's tendon origin."""
    model = make_model_on_moving_base()
    data = mujoco.MjData(model)
    for angle in np.linspace(-0.4, 0.4, 9):
        data.qpos[:] = 0.3, 0.2, 0.1, angle
        mujoco.mj_forward(model, data)
        foot = FOOT._replace(origin_z=float(model.site("achilles_origin").pos[2]))
        assert law.unit_length(foot, angle) == pytest.approx(data.ten_length[0], abs=1e-12)
        assert law.moment_arm(foot, angle) == pytest.approx(-data.ten_J.reshape(-1)[-1], abs=1e-12)


def test_moments_match_mujoco_inverse_dynamics() -> None:
    """The ankle moment of any motion of base and ankle, with weight and Coriolis terms."""
    model, random = make_model_on_moving_base(), np.random.default_rng(3)
    data, joint = mujoco.MjData(model), model.joint("ankle").dofadr[0]
    for _ in range(20):
        q, v, a = random.normal(0, 0.15, 4), random.normal(0, 2.0, 4), random.normal(0, 30.0, 4)
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        # A rotating base adds no Coriolis moment about the ankle, because the axis itself is prescribed.
        base = FootInputs(q[2], a[2], a[0], a[1], 0.0)
        spring = -FOOT.spring_stiffness * (q[3] - FOOT.spring_rest_angle) - FOOT.ankle_damping * v[3]
        needed = FOOT.inertia * (a[2] + a[3]) - law.gravity_and_inertia_moment(FOOT, q[3], base) - spring
        assert needed == pytest.approx(data.qfrc_inverse[joint], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("angle", "velocity"), [(-0.46, -1.0), (-0.4502, -0.5), (0.455, 2.0), (0.4507, -3.0), (-0.46, 40.0), (0.4499, 1.0)]
)
def test_end_stop_matches_mujoco(angle: float, velocity: float) -> None:
    """An applied moment overcomes the spring, which pushes away from both stops."""
    spec = models.load_spec("ankle")
    spec.delete(spec.joint("heel"))
    spec.delete(spec.geom("floor"))
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0], data.qfrc_applied[0] = angle, velocity, 100.0 * np.sign(angle)
    mujoco.mj_forward(model, data)
    free_acceleration = float(data.qacc_smooth[0])
    moment = law.end_stop_moment(FOOT, angle, velocity, free_acceleration)
    assert (moment == 0.0) == (
        (angle, velocity) in ((-0.46, 40.0), (0.4499, 1.0))
    )  # outside the stop, or moving out of it
    assert free_acceleration + moment / FOOT.inertia == pytest.approx(float(data.qacc[0]), rel=1e-6)


def test_friction_holds_up_to_its_moment_and_never_drives_the_foot() -> None:
    """A hanging foot without spring stays where friction exceeds its weight and swings down elsewhere."""
    hanging = FOOT._replace(spring_stiffness=0.0, ankle_damping=0.0, ankle_friction=0.05, min_angle=-2.0, max_angle=2.0)
    angles, velocities, dt = [0.9], [0.0], 1e-4
    for _ in range(40000):
        ankle = law.step_ankle(hanging, angles[-1], velocities[-1], 0.0, NO_MOTION, dt)
        if ankle.velocity != 0.0:
            assert (ankle.moment * ankle.velocity) < 0.0
        assert abs(ankle.moment) <= hanging.ankle_friction * (1 + 1e-9)
        angles.append(ankle.angle)
        velocities.append(ankle.velocity)
    assert velocities[-1] == 0.0
    assert max(np.abs(velocities)) > 0.3
    assert abs(law.gravity_and_inertia_moment(hanging, angles[-1], NO_MOTION)) <= 0.05
    ankle_at_rest = law.step_ankle(hanging, angles[-1], 0.0, 0.0, NO_MOTION, dt)
    assert ankle_at_rest.moment == pytest.approx(
        -law.gravity_and_inertia_moment(hanging, angles[-1], NO_MOTION), rel=1e-9
    )


def test_foot_oscillates_at_its_natural_frequency() -> None:
    spring = FOOT._replace(ankle_damping=0.0, spring_rest_angle=0.0, mass=0.0)
    angle, velocity, dt, crossings = 0.1, 0.0, 1e-5, []
    for k in range(20000):
        after = law.step_ankle(spring, angle, velocity, 0.0, NO_MOTION, dt)
        if after.angle * angle < 0.0:
            crossings.append(k * dt)
        angle, velocity = after.angle, after.velocity
    period = 2.0 * np.mean(np.diff(crossings))
    assert period == pytest.approx(2.0 * np.pi * np.sqrt(FOOT.inertia / FOOT.spring_stiffness), rel=1e-4)
    assert isinstance(spring, Foot)
