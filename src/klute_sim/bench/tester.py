"""The bench in MuJoCo: a crosshead on a servo, a load cell, and the device between them as in the ankle."""

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from klute_sim.bench.build import build_tester, compute_servo_commands, place_crosshead
from klute_sim.bench.channels import create_recording
from klute_sim.bench.validation import validate_inputs
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceState, compute_taut_state, compute_tension, get_dead_time
from klute_sim.device.energy.ledger import EnergyRecorder
from klute_sim.device.rollout import interpolate_samples
from klute_sim.plant import callbacks
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.recording.recording import Recording

PROGRESS_INTERVAL_STEPS = 500
"""Steps from one word about progress to the next."""


def simulate_tester(
    device: Device,
    length: ArrayLike,
    command: ArrayLike,
    dt: float,
    backend: str = "auto",
    *,
    initial_state: DeviceState | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Recording:
    """Record ``device`` while a servo follows unit ``length`` [m] and a regulator ``command`` [Pa].

    Both have one sample per ``step`` [s].

    The servo feeds velocity and acceleration forward and gives way a little to the load: the channel ``length`` is the
    length reached, ``length_command`` the one that was asked for. ``force`` is the unit's tension, ``load_cell`` what
    the load cell reads. The device begins at ``start``, by default where the tendon is just taut at the first length
    and command.
    ``law`` is one of :data:`klute_sim.device.backend.select.LAWS`; ``told`` hears the finished fraction.

    Raises InputError when the two series differ in length, are not finite, or ask for a unit that is shorter than the
    muscle can get or, with a rigid tie, longer than it rests.
    """
    length, command = validate_inputs(device, length, command, dt)
    parameters = device.parameters
    begin = (
        compute_taut_state(parameters, float(length[0]), float(command[0])) if initial_state is None else initial_state
    )

    model = build_tester(device, dt)
    data = mujoco.MjData(model)
    actuator = DeviceActuator(model, "muscle_tendon")
    actuator.set_state(data, begin)
    speed, load = (length[1] - length[0]) / dt, compute_tension(parameters, begin, float(length[0]), 0.0)
    place_crosshead(data, float(length[0]), float(speed), load)
    target = compute_servo_commands(length, dt)
    late, commands = get_dead_time(parameters) / dt, command.tolist()
    servo = int(model.actuator_ctrladr[model.actuator("servo").id])
    cell = int(model.sensor("load_cell").adr[0])

    found = np.empty((len(length), 6))
    book = EnergyRecorder(parameters, len(length))
    with callbacks.device_callbacks(backend) as in_force:
        for k in range(len(length)):
            data.ctrl[servo] = target[k]
            actuator.set_command(data, interpolate_samples(commands, k - late))
            before = actuator.get_state(data)
            callbacks.step_model(model, data)
            after = actuator.state_after_step(model, data, before)
            rate = (after.length - before.length) / dt
            book.record_sample(k, after, actuator.unit_length(data), rate)
            found[k] = (
                actuator.unit_length(data),
                actuator.tension(data),
                -data.sensordata[cell],  # the sensor tells what the unit does to the cell, along x
                after.pressure,
                after.length,
                rate,
            )
            if k % PROGRESS_INTERVAL_STEPS == 0:
                progress(k / len(length))
    progress(1.0)
    reached, pulled, weighed, pressure, muscle, muscle_rate = (np.ascontiguousarray(x) for x in found.T)
    return create_recording(
        device,
        dt=dt,
        length=reached,
        length_command=length,
        command=command,
        tension=pulled,
        load_cell=weighed,
        pressure=pressure,
        muscle_length=muscle,
        muscle_rate=muscle_rate,
        ledger=book.to_energy_balance(dt),
        options={"law": in_force, "mujoco": True},
    )
