"""Bench in MuJoCo: a crosshead on a servo, a load cell, and the device between them, attached as in the ankle."""

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from klute_sim.bench.build import build_tester, compute_servo_commands, place_crosshead
from klute_sim.bench.channels import create_recording
from klute_sim.bench.validation import validate_inputs
from klute_sim.device.delay import DelayLine
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceState, compute_tension, get_dead_time
from klute_sim.device.energy.ledger import EnergyRecorder
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.plant import callbacks
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.recording.recording import Recording
from klute_sim.types import ProgressCallback

PROGRESS_INTERVAL_STEPS = 500
"""Number of time steps between progress reports."""


def simulate_tester(
    device: Device,
    length: ArrayLike,
    command: ArrayLike,
    dt: float,
    backend: str = "auto",
    *,
    initial_state: DeviceState | None = None,
    progress: ProgressCallback = lambda fraction, stage: None,
) -> Recording:
    """Record ``device`` while a servo follows the unit ``length`` [m] and a regulator follows ``command`` [Pa].

    ``length`` and ``command`` have one sample per time step ``dt`` [s]. A device with valve openings as commands
    takes ``command`` in [-1, 1].

    The servo feeds velocity and acceleration forward and deflects under the load: channel ``length`` is the length
    reached, ``length_command`` the commanded one. ``force`` is the tension of the unit, ``load_cell`` the reading of
    the load cell. The device starts in ``initial_state``; by default, the tendon is just taut at the first length and
    command. ``backend`` is ``"auto"``, ``"compiled"`` or ``"python"``.

    Raises InputError when the series differ in length, are not finite, need a unit shorter than the lock length of the
    muscle or, with a rigid tie, longer than its resting length.
    """
    length, command = validate_inputs(device, length, command, dt)
    parameters = device.parameters
    if initial_state is None:
        initial_state = compute_taut_state(parameters, float(length[0]), float(command[0]))

    model = build_tester(device, dt)
    data = mujoco.MjData(model)
    actuator = DeviceActuator(model, "muscle_tendon")
    actuator.set_state(data, initial_state)
    speed, load = (length[1] - length[0]) / dt, compute_tension(parameters, initial_state, float(length[0]), 0.0)
    place_crosshead(data, float(length[0]), float(speed), load)
    servo_commands = compute_servo_commands(length, dt)
    delay_line = DelayLine(command.tolist(), get_dead_time(parameters), dt)
    servo_index = int(model.actuator_ctrladr[model.actuator("servo").id])
    load_cell_index = int(model.sensor("load_cell").adr[0])

    samples = np.empty((len(length), 6))
    energy = EnergyRecorder(parameters, len(length))
    with callbacks.device_callbacks(backend) as used_backend:
        for k in range(len(length)):
            data.ctrl[servo_index] = servo_commands[k]
            actuator.set_command(data, delay_line.sample(k))
            before = actuator.get_state(data)
            callbacks.step_model(model, data)
            after = actuator.compute_state_after_step(model, data, before)
            rate = (after.length - before.length) / dt
            energy.record_sample(k, after, actuator.get_unit_length(data), rate)
            samples[k] = (
                actuator.get_unit_length(data),
                actuator.get_tension(data),
                -data.sensordata[load_cell_index],  # the sensor measures the force of the unit on the cell, along x
                after.pressure,
                after.length,
                rate,
            )
            if k % PROGRESS_INTERVAL_STEPS == 0:
                progress(k / len(length), "testing")
    progress(1.0, "testing")
    reached, tension, load_cell, pressure, muscle_length, muscle_rate = (np.ascontiguousarray(x) for x in samples.T)
    return create_recording(
        device,
        dt=dt,
        length=reached,
        length_command=length,
        command=command,
        tension=tension,
        load_cell=load_cell,
        pressure=pressure,
        muscle_length=muscle_length,
        muscle_rate=muscle_rate,
        ledger=energy.to_energy_balance(dt),
        options={"backend": used_backend, "mujoco": True},
    )
