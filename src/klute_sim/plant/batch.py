"""Many simulations of one model on all cores, each with a device of its own if wanted.

A thin layer over :class:`mujoco.batch.Batch`, whose results do not depend on the number of threads. MuJoCo's batch
takes C functions only, so it needs the compiled law.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import mujoco
import numpy as np
from mujoco.batch import Batch

from klute_sim.device.step import Parameters
from klute_sim.device.vector import SIZE, pack
from klute_sim.errors import InputError
from klute_sim.plant import router
from klute_sim.plant.actuator import DeviceActuator


def simulations(model: mujoco.MjModel, count: int, threads: int = 0) -> Batch:
    """``count`` simulations of ``model`` (made with ``equip``) on ``threads`` threads (0: all cores).

    Step them inside :func:`stepping`. Raises InputError where there is no compiled law.
    """
    if router.choose("auto") != "compiled":
        raise InputError("a batch needs the compiled law; step the simulations one by one instead")
    return Batch(model, count, threads)


def give(batch: Batch, actuator: str, parameters: Sequence[Parameters]) -> None:
    """Give every simulation of ``batch`` its own device on ``actuator``.

    Only the device differs: where it is mounted is the model's. Raises InputError for another number of devices, for a
    rigid device, whose damping is shown in the model, or if the actuator carries none.
    """
    place = DeviceActuator(batch.model, actuator).id
    if len(parameters) != batch.nsim:
        raise InputError(f"{len(parameters)} devices for {batch.nsim} simulations")
    if any(each.tendon.rigid for each in (*parameters, DeviceActuator(batch.model, actuator).parameters)):
        raise InputError("a device without a tendon needs a model of its own")
    batch.expand("actuator_user")[:, place, :SIZE] = np.array([pack(each) for each in parameters])


@contextmanager
def stepping() -> Iterator[None]:
    """While inside, batches may be stepped.

    Raises SimulationError on the way out if a device had no finite state; its simulation's states are NaN from then
    on. Raises InputError if somebody else's callbacks are in MuJoCo's slots.
    """
    with router.installed("compiled") as law:
        if law != "compiled":
            raise InputError("a batch cannot be stepped while Python callbacks are installed in MuJoCo")
        yield
