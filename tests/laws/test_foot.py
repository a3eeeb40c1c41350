"""The one equation of a foot on a prescribed shank, held against MuJoCo."""

import mujoco
import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.laws import foot as law
from klute_sim.laws.foot import Foot, FootInputs
from klute_sim.plant import models

FOOT = build_device_foot(load_device("klute-1-1-4-pair"))
STILL = FootInputs(0.0, 0.0, 0.0, 0.0, 0.0)


def on_a_moving_base() -> mujoco.MjModel:
    """ankle.xml, its pylon free in the plane, its heel rigid; the actuator gives no force without a device."""
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


def test_the_foot_is_the_models() -> None:
    """Also that the walking rig's foot is that of ankle.xml, but for where the device needs its tendon."""
    model = on_a_moving_base()
    data = mujoco.MjData(model)
    for angle in np.linspace(-0.4, 0.4, 9):
        data.qpos[:] = 0.3, 0.2, 0.1, angle
        mujoco.mj_forward(model, data)
        there = FOOT._replace(origin_z=float(model.site("achilles_origin").pos[2]))
        assert law.unit_length(there, angle) == pytest.approx(data.ten_length[0], abs=1e-12)
        assert law.moment_arm(there, angle) == pytest.approx(-data.ten_J.reshape(-1)[-1], abs=1e-12)


def test_moments_are_those_of_mujocos_inverse_dynamics() -> None:
    """Any motion of base and ankle: what it takes at the ankle, weight, Coriolis and all."""
    model, random = on_a_moving_base(), np.random.default_rng(3)
    data, joint = mujoco.MjData(model), model.joint("ankle").dofadr[0]
    for _ in range(20):
        q, v, a = random.normal(0, 0.15, 4), random.normal(0, 2.0, 4), random.normal(0, 30.0, 4)
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        # About the ankle a turning base adds no Coriolis moment: the axis itself is what is prescribed.
        base = FootInputs(q[2], a[2], a[0], a[1], 0.0)
        spring = -FOOT.spring_stiffness * (q[3] - FOOT.spring_rest_angle) - FOOT.ankle_damping * v[3]
        needed = FOOT.inertia * (a[2] + a[3]) - law.gravity_and_inertia_moment(FOOT, q[3], base) - spring
        assert needed == pytest.approx(data.qfrc_inverse[joint], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("angle", "rate"), [(-0.46, -1.0), (-0.4502, -0.5), (0.455, 2.0), (0.4507, -3.0), (-0.46, 40.0), (0.4499, 1.0)]
)
def test_the_end_stop_is_mujocos(angle: float, rate: float) -> None:
    """The spring, which pushes away from both stops, is overcome."""
    spec = models.load_spec("ankle")
    spec.delete(spec.joint("heel"))
    spec.delete(spec.geom("floor"))
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0], data.qfrc_applied[0] = angle, rate, 100.0 * np.sign(angle)
    mujoco.mj_forward(model, data)
    free = float(data.qacc_smooth[0])
    pushed = law.end_stop_moment(FOOT, angle, rate, free)
    assert (pushed == 0.0) == ((angle, rate) in ((-0.46, 40.0), (0.4499, 1.0)))  # off it, or off and away
    assert free + pushed / FOOT.inertia == pytest.approx(float(data.qacc[0]), rel=1e-6)


def test_friction_holds_up_to_its_moment_and_never_drives() -> None:
    """A foot that hangs, its spring off: it stays where its weight is less than friction, and swings down elsewhere."""
    loose = FOOT._replace(spring_stiffness=0.0, ankle_damping=0.0, ankle_friction=0.05, min_angle=-2.0, max_angle=2.0)
    angles, rates, step = [0.9], [0.0], 1e-4
    for _ in range(40000):
        turned = law.step_ankle(loose, angles[-1], rates[-1], 0.0, STILL, step)
        if turned.rate != 0.0:
            assert (turned.moment * turned.rate) < 0.0
        assert abs(turned.moment) <= loose.ankle_friction * (1 + 1e-9)
        angles.append(turned.angle)
        rates.append(turned.rate)
    assert rates[-1] == 0.0
    assert max(np.abs(rates)) > 0.3
    assert abs(law.gravity_and_inertia_moment(loose, angles[-1], STILL)) <= 0.05
    still = law.step_ankle(loose, angles[-1], 0.0, 0.0, STILL, step)
    assert still.moment == pytest.approx(-law.gravity_and_inertia_moment(loose, angles[-1], STILL), rel=1e-9)


def test_a_foot_swings_with_its_own_frequency() -> None:
    spring = FOOT._replace(ankle_damping=0.0, spring_rest_angle=0.0, mass=0.0)
    angle, rate, step, crossings = 0.1, 0.0, 1e-5, []
    for k in range(20000):
        after = law.step_ankle(spring, angle, rate, 0.0, STILL, step)
        if after.angle * angle < 0.0:
            crossings.append(k * step)
        angle, rate = after.angle, after.rate
    period = 2.0 * np.mean(np.diff(crossings))
    assert period == pytest.approx(2.0 * np.pi * np.sqrt(FOOT.inertia / FOOT.spring_stiffness), rel=1e-4)
    assert isinstance(spring, Foot)
