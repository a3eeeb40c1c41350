"""The bench in MuJoCo: a crosshead on a servo, a load cell, and the device between them as in the ankle."""

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from klute_sim.device.files import Device
from klute_sim.device.ledger import Book
from klute_sim.device.rollout import earlier
from klute_sim.device.step import State, dead_time, taut, tension
from klute_sim.plant import router
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.recording.recording import Recording
from klute_sim.rigs.bench.asked import checked
from klute_sim.rigs.bench.build import build, servo_commands, stand
from klute_sim.rigs.bench.channels import recorded

OFTEN = 500
"""Steps from one word about progress to the next."""


def pull(
    device: Device,
    length: ArrayLike,
    command: ArrayLike,
    step: float,
    law: str = "auto",
    *,
    start: State | None = None,
    told: Callable[[float], None] = lambda fraction: None,
) -> Recording:
    """Record ``device`` while a servo follows unit ``length`` [m] and a regulator ``command`` [Pa].

    Both have one sample per ``step`` [s].

    The servo feeds velocity and acceleration forward and gives way a little to the load: the channel ``length`` is the
    length reached, ``length_command`` the one that was asked for. ``force`` is the unit's tension, ``load_cell`` what
    the load cell reads. The device begins at ``start``, by default where the tendon is just taut at the first length
    and command.
    ``law`` is one of :data:`klute_sim.device.installation.LAWS`; ``told`` hears the finished fraction.

    Raises InputError when the two series differ in length, are not finite, or ask for a unit that is shorter than the
    muscle can get or, with a rigid tie, longer than it rests.
    """
    length, command = checked(device, length, command, step)
    parameters = device.parameters
    begin = taut(parameters, float(length[0]), float(command[0])) if start is None else start

    model = build(device, step)
    data = mujoco.MjData(model)
    actuator = DeviceActuator(model, "muscle_tendon")
    actuator.set_state(data, begin)
    speed, load = (length[1] - length[0]) / step, tension(parameters, begin, float(length[0]), 0.0)
    stand(data, float(length[0]), float(speed), load)
    target = servo_commands(length, step)
    late, commands = dead_time(parameters) / step, command.tolist()
    servo = int(model.actuator_ctrladr[model.actuator("servo").id])
    cell = int(model.sensor("load_cell").adr[0])

    found = np.empty((len(length), 6))
    book = Book(parameters, len(length))
    with router.installed(law) as in_force:
        for k in range(len(length)):
            data.ctrl[servo] = target[k]
            actuator.command(data, earlier(commands, k - late))
            before = actuator.state(data)
            router.step(model, data)
            after = actuator.reached(model, data, before)
            rate = (after.length - before.length) / step
            book.note(k, after, actuator.unit_length(data), rate)
            found[k] = (
                actuator.unit_length(data),
                actuator.tension(data),
                -data.sensordata[cell],  # the sensor tells what the unit does to the cell, along x
                after.pressure,
                after.length,
                rate,
            )
            if k % OFTEN == 0:
                told(k / len(length))
    told(1.0)
    reached, pulled, weighed, pressure, muscle, muscle_rate = (np.ascontiguousarray(x) for x in found.T)
    return recorded(
        device,
        step=step,
        length=reached,
        length_command=length,
        command=command,
        tension=pulled,
        load_cell=weighed,
        pressure=pressure,
        muscle_length=muscle,
        muscle_rate=muscle_rate,
        ledger=book.ledger(step),
        options={"law": in_force, "mujoco": True},
    )
