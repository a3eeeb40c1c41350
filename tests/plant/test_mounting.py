"""Devices on actuators: several devices, beside other actuators, and only on compatible actuators."""

import re
from typing import Any

import mujoco
import numpy as np
import pytest

from klute_sim.device import dynamics as unit
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.errors import InputError, SimulationError
from klute_sim.plant import batch, callbacks, coupling, models
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.coupling import DAMPING_INDEX

STEP = 5e-4
MADE = 'dyntype="user" actdim="2" gaintype="fixed" gainprm="0" biastype="user"'
CROWD = f"""
<mujoco><size nuser_actuator="80"/><option timestep="{STEP}" integrator="implicitfast" gravity="0 0 0"/>
<worldbody>
  <site name="left"/>
  <body><joint name="b" type="ball"/><geom size=".1" contype="0" conaffinity="0"/></body>
  <body><joint name="x" type="slide"/><geom size=".1" mass="100" contype="0" conaffinity="0"/><site name="xe"/></body>
  <body><joint name="y" type="slide"/><geom size=".1" mass="100" contype="0" conaffinity="0"/><site name="ye"/></body>
</worldbody>
<tendon>
  <spatial name="tx"><site site="left"/><site site="xe"/></spatial>
  <spatial name="ty"><site site="left"/><site site="ye"/></spatial>
</tendon>
<actuator>
  <orientation name="o" joint="b" kp="1"/>
  <muscle name="m" joint="b" lengthrange="-1 1"/>
  <general name="first" tendon="tx" {MADE}/>
  <pid name="p" joint="x"/>
  <general name="second" tendon="ty" {MADE}/>
</actuator></mujoco>"""


@pytest.mark.parametrize("backend", ["compiled", "python"])
def test_two_devices_among_other_actuators_are_independent(backend: str) -> None:
    devices = {"first": load_device("klute-3-4-pair").parameters, "second": load_device("klute-1-1-4-pair").parameters}
    model = models.attach_devices(mujoco.MjSpec.from_string(CROWD), devices)
    assert model.nuser_actuator == coupling.USER_ROW_SIZE
    for address in (model.actuator_ctrladr, model.actuator_outadr, model.actuator_actadr):
        assert address.tolist() != list(range(5))
    data = mujoco.MjData(model)
    placed = {name: DeviceActuator(model, name) for name in devices}
    states = {name: unit.DeviceState(0.0, device.muscle.resting_length) for name, device in devices.items()}
    data.ctrl[:] = 0.3
    with callbacks.device_callbacks(backend):
        for k in range(400):
            lengths = {
                name: float(
                    device.tendon.slack_length + device.muscle.resting_length * (0.97 + 0.04 * np.sin(0.01 * k))
                )
                for name, device in devices.items()
            }
            commands = {"first": 2e5, "second": 4e5 if k > 200 else 1e5}
            for name, joint in (("first", "x"), ("second", "y")):
                data.joint(joint).qpos[0], data.joint(joint).qvel[0] = lengths[name], 0.0
                placed[name].set_command(data, commands[name])
            callbacks.step_model(model, data)
            for name, device in devices.items():
                states[name] = unit.advance_state(device, states[name], lengths[name], commands[name], STEP)
                expected = unit.compute_tension(device, states[name], lengths[name], 0.0)
                assert placed[name].get_tension(data) == pytest.approx(expected, rel=1e-9, abs=1e-7)
                assert placed[name].get_state(data)[:2] == pytest.approx(states[name][:2], rel=1e-9)
    assert placed["second"].get_tension(data) > 100.0


def with_attributes(more: str, tendon: str = "") -> mujoco.MjSpec:
    xml = (models.get_models_folder() / "bench.xml").read_text("utf-8")
    return mujoco.MjSpec.from_string(
        xml.replace('biastype="user"/>', f'biastype="user" {more}/>').replace(
            'width="0.004"', f'width="0.004" {tendon}'
        )
    )


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (lambda: with_attributes('gear="2"'), "gear must be 1"),
        (lambda: with_attributes('ctrlrange="0 5"'), "must not have a ctrlrange"),
        (lambda: with_attributes('forcerange="-100 0"'), "must not have a forcerange"),
        (lambda: with_attributes('actrange="0 5"'), "must not have a actrange"),
        (lambda: with_attributes('delay="0.01" nsample="20"'), "must not have a delay"),
        (lambda: with_attributes("", 'actuatorfrcrange="-100 0"'), "tendon must not have an actuatorfrcrange"),
    ],
)
def test_actuator_with_clipping_or_delay_is_refused(spec: Any, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        models.attach_devices(spec(), {"muscle_tendon": load_device("klute-3-4-pair").parameters})


def tied(coefficient: float) -> DeviceParameters:
    pair = load_device("klute-3-4-pair").parameters
    damper = pair.damper._replace(concentric_coefficient=coefficient, eccentric_coefficient=0.5 * coefficient)
    return pair._replace(tendon=pair.tendon._replace(is_rigid=True), damper=damper)


def test_reattached_device_keeps_the_damping_of_the_tendon() -> None:
    spec = with_attributes("", 'damping="1 2"')
    first = models.attach_devices(spec, {"muscle_tendon": tied(3e3)})
    again = models.attach_devices(spec, {"muscle_tendon": tied(5e3)})
    last = models.attach_devices(spec, {"muscle_tendon": load_device("klute-3-4-pair").parameters})
    assert [m.actuator_user[0, DAMPING_INDEX] for m in (first, again, last)] == [3e3, 5e3, 0.0]
    assert [m.tendon_dampingpoly[0, 0] for m in (first, again, last)] == [3002.0, 5002.0, 2.0]
    assert last.tendon_damping[0] == 1.0
    reattached = models.attach_devices(spec, {})  # the actuator has a device already
    assert DeviceActuator(reattached, "muscle_tendon").parameters == load_device("klute-3-4-pair").parameters


def test_batch_refuses_a_rigid_device() -> None:
    model = models.attach_devices(models.load_spec("bench"), {"muscle_tendon": tied(3e3)})
    with pytest.raises(InputError, match="with a rigid tendon cannot be in a batch"):
        batch.set_parameters(batch.create_batch(model, 1), "muscle_tendon", [load_device("klute-3-4-pair").parameters])


def test_batch_refuses_invalid_counts() -> None:
    model = models.attach_devices(
        models.load_spec("bench"), {"muscle_tendon": load_device("klute-3-4-pair").parameters}
    )
    for count, threads in ((0, 1), (-1, 1), (1, -1)):
        with pytest.raises(InputError, match=f"{count} simulations on {threads} threads"):
            batch.create_batch(model, count, threads)


def test_batch_reports_failed_simulations() -> None:
    model = models.attach_devices(
        models.load_spec("bench"), {"muscle_tendon": load_device("klute-3-4-pair").parameters}
    )
    simulations = batch.create_batch(model, 4, n_threads=2)
    simulations.bind("qpos")[:] = 0.34
    simulations.bind("ctrl")[2] = np.nan
    with pytest.raises(SimulationError, match=r"1 of 4 simulations have failed \(2\): actuator 'muscle_tendon' has no"):
        batch.step_batch(simulations, n_steps=3)
    simulations.bind("ctrl")[2] = 1.0
    simulations.bind("act")[2] = 0.0
    batch.step_batch(simulations)  # a fault is reported once
    assert DeviceActuator(model, "muscle_tendon").parameters.muscle.resting_length > 0.0
    assert np.isfinite(simulations.bind("act")).all()
