"""The bench without MuJoCo: the device's law alone under a prescribed length; a perfect crosshead and load cell."""

from collections.abc import Callable

from numpy.typing import ArrayLike

from klute_sim.bench.channels import create_recording
from klute_sim.bench.validation import validate_inputs
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceState
from klute_sim.device.recorded_rollout import record_rollout
from klute_sim.recording.recording import Recording


def simulate_device_only(
    device: Device,
    length: ArrayLike,
    command: ArrayLike,
    dt: float,
    backend: str = "auto",
    *,
    initial_state: DeviceState | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Recording:
    """As :func:`klute_sim.bench.tester.pull`, with a length that is reached exactly."""
    length, command = validate_inputs(device, length, command, dt)
    found = record_rollout(device.parameters, length, command, dt, initial_state=initial_state, backend=backend)
    progress(1.0)
    return create_recording(
        device,
        dt=dt,
        length=length,
        length_command=length,
        command=command,
        tension=found.tension,
        load_cell=found.tension,
        pressure=found.pressure,
        muscle_length=found.length,
        muscle_rate=found.velocity,
        ledger=found.energy_balance,
        options={"mujoco": False},
    )
