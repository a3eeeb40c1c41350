"""Devices on actuators: any number of them, beside actuators of every shape, and only where they can work."""

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


@pytest.mark.parametrize("law", ["compiled", "python"])
def test_two_devices_among_unlike_actuators_each_do_their_own(law: str) -> None:
    devices = {"first": load_device("klute-3-4-pair").parameters, "second": load_device("klute-1-1-4-pair").parameters}
    model = models.attach_devices(mujoco.MjSpec.from_string(CROWD), devices)
    assert model.nuser_actuator == coupling.USER_ROW_SIZE
    for address in (model.actuator_ctrladr, model.actuator_outadr, model.actuator_actadr):
        assert address.tolist() != list(range(5))
    data = mujoco.MjData(model)
    placed = {name: DeviceActuator(model, name) for name in devices}
    states = {name: unit.compute_rest_state(each) for name, each in devices.items()}
    data.ctrl[:] = 0.3
    with callbacks.device_callbacks(law):
        for k in range(400):
            lengths = {
                name: float(each.tendon.slack_length + each.muscle.resting_length * (0.97 + 0.04 * np.sin(0.01 * k)))
                for name, each in devices.items()
            }
            commands = {"first": 2e5, "second": 4e5 if k > 200 else 1e5}
            for name, joint in (("first", "x"), ("second", "y")):
                data.joint(joint).qpos[0], data.joint(joint).qvel[0] = lengths[name], 0.0
                placed[name].set_command(data, commands[name])
            callbacks.step_model(model, data)
            for name, each in devices.items():
                states[name] = unit.advance_state(each, states[name], lengths[name], commands[name], STEP)
                wanted = unit.compute_tension(each, states[name], lengths[name], 0.0)
                assert placed[name].tension(data) == pytest.approx(wanted, rel=1e-9, abs=1e-7)
                assert placed[name].get_state(data)[:2] == pytest.approx(states[name][:2], rel=1e-9)
    assert placed["second"].tension(data) > 100.0


def with_attributes(more: str, tendon: str = "") -> mujoco.MjSpec:
    xml = (models.get_models_folder() / "bench.xml").read_text("utf-8")
    return mujoco.MjSpec.from_string(
        xml.replace('biastype="user"/>', f'biastype="user" {more}/>').replace(
            'width="0.004"', f'width="0.004" {tendon}'
        )
    )


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        (lambda: with_attributes('gear="2"'), "gear must be 1"),
        (lambda: with_attributes('ctrlrange="0 5"'), "must not have a ctrlrange"),
        (lambda: with_attributes('forcerange="-100 0"'), "must not have a forcerange"),
        (lambda: with_attributes('actrange="0 5"'), "must not have a actrange"),
        (lambda: with_attributes('delay="0.01" nsample="20"'), "must not have a delay"),
        (lambda: with_attributes("", 'actuatorfrcrange="-100 0"'), "tendon must not have an actuatorfrcrange"),
    ],
)
def test_what_would_clip_or_delay_behind_the_devices_back_is_refused(spec: Any, words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        models.attach_devices(spec(), {"muscle_tendon": load_device("klute-3-4-pair").parameters})


def tied(coefficient: float) -> DeviceParameters:
    pair = load_device("klute-3-4-pair").parameters
    damper = pair.damper._replace(concentric_coefficient=coefficient, eccentric_coefficient=0.5 * coefficient)
    return pair._replace(tendon=pair.tendon._replace(is_rigid=True), damper=damper)


def test_a_spec_can_be_equipped_again_and_keeps_its_own_damping() -> None:
    spec = with_attributes("", 'damping="1 2"')
    first = models.attach_devices(spec, {"muscle_tendon": tied(3e3)})
    again = models.attach_devices(spec, {"muscle_tendon": tied(5e3)})
    last = models.attach_devices(spec, {"muscle_tendon": load_device("klute-3-4-pair").parameters})
    assert [m.actuator_user[0, DAMPING_INDEX] for m in (first, again, last)] == [3e3, 5e3, 0.0]
    assert [m.tendon_dampingpoly[0, 0] for m in (first, again, last)] == [3002.0, 5002.0, 2.0]
    assert last.tendon_damping[0] == 1.0
    kept = models.attach_devices(spec, {})  # it has a device already
    assert DeviceActuator(kept, "muscle_tendon").parameters == load_device("klute-3-4-pair").parameters


def test_a_batch_does_not_swap_a_device_whose_damping_is_in_the_model() -> None:
    model = models.attach_devices(models.load_spec("bench"), {"muscle_tendon": tied(3e3)})
    with pytest.raises(InputError, match="without a tendon needs a model of its own"):
        batch.set_parameters(batch.create_batch(model, 1), "muscle_tendon", [load_device("klute-3-4-pair").parameters])


def test_a_batch_of_no_simulations_or_fewer_than_no_threads_is_refused() -> None:
    model = models.attach_devices(
        models.load_spec("bench"), {"muscle_tendon": load_device("klute-3-4-pair").parameters}
    )
    for count, threads in ((0, 1), (-1, 1), (1, -1)):
        with pytest.raises(InputError, match=f"{count} simulations on {threads} threads"):
            batch.create_batch(model, count, threads)


def test_a_batch_says_which_of_its_simulations_failed() -> None:
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
    batch.step_batch(simulations)  # told once
    assert DeviceActuator(model, "muscle_tendon").parameters.muscle.resting_length > 0.0
    assert np.isfinite(simulations.bind("act")).all()
