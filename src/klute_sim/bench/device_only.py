"""Bench without MuJoCo: the device alone under a prescribed length, with an ideal crosshead and load cell."""

from numpy.typing import ArrayLike

from klute_sim.bench.channels import create_recording
from klute_sim.bench.validation import validate_inputs
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceState
from klute_sim.device.recorded_rollout import record_rollout
from klute_sim.recording.recording import Recording
from klute_sim.types import ProgressCallback


def simulate_device_only(
    device: Device,
    length: ArrayLike,
    command: ArrayLike,
    dt: float,
    backend: str = "auto",
    *,
    initial_state: DeviceState | None = None,
    progress: ProgressCallback = lambda fraction, stage: None,
) -> Recording:
    """Record ``device`` at exactly the unit ``length`` [m]; else as :func:`klute_sim.bench.tester.simulate_tester`."""
    length, command = validate_inputs(device, length, command, dt)
    rollout = record_rollout(device.parameters, length, command, dt, initial_state=initial_state, backend=backend)
    progress(1.0, "testing")
    return create_recording(
        device,
        dt=dt,
        length=length,
        length_command=length,
        command=command,
        tension=rollout.tension,
        load_cell=rollout.tension,
        pressure=rollout.pressure,
        muscle_length=rollout.length,
        muscle_rate=rollout.velocity,
        ledger=rollout.energy_balance,
        options={"mujoco": False},
    )
