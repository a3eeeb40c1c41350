"""Many simulations of one model on all cores, each with a device of its own if wanted.

A thin layer over :class:`mujoco.batch.Batch`, whose results do not depend on the number of threads. MuJoCo's batch
takes C functions only, so it needs the compiled law.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike

from klute_sim.device.backend.packing import ROW_SIZE, pack_parameters
from klute_sim.device.dynamics import DeviceParameters, has_internal_state
from klute_sim.errors import InputError, SimulationError
from klute_sim.plant import callbacks
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.coupling import N_BASE_STATES


def create_batch(model: mujoco.MjModel, n_simulations: int, n_threads: int = 0) -> Batch:
    """``count`` simulations of ``model`` (made with ``equip``) on ``threads`` threads (0: all cores).

    Step them with :func:`step`. Raises InputError where there is no compiled law, or for numbers that cannot be.
    """
    if n_simulations < 1 or n_threads < 0:
        raise InputError(
            f"{n_simulations} simulations on {n_threads} threads; allowed: 1 or more, on 0 (all cores) or more"
        )
    if callbacks.choose_backend("auto") != "compiled":
        raise InputError("a batch needs the compiled law; step the simulations one by one instead")
    return Batch(model, n_simulations, n_threads)


def set_parameters(batch: Batch, actuator: str, parameters: Sequence[DeviceParameters]) -> None:
    """Give every simulation of ``batch`` its own device on ``actuator``.

    Only the device differs: where it is mounted is the model's. Raises InputError for another number of devices, for a
    rigid device, whose damping is shown in the model, or if the actuator carries none.
    """
    place = DeviceActuator(batch.model, actuator).id
    if len(parameters) != batch.nsim:
        raise InputError(f"{len(parameters)} devices for {batch.nsim} simulations")
    if any(each.tendon.is_rigid for each in (*parameters, DeviceActuator(batch.model, actuator).parameters)):
        raise InputError("a device without a tendon needs a model of its own")
    if any(has_internal_state(each) for each in parameters) and batch.model.actuator_actnum[place] == N_BASE_STATES:
        raise InputError("an effect that remembers needs a model made with equip(..., memory=True)")
    batch.expand("actuator_user")[:, place, :ROW_SIZE] = np.array([pack_parameters(each) for each in parameters])


def step_batch(batch: Batch, ids: ArrayLike | None = None, n_steps: int = 1) -> None:
    """Take ``count`` steps of the simulations ``ids`` (None: of all).

    Raises SimulationError if a device has no finite state: its simulation's pressure is NaN then, and all other
    simulations have been stepped. Raises InputError if somebody else's callbacks are in MuJoCo's slots.
    """
    with callbacks.device_callbacks("compiled") as law:
        if law != "compiled":
            raise InputError("a batch cannot be stepped while Python callbacks are installed in MuJoCo")
        batch.step(ids=ids, nstep=n_steps)
        reports = callbacks.pop_fault_messages()
    if reports:
        act = batch.bind("act")
        failed = np.flatnonzero(np.isnan(act[:, _pressure_addresses(batch.model)]).any(axis=1))
        shown = ", ".join(str(each) for each in failed[:5]) + (", ..." if len(failed) > 5 else "")
        raise SimulationError(f"{len(failed)} of {batch.nsim} simulations have failed ({shown}): {reports[0]}")


def _pressure_addresses(model: mujoco.MjModel) -> list[int]:
    """Where the pressures of the devices are in ``act``."""
    return [int(model.actuator_actadr[i]) for i in range(model.nactuator) if callbacks.get_parameter_row(model, i)]
