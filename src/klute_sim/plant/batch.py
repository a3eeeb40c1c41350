"""Many simulations of one model on all cores, each with a device of its own if wanted.

A thin layer over :class:`mujoco.batch.Batch`, whose results do not depend on the number of threads. MuJoCo's batch
takes C functions only, so it needs the compiled law.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike

from klute_sim.device.step import Parameters, remembers
from klute_sim.device.vector import SIZE, pack
from klute_sim.errors import InputError, SimulationError
from klute_sim.plant import router
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.coupling import STATES


def simulations(model: mujoco.MjModel, count: int, threads: int = 0) -> Batch:
    """``count`` simulations of ``model`` (made with ``equip``) on ``threads`` threads (0: all cores).

    Step them with :func:`step`. Raises InputError where there is no compiled law, or for numbers that cannot be.
    """
    if count < 1 or threads < 0:
        raise InputError(f"{count} simulations on {threads} threads; allowed: 1 or more, on 0 (all cores) or more")
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
    if any(remembers(each) for each in parameters) and batch.model.actuator_actnum[place] == STATES:
        raise InputError("an effect that remembers needs a model made with equip(..., memory=True)")
    batch.expand("actuator_user")[:, place, :SIZE] = np.array([pack(each) for each in parameters])


def step(batch: Batch, ids: ArrayLike | None = None, count: int = 1) -> None:
    """Take ``count`` steps of the simulations ``ids`` (None: of all).

    Raises SimulationError if a device has no finite state: its simulation's pressure is NaN then, and all other
    simulations have been stepped. Raises InputError if somebody else's callbacks are in MuJoCo's slots.
    """
    with router.installed("compiled") as law:
        if law != "compiled":
            raise InputError("a batch cannot be stepped while Python callbacks are installed in MuJoCo")
        batch.step(ids=ids, nstep=count)
        reports = router.take_reports()
    if reports:
        act = batch.bind("act")
        failed = np.flatnonzero(np.isnan(act[:, _pressures(batch.model)]).any(axis=1))
        shown = ", ".join(str(each) for each in failed[:5]) + (", ..." if len(failed) > 5 else "")
        raise SimulationError(f"{len(failed)} of {batch.nsim} simulations have failed ({shown}): {reports[0]}")


def _pressures(model: mujoco.MjModel) -> list[int]:
    """Where the pressures of the devices are in ``act``."""
    return [int(model.actuator_actadr[i]) for i in range(model.nactuator) if router.row_of(model, i)]
