"""The bench without MuJoCo: the device's law alone under a prescribed length; a perfect crosshead and load cell."""

from collections.abc import Callable

from numpy.typing import ArrayLike

from klute_sim.device.account import account
from klute_sim.device.files import Device
from klute_sim.device.step import State
from klute_sim.recording.recording import Recording
from klute_sim.rigs.bench.asked import checked
from klute_sim.rigs.bench.channels import recorded


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
    """As :func:`klute_sim.rigs.bench.tester.pull`, with a length that is reached exactly."""
    length, command = checked(device, length, command, step)
    found = account(device.parameters, length, command, step, start=start, law=law)
    told(1.0)
    return recorded(
        device,
        step=step,
        length=length,
        length_command=length,
        command=command,
        tension=found.tension,
        load_cell=found.tension,
        pressure=found.pressure,
        muscle_length=found.length,
        muscle_rate=found.rate,
        ledger=found.ledger,
        options={"mujoco": False},
    )
