"""Measurements of the gait rig against the sums of MuJoCo."""

import mujoco
import numpy as np
import pytest

from klute_sim.controllers import pressure
from klute_sim.device.device import load_device
from klute_sim.gait import reference
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.rig.build import build_gait_model
from klute_sim.gait.rig.measurements import MEASURED_COLUMNS, GaitMeasurements
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.plant import callbacks
from klute_sim.plant.actuator import DeviceActuator

DEVICE = load_device("klute-1-1-4-pair")


def read(height: float, ankle: float, rate: float) -> tuple[mujoco.MjModel, mujoco.MjData, dict[str, float]]:
    """Return model, data and sample of one step with a straight leg.

    The hip is at ``height`` [m], the ankle hinge at ``ankle`` [rad] with the angular velocity ``rate`` [rad/s].
    """
    model = build_gait_model(DEVICE, mass=75, stature=1.75, dt=5e-4)
    data = mujoco.MjData(model)
    actuator = DeviceActuator(model, PROSTHESIS_PREFIX + "muscle_tendon")
    gauges = GaitMeasurements(model, actuator)
    data.qpos[1] = height
    data.qpos[model.joint(PROSTHESIS_PREFIX + "ankle").qposadr[0]] = ankle
    data.act[:4] = data.qpos[:4]  # the servos hold the posture
    data.qvel[model.joint(PROSTHESIS_PREFIX + "ankle").dofadr[0]] = rate
    actuator.set_command(data, 3e5)
    q, v, before = data.qpos.copy(), data.qvel.copy(), actuator.get_state(data)
    with callbacks.device_callbacks():
        mujoco.mj_step(model, data)
        after = actuator.compute_state_after_step(model, data, before)
        row = gauges.measure(data, q, v, after, (after.length - before.length) / model.opt.timestep)
    return model, data, dict(zip((heading.split(" ")[0] for heading in MEASURED_COLUMNS), row, strict=True))


@pytest.mark.parametrize("angle", [0.47, -0.47])
def test_stop_moment_is_part_of_the_net_moment(angle: float) -> None:
    # In the air the stop is the only constraint of the ankle; the return spring alone would stop a slower motion.
    rate = 300.0 * np.sign(angle)
    model, data, sample = read(2.0, angle, rate)
    dof = model.joint(PROSTHESIS_PREFIX + "ankle").dofadr[0]
    assert sample["grf_vertical"] == 0.0
    assert np.isnan(sample["cop_x"])
    assert sample["stop_moment"] == pytest.approx(data.qfrc_constraint[dof], rel=1e-9)
    assert sample["stop_moment"] * angle < -1.0
    parts = sample["actuator_moment"] + sample["passive_moment"] + sample["stop_moment"]
    assert sample["ankle_moment"] == pytest.approx(parts, rel=1e-12)
    assert sample["ankle_power"] == pytest.approx(sample["ankle_moment"] * rate, rel=1e-12)


def test_ground_reaction_is_the_sum_of_the_contacts() -> None:
    _, data, sample = read(0.86 + 0.064, 0.06, 0.7)  # toe down: the forefoot spheres carry unequal loads
    model = build_gait_model(DEVICE, mass=75, stature=1.75, dt=5e-4)
    total, moment, wrench = np.zeros(3), 0.0, np.zeros(6)
    loads, depths = [], []
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, wrench)
        force = data.contact.frame[i].reshape(3, 3).T @ wrench[:3]
        total += force
        moment += np.cross(data.contact.pos[i], force)[1]
        loads.append(wrench[0])
        depths.append(-data.contact.dist[i])
    assert len(loads) >= 2
    assert sample["grf_vertical"] == pytest.approx(total[2], rel=1e-9)
    assert sample["grf_forward"] == pytest.approx(total[0], rel=1e-9, abs=1e-9)
    assert abs(total[0] * data.contact.pos[:, 2].min()) > 1e-3  # shear below the floor has a moment
    # As on a force plate: the moment about the floor's origin is that of the vertical load at the centre of pressure.
    assert sample["cop_x"] == pytest.approx(-moment / total[2], rel=1e-9)
    assert sample["sole_height"] == pytest.approx(-max(depths), rel=1e-9)
    assert total[2] > 1.0


def test_reference_channels_scale_with_the_subject() -> None:
    recording = simulate_gait(DEVICE, pressure.create_off_controller(), GaitOptions(strides=1, mass=90, speed=1.0))
    human, phase = reference.load_default_reference(), recording["gait_phase"] / 100
    moment = human("ankle_plantarflexor_moment_nm_per_kg", phase)
    assert recording["reference_ankle_moment"] == pytest.approx(90 * moment)
    assert recording["reference_grf_vertical"] == pytest.approx(90 * human("grf_vertical_n_per_kg", phase))
    deviation = human.compute_standard_deviation("ankle_moment_sd_nm_per_kg", phase)
    assert recording["reference_ankle_moment_sd"] == pytest.approx(90 * deviation)
    assert recording["reference_ankle_angle"] == pytest.approx(human("ankle_dorsiflexion_deg", phase))
    # equal moment and angle in a longer stride
    slower = reference.DEFAULT_STRIDE_TIME / recording.provenance["options"]["stride_time_s"]
    assert slower < 0.9
    power = human("ankle_power_w_per_kg", phase)
    assert recording["reference_ankle_power"] == pytest.approx(90 * slower * power)
